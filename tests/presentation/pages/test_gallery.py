"""The gallery shows whatever is registered, makes each film once, and is a page that needs nothing else."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import aerial_il
from aerial_il.core.errors import AerialError, SimulationDivergedError
from aerial_il.data.episode import Episode
from aerial_il.presentation.documentation.sources import ROOT
from aerial_il.presentation.films import clips
from aerial_il.presentation.pages import gallery
from aerial_il.presentation.pages.gallery import Gallery, write_gallery, write_sheet
from aerial_il.workflows.catalogue import catalogue
from tests.presentation.conftest import Flown
from tests.presentation.outline import needs_nothing_else


@pytest.fixture(scope="module")
def made(flown: Flown, tmp_path_factory: pytest.TempPathFactory) -> Gallery:
    """Every card shows the same flight, so that it is rendered once."""
    path = tmp_path_factory.mktemp("gallery") / "gallery.html"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(clips, "FILM_SIZE", (60, 80))
        patch.setattr(clips, "POSTER_SIZE", (90, 120))
        return write_gallery(path, catalogue(), fly=lambda robot, task: (flown.episode, flown.flags), progress=False)


def test_every_robot_and_task_that_can_be_flown_has_a_card() -> None:
    chosen, cells = gallery.cards(), set(aerial_il.list_cells())
    assert {c.name for c in chosen if c.kind == "robot"} == {robot for robot, _ in cells}
    assert {c.name for c in chosen if c.kind == "task"} == {task for _, task in cells}
    assert {(c.robot, c.task) for c in chosen} <= cells
    assert all(c.name == (c.robot if c.kind == "robot" else c.task) for c in chosen)


def test_the_sheet_of_the_docs_has_a_place_for_every_card_and_no_other() -> None:
    rows = -(-len(gallery.cards()) // gallery.SHEET_COLUMNS)
    height, width = gallery.SHEET_PICTURE
    sheet = Image.open(ROOT / "docs/gallery.png")
    assert sheet.size == (gallery.SHEET_COLUMNS * width, rows * (height + gallery.SHEET_LABEL))
    assert (ROOT / "docs/gallery.png").stat().st_size < 1_000_000


def test_no_cell_is_shown_twice_while_others_are_unseen() -> None:
    shown = [(c.robot, c.task) for c in gallery.cards()]
    for card in gallery.cards():
        mine = {cell for cell in aerial_il.list_cells() if cell[card.kind == "task"] == card.name}
        assert shown.count((card.robot, card.task)) == 1 or mine <= set(shown)


def test_the_matrix_says_what_stands_in_the_way() -> None:
    cells = set(aerial_il.list_cells())
    for task, row in gallery.matrix():
        assert {(robot, task) for robot, infeasibility in row if not infeasibility} == {
            c for c in cells if c[1] == task
        }


@pytest.mark.render
def test_the_page_needs_nothing_else_and_names_everything(made: Gallery) -> None:
    html = made.path.read_text()
    assert needs_nothing_else(html)
    assert len(html) < 15_000_000
    for name in (*aerial_il.list_robots(), *aerial_il.list_tasks()):
        assert name in html
    for row in catalogue()["tasks"]:
        assert row["instruction"] in html.replace("&#39;", "'")


@pytest.mark.render
def test_a_film_is_made_once_and_again_when_the_flight_differs(made: Gallery, flown: Flown, tmp_path: Path) -> None:
    folder = made.path.with_name("gallery_clips")
    before = {file: file.stat().st_mtime_ns for file in folder.iterdir()}
    again = clips.make_clips(flown.episode, flown.flags, folder)
    assert {file: file.stat().st_mtime_ns for file in folder.iterdir()} == before
    assert set(again.files) == set(before)
    assert set(again.stills) == {"scene", "wrist", "base"}
    other = {**vars(flown.episode), "states": flown.episode.states[:30]}
    assert clips.digest_of(Episode(**other), clips.Excerpt(0, 28, 3)) not in again.film.name


def test_without_a_renderer_nothing_is_flown(tmp_path: Path) -> None:
    def fly(robot: str, task: str) -> tuple[Episode, np.ndarray]:
        raise AssertionError("nothing may be flown")

    bare = write_gallery(tmp_path / "g.html", catalogue(), fly=fly, note="No pictures: dark here.", progress=False)
    html = bare.path.read_text()
    assert "No pictures: dark here." in html
    assert not {"<video", "<img"} & set(html.split())
    assert needs_nothing_else(html)
    with pytest.raises(AerialError, match="dark here"):
        write_sheet(tmp_path / "sheet.png", bare)


def test_a_flight_that_fails_leaves_a_card_that_says_why(tmp_path: Path) -> None:
    def fly(robot: str, task: str) -> tuple[Episode, np.ndarray]:
        raise SimulationDivergedError("qacc of DOF 3", seed=0, step=7)

    html = write_gallery(tmp_path / "g.html", catalogue(), fly=fly, progress=False).path.read_text()
    assert html.count("qacc of DOF 3 at step 7") == len(gallery.cards())
