"""The study of files of others: they hold what was flown, and each stage that one does not reach is a target missed."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aerial_il.core.errors import AerialError
from aerial_il.data.dataset import open_dataset
from experiments.foreign.arm import Flown, flown
from experiments.foreign.files import of_people, of_the_arm
from experiments.foreign.odd import odd_files
from experiments.foreign.study import CONTROL, targets_of

SEEDS = (0, 1)


@pytest.fixture(scope="module")
def flights() -> list[Flown]:
    return list(flown(SEEDS))


def test_the_script_reaches_every_time(flights: list[Flown]) -> None:
    assert all(flight.rewards.sum() > -8 for flight in flown(range(5000, 5010)))
    assert [len(flight.actions) for flight in flights] == [50, 50]
    assert all(flight.truncated[-1] and not flight.terminated.any() for flight in flights)


def test_all_files_hold_the_same_flights(flights: list[Flown], tmp_path: Path) -> None:
    for number, file in enumerate(of_the_arm(flights, [])):
        (place := tmp_path / str(number)).mkdir()
        episodes = list(open_dataset(file.write(place)))
        assert len(episodes) == len(flights), file.name
        for episode, flight in zip(episodes, flights, strict=True):
            (seen,) = episode.obs.values()
            np.testing.assert_allclose(seen[:-1], flight.obs["observation"][:-1], rtol=1e-6, atol=1e-6)
            np.testing.assert_allclose(episode.actions, flight.actions, rtol=1e-6, atol=1e-6)


@pytest.mark.render
def test_a_camera_sees_the_same_flight(flights: list[Flown]) -> None:
    (seen,) = flown([SEEDS[1]], pictures=True)
    np.testing.assert_array_equal(seen.actions, flights[1].actions)
    assert seen.obs["agentview_image"].shape == (51, 84, 84, 3)
    assert seen.obs["agentview_image"].std() > 1


def test_odd_files_are_refused_or_lose_what_is_odd(flights: list[Flown], tmp_path: Path) -> None:
    sound, kinds = odd_files(flights)
    assert len(open_dataset(sound(tmp_path))) == 2
    whole = {"an episode without steps", "a field of one episode alone", "one episode in another unit"}
    whole |= {"a failure among successes", "depth as floats"}
    counts = {}
    for number, (what, write) in enumerate(kinds.items()):
        (place := tmp_path / str(number)).mkdir()
        try:
            counts[what] = len(open_dataset(write(place)))
        except AerialError:
            counts[what] = 0
    assert {what for what, count in counts.items() if count == 2} == whole
    assert sum(count == 1 for count in counts.values()) == 4


def test_people_s_files_are_read_where_they_are(tmp_path: Path) -> None:
    arrays = {}
    for number in range(3):
        arrays |= {f"ep0{number}/observations": np.full((9, 4), number, float), f"ep0{number}/rewards": np.ones(9)}
        arrays[f"ep0{number}/actions"] = np.full((9, 2), number, float)
    np.savez(tmp_path / "door_human_demos.npz", **arrays)
    (door,) = of_people(tmp_path)
    episodes = list(open_dataset(door.write(tmp_path)))
    assert [len(episode) for episode in episodes] == [9, 9, 9]
    assert [float(episode.actions[0, 0]) for episode in episodes] == [0.0, 1.0, 2.0]


def way(*, episodes: int = 9, trains: bool = True, percent: float | None = 97.0) -> dict[str, Any]:
    flight = {"percent": percent}
    return {"file": {"episodes": episodes}, "trains": trains, "flight": flight, "like_the_control": True}


@pytest.mark.parametrize(
    ("theirs", "met"),
    [
        (way(), [True, True, True, True]),
        (way(percent=91.0), [True, True, True, False]),
        (way(percent=None), [True, True, False]),
        (way(trains=False, percent=None), [True, False, False]),
        (way(episodes=0, trains=False, percent=None), [False, False, False]),
    ],
)
def test_every_target_can_be_missed(theirs: dict[str, Any], met: list[bool]) -> None:
    assert [target.met for target in targets_of({CONTROL: way(), "theirs": theirs})] == met
