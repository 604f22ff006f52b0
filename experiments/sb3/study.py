"""Reinforcement learning beside Stable-Baselines3: same tasks, networks, steps, worlds and published settings.

Both sides train in turn, so that a busy machine slows both: in one process with one thread, but for the other side on
``reach``, each of whose worlds has a process of its own. Every training is kept by all that decides it: killed at any
moment, the same call continues.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.files import write_json
from aerial_il.evaluation.statistics import t_interval
from experiments.common.notes import About, Note, notes_on
from experiments.common.outside import Learned, OutsideStages
from experiments.common.record import Record
from experiments.common.report import Report, Row, Target, bar
from experiments.common.seeds import EVALUATION_SEED
from experiments.common.stages import check_fewer
from experiments.sb3.cells import DIFFERENCES, Cell, cells
from experiments.sb3.curves import kept, return_curves
from experiments.sb3.theirs import INSTALLED, Found, learn

FEWER: Mapping[str, int] = {"ppo_reach": 1, "sac_half_cheetah": 1, "ppo_half_cheetah": 1}
OURS, THEIRS, FOUND = "ours", "sb3", "found.json"
FEWEST = 3  # trainings for an interval of a return whose bounds are unknown
NOTES: tuple[Note, ...] = (
    (
        "Return: mean over the episodes of each training's final policy, its mean action, on held-out seeds; then over "
        "trainings, which differ in weights, exploration and episodes. Its interval: Student's 95 % with a training as "
        f"the unit, given for {FEWEST} trainings or more, or where it is known what a return can be, and clipped to "
        "that.",
    ),
    (
        "Theirs: the settings that the authors of Stable-Baselines3 publish for it, one thread. Ours: the same but for "
        "what is named below.",
        About(
            ("ppo_reach",),
            "On `reach`, for which they publish none, both have the same; its worlds have a process each "
            "(SubprocVecEnv), ours are a batch.",
        ),
    ),
    DIFFERENCES,
    (
        "Sooner: seconds until the mean return of the last hundred episodes of training, with exploration, first "
        "reaches the lower of the two sides' highest, theirs over ours, by pairs of trainings; median.",
    ),
    ("Exploring: mean return of the last hundred episodes of training, flown with exploration.",),
    (About(tuple(FEWER), "Slow comparisons have one training run on each side (`bench.fewer`): {}."),),
    ("Steps per second: environment steps of the whole training over its time, learning included.",),
)


@dataclass(frozen=True, kw_only=True)
class Sb3:
    """Settings.

    Attributes:
        cells: which comparisons; empty for all. seeds: trainings on each side. episodes: that judge one.
        first_episode: the first of them.
        fewer: comparison -> with how many of the seeds it is made, where that takes long.
        steps_share: of the steps of each, to try the study; results at other shares are kept apart.
    """

    name: ClassVar[str] = "sb3"
    question: ClassVar[str] = "Does reinforcement learning here reach what it does in Stable-Baselines3, and how soon?"

    cells: tuple[str, ...] = ()
    seeds: tuple[int, ...] = (0, 1, 2)
    fewer: Mapping[str, int] = field(default_factory=lambda: dict(FEWER))
    episodes: int = 100
    first_episode: int = EVALUATION_SEED
    steps_share: float = 1.0

    def __post_init__(self) -> None:
        for name in self.cells:
            if name not in cells():
                raise UnknownNameError("comparison", name, tuple(cells()))
        check_fewer(self.fewer, cells(), "comparison")
        if not self.seeds or self.episodes < 1 or not 0.0 < self.steps_share <= 1.0:
            raise InvalidValueError("seeds name one at least, episodes start at 1, steps_share lies in (0, 1].")

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Train and judge what ``folder`` does not hold yet; see :class:`Study`."""
        if not INSTALLED:
            raise InvalidValueError("bench sb3 needs Stable-Baselines3: python -m pip install 'aerial-il[sb3]'.")
        stages = OutsideStages(record=Record(folder), episodes=self.episodes, progress=progress)
        chosen = {name: cell for name, cell in cells().items() if name in self.cells or not self.cells}
        trainings = [(name, seed) for name in chosen for seed in self.seeds[: self.fewer.get(name)]]
        found: dict[str, list[tuple[Found, Found]]] = {name: [] for name in chosen}
        for name, seed in bar(trainings, self.name, progress):
            found[name].append((self._ours(chosen[name], seed, stages), self._theirs(chosen[name], seed, stages)))
        rows = [row for name, pairs in found.items() for row in table_rows(name, chosen[name], pairs)]
        return Report(
            study=self,
            targets=tuple(target for name, pairs in found.items() for target in targets_of(name, chosen[name], pairs)),
            tables={"Both sides": rows},
            notes=tuple(notes_on(chosen, NOTES)),
            details={name: [[kept(side) for side in pair] for pair in pairs] for name, pairs in found.items()},
            figures={"sb3.svg": return_curves(found, (OURS, THEIRS))},
            wall_time_s=sum(side.seconds for pairs in found.values() for pair in pairs for side in pair),
        )

    def _steps(self, cell: Cell) -> int:
        return max(1, round(self.steps_share * cell.ours.steps))

    def _ours(self, cell: Cell, seed: int, stages: OutsideStages) -> Found:
        algorithm = replace(cell.ours, steps=self._steps(cell))
        training = Learned(cell.ours.name, cell.learned(), algorithm, cell.policy, seed, cell.worlds)
        result = stages.judged(training)
        return Found([e.return_ for e in result.episodes], stages.seconds(training), stages.curve(training))

    def _theirs(self, cell: Cell, seed: int, stages: OutsideStages) -> Found:
        steps, judging = self._steps(cell), {"episodes": self.episodes, "judge_seed": self.first_episode}
        decided_by = {
            "theirs": cell.theirs.decided_by(),
            "steps": steps,
            "worlds": cell.worlds,
            "seed": seed,
            **judging,
            **cell.learned().stands_on,
        }
        label = f"{cell.task}/{cell.theirs.algorithm}/{seed}".replace(":", "-")
        file = stages.record.place("peer", label, decided_by) / FOUND
        if not file.exists():
            found = learn(cell.theirs, cell.maker(), steps=steps, worlds=cell.worlds, seed=seed, **judging)
            write_json(file, asdict(found))
        return Found(**json.loads(file.read_text()))


