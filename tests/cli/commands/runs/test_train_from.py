"""``aerial-il train from=RUN``: a training with the settings of an earlier one."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
import yaml

import aerial_il
from aerial_il.algorithms.bc import BC
from aerial_il.cli.main import main
from aerial_il.evaluation import training_run
from aerial_il.policies.mlp import MLP
from aerial_il.workflows.parts import earlier_run

FEW = {"steps": 4, "lr": 2e-3, "batch_size": 16}
WORDS = [f"algorithm.{name}={value}" for name, value in FEW.items()]


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run ``a`` on three of the four demonstrations, and ``own``, trained by the algorithm's own ``train``."""
    folder = tmp_path_factory.mktemp("from")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        demos = aerial_il.collect("quad", "hover", out="demos", episodes=4, progress=False)
        words = ["dataset=demos", "dataset.episodes=3", "seed=7", "tracker=[]", "policy.hidden=[8]", *WORDS]
        assert main(["train", *words, "run=a", "progress=false"]) == 0
        BC(**FEW).train(demos, MLP(hidden=(8,)), run="own", progress=False)
    return folder


@pytest.fixture(autouse=True)
def at_home(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(home)


def config_of(run: str) -> dict[str, Any]:
    return yaml.safe_load(Path(run, "config.yaml").read_text())


def test_all_settings_are_taken() -> None:
    before = {file: file.read_bytes() for file in Path("a").rglob("*") if file.is_file()}
    assert main(["train", "from=a", "run=same", "progress=false"]) == 0
    assert config_of("same") == config_of("a")
    assert not Path("same/tensorboard").exists()
    first, second = (json.loads(Path(run, "command.json").read_text()) for run in ("a", "same"))
    assert second["command"] == first["command"].replace("run=a", "run=same")
    weights = [{f.name: f.read_bytes() for f in Path(run, "policy").glob("*.safetensors")} for run in ("a", "same")]
    assert weights[0] == weights[1] != {}
    assert before == {file: file.read_bytes() for file in Path("a").rglob("*") if file.is_file()}


def test_the_run_is_read_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its metrics may be long."""
    opened = []
    monkeypatch.setattr(earlier_run, "read_run", lambda place: opened.append(place) or training_run.read_run(place))
    assert main(["train", "from=a", "algorithm.lr=1e-4", "run=once", "progress=false"]) == 0
    assert opened == ["a"]


def test_what_is_typed_goes_before_them() -> None:
    words = ["algorithm.lr=1e-4", "evaluate_episodes=${algorithm.steps}"]
    assert main(["train", "from=a", *words, "run=typed", "progress=false"]) == 0
    changed = config_of("a")
    changed["settings"]["lr"] = 1e-4
    assert config_of("typed") == changed
    assert "evaluate_episodes=4" in json.loads(Path("typed/command.json").read_text())["command"]
    aerial_il.train(from_run=Path("a"), run="python", algorithm={"lr": 1e-4}, progress=False)
    assert config_of("python") == changed


def test_another_class_comes_with_its_defaults() -> None:
    assert main(["train", "from=a", "policy=gaussian", "run=gaussian", "progress=false"]) == 0
    made, before = config_of("gaussian"), config_of("a")
    assert made["policy"]["name"] == "gaussian"
    assert made["policy"]["hidden"] != before["policy"]["hidden"]
    assert made["settings"] == before["settings"]


def test_a_sweep_varies_a_run() -> None:
    assert main(["train", "-m", "from=a", "seed=1,2", "run=seeds", "progress=false"]) == 0
    for seed in (1, 2):
        made = config_of(f"seeds/seed={seed}")
        assert (made["seed"], made["settings"]) == (seed, config_of("a")["settings"])


def test_keys_are_those_of_the_run(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["train", "from=a", "algorithm.rounds=2", "run=x"]) == 2
    assert "Unknown key 'algorithm.rounds'" in capsys.readouterr().err
    assert main(["train", "from=a", "--help"]) == 0
    assert "seed=7" in capsys.readouterr().out


def test_a_run_of_python_lacks_its_demonstrations(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["train", "from=own", "run=x", "progress=false"]) == 2
    assert "set dataset=PATH" in capsys.readouterr().err
    assert main(["train", "from=own", "dataset=demos", "run=from_own", "progress=false"]) == 0
    assert config_of("from_own")["settings"] == config_of("own")["settings"]


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("from=demos", "from=demos is no training run"),
        ("from=nowhere", "from=nowhere does not exist"),
        ("from=sweep", "from=sweep is a sweep; name one of its runs: seed=1"),
        ("from=old", "algorithm.log_every is called algorithm.cadence.log_every now"),
    ],
)
def test_what_is_no_run_of_this_version_is_refused(word: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    for place in ("old", "sweep/seed=1"):
        Path(place).mkdir(parents=True, exist_ok=True)
        Path(place, "metrics.jsonl").write_text("")
        config = config_of("a")
        config["settings"]["log_every"] = config["settings"].pop("cadence")["log_every"]
        Path(place, "config.yaml").write_text(yaml.safe_dump(config))
    assert main(["train", word, "run=x"]) == 2
    assert said in capsys.readouterr().err
    assert not Path("x").exists()


def test_a_new_folder_must_be_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["train", "from=a"]) == 2
    assert "train needs run=..." in capsys.readouterr().err
    assert main(["train", "from=a", "algorithm.lr=1", "run=a", "progress=false"]) == 2
    assert "a holds another run (settings.lr: 0.002 -> 1" in capsys.readouterr().err


def test_code_that_a_run_names_must_be_typed(capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copytree("a", "asked")
    Path("asked", "command.json").write_text(json.dumps({"settings": {"dataset": "demos", "expert": "pilot:make"}}))
    assert main(["train", "from=asked", "run=x", "progress=false"]) == 2
    assert "If you trust it, type it too: expert=pilot:make" in capsys.readouterr().err
    assert main(["train", "from=asked", "expert=null", "run=unasked", "progress=false"]) == 0
    Path("asked", "command.json").write_text(json.dumps({"settings": ["demos"]}))
    assert main(["train", "from=asked", "run=x"]) == 2
    assert "from=asked: its settings is" in capsys.readouterr().err
