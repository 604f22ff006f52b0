"""Rotor geometry from a PX4 airframe file: lines such as ``param set-default CA_ROTOR0_PX 0.60093``.

PX4's body frame is forward-right-down and its moment coefficient KM is positive for a rotor that turns
counter-clockwise seen from above, which twists the body clockwise: ``torque = -KM * thrust * axis`` (PX4, control
allocation, ``ActuatorEffectivenessRotors``). Here, and only here, both become ours: forward-left-up, and a ratio of
torque to thrust about the thrust axis.
"""

from __future__ import annotations

import logging
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np

from aerial_il.control.allocation import mixer_matrix, wrench_matrix
from aerial_il.core.errors import AerialError, InvalidValueError

log = logging.getLogger(__name__)
FIELDS = ("PX", "PY", "PZ", "AX", "AY", "AZ", "KM", "CT", "TILT")
DEFAULTS = {"PX": 0.0, "PY": 0.0, "PZ": 0.0, "AX": 0.0, "AY": 0.0, "AZ": -1.0, "KM": 0.05}  # PX4's own
COUNT, REVERSIBLE = "CA_ROTOR_COUNT", "CA_R_REV"
VALID = f"{COUNT} and, for rotors 0 to {COUNT} - 1, " + ", ".join(f"CA_ROTOR<i>_{field}" for field in FIELDS)
MOST_ROTORS = 12  # PX4's limit
OURS_FROM_PX4 = np.array([1.0, -1.0, -1.0])

_PARAM = re.compile(r"param\s+(?P<verb>\S+)(?:\s+(?P<name>\S+))?(?:\s+(?P<value>\S+))?\s*(?:#.*)?$")
_ROTOR = re.compile(rf"CA_ROTOR(\d+)_({'|'.join(FIELDS)})$")

Rotor = dict[str, tuple[float, int]]  # field -> value and the line that sets it


class AirframeError(AerialError, ValueError):
    """An airframe file from which no vehicle can be built.

    Args:
        source: the file. line: its line, from 1; 0 where no single line is to blame. problem: what is wrong.
    """

    def __init__(self, source: str, line: int, problem: str) -> None:
        self.source, self.line = source, line
        where = f"{source}, line {line}" if line else source
        super().__init__(f"{where}: {problem} Valid parameters: {VALID}.")


@dataclass(frozen=True, eq=False)
class Airframe:
    """Rotors of one vehicle, in a frame that points forward, left and up.

    Attributes:
        rotor_pos: (R, 3) m. rotor_axis: (R, 3) unit thrust directions.
        rotor_drag_ratio: (R,) torque on the body about the thrust axis per newton of thrust, m.
        max_thrust: (R,) N at full command, or None where the file does not say (no CT).
        notes: what was taken for granted or left out, a sentence each.
    """

    rotor_pos: np.ndarray
    rotor_axis: np.ndarray
    rotor_drag_ratio: np.ndarray
    max_thrust: np.ndarray | None
    notes: tuple[str, ...] = ()


