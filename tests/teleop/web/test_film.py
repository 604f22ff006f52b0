"""Every robot is flown and seen: the pictures of each show it, whatever it has of base, arm and gripper."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import aerial_il
from aerial_il.core.errors import UnknownNameError
from aerial_il.teleop.devices.scripted import Scripted
from aerial_il.teleop.flight import CAMERAS
from aerial_il.teleop.session.cockpit import Cockpit
from aerial_il.teleop.session.logbook import Logbook
from aerial_il.teleop.session.loop import state_of
from aerial_il.teleop.web.film import Film, Shot
from tests.patience import HANG_S
from tests.teleop.hands import schedule, shipped, world

CELLS = dict(reversed(aerial_il.list_cells()))
LEVELS = ("ee_pose", "velocity")


@pytest.mark.render
@pytest.mark.parametrize("robot", CELLS)
@pytest.mark.parametrize("level", LEVELS)
def test_every_robot_is_flown_by_hand_and_seen(tmp_path: Path, robot: str, level: str) -> None:
    env = world(robot, CELLS[robot], action=level)
    cockpit = Cockpit(
        env, shipped("scripted"), Logbook(env, str(tmp_path), operator="ada", first_seed=5000), countdown=3
    )
    shots: list[Shot] = []
    seen = threading.Event()

    def deliver(shot: Shot) -> None:
        shots.append(shot)
        seen.set()

    film = Film(env.model, CAMERAS, (90, 120), deliver)
    film.start()
    try:
        start = state_of(env)
        device = Scripted(schedule((1, 60, ["up+", "forward+", "yaw+"])), cockpit.bindings)
        for _ in range(60):
            cockpit.tick(device.frame())
        film.show(state_of(env), 7)
        assert seen.wait(HANG_S), film.error
    finally:
        film.close()
        cockpit.close()
        env.close()
    assert not np.array_equal(start, state_of(env))
    assert cockpit.status().dead is False
    assert shots[0].input_seq == 7
    for image in shots[0].images:
        (tmp_path / "shot.jpg").write_bytes(image)
        assert np.asarray(Image.open(tmp_path / "shot.jpg")).std() > 5.0, "a picture of something"


@pytest.mark.render
def test_nothing_is_rendered_that_nobody_sees_and_what_stands_still_is_sharp() -> None:
    env, shots, seen = world(), list[Shot](), threading.Event()
    state = state_of(env)

    def deliver(shot: Shot) -> None:
        shots.append(shot)
        seen.set()

    film = Film(env.model, CAMERAS[:1], (90, 120), deliver)
    film.start()
    film.thrift, film.watched = 3, False
    try:
        film.show(state, 1)
        film.watched = True
        for number in (2, 3):
            seen.clear()
            film.show(state, number)
            assert seen.wait(HANG_S), film.error
    finally:
        film.close()
        env.close()
    assert [shot.input_seq for shot in shots] == [2, 3]
    assert len(shots[1].images[0]) > 2 * len(shots[0].images[0])


def test_an_unknown_camera_is_answered_with_those_there_are() -> None:
    with pytest.raises(UnknownNameError, match="chase"):
        Film(world().model, ("chse",), (90, 120), lambda _: None)
