"""Airframe files become rotors with the right signs, or errors that say what to write instead."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aerial_il import robots
from aerial_il.control.allocation import wrench_matrix
from aerial_il.core.errors import InvalidValueError
from aerial_il.robots.parts.airframe import (
    AirframeError,
    parse_airframe,
    read_airframe,
    stored_airframe,
)

QUAD = """
param set-default CA_ROTOR_COUNT 4
param set-default CA_ROTOR0_PX 0.3
param set-default CA_ROTOR0_PY 0.2
param set-default CA_ROTOR0_KM 0.05
param set-default CA_ROTOR1_PX -0.3
param set-default CA_ROTOR1_PY -0.2
param set-default CA_ROTOR1_KM 0.05
param set-default CA_ROTOR2_PX 0.3
param set-default CA_ROTOR2_PY -0.2
param set-default CA_ROTOR2_KM -0.05
param set-default CA_ROTOR3_PX -0.3
param set-default CA_ROTOR3_PY 0.2
param set-default CA_ROTOR3_KM -0.05
"""


def test_the_robot_flies_the_published_airframe() -> None:
    airframe, base = stored_airframe("big_four"), robots.get("big_four_z1").base
    px4 = 0.60093 * np.array([[1, 1], [-1, -1], [1, -1], [-1, 1]])
    np.testing.assert_array_equal(airframe.rotor_pos, np.column_stack([px4[:, 0], -px4[:, 1], np.zeros(4)]))
    np.testing.assert_array_equal(airframe.rotor_axis, np.tile([0.0, 0.0, 1.0], (4, 1)))
    np.testing.assert_array_equal(airframe.rotor_drag_ratio, [-0.05, -0.05, 0.05, 0.05])
    assert airframe.max_thrust is None
    for name in ("rotor_pos", "rotor_axis", "rotor_drag_ratio"):
        np.testing.assert_array_equal(getattr(base, name), getattr(airframe, name))


def test_px4_counts_to_the_right_and_down() -> None:
    frame = parse_airframe(QUAD + "param set-default CA_ROTOR0_PZ -0.1\n")
    np.testing.assert_allclose(frame.rotor_pos[0], [0.3, -0.2, 0.1])
    assert (frame.rotor_axis[:, 2] == 1.0).all()


def test_a_counter_clockwise_rotor_twists_the_body_clockwise() -> None:
    frame = parse_airframe(QUAD)
    wrench = wrench_matrix(frame.rotor_pos, frame.rotor_axis, frame.rotor_drag_ratio)
    assert wrench[5, 0] == pytest.approx(-0.05), "KM > 0: the reaction turns the nose to the right, against +z"
    assert wrench[5, 2] == pytest.approx(0.05)
    assert wrench[3, 0] < 0.0, "a rotor on the right rolls the body to the left"
    assert wrench[4, 0] < 0.0, "a rotor in front raises the nose"


def test_a_tilted_rotor_keeps_its_direction() -> None:
    tilted = parse_airframe(QUAD + "param set-default CA_ROTOR0_AX 0.6\nparam set-default CA_ROTOR0_AZ -0.8\n")
    np.testing.assert_allclose(tilted.rotor_axis[0], [0.6, 0.0, 0.8])
    right = parse_airframe(QUAD + "param set-default CA_ROTOR0_AY 1\nparam set-default CA_ROTOR0_AZ -1\n")
    np.testing.assert_allclose(right.rotor_axis[0], [0.0, -np.sqrt(0.5), np.sqrt(0.5)])


def test_other_lines_of_a_real_file_are_passed_over(tmp_path: Path) -> None:
    file = tmp_path / "4001_quad_x"
    more = "#!/bin/sh\n. ${R}etc/init.d/rc.mc_defaults\nset MIXER quad_x\nparam set-default MC_ROLLRATE_P 0.1 # ours\n"
    file.write_text(more + QUAD.replace("set-default", "set", 3), encoding="utf-8")
    np.testing.assert_array_equal(read_airframe(file).rotor_pos, parse_airframe(QUAD).rotor_pos)


def without(*lines: str) -> str:
    text = QUAD
    for line in lines:
        assert line in text
        text = text.replace(line + "\n", "")
    return text


@pytest.mark.parametrize(
    ("text", "line", "problem"),
    [
        (QUAD.replace("COUNT 4", "COUNT 5"), 0, "Rotor 4 of 5 is missing"),
        (QUAD.replace("COUNT 4", "COUNT 3"), 12, "Rotor 3 does not fit CA_ROTOR_COUNT 3 of line 2"),
        (QUAD.replace("COUNT 4", "COUNT 3.5"), 2, "whole number from 1 to 12, got 3.5"),
        (without("param set-default CA_ROTOR_COUNT 4"), 0, "CA_ROTOR_COUNT is missing"),
        (
            without("param set-default CA_ROTOR2_KM -0.05", "param set-default CA_ROTOR3_KM -0.05"),
            0,
            "Rotors 2, 3 have no",
        ),
        (QUAD.replace("ROTOR2_KM -0.05", "ROTOR2_KM 0"), 11, "CA_ROTOR2_KM is zero"),
        (QUAD.replace("KM -0.05", "KM 0.05"), 0, "cannot produce lift and three torques"),
        (QUAD.replace("ROTOR0_PX 0.3", "ROTOR0_PX"), 3, "Expected `param set-default NAME VALUE`"),
        (QUAD.replace("ROTOR0_PX 0.3", "ROTOR0_PX a"), 3, "CA_ROTOR0_PX is not a finite number: 'a'"),
        (QUAD.replace("ROTOR0_PX 0.3", "ROTOR0_PX nan"), 3, "CA_ROTOR0_PX is not a finite number: 'nan'"),
        (QUAD.replace("ROTOR0_PX", "ROTOR0_POSX"), 3, "Unknown rotor parameter CA_ROTOR0_POSX"),
        (QUAD.replace("ROTOR1_PX", "ROTOR0_PX"), 6, "CA_ROTOR0_PX was set in line 3 already"),
        (QUAD + "param set-default CA_ROTOR0_AZ 0\n", 15, "Rotor 0 has an axis of length zero"),
        (QUAD + "param set-default CA_ROTOR0_CT 0\n", 15, "CA_ROTOR0_CT, the thrust at full command, must be above 0"),
        (QUAD.replace("_PX 0.3", "_PX 0").replace("_PX -0.3", "_PX 0"), 0, "cannot produce lift and three torques"),
        ("", 0, "CA_ROTOR_COUNT is missing"),
    ],
)
def test_an_error_names_file_line_and_what_is_valid(text: str, line: int, problem: str) -> None:
    with pytest.raises(AirframeError) as caught:
        parse_airframe(text, "4001_quad_x")
    message = str(caught.value)
    assert message.startswith(f"4001_quad_x, line {line}: " if line else "4001_quad_x: ")
    assert problem in message
    assert "CA_ROTOR_COUNT and, for rotors 0 to CA_ROTOR_COUNT - 1, CA_ROTOR<i>_PX" in message


def test_a_file_that_cannot_be_read_is_an_airframe_error(tmp_path: Path) -> None:
    with pytest.raises(AirframeError, match="Cannot be read as text"):
        read_airframe(tmp_path / "nothing")
    (tmp_path / "picture").write_bytes(b"\x89PNG\xff\xfe")
    with pytest.raises(AirframeError, match="Cannot be read as text"):
        read_airframe(tmp_path / "picture")


def test_rotors_too_weak_for_the_arm_are_refused() -> None:
    robot = robots.get("big_four_z1")
    with pytest.raises(
        InvalidValueError, match=r"4 rotors lift at most 240.0 N, base and arm weigh 203.*CA_ROTOR<i>_CT"
    ):
        replace(robot, base=replace(robot.base, max_thrust=60.0))


def test_rotors_that_say_no_moment_have_that_of_px4(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Half of PX4's own airframe files leave it to the module's default."""
    file = tmp_path / "4001_quad_x"
    file.write_text(without("param set-default CA_ROTOR0_KM 0.05", "param set-default CA_ROTOR1_KM 0.05"))
    np.testing.assert_allclose(read_airframe(file).rotor_drag_ratio, parse_airframe(QUAD).rotor_drag_ratio)
    assert "Rotors 0, 1 have no CA_ROTOR<i>_KM, so that PX4's own 0.05 was taken" in caplog.text


def test_what_is_left_out_of_an_airframe_is_said() -> None:
    text = (
        QUAD + "param set-default CA_ROTOR1_TILT 2\nparam set-default CA_R_REV 5\nparam set-default CA_ROTOR0_TILT 0\n"
    )
    tilting, reversible = parse_airframe(text).notes
    assert tilting.startswith("Rotors 1 tilt by a servo")
    assert reversible.startswith("Rotors 0, 2 turn both ways")
    assert parse_airframe(QUAD).notes == ()
