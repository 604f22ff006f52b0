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
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np

from aerial_il.control.allocation import mixer_matrix, wrench_matrix
from aerial_il.core.errors import AerialError, InvalidValueError

FIELDS = ("PX", "PY", "PZ", "AX", "AY", "AZ", "KM", "CT", "TILT")
DEFAULTS = {"PX": 0.0, "PY": 0.0, "PZ": 0.0, "AX": 0.0, "AY": 0.0, "AZ": -1.0, "KM": 0.05, "TILT": 0.0}  # PX4's own
COUNT, KIND, REVERSIBLE, SURFACES = "CA_ROTOR_COUNT", "CA_AIRFRAME", "CA_R_REV", "CA_SV_CS_COUNT"
READ = (COUNT, KIND, REVERSIBLE, SURFACES)
VALID = (
    f"{COUNT} and, for rotors 0 to {COUNT} - 1, {', '.join(f'CA_ROTOR<i>_{field}' for field in FIELDS)}; {REVERSIBLE}"
)
MOST_ROTORS = 12  # PX4's limit
STANDARD_VTOL = 2  # a value of CA_AIRFRAME
AHEAD, ACROSS = 0.5, 0.1  # PX4: x of the thrust axis of a rotor that only pushes ahead is above, y and z are within
OURS_FROM_PX4 = np.array([1.0, -1.0, -1.0])

_ROTOR = re.compile(rf"CA_ROTOR(\d+)_({'|'.join(FIELDS)})$")

Settings = dict[str, tuple[float, int]]  # name of a parameter, or field of a rotor -> value and the line that sets it

log = logging.getLogger(__name__)


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
        reversible: (R,) whether the rotor turns both ways: ``min_thrust=-max_thrust * reversible`` of the base.
        notes: what was assumed or left out, a sentence each; logged when the file is read.
    """

    rotor_pos: np.ndarray
    rotor_axis: np.ndarray
    rotor_drag_ratio: np.ndarray
    max_thrust: np.ndarray | None
    reversible: np.ndarray
    notes: tuple[str, ...]


def read_airframe(path: str | Path) -> Airframe:
    """Read a PX4 airframe file, and log in a line what was assumed or left out.

    Raises:
        AirframeError: a malformed line, an unknown, missing or impossible rotor parameter, or rotors that cannot
            produce lift and three torques; with file, line and the valid parameters.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise AirframeError(str(path), 0, f"Cannot be read as text ({error}).") from error
    airframe = parse_airframe(text, str(path))
    if airframe.notes:
        log.warning("%s: %s", path, " ".join(airframe.notes))
    return airframe


def stored_airframe(name: str) -> Airframe:
    """Read an airframe that comes with the package, from ``aerial_il/robots/airframes``."""
    place = resources.files("aerial_il.robots") / "airframes" / name
    return parse_airframe(place.read_text(encoding="utf-8"), f"airframes/{name}")


def parse_airframe(text: str, source: str = "airframe") -> Airframe:
    """Read the text of an airframe file; ``source`` names it in errors. See :func:`read_airframe`."""
    settings = _settings(text, source)
    rotors = _rotors(settings, source)
    for i, rotor in enumerate(rotors):
        _check_rotor(rotor, i, source)
    flown = [i for i, rotor in enumerate(rotors) if not (_of(settings, KIND) == STANDARD_VTOL and _pushes(rotor))]
    columns = {f: np.array([_value(rotors[i], f) for i in flown]) for f in FIELDS}
    pos = np.stack([columns[f] for f in ("PX", "PY", "PZ")], axis=1) * OURS_FROM_PX4
    axis = np.array([_axis(rotors[i]) for i in flown]) * OURS_FROM_PX4
    thrust = columns["CT"] if np.isfinite(columns["CT"]).all() else None
    reversible = np.array([bool(_of(settings, REVERSIBLE) >> i & 1) for i in flown])
    notes = _notes(settings, rotors, flown)
    airframe = Airframe(pos, axis, -columns["KM"], thrust, reversible, notes)
    try:
        mixer_matrix(wrench_matrix(pos, axis, airframe.rotor_drag_ratio))
    except InvalidValueError as error:
        raise AirframeError(source, 0, " ".join((f"{error}", *notes))) from error
    return airframe


def _settings(text: str, source: str) -> Settings:
    """What the file says of rotors; other parameters and shell commands are passed over."""
    settings: Settings = {}
    for line, content in enumerate(text.splitlines(), start=1):
        setting = _setting(content, source, line)
        if setting is None:
            continue
        name, value = setting
        if name not in READ and not _ROTOR.match(name):
            raise AirframeError(source, line, f"Unknown rotor parameter {name}.")
        if name in settings:
            raise AirframeError(source, line, f"{name} was set in line {settings[name][1]} already.")
        settings[name] = value, line
    return settings


