"""``view``, ``inspect`` and the gallery of ``list`` as a user meets them, on a machine without a screen."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from aerial_il.cli.main import main
from aerial_il.data.folder import DatasetFolder
from aerial_il.data.recording.reader import read_episode
from aerial_il.presentation.films import scene_renderer, window
from aerial_il.presentation.rerun import program
from aerial_il.workflows import catalogue
from aerial_il.workflows.parts import pilots
from tests.presentation.browser import needs_browser
from tests.presentation.rerun.conftest import Shown

REACH = ["robot=ua_quad_arm4", "task=reach", "progress=false"]


@pytest.fixture(autouse=True)
def headless(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name in window.SCREENS:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def dark(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine that cannot render, on which pages are quick."""
    monkeypatch.setattr(scene_renderer, "can_render", lambda: False)


@pytest.fixture(scope="module")
def flights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of two flights."""
    out = tmp_path_factory.mktemp("recorded") / "reach"
    flown = ["collect", "robot=ua_quad_arm4", "task=reach", "episodes=2", "seed=7", f"out={out}", "progress=false"]
    assert main(flown) == 0
    return out


def test_without_a_screen_a_flight_becomes_a_page(dark: None, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["view", *REACH, "seed=3"]) == 0
    said = capsys.readouterr().out
    page = Path("runs/views/reach-ua_quad_arm4-calm-3-expert.html")
    assert "No screen here: a page instead." in said
    assert f"Page: {page}" in said
    assert "No film: no rendering back end" in page.read_text()
    assert read_episode(page.with_suffix(".mcap")).seed == 3


@pytest.mark.parametrize("policy", ["random", "hover"])
def test_baselines_can_be_watched(policy: str, dark: None, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["view", *REACH, f"policy={policy}", "out=x.html"]) == 0
    assert "success" not in capsys.readouterr().out
    assert read_episode("x.mcap").provenance["policy"] == policy


def test_a_recording_becomes_a_page_with_its_sub_tasks(
    flights: Path, dark: None, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["view", f"recording={flights}", "seed=7", "out=x.html"]) == 0
    assert "success" in capsys.readouterr().out
    assert "within 10 cm" in Path("x.html").read_text()


def test_a_file_for_rerun(flights: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["view", f"recording={flights}", "viewer=rerun"]) == 0
    said = capsys.readouterr().out
    assert "No screen here. On a machine with one: rerun runs/views/" in said
    (file,) = Path("runs/views").glob("*.rrd")
    assert file.stat().st_size > 1000


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["view"], "policy=expert needs robot=... and task=..."),
        (["view", "policy=random"], "policy=random needs robot=... and task=..."),
        (["view", "recording=nowhere"], "does not exist"),
        (["view", "recording=x.mcap", "task=reach"], "leave out robot="),
        (["view", *REACH, "out=x.gif"], ".html, .mp4, .rrd"),
        (["view", *REACH, "out=x.mp4", "viewer=rerun"], "out=x.mp4 is for viewer=film"),
        (["view", *REACH, "viewer=nonsense"], "auto, window, page, film, rerun, still"),
        (["view", *REACH, "seed=-1"], "seed=-1 is too small"),
        (["view", "policy=nowhere"], "does not exist"),
        (["list", "html=page.txt"], "ends in .html"),
        (["list", "sheet=x.png"], "needs html=..."),
    ],
)
def test_bad_input_is_answered(words: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(words) == 2
    assert said in capsys.readouterr().err


def test_a_seed_that_a_dataset_lacks_is_answered(flights: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["view", f"recording={flights}", "seed=9"]) == 2
    assert "Seeds from 7 to 8" in capsys.readouterr().err


def test_a_seed_is_found_in_recordings_of_any_name(
    flights: Path, tmp_path: Path, dark: None, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, file in zip(("first", "a-b-second"), DatasetFolder(flights).files(), strict=True):
        shutil.copy(file, tmp_path / f"{name}.mcap")
    assert main(["view", f"recording={tmp_path}", "seed=8"]) == 0
    assert "a-b-second.html" in capsys.readouterr().out
    assert main(["view", f"recording={tmp_path}", "seed=9"]) == 2
    assert "Seeds from 7 to 8" in capsys.readouterr().err


def test_a_film_needs_a_renderer(flights: Path, dark: None, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["view", f"recording={flights}", "viewer=film"]) == 2
    assert "viewer=page shows the traces" in capsys.readouterr().err


def test_a_window_without_a_screen_is_refused_by_name(flights: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["view", f"recording={flights}", "viewer=window"]) == 2
    assert "viewer=page writes a page instead" in capsys.readouterr().err


def test_the_gallery_without_pictures(dark: None, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", "html=true"]) == 0
    said = capsys.readouterr().out
    assert "No pictures: no rendering back end" in said
    assert f"Gallery: {catalogue.GALLERY}" in said
    assert "aerial-il doctor" in Path(catalogue.GALLERY).read_text()


def test_the_flight_for_the_gallery_is_one_that_succeeds() -> None:
    episode, flags = pilots.expert_flight("ua_quad_arm4", "reach")
    assert episode.success
    assert flags.shape == (len(episode), len(episode.spec.subtasks))


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
