"""Numbers to fly by: what the observation says, along the heading, in centimetres and degrees.

They follow from the names, shapes and units of the observation's fields, so that a task has its numbers without a line
of its own; and from nothing but the observation, so that a person is shown no more than a policy is.

====================================  =======================================================
field of the task                     reading
====================================  =======================================================
``A_to_B`` (3,) m                     ahead, left, up: from A to B
``A_pos`` (3,) m                      from the tool to A, unless another field ends ``_to_A``
``target_rot6d`` (6,)                 turn of the tool that gives it the target's rotation
``A_rot6d`` (6,)                      turn that points the tool against A's z axis, squarely
``A_heading`` (2,) cos, sin           yaw of the tool to A; of four faces the nearest (cos4, sin4)
``heading_error`` (2,) cos, sin       yaw
``A_direction`` (2,) x, y             where it points, from straight ahead to the left
``A_axis`` (3,)                       lean from the vertical
``A_vel`` (3,) m/s                    ahead, left, up
other (3,)                            length of the vector
(1,)                                  the number
====================================  =======================================================

Others have no reading. The tool's own come last: height, where it points, opening of the gripper.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from aerial_il.core.rotations import (
    cross,
    dot,
    mat_from_yaw,
    matmul_back,
    norm,
    rotate,
    rotate_back,
    rotvec_from_mat,
    scale,
    sub,
    wrap_angle,
)
from aerial_il.core.specs import Field, ObservationSpec
from aerial_il.teleop.piloting.command import Vec3
from aerial_il.teleop.piloting.targets import Obs, heading, rotation, vector

SHOWN = {"m": (100.0, "cm"), "m/s": (100.0, "cm/s"), "rad": (180.0 / math.pi, "°"), "rad/s": (180.0 / math.pi, "°/s")}
DECIMALS = {"°": 0, "°/s": 0, "%": 0}  # 1 for other units
POLES = ("ahead", "back"), ("left", "right"), ("up", "down")
TURNS = ("left", "right"), ("nose down", "nose up"), ("roll right", "roll left")
FACES = {"cos2": 2, "cos4": 4}  # from how many sides a thing looks the same, by the label of its heading
PLAIN = (("", ""),)


@dataclass(frozen=True)
class Reading:
    """A row of numbers.

    Attributes:
        title: what it is of. poles: of each number, what to call it where it is positive and where negative; empty for
            one that speaks for itself. unit: SI unit of what ``read`` returns. read: the numbers, from an observation.
    """

    title: str
    poles: tuple[tuple[str, str], ...]
    unit: str
    read: Callable[[Obs], Sequence[float]]

    def numbers(self, obs: Obs) -> list[float]:
        """Return the numbers in the unit that is shown, rounded as they are shown."""
        factor, unit = SHOWN.get(self.unit, (1.0, self.unit))
        return [round(factor * value, DECIMALS.get(unit, 1)) for value in self.read(obs)]

    def to_dict(self) -> dict[str, Any]:
        """Return all but the numbers, as plain values."""
        unit = SHOWN.get(self.unit, (1.0, self.unit))[1]
        return {"title": self.title, "poles": [list(p) for p in self.poles], "unit": unit}


def readings_of(spec: ObservationSpec) -> tuple[Reading, ...]:
    """Return the readings of an observation, those of the task first."""
    readings = [reading for field in spec.of_group("task") if (reading := _task_reading(field, spec)) is not None]
    return (*readings, *_tool_readings(spec))


def _task_reading(field: Field, spec: ObservationSpec) -> Reading | None:
    name, thing, title = field.name, field.name.rpartition("_")[0], field.name.replace("_", " ")
    has_tool = {"ee_pos", "ee_rot6d"} <= set(spec.names)
    along = _along_heading(name)
    match field.shape, field.unit:
        case (3,), "m" if "_to_" in name:
            return Reading(title, POLES, "m", along)
        case (3,), "m" if name.endswith("_pos"):
            is_given = any(other.endswith(f"_to_{thing}") for other in spec.names)
            return Reading(f"tool to {thing}", POLES, "m", _from_tool(name)) if has_tool and not is_given else None
        case (6,), "" if name.endswith("_rot6d") and has_tool:
            if thing == "target":
                return Reading("turn to target", TURNS, "rad", _to_pose(name))
            return Reading(f"turn to face {thing}", TURNS, "rad", _to_face(name))
        case (2,), "" if name == "heading_error":
            return Reading("turn", TURNS[:1], "rad", lambda obs: [_angle(obs[name])])
        case (2,), "" if name.endswith("_heading") and has_tool and "heading_error" not in spec.names:
            return Reading(f"turn to {thing}", TURNS[:1], "rad", _to_heading(name, FACES.get(field.labels[0], 1)))
        case (2,), "" if name.endswith("_direction"):
            return Reading(title, TURNS[:1], "rad", lambda obs: [wrap_angle(_angle(obs[name]) - heading(obs))])
        case (3,), "m/s":
            return Reading(title, POLES, "m/s", along)
        case (3,), "" if name.endswith("_axis"):
            return Reading(f"{thing} leans", PLAIN, "rad", lambda obs: [_lean(vector(obs[name]))])
        case (3,), _:
            return Reading(title, PLAIN, field.unit, lambda obs: [norm(vector(obs[name]))])
        case (1,), _:
            return Reading(title, PLAIN, field.unit, lambda obs: [float(obs[name][0])])
    return None


def _tool_readings(spec: ObservationSpec) -> list[Reading]:
    readings = []
    if {"ee_pos", "ee_rot6d"} <= set(spec.names):
        readings.append(Reading("tool height", PLAIN, "m", lambda obs: [float(obs["ee_pos"][2])]))
        readings.append(Reading("tool points", (TURNS[1], TURNS[0]), "rad", _pointing))
    if "gripper" in spec.names:
        readings.append(Reading("gripper", (("open", "open"),), "%", lambda obs: [100.0 * float(obs["gripper"][0])]))
    return readings


def _along_heading(name: str) -> Callable[[Obs], Vec3]:
    return lambda obs: rotate_back(mat_from_yaw(heading(obs)), vector(obs[name]))


def _from_tool(name: str) -> Callable[[Obs], Vec3]:
    return lambda obs: rotate_back(mat_from_yaw(heading(obs)), sub(vector(obs[name]), vector(obs["ee_pos"])))


def _to_pose(name: str) -> Callable[[Obs], Vec3]:
    def read(obs: Obs) -> Vec3:
        tool = rotation(obs["ee_rot6d"])
        return _turns(obs, rotate(tool, rotvec_from_mat(matmul_back(tool, rotation(obs[name])))))

    return read


def _to_face(name: str) -> Callable[[Obs], Vec3]:
    def read(obs: Obs) -> Vec3:
        pointing, inward = rotation(obs["ee_rot6d"])[0::3], scale(-1.0, rotation(obs[name])[2::3])
        axis = cross(pointing, inward)
        sine, cosine = norm(axis), dot(pointing, inward)
        return _turns(obs, scale(math.atan2(sine, cosine) / max(sine, 1e-9), axis))

    return read


def _to_heading(name: str, faces: int) -> Callable[[Obs], Sequence[float]]:
    """Yaw from the tool's to that of a thing which looks the same from ``faces`` sides."""

    def read(obs: Obs) -> Sequence[float]:
        left = rotation(obs["ee_rot6d"])[1::3]  # the tool's y axis stays level however it points
        yaw = math.atan2(-left[0], left[1])
        return [wrap_angle(_angle(obs[name]) - faces * yaw) / faces]

    return read


def _turns(obs: Mapping[str, np.ndarray], rotvec: Vec3) -> Vec3:
    """Return a rotation vector of the world (rad) as turns to the left, nose down, right side down."""
    roll, pitch, yaw = rotate_back(mat_from_yaw(heading(obs)), rotvec)
    return yaw, pitch, roll


def _pointing(obs: Obs) -> tuple[float, float]:
    """Return how far the nose is down, 90° straight down and more if it leans back, and how far it points aside."""
    ahead, left, up = rotate_back(mat_from_yaw(heading(obs)), rotation(obs["ee_rot6d"])[0::3])
    return math.atan2(-up, ahead), math.asin(min(1.0, max(-1.0, left)))


def _lean(axis: Vec3) -> float:
    return math.atan2(math.hypot(axis[0], axis[1]), axis[2])


def _angle(cos_sin: np.ndarray) -> float:
    return math.atan2(float(cos_sin[1]), float(cos_sin[0]))
