"""Tracking error of the tool, hovering and moving, in still air and in gusts.

Every world of one batch flies one motion with one seed. After a time to fly there and settle, the distance between
tool and reference is taken at each control step: the action is where the tool should be at the end of that step, as in
the environment's own ``ee_error_m``.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from aerial_il.control import controller_state
from aerial_il.core.arrays import length, rotation_cosine
from aerial_il.core.errors import InvalidValueError
from aerial_il.suite import tiers
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.scenario import Scenario
from experiments.common.figures import tracking_bars
from experiments.common.report import Report, Row, Target, bar
from experiments.common.seeds import EVALUATION_SEED
from experiments.tracking.motions import Kind, Motion, curves, poses

TASK = "reach"
STUDIED = ("fa_hexa_arm4", "ua_quad_arm4", "big_four_z1")
DEFAULT, UNOBSERVED = "geometric_observer", "geometric"
KINDS: tuple[Kind, ...] = ("hover", "moving")
LIMITS_CM: dict[tuple[str, str], dict[str, float]] = {
    (robot, tier): {"hover": hover, "moving": 1.5}
    for robot, hover in (("fa_hexa_arm4", 0.8), ("ua_quad_arm4", 0.8), ("big_four_z1", 1.0))
    for tier in ("calm", "gusts")
}
OBSERVED_SHARE = 0.8  # of the base's error in gusts without the disturbance observer
NOTES = (
    "RMSE: root mean square distance between tool and reference over the measured time of all runs together.",
    "Seed SD: standard deviation over seeds of each seed's own RMSE. Worst run: largest RMSE of one motion and seed.",
    "Base RMSE: distance between the base and the reference that the whole-body controller computed for it.",
    "Controllers: the same seeds under each control law (docs/controllers.md). Targets are for the default law, and "
    "for the benefit of its disturbance observer to the base in wind.",
    "Errors are computed from the true state; the controllers use the tier's noisy estimate of it.",
)


@dataclass(frozen=True, eq=False)
class Flights:
    """Measurements of W runs at T control steps.

    Attributes:
        motions: (W,) what each flew. seeds: (W,) with which seed.
        error_m: (T, W, 3) tool minus reference, world. base_error_m: (T, W) base to its own reference.
        angle_rad: (T, W) between wanted and actual tool orientation. crashed: (W,) bool.
    """

    motions: tuple[Motion, ...]
    seeds: np.ndarray
    error_m: np.ndarray
    base_error_m: np.ndarray
    angle_rad: np.ndarray
    crashed: np.ndarray

    def select(self, chosen: Iterable[bool]) -> Flights:
        """Return the runs where ``chosen`` (W,) is true."""
        mask = np.array(list(chosen), bool)
        motions = tuple(m for m, keep in zip(self.motions, mask, strict=True) if keep)
        columns = (self.error_m[:, mask], self.base_error_m[:, mask], self.angle_rad[:, mask])
        return Flights(motions, self.seeds[mask], *columns, self.crashed[mask])

    @property
    def run_rmse_m(self) -> np.ndarray:
        """(W,) root mean square distance of each run."""
        return _rms(length(self.error_m), axis=0)

    @property
    def seed_rmse_m(self) -> np.ndarray:
        """Root mean square distance of each seed over its motions, one number per distinct seed."""
        return np.array([_rms(self.run_rmse_m[self.seeds == seed]) for seed in np.unique(self.seeds)])


@dataclass(frozen=True, kw_only=True)
class Tracking:
    """Settings.

    Attributes:
        robots: names; empty for those that the suite states figures for. tiers: disturbance tiers. controllers: flight
            laws. seeds: how many. seed: the first of them. settle_s: flown before measuring. duration_s: measured.
        speed_m_s: of the moving reference. threads: of the simulation; 0 for all cores.
    """

    name: ClassVar[str] = "tracking"
    question: ClassVar[str] = "How closely does the tool follow a reference that is at rest or moving?"

    robots: tuple[str, ...] = ()
    tiers: tuple[str, ...] = ("calm", "gusts")
    controllers: tuple[str, ...] = (DEFAULT, "geometric", "pid")
    seeds: int = 16
    seed: int = EVALUATION_SEED
    settle_s: float = 6.0
    duration_s: float = 12.0
    speed_m_s: float = 0.2
    threads: int = 0

    def __post_init__(self) -> None:
        if self.seeds < 1 or self.duration_s <= 0.0 or self.settle_s < 0.0 or self.speed_m_s <= 0.0:
            raise InvalidValueError(
                "tracking needs seeds >= 1, duration_s > 0, settle_s >= 0 and speed_m_s > 0; got "
                f"{self.seeds}, {self.duration_s}, {self.settle_s} and {self.speed_m_s}."
            )

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Fly every robot, tier and flight law in one batch each; see :class:`Study`."""
        started = time.perf_counter()
        arms = list(product(self.robots or STUDIED, self.tiers, self.controllers))
        flown = {arm: self.fly(*arm) for arm in bar(arms, "tracking", progress)}
        rows = [row for arm in arms for row in tracking_rows(arm, flown[arm])]
        by_motion = [row for arm in arms if arm[2] == DEFAULT for row in _motion_rows(arm, flown[arm])]
        return Report(
            study=self,
            targets=(
                *(t for (robot, tier, law), f in flown.items() if law == DEFAULT for t in targets_of(robot, tier, f)),
                *observer_targets(flown),
            ),
            tables={"Tracking": rows, f"By motion, {DEFAULT}": by_motion},
            notes=(*NOTES, *map(_air, self.tiers)),
            figures={"tracking.svg": tracking_bars(rows, LIMITS_CM)},
            details={", ".join(arm): _runs(flown[arm]) for arm in arms},
            wall_time_s=time.perf_counter() - started,
        )

    def fly(self, robot: str, tier: str, controller: str) -> Flights:
        """Fly every motion with every seed, all at once."""
        motions = [motion for motion in (*poses(), *curves()) for _ in range(self.seeds)]
        seeds = np.resize(np.arange(self.seed, self.seed + self.seeds), len(motions))
        env = BatchEnvironment(Scenario(robot, TASK, tier, controller=controller), len(motions), self.threads)
        try:
            env.reset(seeds)
            return self._measure(env, motions, seeds)
        finally:
            env.close()

    def _measure(self, env: BatchEnvironment, motions: list[Motion], seeds: np.ndarray) -> Flights:
        settling, steps = (round(t / env.spec.control_dt_s) for t in (self.settle_s, self.settle_s + self.duration_s))
        times = env.spec.control_dt_s * np.arange(1, steps + 1)
        wanted = np.stack([motion.positions(times, self.speed_m_s) for motion in motions], axis=1)
        rot6d = np.stack([motion.rot6d for motion in motions])
        open_gripper = np.ones((len(motions), 1))
        view, crashed, found = env.simulation.view, np.zeros(len(motions), bool), []
        for step in range(steps):
            result = env.step(np.concatenate([wanted[step], rot6d, open_gripper], axis=1))
            crashed |= result.terminated
            if step >= settling:
                base_reference = view.userdata[:, controller_state.BASE_POS : controller_state.BASE_POS + 3]
                base_error = length(view.base_pos - base_reference)
                found.append((view.tool_pos - wanted[step], base_error, _angle(view.tool_mat, rot6d)))
        error, base_error, angle = (np.stack(parts) for parts in zip(*found, strict=True))
        return Flights(tuple(motions), seeds, error, base_error, angle, crashed)


