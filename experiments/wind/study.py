"""The wind against its source: strength, correlation and spectra; and what its drag amounts to on each vehicle."""

from __future__ import annotations

import itertools
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from aerial_il import robots
from aerial_il.control.vehicle import GRAVITY
from aerial_il.core.arrays import length
from aerial_il.core.errors import InvalidValueError
from aerial_il.suite import tiers
from aerial_il.suite.disturbances.wind import (
    LARGEST_GUST,
    WORK_HEIGHT_M,
    Air,
    air_about,
    blow,
    drag,
    intensities,
    length_scales,
    mean_share,
)
from aerial_il.suite.timing import CONTROL_DT_S
from experiments.common.figures import force_lines, spectra
from experiments.common.report import Report, Row, Target

COMPONENTS = ("along the mean", "across", "up")
SEGMENT, BINS = 8192, 28  # steps of one periodogram, points of a drawn spectrum
LARGEST_DEVIATION_PERCENT = 5.0
SHOWN_S = 40.0
NOTES = (
    f"Wind at {WORK_HEIGHT_M:g} m above the ground, advanced every {1000 * CONTROL_DT_S:g} ms as in flight.",
    "Theory: MIL-F-8785C, low altitude; docs/tiers.md has the equations. Gusts are truncated at "
    f"{LARGEST_GUST:g} standard deviations.",
    "Drag: of a vehicle that is level and at rest in the wind, divided by its weight.",
)


