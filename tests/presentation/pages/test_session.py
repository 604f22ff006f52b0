"""The summary of a folder that people fly into, read back from its page."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aerial_il.core.errors import DemoError
from aerial_il.data.folder import DatasetFolder
from aerial_il.data.recording.reader import read_episode
from aerial_il.presentation.pages.session import lengths, operator_of, rows_of, session_page, take_of, tool_jerk
from aerial_il.teleop.devices.scripted import Scripted
from aerial_il.teleop.session.cockpit import Cockpit
from aerial_il.teleop.session.logbook import Logbook
from tests.teleop.hands import schedule, shipped, world


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder into which two people have flown three short episodes, at two speeds of time."""
    place, env = tmp_path_factory.mktemp("flown"), world()
    for operator, pace, ticks in (("ada", 1.0, 30), ("bob", 0.5, 50), ("bob", 0.5, 70)):
        logbook = Logbook(env, str(place), operator=operator, first_seed=5000)
        cockpit = Cockpit(env, shipped("scripted"), logbook, countdown=3, time_scale=pace)
        script = schedule(
            (1, 2, ["record"]), (6, 20, ["forward+"]), (ticks, ticks + 1, ["record"]), (ticks + 2, ticks + 3, ["save"])
        )
        device = Scripted(script, cockpit.bindings)
        for _ in range(ticks + 5):
            cockpit.tick(device.frame())
        cockpit.close()
    return place


def test_it_sums_up_by_operator_and_stands_alone(folder: Path) -> None:
    page = session_page(folder, ["aerial-il validate x&y"])
    assert "3 flights by hand" in page
    assert re.search(r"<td>bob</td><td>0</td><td>2</td>", page)
    assert re.search(r"<td>ada</td><td>0</td><td>1</td>", page)
    assert page.count("flown at 0.5 of real time") == 2
    assert "x&amp;y" in page
    assert not re.search(r'(src|href)="(?!data:)', page), "it opens offline"
    assert not re.search(r"<script|https?://", page)


def test_a_folder_without_recordings_says_how_to_go_on(tmp_path: Path) -> None:
    with pytest.raises(DemoError, match="aerial-il teleop"):
        session_page(tmp_path)


def test_a_damaged_recording_is_left_out(folder: Path, tmp_path: Path) -> None:
    copy = Path(shutil.copytree(folder, tmp_path / "copy"))
    first = next(file for kind in ("demos", "failures") for file in DatasetFolder(copy).files(kind))
    first.write_bytes(first.read_bytes()[:-40])
    page = session_page(copy)
    assert "2 flights by hand" in page


def test_jerk_is_that_of_a_known_path(folder: Path) -> None:
    episode = read_episode(DatasetFolder(folder).files("failures")[0])
    times = episode.spec.control_dt_s * np.arange(len(episode) + 1)
    path = np.stack([times**3 / 6.0, np.zeros_like(times), 4.0 * times**3 / 6.0], axis=1)
    known = replace(episode, obs={**episode.obs, "ee_pos": path})
    assert tool_jerk(known) == pytest.approx(np.hypot(1.0, 4.0), rel=1e-6)


def test_every_take_is_counted_once(folder: Path) -> None:
    takes = [take_of(read_episode(file)) for file in DatasetFolder(folder).files("failures")]
    assert sum(row.demos + row.failures for row in rows_of(takes)) == 3
    bars = re.findall(r"<title>[^<]*: (\d+) not solved</title>", lengths(takes).svg)
    assert sum(map(int, bars)) == 3
    solved = [replace(take, success=True) for take in takes]
    assert [row.demos for row in rows_of(solved)] == [2, 1], "who has flown most comes first"


@pytest.mark.parametrize(
    ("policy", "operator"),
    [("human:ada", "ada"), ("runs/x with human:bob", "bob"), ("expert", "expert"), ("", "unknown")],
)
def test_who_flew(policy: str, operator: str) -> None:
    assert operator_of(policy) == operator
