"""Bad demonstrations found: how many of those that were planted, and what a clone gains without them.

Among flights of the expert a tenth are bad, in six known ways. What ``judge`` calls suspect is compared with what was
planted; and clones of all, of what is left without the suspects, and of the good ones alone fly the same reserved
seeds. A set without a bad one is filtered likewise: nothing must be lost.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any, ClassVar

import aerial_il
from aerial_il.algorithms.bc import BC
from aerial_il.collection.collect import collect
from aerial_il.core.contracts import Policy
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.data.episode import Episode
from aerial_il.data.quality.judge import judge
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.evaluation.statistics import fisher, wilson
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.network import PolicySettings
from aerial_il.suite import tasks as registered
from experiments.common.demonstrations import Source
from experiments.common.record import Record
from experiments.common.report import Report, Row, Target, bar
from experiments.common.seeds import EVALUATION_SEED, check_seeds
from experiments.common.stages import Shown, Stages, all_that_decides
from experiments.common.success import failed_seeds, pooled_rows
from experiments.quality.planted import FLOWN, KINDS, SPOILED

FAULTY_SEED, SEEDS_PER_DRAW, SEEDS_PER_KIND = 4_000_000, 100_000, 1_000
ALL, FILTERED, GOOD, GOOD_FILTERED = "all", "filtered", "good", "good_filtered"
ARMS = (ALL, FILTERED, GOOD, GOOD_FILTERED)
RECALL, PRECISION, GAIN = 90.0, 80.0, 10.0
NOISE = 0.3  # of the expert, in good and bad flights alike


@dataclass(frozen=True, eq=False)
class Planted(Shown):
    """A clone of good and bad demonstrations, or of some of them; ``demos`` of them in all.

    Attributes:
        algorithm: how it is cloned. share: of bad ones. kinds: of these. arm: what it learns from.
    """

    algorithm: BC
    share: float
    kinds: tuple[str, ...]

    def decided_by(self) -> dict[str, Any]:
        return {**all_that_decides(self), "arm": self.method, "share": self.share, "kinds": list(self.kinds)}

    def train(self, stages: Stages, run: Path) -> Policy:
        episodes, kinds = planted(stages, self.source, self.demos, self.share, self.kinds)
        if self.method.startswith(GOOD):
            episodes = [episode for episode in episodes if episode.uid not in kinds]
        if self.method.endswith(FILTERED):
            suspects = judge(episodes).suspects
            episodes = [episode for episode in episodes if episode.uid not in suspects]
        return self.algorithm.train(episodes, self.policy, run=run, seed=self.source.draw, progress=stages.progress)


@dataclass(frozen=True, kw_only=True)
class Quality:
    """Settings.

    Attributes:
        policy: what is cloned. cloning: how. robot: that flies. tasks: on which bad ones are looked for.
        cloned: on which clones are compared, too. demos: in a set. share: of bad ones in it. kinds: of these.
        arms: clones. draws: of demonstrations and weights. flown_in: tiers that judge clones.
        episodes: that judge a clone. first_episode: the first of them. num_envs: worlds flown at once.
        threads: of the simulation; 0 for all cores.
    """

    name: ClassVar[str] = "quality"
    question: ClassVar[str] = "Are bad demonstrations found, and does a policy gain from leaving them out?"

    policy: PolicySettings = field(default_factory=MLP)
    cloning: BC = field(default_factory=BC)
    robot: str = "fa_hexa_arm4"
    tasks: tuple[str, ...] = ("pick_place", "insert_peg", "open_door", "press_button", "push_slider", "rotate_valve")
    cloned: tuple[str, ...] = ("pick_place", "insert_peg")
    demos: int = 200
    share: float = 0.1
    kinds: tuple[str, ...] = KINDS
    arms: tuple[str, ...] = ARMS
    draws: tuple[int, ...] = (0, 1, 2)
    flown_in: tuple[str, ...] = ("calm", "gusts")
    episodes: int = 200
    first_episode: int = EVALUATION_SEED
    num_envs: int = 50
    threads: int = 0

    def __post_init__(self) -> None:
        for task in (*self.tasks, *self.cloned):
            registered.get(task)
        for kind, chosen, valid in (("arm", self.arms, ARMS), ("kind", self.kinds, KINDS)):
            for name in chosen:
                if name not in valid:
                    raise UnknownNameError(kind, name, valid)
        if not (self.draws and self.kinds) or min(self.demos, self.episodes, self.num_envs) < 1:
            raise InvalidValueError("draws and kinds name one at least; demos, episodes and num_envs start at 1.")
        if not 0.0 < self.share < 0.5:
            raise InvalidValueError(f"share is {self.share}; it lies between 0 and 0.5.")
        check_seeds(self.first_episode, self.episodes)

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Fly, judge, train and evaluate what ``folder`` does not hold yet; see :class:`Study`."""
        stages = Stages(record=Record(folder), num_envs=self.num_envs, threads=self.threads, progress=progress)
        found = [self._found(stages, task) for task in bar(list(self.tasks), self.name, progress)]
        work = list(product(self._trainings(), self.flown_in))
        seeds = range(self.first_episode, self.first_episode + self.episodes)
        results = {key: stages.judged(key[0], key[1], seeds) for key in bar(work, "clones", progress)}
        clones = list(_clone_rows(results))
        return Report(
            study=self,
            targets=(*_found_targets(found), *_clone_targets(clones)),
            tables={"Found": found} | ({"Clones": clones} if clones else {}),
            notes=(*NOTES, *stages.record.notes()),
            details={"failed_seeds": {f"{t.label}, {tier}": failed_seeds(r) for (t, tier), r in results.items()}},
            wall_time_s=stages.seconds(),
        )

    def _found(self, stages: Stages, task: str) -> Row:
        """Return what was found in all draws of a task."""
        counts = Counter[str]()
        for draw in self.draws:
            episodes, kinds = planted(stages, self._source(task, draw), self.demos, self.share, self.kinds)
            suspects = judge(episodes).suspects
            counts.update(planted=len(kinds), suspect=len(suspects), found=len(kinds.keys() & suspects.keys()))
            counts.update(f"missed {kind}" for uid, kind in kinds.items() if uid not in suspects)
        recall, precision = counts["found"] / counts["planted"], counts["found"] / max(1, counts["suspect"])
        low, high = wilson(counts["found"], counts["planted"])
        return {
            "task": task,
            "draws": len(self.draws),
            "planted": counts["planted"],
            "suspect": counts["suspect"],
            "found": counts["found"],
            "recall": round(100 * recall, 1),
            "recall_low": round(100 * low, 1),
            "recall_high": round(100 * high, 1),
            "precision": round(100 * precision, 1),
            "missed": ", ".join(f"{n} {what[7:]}" for what, n in sorted(counts.items()) if what.startswith("missed")),
        }

    def _source(self, task: str, draw: int) -> Source:
        return Source(robot=self.robot, task=task, noise=NOISE, draw=draw)

    def _trainings(self) -> Iterator[Planted]:
        for draw, task, arm in product(self.draws, self.cloned, self.arms):
            source = self._source(task, draw)
            yield Planted(arm, source, self.demos, self.policy, self.cloning, self.share, self.kinds)


