"""An exported policy flies on the robot's computer, where neither torch nor MuJoCo is installed."""

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("onnx", reason="pip install 'aerial-il[export]'")
pytest.importorskip("onnxruntime", reason="pip install 'aerial-il[export]'")

from aerial_il import load_batch, open_dataset
from aerial_il.core.errors import InvalidValueError
from aerial_il.evaluation.rollouts import evaluate
from aerial_il.links.onboard import fly, main
from aerial_il.links.robot import SimulatedRobot
from aerial_il.links.simulated.in_process import SimulatedLink
from aerial_il.policies.parts.exported import OnnxPolicy, load_exported
from aerial_il.workflows.export import Export, export
from tests.links.test_fly import ROBOT, TASK, fresh_policy

WITHOUT = """
import sys
MISSING = {"torch", "mujoco", "dm_control", "yaml", "numba", "safetensors", "gymnasium", "scipy", "aiohttp", "mcap"}
class Missing:
    def find_spec(self, name, *_):
        if name.split(".")[0] in MISSING:
            raise ModuleNotFoundError(f"{name} was imported", name=name)
sys.meta_path.insert(0, Missing())
from aerial_il.links.onboard import main
sys.exit(main(sys.argv[1:]))
"""


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("policy")
    fresh_policy("mlp").save(place / "policy")
    return export(Export(policy=str(place / "policy"), out=str(place / "exported"))).folder


def test_it_flies_as_an_evaluation_does_and_is_written(exported: Path, tmp_path: Path) -> None:
    policy, link = load_exported(exported), SimulatedLink(SimulatedRobot(ROBOT, TASK))
    flight = fly(policy, link, seconds=2.0, seed=3)
    env = load_batch(ROBOT, TASK, num_envs=1)
    judged = evaluate(env, policy.fresh(), [3], policy_name="a", progress=False).episodes[0]
    assert len(flight.actions) == min(100, judged.steps)
    flight.save(tmp_path / "flight.npz")
    (episode,) = open_dataset(str(tmp_path / "flight.npz"))
    assert len(episode) == len(flight.actions)
    assert len(flight.obs["ee_pos"]) == len(flight.actions) + 1


def test_nothing_heavy_is_imported(exported: Path) -> None:
    typed = [sys.executable, "-c", WITHOUT, f"policy={exported}", "link=simulated"]
    done = subprocess.run(typed, capture_output=True, text=True, check=False)
    assert "was imported" not in done.stderr
    assert (done.returncode, "need MuJoCo" in done.stderr) == (2, True), done.stderr


def test_another_robot_is_refused(exported: Path) -> None:
    policy = load_exported(exported)
    assert isinstance(policy, OnnxPolicy)
    with pytest.raises(InvalidValueError, match="trained for"):
        fly(policy, SimulatedLink(SimulatedRobot("ua_quad_arm4", "pick_place")), seconds=1.0, seed=0)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["link=simulated"], "policy=... is missing"),
        (["policy=x", "link=pigeon"], "Unknown link"),
        (["policy=nowhere", "link=simulated"], "nowhere"),
        (["policy=x", "link=simulated", "second=3"], "Unknown key 'second'"),
        (["policy=x", "link=simulated", "--help"], "Unknown key '--help'"),
        (["policy=x", "link=simulated", "out=nowhere/flight.npz"], "a new file NAME.npz"),
        (["policy=x", "link=simulated", "out=flight.csv"], "a new file NAME.npz"),
    ],
)
def test_what_is_wrong_is_said(words: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(words, here=lambda: SimulatedRobot(ROBOT, TASK)) == 2
    assert said in capsys.readouterr().err
