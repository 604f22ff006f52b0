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
    FIELDS,
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


def without(line: str) -> str:
    assert line in QUAD
    return QUAD.replace(line + "\n", "")


def unsigned(*rotors: int) -> str:
    """The quadrotor without the KM of these rotors."""
    return "".join(line for line in QUAD.splitlines(True) if not any(f"ROTOR{i}_KM" in line for i in rotors))


def written(rotors: list[dict[str, float]], **settings: float) -> str:
    """An airframe file as PX4 has them, with comments, includes and shell variables."""
    lines = ["#!/bin/sh", "# @type Test", ". ${R}etc/init.d/rc.mc_defaults", "param set MAV_TYPE ${MAV_TYPE}"]
    lines += ["if param compare SYS_AUTOCONFIG 1", "then", "\tparam touch CAL_MAG0_ID", "fi"]
    lines += [f"param set-default {name} {value}" for name, value in settings.items()]
    lines += [f"param set-default CA_ROTOR_COUNT {len(rotors)}"]
    for i, rotor in enumerate(rotors):
        lines += [f"\tparam set-default CA_ROTOR{i}_{field} {value} # ours" for field, value in rotor.items()]
    return "\n".join(lines)


def ring(count: int) -> list[dict[str, float]]:
    """Rotors on a circle; only those that turn clockwise, every second one, say so."""
    angles = 2.0 * np.pi * (np.arange(count) + 0.5) / count
    places = [{"PX": round(0.4 * np.cos(angle), 4), "PY": round(0.4 * np.sin(angle), 4)} for angle in angles]
    return [place | ({"KM": -0.05} if i % 2 else {}) for i, place in enumerate(places)]