def tracking_rows(arm: tuple[str, str, str], flights: Flights) -> list[Row]:
    return [_row(arm, kind, flights.select(m.kind == kind for m in flights.motions)) for kind in KINDS]


def _row(arm: tuple[str, str, str], kind: Kind, flights: Flights) -> Row:
    robot, tier, controller = arm
    return {
        "robot": robot,
        "tier": tier,
        "reference": kind,
        "controller": controller,
        "rmse_cm": _cm(_rms(flights.run_rmse_m)),
        "seed_sd_cm": _cm(_sd(flights.seed_rmse_m)),
        "worst_run_cm": _cm(flights.run_rmse_m.max()),
        "max_cm": _cm(length(flights.error_m).max()),
        "base_rmse_cm": _cm(_rms(flights.base_error_m)),
        "angle_rmse_deg": round(float(np.rad2deg(_rms(flights.angle_rad))), 2),
        "crashes": int(flights.crashed.sum()),
    }


def _motion_rows(arm: tuple[str, str, str], flights: Flights) -> list[Row]:
    """One row per motion, with the error along each world axis."""
    rows = []
    for name in dict.fromkeys(motion.name for motion in flights.motions):
        part = flights.select(motion.name == name for motion in flights.motions)
        axes = {f"{axis}_cm": _cm(_rms(part.error_m[..., k])) for k, axis in enumerate("xyz")}
        head = {"robot": arm[0], "tier": arm[1], "motion": name, "rmse_cm": _cm(_rms(part.run_rmse_m))}
        rows.append({**head, **axes, "max_cm": _cm(length(part.error_m).max())})
    return rows