@dataclass(frozen=True, kw_only=True)
class Wind:
    """Settings.

    Attributes:
        robots: names; empty for all that feel the air. tiers: names of tiers with wind. duration_s: simulated time.
        seed: of the wind.
    """

    name: ClassVar[str] = "wind"
    question: ClassVar[str] = "Does the wind match its model, and how hard does it push each vehicle?"

    robots: tuple[str, ...] = ()
    tiers: tuple[str, ...] = ("breeze", "gusts")
    duration_s: float = 20_000.0
    seed: int = 0

    def __post_init__(self) -> None:
        if self.duration_s < SEGMENT * CONTROL_DT_S:
            raise InvalidValueError(f"duration_s is at least {SEGMENT * CONTROL_DT_S:g} s, got {self.duration_s:g}.")
        if missing := [name for name in self.tiers if "wind" not in tiers.get(name).parts]:
            raise InvalidValueError(f"No wind in {', '.join(missing)}; tiers with wind: breeze, gusts, hard.")

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Simulate the wind and compare; see :class:`Study`."""
        started = time.perf_counter()
        flying = self.robots or tuple(name for name in robots.names() if robots.get(name).vehicle.drag.any())
        airs = {(robot, tier): _air(robot, tier) for robot in flying for tier in self.tiers}
        winds = {cell: self._blow(air) for cell, air in airs.items()}
        first = next(iter(airs))
        turbulence = _turbulence_rows(airs[first], winds[first])
        rows = [_force_row(*cell, airs[cell], winds[cell]) for cell in airs]
        frequency, measured, theory = _spectra(airs[first], winds[first])
        return Report(
            study=self,
            targets=tuple(target for row in turbulence for target in targets_of(row)),
            tables={"Wind and its drag": rows, f"Turbulence against theory ({', '.join(first)})": turbulence},
            notes=NOTES,
            figures={
                "spectra.svg": spectra(frequency, measured, theory),
                "drag.svg": force_lines(*_lines(winds, airs)),
            },
            wall_time_s=time.perf_counter() - started,
        )

    def _blow(self, air: Air) -> np.ndarray:
        steps = round(self.duration_s / CONTROL_DT_S)
        return blow(air, height=WORK_HEIGHT_M, seed=self.seed, dt=CONTROL_DT_S, steps=steps)


def _air(robot: str, tier: str) -> Air:
    wind: Any = tiers.get(tier).parts["wind"]
    return air_about(robots.get(robot).vehicle, wind.share)


def _force_row(robot: str, tier: str, air: Air, wind: np.ndarray) -> Row:
    vehicle = robots.get(robot).vehicle
    percent = _percent(robot, air, wind)
    return {
        "robot": robot,
        "tier": tier,
        "mass_kg": round(vehicle.mass, 2),
        "wind_at_6m_m_s": round(air.speed, 1),
        "mean_wind_m_s": round(float(wind[:, 0].mean()), 1),
        "gust_sd_m_s": round(float(wind[:, 0].std()), 2),
        "drag_mean_percent": round(float(percent[:, 0].mean()), 1),
        "drag_sd_percent": round(float(percent[:, 0].std()), 1),
        "drag_largest_percent": round(float(length(percent).max()), 1),
    }


def _turbulence_rows(air: Air, wind: np.ndarray) -> list[Row]:
    """Spread and correlation of each component, measured and from theory."""
    rows = []
    for k, name in enumerate(COMPONENTS):
        gust, sd, tau = wind[:, k] - wind[:, k].mean(), _spread(air)[k], _time_constants(air)[k]
        lag = max(1, round(tau / CONTROL_DT_S))
        ratio = lag * CONTROL_DT_S / tau
        expected = np.exp(-ratio) * (1.0 if k == 0 else 1.0 - 0.5 * ratio)
        rows.append(
            {
                "component": name,
                "sd_m_s": round(float(gust.std()), 4),
                "sd_theory_m_s": round(float(sd), 4),
                "time_constant_s": round(float(tau), 2),
                "correlation_there": round(float(np.mean(gust[lag:] * gust[:-lag]) / gust.var()), 3),
                "correlation_theory": round(float(expected), 3),
            }
        )
    return rows


def targets_of(row: Row) -> list[Target]:
    name = row["component"]
    spread = 100.0 * abs(row["sd_m_s"] / row["sd_theory_m_s"] - 1.0)
    memory = 100.0 * abs(row["correlation_there"] - row["correlation_theory"])
    limit = LARGEST_DEVIATION_PERCENT
    return [
        Target(f"{name}: deviation of the standard deviation", "at most", limit, spread, "%"),
        Target(f"{name}: deviation of the correlation after one time constant", "at most", limit, memory, "%"),
    ]


def _spectra(air: Air, wind: np.ndarray) -> tuple[list[float], Mapping[str, list[float]], Mapping[str, list[float]]]:
    """Frequencies (Hz), measured and theoretical densities (m²/s²/Hz), averaged over bins of equal ratio."""
    window = np.hanning(SEGMENT)
    parts = wind[: len(wind) // SEGMENT * SEGMENT].reshape(-1, SEGMENT, 3)
    parts = parts - wind.mean(axis=0)
    power = np.mean(np.abs(np.fft.rfft(parts * window[None, :, None], axis=1)) ** 2, axis=0)
    density, frequency = power * 2.0 * CONTROL_DT_S / np.sum(window**2), np.fft.rfftfreq(SEGMENT, CONTROL_DT_S)
    edges = np.geomspace(0.02, 10.0, BINS + 1)
    inside = [(frequency >= a) & (frequency < b) for a, b in itertools.pairwise(edges)]
    inside = [mask for mask in inside if mask.any()]
    theory = _theory(air, frequency)
    measured = {name: [float(density[m, k].mean()) for m in inside] for k, name in enumerate(COMPONENTS)}
    expected = {name: [float(theory[m, k].mean()) for m in inside] for k, name in enumerate(COMPONENTS)}
    return [float(frequency[m].mean()) for m in inside], measured, expected


def _theory(air: Air, frequency: np.ndarray) -> np.ndarray:
    """(F, 3) Dryden's one-sided densities, m²/s² per Hz."""
    x = (2.0 * np.pi * frequency[:, None] * _time_constants(air)) ** 2
    shape = np.where(np.arange(3) == 0, 4.0 / (1.0 + x), 2.0 * (1.0 + 3.0 * x) / (1.0 + x) ** 2)
    return _spread(air) ** 2 * _time_constants(air) * shape


def _lines(
    winds: Mapping[tuple[str, str], np.ndarray], airs: Mapping[tuple[str, str], Air]
) -> tuple[list[float], dict[str, dict[str, list[float]]]]:
    """Times and, by robot and tier, the drag along the mean wind over weight, every fifth step."""
    steps, found = round(SHOWN_S / CONTROL_DT_S), {}
    for (robot, tier), wind in winds.items():
        percent = _percent(robot, airs[robot, tier], wind[:steps:5])[:, 0]
        found.setdefault(robot, {})[tier] = [round(float(value), 2) for value in percent]
    return [round(CONTROL_DT_S * step, 2) for step in range(0, steps, 5)], found


def _percent(robot: str, air: Air, wind: np.ndarray) -> np.ndarray:
    """(T, 3) drag as a percentage of weight."""
    vehicle = robots.get(robot).vehicle
    return 100.0 * drag(vehicle, air, wind) / (vehicle.mass * GRAVITY)


def _spread(air: Air) -> np.ndarray:
    return air.speed * np.array(intensities(WORK_HEIGHT_M))


def _time_constants(air: Air) -> np.ndarray:
    return np.array(length_scales(WORK_HEIGHT_M)) / (air.speed * mean_share(WORK_HEIGHT_M))