def table_rows(name: str, cell: Cell, pairs: Sequence[tuple[Found, Found]]) -> list[Row]:
    """Return a row for each side."""
    sooner = times_sooner(pairs)
    rows = []
    for k, side in enumerate((OURS, THEIRS)):
        means = np.array([np.mean(pair[k].returns) for pair in pairs])
        seconds, steps = (np.array([value(pair[k]) for pair in pairs]) for value in (_seconds, _steps_of))
        rows.append(
            {
                "comparison": name,
                "side": side,
                "worlds": cell.worlds,
                "steps": _whole(steps.mean()),
                "trainings": len(pairs),
                "return": round(float(means.mean()), 1),
                **interval_ends(means, cell.bounds),
                "each": " ".join(f"{mean:.0f}" for mean in means),
                "exploring": _exploring([pair[k] for pair in pairs]),
                "train_s": round(float(seconds.mean()), 1),
                "steps_per_s": _whole((steps / seconds).mean()),
                "sooner": None if k or sooner is None else round(float(np.median(sooner)), 2),
            }
        )
    return rows


def targets_of(name: str, cell: Cell, pairs: Sequence[tuple[Found, Found]]) -> list[Target]:
    ours, theirs = (np.array([np.mean(pair[k].returns) for pair in pairs]) for k in (0, 1))
    spread = f"{_said(ours)}; Stable-Baselines3 {_said(theirs)}"
    targets = []
    if cell.wanted is not None:
        targets.append(Target(f"{name}: return", "at least", cell.wanted, float(ours.mean()), "", spread))
    if cell.as_theirs or cell.sooner is not None:
        what, wanted = f"{name}: return without exploration, no worse than theirs", round(float(theirs.mean()), 1)
        targets.append(Target(what, "at least", wanted, float(ours.mean()), "", spread))
    if cell.sooner is not None:
        sooner = times_sooner(pairs)
        each = "never" if sooner is None else " ".join(f"{value:.2f}" for value in sooner)
        measured = 0.0 if sooner is None else float(np.median(sooner))
        what = f"{name}: times sooner at the same return with exploration"
        targets.append(Target(what, "at least", cell.sooner, measured, "", each))
    return targets


def times_sooner(pairs: Sequence[tuple[Found, Found]]) -> list[float] | None:
    """Return of each pair how many times sooner ours first has what both reach; None without curves."""
    if not all(side.curve for pair in pairs for side in pair):
        return None
    found = []
    for ours, theirs in pairs:
        both = min(max(point[2] for point in side.curve) for side in (ours, theirs))
        when = [next(seconds for _, seconds, mean in side.curve if mean >= both) for side in (ours, theirs)]
        found.append(when[1] / when[0])
    return found


def _exploring(found: Sequence[Found]) -> float | None:
    last = [side.curve[-1][2] for side in found if side.curve]
    return round(float(np.mean(last)), 1) if last else None


def _seconds(found: Found) -> float:
    return found.seconds


def _steps_of(found: Found) -> float:
    return found.curve[-1][0] if found.curve else float("nan")


def _whole(value: float) -> int | None:
    """Return a number without its fraction; None where there is none, as without a curve."""
    return int(value) if np.isfinite(value) else None


def interval_ends(means: np.ndarray, bounds: tuple[float, float]) -> Mapping[str, Any]:
    """Return both ends of the interval of a mean return within its bounds; None where there is none to speak of."""
    found = np.clip(t_interval(means), *bounds)
    told = np.isfinite(found).all() and (len(means) >= FEWEST or np.isfinite(bounds).all())
    return dict(zip(("low", "high"), found.round(1).tolist() if told else (None, None), strict=True))


def _said(means: np.ndarray) -> str:
    return f"{means.mean():.0f} ({' '.join(f'{mean:.0f}' for mean in means)})"
