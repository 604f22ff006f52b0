"""Demonstrations out of one: how often generated flights succeed, and how well a clone of them flies.

Each draw has one flight of the expert, the source. It is generated from for every robot and in several tiers, and a
clone of what was generated flies, on each robot, beside three controls: a clone of as many flights of the expert, one
of as many with half of them in gusts, and one of the source alone. On a few tasks three more ways are compared: with
noise, out of six sources, and out of the nearest of six. All are judged on the same reserved seeds.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any, ClassVar

import aerial_il
from aerial_il.algorithms.bc import BC
from aerial_il.core.contracts import Policy
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.data.dataset import Dataset
from aerial_il.data.folder import DEMOS, FAILURES, DatasetFolder
from aerial_il.data.joined import Joined
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.evaluation.statistics import wilson
from aerial_il.generation.generator import Select
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.network import PolicySettings
from aerial_il.suite import tasks as registered
from aerial_il.workflows.generate import Generate, generate
from aerial_il.workflows.segment import Segmentation, segment
from experiments.common.demonstrations import GENERATION_SEED, SEEDS_PER_DRAW, Source, collections
from experiments.common.plain import plain
from experiments.common.record import RECORD, Record
from experiments.common.report import Report, Row, Target, bar
from experiments.common.seeds import EVALUATION_SEED, check_seeds
from experiments.common.stages import Cloned, Shown, Stages, all_that_decides
from experiments.common.success import failed_seeds, pooled_rows

GENERATED, BOTH, AS_MANY, ALONE = "generated", "both", "as_many", "alone"
EXPERT_IN_BOTH = "expert_in_both"
NOISY, SIX, SIX_IN_BOTH, NEAREST = "noisy", "six", "six_in_both", "nearest"
SHORT, LONG = "short", "long"
EVERYWHERE = (GENERATED, BOTH, AS_MANY, EXPERT_IN_BOTH, ALONE)
ARMS = (*EVERYWHERE, NOISY, SIX, SIX_IN_BOTH, NEAREST, SHORT, LONG)
LEADS = {SHORT: -12, LONG: 25}  # steps, of 30 or so in which the tool goes the 10 cm before a cut's thing moves
WITH_OBJECTS = (
    "pick_place", "insert_peg", "press_button", "open_door", "push_slider", "pull_lever", "rotate_valve",
    "inspect_contact",
)  # fmt: skip
BESIDE = "gusts"  # where half of what the arm "both" learns from is generated
WANTED = {"calm": 98.0, "gusts": 90.0, "hard": 95.0}  # % of generated flights, by tier, of the robot of the source
ACROSS = {"ua_quad_arm4": 95.0, "big_four_z1": 90.0}  # likewise on other robots, in calm air
CLONES = {"pick_place": (99.0, 95.0), "insert_peg": (98.0, 90.0)}  # % calm and gusts
OTHER_CLONES = (95.0, 85.0)


@dataclass(frozen=True)
class Out:
    """How flights are generated.

    Attributes:
        shown: whose flights they are generated out of. sources: how many of them. select, noise: of the generator.
        lead: steps by which each cut begins earlier than where it is found.
    """

    shown: Source
    sources: int = 1
    select: Select = "random"
    noise: float = 0.0
    lead: int = 0

    def decided_by(self) -> dict[str, Any]:
        """Return all that decides what is generated, but for where."""
        return {**plain(self), "shown": self.shown.decided_by()}


@dataclass(frozen=True, eq=False)
class GeneratedFrom(Shown):
    """A clone of what was generated for the cell of its source.

    Attributes:
        algorithm: how it is cloned. out: of what. flights: how many are generated; it learns from the successes.
        beside: a further tier in which as many are generated, half of them in each.
    """

    algorithm: BC
    out: Out
    flights: int
    beside: str | None = None

    def decided_by(self) -> dict[str, Any]:
        beside = {} if self.beside is None else {"beside": self.beside}
        return {**all_that_decides(self), "out": self.out.decided_by(), "flights": self.flights, **beside}

    def train(self, stages: Stages, run: Path) -> Policy:
        tiers = [self.source.tier] if self.beside is None else [self.source.tier, self.beside]
        each = self.flights // len(tiers)
        made = [generated(stages, self.out, self.source.robot, tier, each) for tier in tiers]
        shown = made[0] if len(made) == 1 else Joined(made)
        return self.algorithm.train(shown, self.policy, run=run, seed=self.source.draw, progress=stages.progress)


@dataclass(frozen=True, eq=False)
class ClonedInBoth(Cloned):
    """A clone of the expert's flights, half of them in :data:`BESIDE`."""

    def decided_by(self) -> dict[str, Any]:
        return {**all_that_decides(self), "beside": BESIDE}

    def train(self, stages: Stages, run: Path) -> Policy:
        sources = self.source, replace(self.source, tier=BESIDE)
        shown = Joined([stages.demonstrations(source, self.demos // 2) for source in sources])
        return self.algorithm.train(shown, self.policy, run=run, seed=self.source.draw, progress=stages.progress)


@dataclass(frozen=True, kw_only=True)
class Generation:
    """Settings.

    Attributes:
        policy: what is cloned. cloning: how. robot: of the sources. others: robots that it is generated for, too.
        tasks: which. compared: those of them on which all arms are flown; others fly the first five.
        tiers: that it is generated in, the first of which clones learn from; the sources are flown there.
        flown_in: tiers that judge clones. flights: generated for each robot. few: in other tiers.
        noise: of the arm with noise. arms: clones, of which other robots fly the first. draws: of sources and weights.
        episodes: that judge a clone. first_episode: the first of them. num_envs: worlds flown at once.
        threads: of the simulation; 0 for all cores.
    """

    name: ClassVar[str] = "generation"
    question: ClassVar[str] = "How many demonstrations, and how good a clone, come out of a single flight?"

    policy: PolicySettings = field(default_factory=MLP)
    cloning: BC = field(default_factory=BC)
    robot: str = "fa_hexa_arm4"
    others: tuple[str, ...] = tuple(ACROSS)
    tasks: tuple[str, ...] = WITH_OBJECTS
    compared: tuple[str, ...] = ("pick_place", "insert_peg")
    tiers: tuple[str, ...] = ("calm", "gusts", "hard")
    flown_in: tuple[str, ...] = ("calm", "gusts")
    flights: int = 400
    few: int = 200
    noise: float = 0.3
    arms: tuple[str, ...] = ARMS
    draws: tuple[int, ...] = (0, 1, 2)
    episodes: int = 200
    first_episode: int = EVALUATION_SEED
    num_envs: int = 50
    threads: int = 0

    def __post_init__(self) -> None:
        for task in self.tasks:
            registered.get(task)
        for arm in self.arms:
            if arm not in ARMS:
                raise UnknownNameError("arm", arm, ARMS)
        if not (self.draws and self.tiers) or min(self.flights, self.few, self.episodes, self.num_envs) < 1:
            raise InvalidValueError("draws and tiers name one at least; flights, few, episodes, num_envs start at 1.")
        check_seeds(self.first_episode, self.episodes)

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Fly, generate, train and judge what ``folder`` does not hold yet; see :class:`Study`."""
        stages = Stages(record=Record(folder), num_envs=self.num_envs, threads=self.threads, progress=progress)
        flown = [self._flown(stages, *cell) for cell in bar(list(self._cells()), self.name, progress)]
        work = list(product(self._trainings(), self.flown_in))
        seeds = range(self.first_episode, self.first_episode + self.episodes)
        results = {key: stages.judged(key[0], key[1], seeds) for key in bar(work, "clones", progress)}
        clones = list(_clone_rows(results))
        return Report(
            study=self,
            targets=(*self._flight_targets(flown), *_clone_targets(clones)),
            tables={"Generated": flown, "Clones": clones},
            notes=(*NOTES, *stages.record.notes()),
            details={"failed_seeds": {f"{t.label}, {tier}": failed_seeds(r) for (t, tier), r in results.items()}},
            wall_time_s=stages.seconds(),
        )

    def _cells(self) -> Iterator[tuple[str, str, str]]:
        """Yield robot, tier and task of what is generated: the sources' robot in all tiers, others in the first."""
        for task in self.tasks:
            yield from ((self.robot, tier, task) for tier in self.tiers)
            yield from (
                (other, self.tiers[0], task) for other in self.others if (other, task) in aerial_il.list_cells()
            )

    def _source(self, task: str, draw: int) -> Source:
        return Source(robot=self.robot, task=task, tier=self.tiers[0], draw=draw)

    def _flown(self, stages: Stages, robot: str, tier: str, task: str) -> Row:
        """Return how often flights that were generated for a cell succeed, over all draws."""
        count, won, seconds = self.flights if tier == self.tiers[0] else self.few, list[int](), 0.0
        for draw in self.draws:
            dataset = generated(stages, Out(self._source(task, draw)), robot, tier, count)
            won.append(len(DatasetFolder(dataset.path).files(DEMOS)))
            seconds += sum(run["seconds"] for run in collections([Path(dataset.path)]))
        low, high = wilson(sum(won), count * len(won))
        head = {"robot": robot, "tier": tier, "task": task, "sources": len(won), "flown": count * len(won)}
        percents = [round(100 * each / count, 1) for each in won]
        return {
            **head,
            "success": sum(won),
            "percent": round(100 * sum(won) / (count * len(won)), 1),
            "flights_low": round(100 * low, 1),
            "flights_high": round(100 * high, 1),
            "worst": min(percents),
            "best": max(percents),
            "a_minute": round(60 * sum(won) / seconds),
        }

    def _trainings(self) -> Iterator[GeneratedFrom | Cloned]:
        for draw, task in product(self.draws, self.tasks):
            source = self._source(task, draw)
            by_arm: dict[str, GeneratedFrom | Cloned] = {
                GENERATED: self._generated(GENERATED, Out(source)),
                BOTH: self._generated(BOTH, Out(source), beside=BESIDE),
                AS_MANY: Cloned(AS_MANY, replace(source, noise=0.3), self.flights, self.policy, self.cloning),
                EXPERT_IN_BOTH: ClonedInBoth(
                    EXPERT_IN_BOTH, replace(source, noise=0.3), self.flights, self.policy, self.cloning
                ),
                ALONE: Cloned(ALONE, source, 1, self.policy, replace(self.cloning, validation=0.0)),
                NOISY: self._generated(NOISY, Out(source, noise=self.noise)),
                SIX: self._generated(SIX, Out(source, sources=6)),
                SIX_IN_BOTH: self._generated(SIX_IN_BOTH, Out(source, sources=6), beside=BESIDE),
                NEAREST: self._generated(NEAREST, Out(source, sources=6, select="nearest")),
                **{arm: self._generated(arm, Out(source, lead=lead)) for arm, lead in LEADS.items()},
            }
            yield from (by_arm[arm] for arm in self.arms if task in self.compared or arm in EVERYWHERE)
        for robot, draw, task in product(self.others, self.draws, self.tasks):
            if (robot, task) in aerial_il.list_cells():
                out = Out(self._source(task, draw))
                yield from (
                    self._generated(arm, out, robot=robot, beside=beside)
                    for arm, beside in ((GENERATED, None), (BOTH, BESIDE))
                    if arm in self.arms
                )

    def _generated(self, arm: str, out: Out, *, robot: str = "", beside: str | None = None) -> GeneratedFrom:
        judged = replace(out.shown, robot=robot or self.robot)
        return GeneratedFrom(arm, judged, out.sources, self.policy, self.cloning, out, self.flights, beside)

    def _flight_targets(self, rows: list[Row]) -> Iterator[Target]:
        for row in rows:
            limit = WANTED[row["tier"]] if row["robot"] == self.robot else ACROSS.get(row["robot"])
            if limit is not None:
                what = f"generated from one flight: {row['robot']}, {row['tier']}, {row['task']}"
                spread = (
                    f"flights {row['flights_low']} to {row['flights_high']}; sources {row['worst']} to {row['best']}"
                )
                yield Target(what, "at least", limit, row["percent"], "%", spread)


NOTES = (
    "Generated: flights out of one flight of the expert without noise, by the first robot in calm air; a row "
    "has as many sources as draws, each flown as often. Flights: Wilson's 95 % interval over all of them; worst and "
    "best: of single sources. A minute: successes of wall time, recorded.",
    "Clones of what was generated: each training has its own source and weights; other robots' learn from what was "
    "generated for them out of the same flight. both: of as many flights, half of them generated in gusts. "
    "Controls: as_many, a clone of as many flights of the expert with its default noise; expert_in_both, of as many, "
    "half of them in gusts; alone, one of the single flight. noisy: generated with noise; six: out of six flights of "
    "the expert; six_in_both: out of these, half of them in gusts; nearest: out of whichever of these six is nearest; "
    "short, long: with cuts that begin .24 s later, and .5 s earlier, than they are found to.",
)


def generated(stages: Stages, out: Out, robot: str, tier: str, count: int) -> Dataset:
    """Return ``count`` flights as the command generates them, flying what is missing."""
    shown, decided_by = out.shown, {"out": out.decided_by(), "robot": robot, "tier": tier}
    place = stages.record.place("datasets", f"generated/{robot}-{shown.task}-{tier}/{shown.draw}", decided_by)
    stages.places.setdefault("datasets", {})[place] = None
    folder, first = DatasetFolder(place), GENERATION_SEED + SEEDS_PER_DRAW * shown.draw
    if len(folder.files(DEMOS)) + len(folder.files(FAILURES)) < count:
        generate(
            Generate(
                dataset=str(_sources(stages, out)), sources=out.sources, out=str(place),
                robot=robot, tier=tier, episodes=count, seed=first, select=out.select, noise=out.noise,
                num_envs=stages.num_envs, threads=stages.threads, progress=stages.progress,
            )
        )  # fmt: skip
    return aerial_il.open_dataset(str(place))


def _sources(stages: Stages, out: Out) -> Path:
    """Return the folder of the flights that are generated from, cut as ``out`` says."""
    flown = Path(stages.demonstrations(out.shown, out.sources).path)
    if not out.lead:
        return flown
    shown = {"shown": out.shown.decided_by(), "sources": out.sources, "lead": out.lead}
    place = stages.record.place("datasets", f"cut/{out.shown.task}/{out.shown.draw}", shown)
    if not DatasetFolder(place).files(DEMOS):
        shutil.copytree(flown, place, dirs_exist_ok=True, ignore=shutil.ignore_patterns(RECORD))
    for uid in aerial_il.open_dataset(str(place)).uids:
        segment(Segmentation(dataset=str(place), uid=uid, cuts=("found",)))
        (cuts,) = segment(Segmentation(dataset=str(place), uid=uid, page=False)).values()
        ends = [0, *(each.last for each in cuts)]
        moved = [
            replace(each, first=max(end, min(each.first - out.lead, each.last - 1)))
            for each, end in zip(cuts, ends, strict=False)
        ]
        segment(Segmentation(dataset=str(place), uid=uid, cuts=tuple(map(str, moved))))
    return place


def _clone_rows(results: Mapping[tuple[Any, str], EvaluationResult]) -> Iterator[Row]:
    return pooled_rows(
        ({"robot": made.source.robot, "task": made.source.task, "arm": made.method, "tier": tier}, result)
        for (made, tier), result in results.items()
    )


def _clone_targets(rows: list[Row]) -> Iterator[Target]:
    for row in (row for row in rows if row["arm"] in (GENERATED, BOTH)):
        limits = dict(zip(("calm", "gusts"), CLONES.get(row["task"], OTHER_CLONES), strict=True))
        if row["tier"] in limits:
            spread = f"flights {row['flights_low']} to {row['flights_high']}; worst {row['worst']}, best {row['best']}"
            what = f"clone of what one flight gave, {row['arm']}: {row['robot']}, {row['task']}, {row['tier']}"
            yield Target(what, "at least", limits[row["tier"]], row["percent"], "%", spread)
