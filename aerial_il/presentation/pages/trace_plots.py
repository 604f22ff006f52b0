"""The traces of one flight that people read beside its film, for whatever robot, task and action level it was."""

from dataclasses import dataclass

import numpy as np

from aerial_il import robots
from aerial_il.core.errors import UnknownNameError
from aerial_il.data.episode import Episode

XYZ = ("x", "y", "z")
PER_CENT = (0.0, 100.0)
AIR = 0.05
MOST_SERIES = 8  # more lines in one chart cannot be told apart


@dataclass(frozen=True, eq=False)
class Series:
    """One line: (T + 1,) values, NaN where there is none; ``hue`` picks its colour. Commands, ``dashed``, come last."""

    label: str
    values: np.ndarray
    hue: int
    dashed: bool = False


@dataclass(frozen=True, eq=False)
class TracePlot:
    """A chart over the time of a flight; ``least`` is a range that its axis shows in any case."""

    title: str
    unit: str
    series: tuple[Series, ...]
    least: tuple[float, float] | None = None

    @property
    def range(self) -> tuple[float, float]:
        """Lowest and highest value that are shown, with some air."""
        values = np.concatenate([line.values for line in self.series])
        low, high = float(np.nanmin(values)), float(np.nanmax(values))
        if self.least is not None:
            low, high = min(low, self.least[0]), max(high, self.least[1])
        return low - AIR * (high - low), high + AIR * (high - low)


def trace_plots(episode: Episode) -> list[TracePlot]:
    """Return what the recording can show: position, distances, speed, attitude, arm, task, rotors, reward."""
    plots = [
        _position(episode),
        _distances(episode),
        _speed(episode),
        _tilt(episode),
        *_task_values(episode),
        _joints(episode),
        _gripper(episode),
        _rotors(episode),
        TracePlot("Reward", "", (Series("reward", _after(episode.rewards), 0),), (0.0, 1.0)),
    ]
    return [one for one in plots if one is not None and one.series]


def _position(episode: Episode) -> TracePlot | None:
    name = next((n for n in ("ee_pos", "base_pos") if n in episode.obs), None)
    if name is None:
        return None
    lines = [Series(axis, episode.obs[name][:, k], k) for k, axis in enumerate(XYZ)]
    if episode.spec.action.level == "ee_pose" and name == "ee_pos":
        commands = _after(episode.executed_actions[:, :3])
        lines += [Series(f"{axis} commanded", commands[:, k], k, dashed=True) for k, axis in enumerate(XYZ)]
    return TracePlot("End effector" if name == "ee_pos" else "Vehicle", "m", tuple(lines))


def _distances(episode: Episode) -> TracePlot | None:
    """Lengths of all task vectors ``a_to_b``."""
    vectors = [f.name for f in episode.spec.observation.of_group("task") if "_to_" in f.name and f.shape == (3,)]
    lines = [
        Series(name.replace("_", " "), 100.0 * _norm(episode.obs[name]), k)
        for k, name in enumerate(vectors[:MOST_SERIES])
    ]
    return TracePlot(_titled("Distances", len(vectors)), "cm", tuple(lines))


def _speed(episode: Episode) -> TracePlot | None:
    if "base_vel" not in episode.obs:
        return None
    return TracePlot("Speed of the base", "m/s", (Series("speed", _norm(episode.obs["base_vel"]), 0),))


def _tilt(episode: Episode) -> TracePlot | None:
    if "base_rot6d" not in episode.obs:
        return None
    rot6d = episode.obs["base_rot6d"]
    upward = rot6d[:, 0] * rot6d[:, 4] - rot6d[:, 1] * rot6d[:, 3]  # z of the third column, the cross product
    return TracePlot("Tilt of the base", "°", (Series("tilt", np.rad2deg(np.arccos(np.clip(upward, -1, 1))), 0),))


def _task_values(episode: Episode) -> list[TracePlot]:
    """Single numbers that the task observes, such as a valve's angle or a force, one chart for each unit."""
    by_unit: dict[str, list[tuple[str, np.ndarray]]] = {}
    for field in episode.spec.observation.of_group("task"):
        if field.size == 1:
            values = episode.obs[field.name].reshape(len(episode) + 1)
            by_unit.setdefault(field.unit, []).append((field.name.replace("_", " "), values))
    return [
        TracePlot(
            _titled("Task" if len(lines) > 1 else lines[0][0].capitalize(), len(lines)),
            unit,
            tuple(Series(label, values, k) for k, (label, values) in enumerate(lines[:MOST_SERIES])),
        )
        for unit, lines in by_unit.items()
    ]


def _joints(episode: Episode) -> TracePlot | None:
    angles = episode.obs.get("joint_pos")
    if angles is None or not angles.shape[1]:
        return None
    lines = [Series(f"joint {k}", np.rad2deg(angles[:, k]), k) for k in range(min(MOST_SERIES, angles.shape[1]))]
    return TracePlot(_titled("Arm", angles.shape[1]), "°", tuple(lines))


def _gripper(episode: Episode) -> TracePlot | None:
    if "gripper" not in episode.obs:
        return None
    opening = 100.0 * episode.obs["gripper"].reshape(len(episode) + 1)
    return TracePlot("Gripper", "% open", (Series("opening", opening, 0),), PER_CENT)


def _rotors(episode: Episode) -> TracePlot | None:
    """Commanded thrust in per cent of each rotor's most; needs the robot, so only where it is one of ours."""
    try:
        limits = robots.get(episode.spec.robot).vehicle.rotor_max
    except UnknownNameError:
        return None
    if not len(limits) or episode.ctrl.shape[1] < len(limits):
        return None
    share = _after(100.0 * episode.ctrl[:, : len(limits)] / limits)
    lines = [Series(f"rotor {k}", share[:, k], k) for k in range(min(MOST_SERIES, len(limits)))]
    return TracePlot(_titled("Thrust commanded", len(limits)), "%", tuple(lines), PER_CENT)


def _titled(title: str, count: int) -> str:
    """Return a title that says so where not all of ``count`` lines are drawn."""
    return title if count <= MOST_SERIES else f"{title}, the first {MOST_SERIES} of {count}"


def _after(values: np.ndarray) -> np.ndarray:
    """Put values (T, ...) of steps where the step ends: (T + 1, ...), the first of them NaN."""
    return np.concatenate([np.full((1, *values.shape[1:]), np.nan), values])


def _norm(vectors: np.ndarray) -> np.ndarray:
    return np.sqrt((vectors**2).sum(axis=1))
