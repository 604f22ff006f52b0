"""An exported policy acts as the one it came from, without torch and MuJoCo, and nothing else passes for one."""

import hashlib
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import aerial_il
from aerial_il.cli.main import main
from aerial_il.core.errors import CheckpointError, InvalidValueError
from aerial_il.evaluation.rollouts import origin_of, weights_of
from aerial_il.policies import load_any_policy
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.workflows.export import Export, export
from tests.experiments.results import result_with
from tests.policies import test_vision
from tests.policies.test_contract import observations, policy
from tests.policies.test_registry import NAMES

pytest.importorskip("onnx", reason="pip install 'aerial-il[export]'")
pytest.importorskip("onnxruntime", reason="pip install 'aerial-il[export]'")
STEPS, WORLDS = 1000, 3
GRAPHS = [name for name in NAMES if getattr(name, "values", [name])[0] != "lerobot_diffusion"]
WITHOUT = """
import json, sys
MISSING = {"torch", "mujoco", "dm_control", "yaml", "numba", "safetensors", "gymnasium", "scipy"}
class Missing:
    def find_spec(self, name, *_):
        if name.split(".")[0] in MISSING:
            raise ModuleNotFoundError(f"{name} was imported", name=name)
sys.meta_path.insert(0, Missing())
import numpy as np
import aerial_il
policy = aerial_il.load_policy(sys.argv[1])
obs = {name: np.array(value) for name, value in json.loads(sys.argv[2]).items()}
print(json.dumps(policy.act(obs).tolist()))
"""


def exported(policy: ChunkPolicy, tmp_path: Path) -> Path:
    policy.save(tmp_path / "policy")
    return export(Export(policy=str(tmp_path / "policy"), out=str(tmp_path / "exported"))).folder


@pytest.mark.parametrize("name", GRAPHS)
def test_every_class_acts_alike_over_a_thousand_steps(name: str, tmp_path: Path) -> None:
    own, rng = policy(name), np.random.default_rng(0)
    again = load_any_policy(exported(own, tmp_path))
    differing, largest = 0, 0.0
    for step in range(STEPS):
        obs = observations(rng, WORLDS)
        if step % 100 == 99:
            ended = rng.random(WORLDS) < 0.5
            own.reset(ended), again.reset(ended)
        apart = np.abs(own.act(obs) - again.act(obs)).max()
        differing, largest = differing + (apart > 1e-5), max(largest, apart)
    # Where it chooses, by a sample or among a few actions, rounding decides once in a long while.
    assert differing <= (STEPS // 100 if name in ("gmm", "categorical") else 0), largest


@pytest.mark.parametrize("name", GRAPHS)
def test_every_class_sees_alike(name: str, tmp_path: Path) -> None:
    own, rng = test_vision.fresh_policy(name), np.random.default_rng(0)
    again = load_any_policy(exported(own, tmp_path))
    for _ in range(20):
        obs = test_vision.look(WORLDS, rng)
        np.testing.assert_allclose(own.act(obs), again.act(obs), rtol=0.0, atol=1e-5)


@pytest.mark.slow
def test_what_no_graph_can_hold_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match="policy=lerobot_diffusion computes in a way"):
        exported(policy("lerobot_diffusion"), tmp_path)


def test_it_flies_without_torch_and_mujoco(tmp_path: Path) -> None:
    own, obs = policy("mlp"), observations(np.random.default_rng(0), WORLDS)
    said = json.dumps({name: value.tolist() for name, value in obs.items()})
    place = str(exported(own, tmp_path))
    flown = subprocess.run([sys.executable, "-c", WITHOUT, place, said], capture_output=True, text=True, check=False)
    assert flown.returncode == 0, flown.stderr
    np.testing.assert_allclose(json.loads(flown.stdout), own.act(obs), rtol=0.0, atol=1e-5)


def test_the_readme_says_what_it_flies(tmp_path: Path) -> None:
    own = policy("mlp")
    text = (exported(own, tmp_path) / "README.md").read_text()
    for field in own.interface.layout.names:
        assert field.replace("_", r"\_") in text
    assert "not evaluated" in text
    assert own.spec.robot.replace("_", r"\_") in text