def _setting(content: str, source: str, line: int) -> tuple[str, float] | None:
    """Name and value of a ``param set`` or ``param set-default`` line about rotors; None for any other line."""
    words = content.partition("#")[0].split()
    if words[:1] != ["param"] or not any(word.startswith(("CA_ROTOR", *READ)) for word in words):
        return None
    if len(words) != 4 or words[1] not in ("set", "set-default"):
        raise AirframeError(source, line, f"Expected `param set-default NAME VALUE`, got {content.strip()!r}.")
    try:
        value = float(words[3])
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise AirframeError(source, line, f"{words[2]} is not a finite number: {words[3]!r}.")
    if words[2] in READ and words[2] != COUNT and (value != int(value) or value < 0):
        raise AirframeError(source, line, f"{words[2]} is a whole number of at least 0, got {value:g}.")
    return words[2], value


def _of(settings: Settings, name: str) -> int:
    """A whole number, 0 where the file does not say it, as PX4 has it."""
    return int(settings.get(name, (0, 0))[0])


def _rotors(settings: Settings, source: str) -> list[Settings]:
    """What the file says of each rotor."""
    rotors: dict[int, Settings] = {}
    for name, setting in settings.items():
        if match := _ROTOR.match(name):
            rotors.setdefault(int(match[1]), {})[match[2]] = setting
    if COUNT not in settings:
        problem = f"{COUNT} is missing, and parameters of {len(rotors)} rotors are there."
        advice = "Rotors that are in a file it includes, or in a mixer (`set MIXER`), must be written here."
        raise AirframeError(source, 0, f"{problem} {advice}")
    value, count_line = settings[COUNT]
    if value != int(value) or not 1 <= value <= MOST_ROTORS:
        raise AirframeError(source, count_line, f"{COUNT} is a whole number from 1 to {MOST_ROTORS}, got {value:g}.")
    count = int(value)
    surplus = [i for i in rotors if i >= count]
    if surplus:
        line = min(line for _, line in rotors[surplus[0]].values())
        problem = f"Rotor {surplus[0]} does not fit {COUNT} {count} of line {count_line}: rotors count from 0."
        raise AirframeError(source, line, problem)
    return [rotors.get(i, {}) for i in range(count)]


def _check_rotor(rotor: Settings, i: int, source: str) -> None:
    """Refuse a rotor that is not there, has no direction or no thrust."""
    if not rotor:
        raise AirframeError(source, 0, f"Rotor {i} is missing: neither CA_ROTOR{i}_PX nor any other of it is set.")
    if not any(_value(rotor, field) for field in ("AX", "AY", "AZ")):
        raise AirframeError(source, max(line for _, line in rotor.values()), f"Rotor {i} has an axis of length zero.")
    if "CT" in rotor and rotor["CT"][0] <= 0.0:
        raise AirframeError(source, rotor["CT"][1], f"CA_ROTOR{i}_CT, the thrust at full command, must be above 0 N.")


def _value(rotor: Settings, field: str) -> float:
    return rotor[field][0] if field in rotor else DEFAULTS.get(field, math.nan)


def _axis(rotor: Settings) -> np.ndarray:
    """Unit thrust direction (3,) in PX4's frame; a rotor that a servo tilts stands upright."""
    axis = np.array([_value(rotor, field) for field in ("AX", "AY", "AZ")])
    if _value(rotor, "TILT"):
        axis = np.array([DEFAULTS[field] for field in ("AX", "AY", "AZ")])
    return axis / np.sqrt(np.square(axis).sum())


def _pushes(rotor: Settings) -> bool:
    """Whether a rotor pushes ahead only, and stands still in hover."""
    x, y, z = _axis(rotor)
    return bool(x > AHEAD and abs(y) < ACROSS and abs(z) < ACROSS)


def _notes(settings: Settings, rotors: list[Settings], flown: list[int]) -> tuple[str, ...]:
    """What was assumed or left out, a sentence each."""
    km = DEFAULTS["KM"]
    silent = [i for i in flown if "CT" not in rotors[i]]
    found = {
        f"No CA_ROTOR<i>_KM, taken as {km:g}, PX4's default: counter-clockwise seen from above; write it, -{km:g} for "
        "clockwise": [i for i in flown if "KM" not in rotors[i]],
        "No CA_ROTOR<i>_PX and _PY, taken as 0": [i for i in flown if not {"PX", "PY"} & set(rotors[i])],
        "No CA_ROTOR<i>_CT, so that those of the others are left out": silent if len(silent) < len(flown) else [],
        "Tilted by a servo in PX4 (CA_ROTOR<i>_TILT), upright here": [i for i in flown if _value(rotors[i], "TILT")],
        f"Pushing ahead only ({KIND} {STANDARD_VTOL}), left out": [i for i in range(len(rotors)) if i not in flown],
        f"Turning both ways ({REVERSIBLE}): say so to the base, min_thrust=-max_thrust * reversible": [
            i for i in flown if _of(settings, REVERSIBLE) >> i & 1
        ],
    }
    notes = [
        f"{text}: rotor{'s'[: len(some) > 1]} {', '.join(map(str, some))}." for text, some in found.items() if some
    ]
    if _of(settings, SURFACES):
        notes.append("Control surfaces are left out.")
    return tuple(notes)
