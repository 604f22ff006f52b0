"""What of a path a robot cannot fly is said before it flies, and nothing is said of what it can."""

from collections.abc import Callable
from dataclasses import replace
from itertools import cycle
from pathlib import Path as FilePath

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aerial_il import robots
from aerial_il.cli.main import main
from aerial_il.data.dataset import open_dataset
from aerial_il.data.episode import Episode
from aerial_il.generation.plan import Path, moved
from aerial_il.generation.reach import beyond
from aerial_il.generation.segments import cut
from aerial_il.generation.source import read_source
from aerial_il.robots.robot import Robot
from aerial_il.suite.tasks import pick_place

Flights = Callable[[str], Episode]
FLYING = ("fa_hexa_arm4", "ua_quad_arm4", "big_four_z1")


def path_of(episode: Episode, number: int = 0) -> Path:
    """Return one of a flight's segments where it was."""
    source = read_source(episode)
    segment = cut(source)[number]
    names = [thing.name for thing in source.things]
    now = type(source.poses)(*(value[:1] for value in vars(source.poses).values()))
    return moved(segment, source.things[segment.thing], names.index(segment.name), now)


def facing(path: Path, turn: Rotation) -> Path:
    return replace(path, faced=np.broadcast_to(turn.as_matrix(), path.faced.shape))


def said(robot: Robot, path: Path, episode: Episode) -> str:
    return beyond(robot, episode.spec.action, path) or ""


@pytest.mark.parametrize("name", FLYING)
def test_nothing_is_said_of_what_robots_fly(flight: Flights, name: str) -> None:
    robot = robots.get(name)
    for task in ("pick_place", "insert_peg", "open_door"):
        assert said(robot, path_of(flight(task)), flight(task)) == ""


def test_what_is_beyond_is_said(flight: Flights) -> None:
    robot, episode = robots.get("fa_hexa_arm4"), flight("pick_place")
    path = path_of(episode)
    away = replace(path, pos=path.pos + np.array([3.5, 0.0, 0.0]))
    assert "leave the space that commands may name, -3 to 3 m by -3 to 3 m" in said(robot, away, episode)
    rolled = facing(path, Rotation.from_euler("x", 120, degrees=True))
    assert "turn the tool farther than it can" in said(robot, rolled, episode)
    level = facing(path, Rotation.identity())
    assert said(robot, level, episode) == ""
    low = replace(level, there=level.there * [1.0, 1.0, 0.0] - [0.0, 0.0, 0.3])
    assert "down to the ground" in said(robot, low, episode)


def test_rotors_keep_a_margin(flight: Flights) -> None:
    robot, episode = robots.get("fa_hexa_arm4"), flight("pick_place")
    weak = replace(robot, base=replace(robot.base, max_thrust=17.5))
    down, ahead = path_of(episode), facing(path_of(episode), Rotation.identity())
    assert said(weak, down, episode) == said(robot, ahead, episode) == ""
    assert "rotors no margin" in said(weak, ahead, episode)


def test_a_fixed_arm_reaches_so_far(flight: Flights) -> None:
    robot, episode = robots.get("z1"), flight("pick_place")
    path = path_of(episode)
    before = replace(path, there=path.there * [0.0, 0.0, 1.0] + [0.0, 0.0, 0.1])
    assert said(robot, before, episode) == ""
    away = replace(path, there=path.there + np.array([1.5, 0.0, 0.0]))
    assert "out of its arm's reach" in said(robot, away, episode)


def test_the_command_says_it_before_it_flies(
    shown: Callable[[str], FilePath], tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    near, far = (np.array([-0.1, 0.2]), np.array([0.1, -0.2])), (np.array([3.2, 0.2]), np.array([3.2, -0.2]))
    words = ["generate", f"dataset={shown('pick_place')}", f"out={tmp_path / 'many'}", "episodes=2", "progress=false"]
    monkeypatch.setattr(pick_place, "two_places", lambda *_, **__: far)
    assert main(words) == 2
    told = "From 16 of 16 starts, seed 0 and on, flights are beyond fa_hexa_arm4: 16 leave the space"
    assert told in capsys.readouterr().err
    for worlds in (1, 2):  # what is refused does not depend on how many fly at once
        turn = cycle([far, near])
        monkeypatch.setattr(pick_place, "two_places", lambda *_, turn=turn, **__: next(turn))
        out = tmp_path / f"{worlds} at once"
        assert main([*words[:2], f"out={out}", *words[3:], f"num_envs={worlds}"]) == 0
        assert "From 8 of 16 starts, seed 0 and on, flights are beyond fa_hexa_arm4" in capsys.readouterr().err
        assert len(list(open_dataset(out, failures=True))) == 2