def test_a_card_states_no_success_of_other_weights(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A run that is trained anew has the evaluation of before beside it."""
    run, stated = tmp_path / "run", result_with(100, 90)
    made = policy("mlp")
    made.save(run)
    for weights, said in ((weights_of(made), "90.0 %"), ("0" * 64, "not evaluated")):
        replace(stated, provenance={"policy_sha256": weights}).save(run / "evaluation")
        out = tmp_path / str(weights)[:4]
        assert main(["export", str(run), f"out={out}"]) == 0
        assert said in (out / "README.md").read_text()
    assert "was flown by other weights" in capsys.readouterr().err
    assert main(["export", str(run), f"out={tmp_path / 'asked'}", f"evaluation={run / 'evaluation'}"]) == 2
    assert "was flown by other weights than" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("file", "change"),
    [
        ("network.onnx", lambda raw: raw[:-1]),
        ("network.onnx", lambda raw: bytes([*raw[:100], raw[100] ^ 1, *raw[101:]])),
        ("exported.json", lambda raw: raw[: len(raw) // 2]),
        ("exported.json", lambda raw: raw.replace(b"exported_policy/1", b"exported_policy/9")),
        ("exported.json", lambda raw: raw.replace(b'"centre"', b'"center"')),
        ("exported.json", lambda raw: raw.replace(b'"obs_clip": ', b'"obs_clip": 1')),
        ("exported.json", lambda raw: b"[]"),
    ],
)
def test_what_was_cut_or_altered_is_refused(file: str, change, tmp_path: Path) -> None:
    place = exported(policy("mlp"), tmp_path)
    (place / file).write_bytes(change((place / file).read_bytes()))
    with pytest.raises(CheckpointError, match="is no policy that was exported"):
        load_any_policy(place)


def test_exporting_again_replaces_what_is_ours_and_nothing_else(tmp_path: Path) -> None:
    place = exported(policy("mlp"), tmp_path)
    exported(policy("mlp"), tmp_path)
    (place / "notes.txt").write_text("mine")
    with pytest.raises(InvalidValueError, match=r"notes\.txt lies there too"):
        exported(policy("mlp"), tmp_path)


def test_the_command_exports_and_says_how_to_fly_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    policy("mlp").save(tmp_path / "policy")
    assert main(["export", str(tmp_path / "policy"), f"out={tmp_path / 'flies'}"]) == 0
    assert f"aerial-il evaluate policy={tmp_path / 'flies'}" in capsys.readouterr().out
    assert main(["export", str(tmp_path / "policy"), f"out={tmp_path / 'flies'}", "license=mine"]) == 2
    assert "license='mine' is not one of" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("part", "name", "value"),
    [
        ("flown", "chunk", 10**12),
        ("flown", "chunk", -1),
        ("flown", "chunk", 11),
        ("flown", "history", 10**9),
        ("flown", "history", 1.5),
        ("flown", "ensemble", float("nan")),
        ("noise", "size", 10**12),
        ("action", "scale", [1.0]),
        ("obs", "centre", [float("nan")]),
        ("switches", "switches.low", [0.0]),
    ],
)
def test_a_description_that_does_not_fit_is_refused(part: str, name: str, value: object, tmp_path: Path) -> None:
    place = exported(policy("mlp"), tmp_path)
    said = json.loads((place / "exported.json").read_text())
    said[part][name] = value
    if name == "scale":
        said[part] = {"scale": value, "centre": value}
    del said["sha256"]
    sealed = hashlib.sha256(json.dumps(said, sort_keys=True).encode() + (place / "network.onnx").read_bytes())
    (place / "exported.json").write_text(json.dumps({**said, "sha256": sealed.hexdigest()}))
    with pytest.raises(CheckpointError, match="is no policy that was exported"):
        load_any_policy(place)


def test_an_evaluation_knows_an_exported_policy_by_its_weights(tmp_path: Path) -> None:
    env = aerial_il.load_batch("floating_gripper", "reach", num_envs=1, num_threads=1)
    known = set[str]()
    for folder, clip in (("a", 5.0), ("b", 5.0), ("c", 6.0)):
        (tmp_path / folder).mkdir()
        place = exported(policy("mlp", obs_clip=clip), tmp_path / folder)
        known.add(origin_of(env, load_any_policy(place))["policy_sha256"])
    assert None not in known
    assert len(known) == 2
