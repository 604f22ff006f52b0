"""A vehicle from an MJCF flies as the file says, about its own centre of mass."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from aerial_il.robots.parts.arm import Arm
from aerial_il.robots.parts.described.error import ModelFileError
from aerial_il.robots.parts.described.rotorcraft import ReadRotorcraft, read_rotorcraft
from aerial_il.robots.parts.gripper import NO_GRIPPER
from aerial_il.robots.robot import Robot
from tests.contract.test_feasibility import register, solved
from tests.robots.described.writing import QUAD_MJCF
from tests.robots.test_robots import compiled

assert register  # a fixture


def read(folder: Path, text: str = QUAD_MJCF, **options: object) -> ReadRotorcraft:
    (folder / "tern.xml").write_text(text, encoding="utf-8")
    known = {"rotor_radius": 0.1, "tau_up": 0.015, "tau_down": 0.025, "drag": (0.2, 0.2, 0.3)}
    return read_rotorcraft(folder / "tern.xml", **(known | options))  # type: ignore[arg-type]


def flying(found: ReadRotorcraft) -> Robot:
    return Robot("tern", "A quadrotor from an MJCF.", found.base, Arm(), NO_GRIPPER, rest_forward=(), rest_down=())


def test_rotors_and_inertia_are_the_files_about_its_centre(tmp_path: Path) -> None:
    found = read(tmp_path)
    base = found.base
    assert base.mass == 1.5
    np.testing.assert_allclose(base.inertia, [0.015, 0.016, 0.028])
    np.testing.assert_allclose(found.origin, [-0.02, 0.0, -0.01])
    np.testing.assert_allclose(base.rotor_pos[0], [0.15, 0.15, 0.03])
    np.testing.assert_allclose(base.rotor_axis, np.tile([0.0, 0.0, 1.0], (4, 1)))
    np.testing.assert_allclose(base.rotor_drag_ratio, [0.016, -0.016, -0.016, 0.016])
    np.testing.assert_allclose(base.rotor_max, 13.0, err_msg="gear times control range, for the last as well")
    np.testing.assert_allclose(base.hub_size, [0.10, 0.05, 0.04])


def test_it_hovers(tmp_path: Path, register: type) -> None:
    robot = flying(read(tmp_path))
    register.add(robot)
    assert compiled(robot).geom("hub_0").contype[0] == 2
    assert solved("tern", "hover") == 4


def changed(old: str, new: str) -> str:
    assert old in QUAD_MJCF
    return QUAD_MJCF.replace(old, new)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (changed('gear="0 0 2 0 0 0.032"', 'gear="1 0 0 0 0 0"'), "'rr' has the gear \"1 0 0 0 0 0\""),
        (changed(' ctrlrange="0 6.5"', ""), r"'rr' has no ctrlrange. .*max_thrust="),
        (changed("0 6.5", "-2 -1"), "'rr' thrusts from -4 to -2 N"),
        (QUAD_MJCF[: QUAD_MJCF.index("<actuator>")] + "</mujoco>", "it has no rotors.*PX4"),
        (QUAD_MJCF.replace("-0.016", "0.016"), "cannot produce lift and three torques"),
        (changed("</worldbody>", '<body name="box"/></worldbody>'), "holds 2 bodies in the world: box, tern"),
        (changed('mass="1.5"', 'mass="0"'), "MuJoCo cannot compile it|has no mass"),
    ],
)
def test_what_is_no_vehicle_is_refused_in_words(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ModelFileError, match=message):
        read(tmp_path, text)


def test_the_vehicle_itself_cannot_be_dropped(tmp_path: Path) -> None:
    with pytest.raises(ModelFileError, match="drop names body 'tern' or one above it; that is the vehicle itself"):
        read(tmp_path, QUAD_MJCF, drop=["tern"])


def test_a_camera_is_left_away_and_a_propeller_is_welded(tmp_path: Path) -> None:
    more = '<body name="eye" pos="0.1 0 0"><geom size="0.02" mass="0.5"/></body><body name="prop" pos="0.17 0.15 0.05">'
    more += '<joint name="spin" axis="0 0 1"/><geom size="0.01" mass="0.01"/></body><site name="fl"'
    found = read(tmp_path, changed('<site name="fl"', more), drop=["eye"])
    assert found.base.mass == pytest.approx(1.51)
    assert found.notes == ("products of inertia up to ", "body 'prop' is welded where it stands.")[1:]