NOTES = (
    "Found: of the bad ones that were planted among good flights of the expert, in all draws; precision: of what was "
    "called suspect, the share that was planted. The limits were chosen on other flights.",
    "Clones: all, of good and bad ones; filtered, of those that are not suspect; good, of the good ones alone; "
    "good_filtered, of the good ones that are not suspect when they are judged alone.",
)


def planted(
    stages: Stages, source: Source, demos: int, share: float, kinds: Sequence[str]
) -> tuple[list[Episode], dict[str, str]]:
    """Return good flights of the expert with bad ones among them, and uid -> kind of the bad ones."""
    bad = max(len(kinds), round(share * demos))
    counts = {kind: bad // len(kinds) + (i < bad % len(kinds)) for i, kind in enumerate(kinds)}
    late = counts.get("late", 0)
    good = list(stages.demonstrations(source, demos - bad + late))
    good, spare = good[: demos - bad], good[demos - bad :]
    found: dict[str, list[Episode]] = {
        kind: _flown(stages, source, kind, n) for kind, n in counts.items() if kind in FLOWN
    }
    if late:
        found["late"] = [SPOILED["late"](episode) for episode in spare]
    if "repeated" in counts:
        found["repeated"] = [SPOILED["repeated"](episode) for episode in good[: counts["repeated"]]]
    named = {episode.uid: kind for kind, episodes in found.items() for episode in episodes}
    return [*good, *(episode for episodes in found.values() for episode in episodes)], named


def _flown(stages: Stages, source: Source, kind: str, count: int) -> list[Episode]:
    """Return the first ``count`` successes of a demonstrator with a fault."""
    first = FAULTY_SEED + SEEDS_PER_DRAW * source.draw + SEEDS_PER_KIND * KINDS.index(kind)
    decided_by = {"source": source.decided_by(), "kind": kind, "first": first, "flown": 4 * count}
    place = stages.record.place("datasets", f"{kind}/{source.label}", decided_by)
    stages.places.setdefault("datasets", {})[place] = None
    expert = aerial_il.expert(source.robot, source.task, noise=source.noise)
    env = stages.environment(source, source.tier, min(stages.num_envs, 4 * count))
    try:
        seeds = range(first, first + 4 * count)
        collect(env, FLOWN[kind](expert), seeds, place, policy_name=kind, progress=stages.progress)
    finally:
        env.close()
    dataset = aerial_il.open_dataset(str(place))
    return list(dataset.only(sorted(dataset.uids)[:count]))


def _clone_rows(results: Mapping[tuple[Planted, str], EvaluationResult]) -> Iterator[Row]:
    return pooled_rows(
        ({"task": training.source.task, "tier": tier, "arm": training.method}, result)
        for (training, tier), result in results.items()
    )


def _found_targets(rows: list[Row]) -> Iterator[Target]:
    for row in rows:
        spread = f"{row['recall_low']} to {row['recall_high']}; missed: {row['missed'] or 'none'}"
        yield Target(f"planted ones that were found: {row['task']}", "at least", RECALL, row["recall"], "%", spread)
        said = f"{row['found']} of {row['suspect']}"
        yield Target(f"suspects that were planted: {row['task']}", "at least", PRECISION, row["precision"], "%", said)


def _clone_targets(rows: list[Row]) -> Iterator[Target]:
    cells = {(row["task"], row["tier"], row["arm"]): row for row in rows}
    for (task, tier, arm), row in cells.items():
        other = cells.get((task, tier, ALL if arm == FILTERED else GOOD))
        if arm not in (FILTERED, GOOD_FILTERED) or other is None:
            continue
        gain = round(row["percent"] - other["percent"], 1)
        p = fisher(row["success"], row["episodes"], other["success"], other["episodes"])
        spread = f"{other['percent']} % before, {row['percent']} % after; p = {p:.2g}"
        if arm == FILTERED:
            yield Target(f"gained by filtering: {task}, {tier}", "at least", GAIN, gain, "points", spread)
        else:
            yield Target(f"gained by filtering good ones: {task}, {tier}", "at least", -2.0, gain, "points", spread)