@pytest.mark.parametrize("count", [4, 6, 8, 12])
def test_a_rotor_without_moment_turns_as_the_autopilot_has_it(count: int) -> None:
    frame = parse_airframe(written(ring(count), CA_AIRFRAME=0, CA_METHOD=1))
    np.testing.assert_array_equal(frame.rotor_drag_ratio, np.tile([-0.05, 0.05], count // 2))
    (note,) = frame.notes
    assert note.startswith("No CA_ROTOR<i>_KM, taken as 0.05")
    assert note.endswith(f"write it, -0.05 for clockwise: rotors {', '.join(map(str, range(0, count, 2)))}.")


def test_what_was_assumed_is_printed_when_the_file_is_read(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    file = tmp_path / "quad"
    file.write_text(QUAD, encoding="utf-8")
    assert read_airframe(file).notes == ()
    assert caplog.text == ""
    file.write_text(unsigned(1), encoding="utf-8")
    read_airframe(file)
    (record,) = caplog.records
    assert record.getMessage().startswith(f"{file}: No CA_ROTOR<i>_KM, taken as 0.05")
    assert record.getMessage().endswith("for clockwise: rotor 1.")


def test_the_pusher_of_a_standard_vtol_is_left_out() -> None:
    pusher = {"AX": 1.0, "AZ": 0.0}
    frame = parse_airframe(written([*ring(4), pusher], CA_AIRFRAME=2, CA_SV_CS_COUNT=3))
    np.testing.assert_array_equal(frame.rotor_pos, parse_airframe(written(ring(4))).rotor_pos)
    assert frame.notes[1:] == (
        "Pushing ahead only (CA_AIRFRAME 2), left out: rotor 4.",
        "Control surfaces are left out.",
    )
    multirotor = parse_airframe(written([*ring(4), pusher]))
    np.testing.assert_array_equal(multirotor.rotor_axis[4], [1.0, 0.0, 0.0])
    assert "No CA_ROTOR<i>_PX and _PY, taken as 0: rotor 4." in multirotor.notes


def test_a_rotor_that_a_servo_tilts_stands_upright() -> None:
    rotors = ring(4)
    rotors[0] |= {"TILT": 2, "AX": 0.5}
    rotors[1] |= {"TILT": 0}
    frame = parse_airframe(written(rotors, CA_AIRFRAME=3, CA_SV_TL_COUNT=2))
    np.testing.assert_array_equal(frame.rotor_axis, np.tile([0.0, 0.0, 1.0], (4, 1)))
    assert frame.notes[-1] == "Tilted by a servo in PX4 (CA_ROTOR<i>_TILT), upright here: rotor 0."


def cube() -> list[dict[str, float]]:
    """Rotors in the corners of a cube, which push along all axes."""
    corners = [(x, y, z) for z in (-1, 1) for x in (1, -1) for y in (-1, 1)]
    axes = [(-0.79, -0.21, -0.58), (0.79, 0.21, -0.58), (0.21, -0.79, 0.58), (-0.21, 0.79, 0.58)]
    return [
        dict(zip(FIELDS, (*(0.15 * np.array(corner)), *axis, 0.05, 10.0), strict=False))
        for corner, axis in zip(corners, axes + axes[::-1], strict=True)
    ]


def test_reversible_rotors_push_either_way() -> None:
    frame = parse_airframe(written(cube(), CA_R_REV=255))
    assert frame.reversible.all()
    assert frame.max_thrust is not None
    assert frame.notes[-1].endswith("min_thrust=-max_thrust * reversible: rotors 0, 1, 2, 3, 4, 5, 6, 7.")
    base = replace(
        robots.get("big_four_z1").base,
        rotor_pos=frame.rotor_pos,
        rotor_axis=frame.rotor_axis,
        rotor_drag_ratio=frame.rotor_drag_ratio,
        max_thrust=frame.max_thrust,
        min_thrust=-frame.max_thrust * frame.reversible,
    )
    np.testing.assert_array_equal(base.rotor_min, -10.0)
    some = parse_airframe(written(ring(6), CA_R_REV=0b100010))
    np.testing.assert_array_equal(some.reversible, [False, True, False, False, False, True])
    assert not parse_airframe(QUAD).reversible.any()


def test_a_rotor_may_have_no_moment_of_its_own() -> None:
    frame = parse_airframe(QUAD.replace("ROTOR2_KM -0.05", "ROTOR2_KM 0"))
    np.testing.assert_array_equal(frame.rotor_drag_ratio, [-0.05, -0.05, 0.0, 0.05])


def test_thrusts_of_some_rotors_are_thrusts_of_none() -> None:
    frame = parse_airframe(QUAD + "param set-default CA_ROTOR1_CT 8\n")
    assert frame.max_thrust is None
    assert frame.notes == ("No CA_ROTOR<i>_CT, so that those of the others are left out: rotors 0, 2, 3.",)


TRICOPTER = written([{"PX": 0.2, "PY": 0.3}, {"PX": 0.2, "PY": -0.3}, {"PX": -0.4, "TILT": 1}], CA_AIRFRAME=8)


@pytest.mark.parametrize(
    ("text", "line", "problem"),
    [
        (QUAD.replace("COUNT 4", "COUNT 5"), 0, "Rotor 4 is missing: neither CA_ROTOR4_PX nor"),
        (QUAD.replace("COUNT 4", "COUNT 3"), 12, "Rotor 3 does not fit CA_ROTOR_COUNT 3 of line 2"),
        (QUAD.replace("COUNT 4", "COUNT 3.5"), 2, "whole number from 1 to 12, got 3.5"),
        (without("param set-default CA_ROTOR_COUNT 4"), 0, "CA_ROTOR_COUNT is missing"),
        (unsigned(0, 1, 2, 3), 0, "write it, -0.05 for clockwise: rotors 0, 1, 2, 3."),
        (TRICOPTER, 0, "(CA_ROTOR<i>_TILT), upright here: rotor 2."),
        (QUAD.replace("KM -0.05", "KM 0.05"), 0, "cannot produce lift and three torques"),
        (QUAD.replace("ROTOR0_PX 0.3", "ROTOR0_PX"), 3, "Expected `param set-default NAME VALUE`"),
        (QUAD.replace("ROTOR0_PX 0.3", "ROTOR0_PX a"), 3, "CA_ROTOR0_PX is not a finite number: 'a'"),
        (QUAD.replace("ROTOR0_PX 0.3", "ROTOR0_PX nan"), 3, "CA_ROTOR0_PX is not a finite number: 'nan'"),
        (QUAD.replace("ROTOR0_PX", "ROTOR0_POSX"), 3, "Unknown rotor parameter CA_ROTOR0_POSX"),
        (QUAD.replace("ROTOR1_PX", "ROTOR0_PX"), 6, "CA_ROTOR0_PX was set in line 3 already"),
        (QUAD + "param set-default CA_ROTOR0_AZ 0\n", 15, "Rotor 0 has an axis of length zero"),
        (QUAD + "param set-default CA_ROTOR0_CT 0\n", 15, "CA_ROTOR0_CT, the thrust at full command, must be above 0"),
        (QUAD.replace("_PX 0.3", "_PX 0").replace("_PX -0.3", "_PX 0"), 0, "cannot produce lift and three torques"),
        (QUAD + "param set-default CA_R_REV 1.5\n", 15, "CA_R_REV is a whole number of at least 0, got 1.5"),
        (". ${R}etc/init.d/rc.mc_defaults\nset MIXER quad_x\n", 0, "in a mixer (`set MIXER`), must be written here"),
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
