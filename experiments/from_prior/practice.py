"""What practice brought round by round, and how far a policy fell below what it began with on the way."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from aerial_il.algorithms.jsrl import JSRL
from aerial_il.algorithms.run.folder import read_metrics
from aerial_il.evaluation.training_run import SETTLING, largest_dip_of, rollouts_of
from experiments.common.practised import Continued, Practised
from experiments.common.report import Row, Target
from experiments.common.stages import Cloned, Stages

MOST_DIP = 5.0  # points below the prior
LISTED, DRAWN = 16, 100  # rounds of a training that are kept, and that are drawn
IN_NAME = ("task", "demos", "arm", "draw")  # what a training is called by


@dataclass(frozen=True)
class Arm:
    """One training and what it stands for.

    Attributes:
        name: of the arm. demos: that its arm begins with. training: what is trained.
    """

    name: str
    demos: int
    training: Cloned | Practised | Continued

    @property
    def cell(self) -> tuple[str, int]:
        """Its task and the number of demonstrations to begin with."""
        return self.training.source.task, self.demos

    def head(self) -> Row:
        """Return what names it in a row about one training."""
        return {"arm": self.name, "task": self.cell[0], "demos": self.demos, "draw": self.training.source.draw}

    def begun(self, stages: Stages) -> tuple[int, float]:
        """Return the steps and the minutes of the practice whose policy it goes on from; zero where that is none."""
        prior = self.training.prior if isinstance(self.training, Continued) else None
        return (
            (prior.flown(stages.run_of(prior)), stages.minutes([prior])) if isinstance(prior, Practised) else (0, 0.0)
        )

    def flown(self, stages: Stages) -> int:
        """Return the control steps that all practice up to its final policy flew."""
        own = 0 if isinstance(self.training, Cloned) else self.training.flown(stages.run_of(self.training))
        return self.begun(stages)[0] + own

    def minutes(self, stages: Stages) -> float:
        """Return the wall time of its training, and of the practice that it goes on from, min."""
        return self.begun(stages)[1] + stages.minutes([self.training])


@dataclass(frozen=True, eq=False)
class Practice:
    """What the rounds of the practising arms cost and brought.

    Attributes:
        stages: of the study. arms: those that practised. beside: names of those whose dips no target judges.
    """

    stages: Stages
    arms: Sequence[Arm]
    beside: tuple[str, ...] = ()

    @cached_property
    def _told(self) -> dict[Arm, list[Row]]:
        """One row for each round of each training, as its metrics tell; the first row tells of its prior."""
        return {arm: list(self._rounds(arm)) for arm in self.arms}

    @property
    def listed(self) -> list[Row]:
        """Some of the rounds of all trainings, evenly spread."""
        return [row for rows in self._told.values() for row in spread_evenly(rows, LISTED)]

    @cached_property
    def on_the_way(self) -> list[Row]:
        """All evaluations on the way, without exploration, of the trainings that learn step by step."""
        return [row for arm in self.arms if isinstance(arm.training, Continued) for row in self._checkpoints(arm)]

    @property
    def lines(self) -> list[Row]:
        """Success along each training: of its evaluations on the way, else of what it flew to learn."""
        watched = {_name(row) for row in self.on_the_way}
        flown = [
            {**row, "percent": row["first_percent"], "faint": isinstance(arm.training, Continued)}
            for arm, rows in self._told.items()
            for row in spread_evenly(rows, DRAWN)
            if _name(row) not in watched and row["first_percent"] is not None
        ]
        return [*({**row, "faint": False} for row in self.on_the_way), *flown]

    @cached_property
    def dips(self) -> list[Row]:
        """One row for each arm: the largest dip of any of its trainings below what it began with, in points."""
        return [self._dip(group) for group in grouped(self.arms)]

    def targets(self) -> Iterator[Target]:
        """Yield that no method may fall far below its prior."""
        judged: dict[tuple[str, int], list[tuple[str, float, float | None]]] = {}
        for row in self.dips:
            exploring = None if row["dip"] is None else row["exploring_dip"]
            dip = row["exploring_dip"] if row["dip"] is None else row["dip"]
            if dip is not None and row["arm"] not in self.beside:
                judged.setdefault((row["task"], row["demos"]), []).append((row["arm"], dip, exploring))
        for (task, demos), dips in judged.items():
            spread = ", ".join(f"{arm} {dip:g}{'' if e is None else f' (exploring {e:g})'}" for arm, dip, e in dips)
            what = f"{task} from {demos}: largest dip below the prior, flown without exploration"
            yield Target(what, "at most", MOST_DIP, max(dip for _, dip, _ in dips), "points", spread)

    def _rounds(self, arm: Arm) -> Iterator[Row]:
        if isinstance(arm.training, Continued):
            yield from self._stretches(arm)
            return
        flown = 0
        for row in read_metrics(self.stages.run_of(arm.training))[1:]:
            flown += int(row["flight_steps"])
            first = row.get("starts_solved_first", row["flights_solved"] / row["flights"])
            yield {
                **arm.head(),
                "round": int(row["step"]),
                "first_percent": round(100 * first, 1),
                "solved_percent": round(100 * row.get("starts_solved", first), 1),
                "flown": flown,
                "minutes": _minutes(row),
            }

    def _stretches(self, arm: Arm) -> Iterator[Row]:
        """Yield one row for each stretch of a training between two rows of its metrics: episodes that ended in it.

        Steps and minutes go on from those of the practice it began with.
        """
        flown, minutes = arm.begun(self.stages)
        rows = [row for row in read_metrics(self.stages.run_of(arm.training)) if "episode/success" in row]
        for number, row in enumerate(rows, start=1):
            solved = round(100 * row["episode/success"], 1)
            alone = not isinstance(arm.training.algorithm, JSRL)  # a guide begins
            yield {
                **arm.head(),
                "round": number,
                "first_percent": solved if alone else None,
                "solved_percent": solved,
                "flown": flown + int(row["step"]),
                "minutes": _minutes(row, minutes),
            }

    def _checkpoints(self, arm: Arm) -> Iterator[Row]:
        """Yield one row for each evaluation on the way, the prior's first; steps and minutes as of its stretches.

        Evaluations do not tell their time: it lies between those of the rows before and after.
        """
        flown, minutes = arm.begun(self.stages)
        rows = read_metrics(self.stages.run_of(arm.training))
        steps, seconds = zip((0.0, 0.0), *((r["step"], r["elapsed_s"]) for r in rows if "elapsed_s" in r), strict=True)
        for rollouts in rollouts_of(rows):
            yield {
                **arm.head(),
                "percent": round(100 * rollouts.rate, 1),
                "flown": flown + rollouts.step,
                "minutes": round(minutes + float(np.interp(rollouts.step, steps, seconds)) / 60, 2),
            }

    def _dip(self, group: Sequence[Arm]) -> Row:
        told = {arm: self._told[arm] for arm in group}
        by_rounds = [
            largest_dip(rows, begun=arm.begun(self.stages)[0])
            for arm, rows in told.items()
            if rows and _has_prior(arm) and all(row["first_percent"] is not None for row in rows)
        ]
        by_flights = [dip for arm in group if (dip := self._flown_dip(arm)) is not None]
        stepwise = isinstance(group[0].training, Continued)
        return {
            "arm": group[0].name,
            "task": group[0].cell[0],
            "demos": group[0].demos,
            "dip": _largest(by_flights if stepwise else by_rounds),
            "exploring_dip": _largest(by_rounds) if stepwise else None,
            "rounds": sum(map(len, told.values())),
        }

    def _flown_dip(self, arm: Arm) -> float | None:
        """Return by how many points the flights on the way fell below those of the prior; None without such flights."""
        if not (isinstance(arm.training, Continued) and _has_prior(arm)):
            return None
        dip = largest_dip_of(read_metrics(self.stages.run_of(arm.training)))
        return None if dip is None else 100 * dip


def _has_prior(arm: Arm) -> bool:
    """Whether it begins with something that it could fall below."""
    return not isinstance(arm.training, Continued) or arm.training.prior is not None


def _largest(dips: Sequence[float]) -> float | None:
    return round(max(dips), 1) if dips else None


def _name(row: Row) -> tuple[Any, ...]:
    return tuple(row[key] for key in IN_NAME)


def by_training(rows: Sequence[Row]) -> dict[str, dict[str, list[Any]]]:
    """Return rows about single trainings column by column, for each training."""
    found: dict[str, dict[str, list[Any]]] = {}
    for row in rows:
        columns = found.setdefault("{} from {}, {}: {}".format(*_name(row)), {})
        for key, value in row.items():
            if key not in IN_NAME:
                columns.setdefault(key, []).append(value)
    return found


def spread_evenly(rounds: Sequence[Row], most: int) -> list[Row]:
    """Return at most so many of the rounds, evenly spread, the first and the last among them."""
    kept = np.linspace(0, len(rounds) - 1, min(most, len(rounds))).round().astype(int)
    return [rounds[k] for k in kept]


def largest_dip(rounds: Sequence[Row], *, begun: int = 0) -> float:
    """Return how far success was below that of the first round, in points, once the first steps were over.

    Args:
        rounds: from the first to the last, with ``first_percent`` and ``flown``. begun: steps flown before the first.
    """
    first, last = rounds[0]["first_percent"], rounds[-1]["flown"]
    judged = [row for row in rounds if row["flown"] - begun >= SETTLING * (last - begun)]
    return max(0.0, *(first - row["first_percent"] for row in judged))


def _minutes(row: Mapping[str, float], begun: float = 0.0) -> float | None:
    """Return the time up to a row of metrics, ``begun`` minutes before it; older runs of rounds do not tell it."""
    return round(begun + row["elapsed_s"] / 60, 2) if "elapsed_s" in row else None


def grouped(arms: Sequence[Arm]) -> Iterator[list[Arm]]:
    """Yield the trainings of each arm, which differ in their draws only."""
    groups: dict[tuple[Any, ...], list[Arm]] = {}
    for arm in arms:
        groups.setdefault((*arm.cell, arm.name), []).append(arm)
    yield from groups.values()
