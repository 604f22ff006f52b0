"""``aerial-il inspect`` as a user meets it, on a machine without a screen."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from aerial_il.cli.main import main
from aerial_il.presentation.films import window
from aerial_il.presentation.rerun import program
from tests.presentation.browser import needs_browser
from tests.presentation.rerun.conftest import Shown


@pytest.fixture(autouse=True)
def headless(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name in window.SCREENS:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="module")
def flights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of two flights."""
    out = tmp_path_factory.mktemp("recorded") / "reach"
    flown = ["collect", "robot=ua_quad_arm4", "task=reach", "episodes=2", "seed=7", f"out={out}", "progress=false"]
    assert main(flown) == 0
    return out


def test_a_dataset_becomes_a_file_of_all_its_flights(flights: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect", str(flights)]) == 0
    said = capsys.readouterr().out
    file = Path("runs/inspections/reach.rrd")
    assert f"rerun {file}" in said
    assert said.count("steps, success") == 2
    assert "without error" in program.run("rrd", "verify", str(file))
    names = [entity for entity in Shown(file).entities if entity.startswith("/states")]
    assert {"/states/0_phase", "/states/2_at_position", "/states/9_outcome"} <= {*names}


def test_two_flights_become_one_recording(flights: Path, capsys: pytest.CaptureFixture[str]) -> None:
    one, two = sorted(flights.glob("demos/*.mcap"))
    assert main(["inspect", str(one), str(two), "save=both.rrd"]) == 0
    assert "Aligned by phases" in capsys.readouterr().out
    roots = {entity.split("/")[1] for entity in Shown(Path("both.rrd")).entities} - {"__properties"}
    assert roots == {one.stem, two.stem}


def test_the_expert_flies_beside_a_recording_from_the_same_start(flights: Path) -> None:
    assert main(["inspect", str(flights), "expert", "episode=1", "save=both.rrd"]) == 0
    shown = Shown(Path("both.rrd"))
    starts = [shown.numbers(f"/{root}/scene/robot/base", "Transform3D:translation")[:3] for root in ("reach", "expert")]
    assert np.array_equal(*starts)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["{demos}", "episode=2"], "expected 0 to 1, got 2"),
        (["nowhere"], "does not exist"),
        (["{demos}", "save=x.mp4"], "its name must end in .rrd"),
        (["{demos}", "screenshot=x.jpg"], "its name must end in .png or .webp"),
        (["{demos}", "screenshot=x.png", "at=2"], "from 0 to 1"),
        (["{demos}", "at=0.5"], "set screenshot=FILE too"),
        (["expert"], "expert is shown beside another flight"),
        (["{demos}", "policy=nowhere"], "nowhere"),
    ],
)
def test_what_cannot_be_shown_is_said(
    words: list[str], said: str, flights: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["inspect", *(word.format(demos=flights) for word in words)]) == 2
    assert said in capsys.readouterr().err


def test_a_viewer_that_is_not_installed_is_told(
    flights: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(program.sys, "executable", str(tmp_path / "python"))
    assert main(["inspect", str(flights)]) == 2
    assert "rerun's viewer is not installed" in capsys.readouterr().err


def test_lerobot_folders_and_hdf5_files_show_their_signals(flights: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from aerial_il.data.dataset import open_dataset
    from aerial_il.data.formats import robomimic

    robomimic.write(open_dataset(flights), Path("reach.hdf5"))
    assert main(["convert", str(flights), "progress=false"]) == 0
    capsys.readouterr()
    for source in ("reach.hdf5", str(flights / "derived" / "lerobot")):
        assert main(["inspect", source, "episode=0", "save=seen.rrd"]) == 0, source
        shown = Shown(Path("seen.rrd"))
        drawn = "/scene/robot/base" in shown.entities
        assert drawn != ("nothing can be drawn in 3-D" in capsys.readouterr().out), source
        assert "/signals/reward" in shown.entities
    shutil.rmtree(flights / "derived")


@pytest.mark.slow
@needs_browser
def test_a_picture_needs_no_screen(flights: Path) -> None:
    assert main(["inspect", str(flights), "episode=0", "save=one.rrd", "screenshot=one.png"]) == 0
    pixels = np.asarray(Image.open("one.png"))
    assert pixels.shape == (1000, 1600, 3)
    assert len(np.unique(pixels[::4, ::4].reshape(-1, 3), axis=0)) > 300