def read_airframe(path: str | Path) -> Airframe:
    """Read a PX4 airframe file; what was taken for granted or left out is logged.

    Raises:
        AirframeError: a malformed line, an unknown, missing or impossible rotor parameter, or rotors that cannot
            produce lift and three torques; with file, line and the valid parameters.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise AirframeError(str(path), 0, f"Cannot be read as text ({error}).") from error
    airframe = parse_airframe(text, str(path))
    for note in airframe.notes:
        log.warning("%s: %s", path, note)
    return airframe


def stored_airframe(name: str) -> Airframe:
    """Read an airframe that comes with the package, from ``aerial_il/robots/airframes``."""
    place = resources.files("aerial_il.robots") / "airframes" / name
    return parse_airframe(place.read_text(encoding="utf-8"), f"airframes/{name}")


def parse_airframe(text: str, source: str = "airframe") -> Airframe:
    """Read the text of an airframe file; ``source`` names it in errors. See :func:`read_airframe`."""
    count, rotors, reversible = _parameters(text, source)
    for i in range(count):
        _check_rotor(rotors.get(i, {}), i, count, source)
    silent = [i for i in range(count) if "KM" not in rotors[i]]
    columns = {f: np.array([_value(rotors[i], f) for i in range(count)]) for f in FIELDS}
    pos = np.stack([columns[f] for f in ("PX", "PY", "PZ")], axis=1) * OURS_FROM_PX4
    axis = np.stack([columns[f] for f in ("AX", "AY", "AZ")], axis=1) * OURS_FROM_PX4
    axis = axis / np.sqrt(np.square(axis).sum(axis=1, keepdims=True))
    thrust = columns["CT"] if np.isfinite(columns["CT"]).all() else None
    airframe = Airframe(pos, axis, -columns["KM"], thrust, tuple(_notes(rotors, silent, reversible)))
    try:
        mixer_matrix(wrench_matrix(pos, axis, airframe.rotor_drag_ratio))
    except InvalidValueError as error:
        guessed = f" {_without_moment(silent)}" if silent else ""
        raise AirframeError(source, 0, f"{error}{guessed}") from error
    return airframe


def _notes(rotors: dict[int, Rotor], silent: list[int], reversible: int) -> Iterator[str]:
    if silent:
        yield _without_moment(silent)
    if tilting := [i for i, rotor in sorted(rotors.items()) if _value(rotor, "TILT") > 0.0]:
        yield f"Rotors {_listed(tilting)} tilt by a servo (CA_ROTOR<i>_TILT); here they stay as their axes say."
    if both := [i for i in rotors if reversible >> i & 1]:
        yield f"Rotors {_listed(sorted(both))} turn both ways ({REVERSIBLE}); here they push along their axes alone."


def _without_moment(silent: list[int]) -> str:
    return (
        f"Rotors {_listed(silent)} have no CA_ROTOR<i>_KM, so that PX4's own 0.05 was taken, counter-clockwise. "
        "Write -0.05 for those that turn clockwise."
    )


def _listed(numbers: list[int]) -> str:
    return ", ".join(map(str, numbers))


def _parameters(text: str, source: str) -> tuple[int, dict[int, Rotor], int]:
    """Number of rotors, what the file says of each, and a bit for each that is reversible.

    Other parameters and shell commands are passed over.
    """
    count, count_line, reversible = None, 0, 0
    rotors: dict[int, Rotor] = {}
    for line, content in enumerate(text.splitlines(), start=1):
        setting = _setting(content, source, line)
        name, value = setting or ("", 0.0)
        if name == REVERSIBLE:
            reversible = int(value)
        if not name.startswith("CA_ROTOR"):
            continue
        if name == COUNT:
            count, count_line = _rotor_count(value, source, line), line
            continue
        match = _ROTOR.match(name)
        if match is None:
            raise AirframeError(source, line, f"Unknown rotor parameter {name}.")
        rotor, field = rotors.setdefault(int(match[1]), {}), match[2]
        if field in rotor:
            raise AirframeError(source, line, f"{name} was set in line {rotor[field][1]} already.")
        rotor[field] = value, line
    if count is None:
        raise AirframeError(source, 0, f"{COUNT} is missing, and parameters of {len(rotors)} rotors are there.")
    surplus = [i for i in rotors if i >= count]
    if surplus:
        line = min(line for _, line in rotors[surplus[0]].values())
        problem = f"Rotor {surplus[0]} does not fit {COUNT} {count} of line {count_line}: rotors count from 0."
        raise AirframeError(source, line, problem)
    return count, rotors, reversible


def _setting(content: str, source: str, line: int) -> tuple[str, float] | None:
    """Name and value of a ``param set`` or ``param set-default`` line; None for any other line."""
    content = content.strip()
    if content.split(maxsplit=1)[:1] != ["param"]:
        return None
    match = _PARAM.match(content)
    if match is None or match["verb"] not in ("set", "set-default") or match["value"] is None:
        raise AirframeError(source, line, f"Expected `param set-default NAME VALUE`, got {content!r}.")
    try:
        value = float(match["value"])
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise AirframeError(source, line, f"{match['name']} is not a finite number: {match['value']!r}.")
    return match["name"], value


def _rotor_count(value: float, source: str, line: int) -> int:
    if value != int(value) or not 1 <= value <= MOST_ROTORS:
        raise AirframeError(source, line, f"{COUNT} is a whole number from 1 to {MOST_ROTORS}, got {value:g}.")
    return int(value)


def _check_rotor(rotor: Rotor, i: int, count: int, source: str) -> None:
    """Refuse a rotor that is not there, has no sense of rotation, no direction or no thrust."""
    if "PX" not in rotor and "PY" not in rotor:
        raise AirframeError(source, 0, f"Rotor {i} of {count} is missing: neither CA_ROTOR{i}_PX nor _PY is set.")
    km, line = rotor.get("KM", (DEFAULTS["KM"], 0))
    if km == 0.0:
        problem = f"CA_ROTOR{i}_KM is zero: a rotor without drag torque has no sense of rotation and cannot yaw."
        raise AirframeError(source, line, problem)
    if not any(_value(rotor, field) for field in ("AX", "AY", "AZ")):
        raise AirframeError(source, max(line for _, line in rotor.values()), f"Rotor {i} has an axis of length zero.")
    if "CT" in rotor and rotor["CT"][0] <= 0.0:
        raise AirframeError(source, rotor["CT"][1], f"CA_ROTOR{i}_CT, the thrust at full command, must be above 0 N.")


def _value(rotor: Rotor, field: str) -> float:
    return rotor[field][0] if field in rotor else DEFAULTS.get(field, math.nan)