def _runs(flights: Flights) -> dict[str, Row]:
    """Motion -> numbers of each seed in order, for who wants other statistics."""
    largest, base = length(flights.error_m).max(axis=0), _rms(flights.base_error_m, axis=0)
    found: dict[str, Row] = {}
    for w, motion in enumerate(flights.motions):
        numbers = {"rmse_cm": flights.run_rmse_m[w], "max_cm": largest[w], "base_rmse_cm": base[w]}
        for name, value in numbers.items():
            found.setdefault(motion.name, {}).setdefault(name, []).append(_cm(value))
    return found


def targets_of(robot: str, tier: str, flights: Flights) -> list[Target]:
    limits = LIMITS_CM.get((robot, tier), {})
    parts = {kind: flights.select(m.kind == kind for m in flights.motions) for kind in limits}
    return [
        Target(
            what=f"{robot}, {tier}, {kind}: tool RMSE",
            sense="at most",
            limit=limit,
            measured=_cm(_rms(parts[kind].run_rmse_m)),
            unit="cm",
            spread=f"SD over seeds {_cm(_sd(parts[kind].seed_rmse_m)):g} cm",
        )
        for kind, limit in limits.items()
    ]


def observer_targets(flown: Mapping[tuple[str, str, str], Flights]) -> Iterator[Target]:
    """Yield what the disturbance observer must bring in wind, to the base: what it is off by, the arm makes up for."""
    for (robot, tier, law), flights in flown.items():
        blind = flown.get((robot, tier, UNOBSERVED))
        if law != DEFAULT or blind is None or "wind" not in tiers.get(tier).parts:
            continue
        with_it, without = (float(_rms(found.base_error_m)) for found in (flights, blind))
        spread = f"{_cm(with_it):g} against {_cm(without):g} cm"
        what = f"{robot}, {tier}: base RMSE with the disturbance observer / without"
        yield Target(what, "at most", OBSERVED_SHARE, round(with_it / without, 3), "", spread)


def _angle(tool_mat: np.ndarray, rot6d: np.ndarray) -> np.ndarray:
    """(W,) rad between actual rotations (W, 9) and wanted ones given by their first two columns (W, 6)."""
    x, y = rot6d[:, :3], rot6d[:, 3:]
    wanted = np.stack([x, y, np.cross(x, y)], axis=2).reshape(-1, 9)
    return np.arccos(np.clip(rotation_cosine(tool_mat, wanted), -1.0, 1.0))


def _air(tier: str) -> str:
    wind: Any = tiers.get(tier).parts.get("wind")
    air = f"wind whose gusts change the drag by up to {100.0 * wind.share:g} % of weight" if wind else "still air"
    return f"{tier.capitalize()}: {air}."


def _rms(values: np.ndarray, axis: int | None = None) -> np.ndarray:
    return np.sqrt(np.mean(np.square(values), axis=axis))


def _sd(values: np.ndarray) -> float:
    return float(values.std(ddof=1)) if values.size > 1 else 0.0


def _cm(metres: float | np.ndarray) -> float:
    return round(100.0 * float(metres), 3)
