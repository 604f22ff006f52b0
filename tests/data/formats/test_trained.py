"""What others record trains from the command line as it is: pictures under any name, several cameras, real rates."""

from pathlib import Path

import numpy as np
import pytest

import aerial_il
from aerial_il.cli.main import main
from experiments.foreign.layouts import robomimic
from tests.data.formats.recorded import demo, lerobot

SHORT = ["algorithm.steps=2", "algorithm.batch_size=4", "run=run", "progress=false"]
EYES = ["policy.image_features=8", "policy.hidden=[8]"]


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_robomimic_images_train(home: Path) -> None:
    rng = np.random.default_rng(0)
    seen = lambda: {"pos": rng.normal(size=(25, 3)), "agentview_image": rng.integers(0, 255, (25, 84, 84, 3), np.uint8)}  # noqa: E731
    robomimic(home / "image.hdf5", *(demo(25, float(i), obs=seen()) for i in range(3)))
    words = ["train", "dataset=image.hdf5", "policy.images=[agentview_image]", *EYES, *SHORT]
    assert main(words) == 0
    policy = aerial_il.load_policy("run")
    shown = {"pos": np.zeros((1, 3)), "agentview_image": np.zeros((1, 84, 84, 3), np.uint8)}
    policy.reset(np.ones(1, bool))
    assert policy.act(shown).shape == (1, 2)


def test_a_robot_s_cameras_train(home: Path) -> None:
    """640 x 480 pictures of three cameras, 30 a second, in one video each."""
    cameras = dict.fromkeys(("top", "left_wrist", "right_wrist"), (480, 640))
    lerobot(home / "robot", [12, 9, 10], cameras=cameras)
    images = "policy.images=[top_rgb,left_wrist_rgb,right_wrist_rgb]"
    assert main(["train", "dataset=robot", images, *EYES, *SHORT]) == 0
    assert main(["validate", "robot", "progress=false"]) == 0


def test_what_is_left_out_and_taken_for_granted_is_said(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    robomimic(home / "odd.hdf5", demo(25, 1.0), demo(25, 2.0, rewards=np.zeros(9)), demo(25, 3.0, dones=None))
    assert main(["train", "dataset=odd.hdf5", "policy.hidden=[8]", *SHORT]) == 0
    assert "1 of 3 episodes are left out, the first as odd.hdf5: demo_1 has rewards" in capsys.readouterr().err
    assert main(["train", "dataset=odd.hdf5", "dataset.strict=true", "policy.hidden=[8]", *SHORT]) == 2
    capsys.readouterr()
    assert main(["validate", "odd.hdf5", "progress=false"]) == 2
    said = capsys.readouterr().out
    assert "demo_1 has rewards of another length than its actions. expected 25 rows, got 9." in said
    assert "demo_2 lacks done, which others have." in said
    assert main(["info", "odd.hdf5", "control_dt=0.1"]) == 0
    assert "2 episodes, 2 successful, 5 s of flight" in capsys.readouterr().out
