"""Reinforcement learning from a clone of few demonstrations, with a sparse reward: what practice adds to being shown.

Every arm begins with the same few demonstrations of its draw. The improving ones fly on by themselves and are told
nothing but whether a flight succeeded. Beside them stand the clone that they begin with, filtered cloning, which any
of them has to beat, and cloning of many demonstrations, which is what the flown steps would buy from an expert. The
final policies are flown on the same unseen seeds in two tiers; they practised in one of them. Every stage is kept by
all that decides it: killed at any moment, the same call continues.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, product
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.bc_ppo import BCPPO
from aerial_il.algorithms.dapg import DAPG
from aerial_il.algorithms.expert_iteration import ExpertIteration
from aerial_il.algorithms.filtered_bc import FilteredBC
from aerial_il.algorithms.ibrl import IBRL
from aerial_il.algorithms.jsrl import JSRL
from aerial_il.algorithms.ppo import PPO
from aerial_il.algorithms.residual import Residual
from aerial_il.algorithms.rlpd import RLPD
from aerial_il.core.composition import build, changed
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.network import PolicySettings
from aerial_il.suite import tasks
from experiments.common.demonstrations import NOISE, Source
from experiments.common.notes import demonstrator, listed, notes_on
from experiments.common.practised import Continued, Practised, Practising
from experiments.common.record import Record
from experiments.common.report import Report, Row, Target, bar
from experiments.common.seeds import EVALUATION_SEED, check_seeds
from experiments.common.stages import Cloned, Stages, check_fewer
from experiments.common.success import failed_seeds, mean_time_s, pooled_row
from experiments.from_prior.gains import gain_row
from experiments.from_prior.lines import practice_lines
from experiments.from_prior.practice import Arm, Practice, by_training, grouped
from experiments.from_prior.practice_notes import BEGINNING, NOTES, SLOWEST_STEPS
from experiments.from_prior.wanted import Wanted, targets_from

CLONE, SHOWN_MORE = "bc, first demonstrations", "bc, many demonstrations"
BEGUN = "beginning"
BASELINES = ("filtered_bc", "ppo")  # flown beside the methods, and not judged
SCRATCH: dict[str, Any] = {  # as bc_ppo learns
    "steps": 20_000_000, "rollout": {"steps": 65_536, "batch_size": 1024, "epochs": 5},
    "reward": "sparse", "reward_patience": 0,
}  # fmt: skip
FEWER: Mapping[str, int] = {"dapg": 1, "residual": 1, "jsrl": 1, "ibrl": 1, "rlpd": 1, "ppo": 1}
ONLY_FROM: Mapping[str, tuple[str, ...]] = {
    "jsrl": ("pick_place_40",),
    "ibrl": ("pick_place_10",),
    "rlpd": ("pick_place_10",),
    "ppo": ("pick_place_0",),
}
SUITED: Mapping[str, Mapping[str, Any]] = {
    "insert_peg": {  # usual noise lets few flights succeed; at a gamma of 0.995 quick is worth more than sure
        "expert_iteration": {"hidden": 0.3, "explorer_dropout": 0.2},
        "bc_ppo": {"exploration": {"noise": 0.05}, "lr": 1e-5, "gamma": 0.9995},
        "jsrl": {"exploration": {"noise": 0.05}, "lr": 1e-5, "gamma": 0.9995},
        "dapg": {"exploration": {"noise": 0.05}, "gamma": 0.9995},
        "residual": {"noise": 0.2, "hold": 20, "lr": 5e-4, "gamma": 0.9995},
    },
}
CRITICS: dict[str, Any] = {
    "reward": "sparse", "reward_patience": 0, "demonstrations": {"bounds": "demonstrations"}, "steps": SLOWEST_STEPS
}  # fmt: skip
WANTED: Mapping[tuple[str, str, int], Wanted] = {  # robot, task, demonstrations
    ("fa_hexa_arm4", "pick_place", 10): Wanted(90.0),
    ("fa_hexa_arm4", "pick_place", 40): Wanted(98.0),
    ("fa_hexa_arm4", "insert_peg", 40): Wanted(90.0),
    ("big_four_z1", "insert_peg", 40): Wanted(80.0, harder=80.0, methods=1),
}
Results = Mapping[tuple[Arm, str], EvaluationResult]


def _all_practising() -> dict[str, Practising]:
    """Return the arms that practise, as they are shipped, paid for success alone; ``ppo`` is shown nothing."""
    found: list[Practising] = [ExpertIteration(), FilteredBC()]
    found += [BCPPO(), Residual(), DAPG(), JSRL()]
    found += [build(IBRL, {**CRITICS, "warmup": 10_000}), build(RLPD, CRITICS)]
    found += [build(PPO, SCRATCH)]
    return {algorithm.name: algorithm for algorithm in found}


@dataclass(frozen=True, kw_only=True)
class FromPrior:
    """Settings.

    Attributes:
        noise: of the expert that demonstrates. policy: what is trained.
        cloning: how clones are made that do not practise.
        beginning: how the clone is made that practice begins with, but for those that make their own.
        practising: arms by name. arms: which of them; empty for all.
        fewer: arm -> in how many of the draws it is trained. only_from: arm -> from which starts (``TASK_DEMOS``).
            Both are for those that take long.
        robot: what is flown. starts: task -> numbers of demonstrations to begin with.
        begun_by: task -> arm that the others with a prior go on from there, if not from the clone; its steps and its
            minutes are added to theirs.
        suited: task -> arm, or ``beginning`` -> what is changed of that there.
        watched: how many times on the way a policy that learns step by step is flown, to see dips.
        many: demonstrations of the clone that was shown more.
        tier: that all are flown in. harder: another one. practised_in: task -> which tier it is demonstrated and
            practised in, if not the first. draws: one training each.
        episodes: unseen seeds per evaluation. first_episode: the first of them; 5000 to 5999 to try settings out.
        num_envs: worlds flown at once there. threads: of the simulation; 0 for all cores.
    """

    name: ClassVar[str] = "from_prior"
    question: ClassVar[str] = "How much does practice rewarded for success alone improve a clone of few demonstrations?"

    noise: float = NOISE
    policy: PolicySettings = field(default_factory=MLP)
    cloning: BC = field(default_factory=BC)
    beginning: BC = field(default_factory=lambda: BCPPO().cloning)
    practising: Mapping[str, Practising] = field(default_factory=lambda: _all_practising())
    arms: tuple[str, ...] = ()
    fewer: Mapping[str, int] = field(default_factory=lambda: dict(FEWER))
    only_from: Mapping[str, tuple[str, ...]] = field(default_factory=lambda: dict(ONLY_FROM))
    robot: str = "fa_hexa_arm4"
    starts: Mapping[str, tuple[int, ...]] = field(default_factory=lambda: {"pick_place": (10, 40), "insert_peg": (40,)})
    begun_by: Mapping[str, str] = field(default_factory=lambda: {"insert_peg": "expert_iteration"})
    suited: Mapping[str, Mapping[str, Any]] = field(default_factory=lambda: dict(SUITED))
    watched: int = 20
    many: int = 400
    tier: str = "calm"
    harder: str = "gusts"
    practised_in: Mapping[str, str] = field(default_factory=lambda: {"insert_peg": "gusts"})
    draws: tuple[int, ...] = (0, 1, 2)
    episodes: int = 200
    first_episode: int = EVALUATION_SEED
    num_envs: int = 50
    threads: int = 0

    def __post_init__(self) -> None:
        begun = [start.rpartition("_")[0] for start in chain(*self.only_from.values())]
        for task in (*self.starts, *self.begun_by, *self.suited, *self.practised_in, *begun):
            tasks.get(task)
        known = (BEGUN, *self.practising, *_all_practising())
        for name in self.arms:
            if name not in self.practising:
                raise UnknownNameError("arm", name, self.practising)
        for name in self.only_from:
            if name not in known[1:]:
                raise UnknownNameError("arm", name, known[1:])
        check_fewer(self.fewer, known[1:])
        counts = [count for task in self.starts.values() for count in task]
        if min([self.many, self.episodes, self.num_envs, *counts]) < 1:
            raise InvalidValueError("starts, many, episodes and num_envs start at 1.")
        if not (self.draws and counts):
            raise InvalidValueError("draws and starts name at least one.")
        check_seeds(self.first_episode, self.episodes)
        in_rounds = [n for n, a in self.practising.items() if isinstance(a, ExpertIteration | FilteredBC)]
        for name in (name for task, name in self.begun_by.items() if task in self.starts):
            if name not in in_rounds:
                raise UnknownNameError("arm whose policy others go on from (begun_by)", name, in_rounds)
        for task, name in ((task, name) for task, arms in self.suited.items() for name in arms):
            if name not in known:
                raise UnknownNameError("arm", name, known)
            if name in (BEGUN, *self.practising):
                self._suited(task, name)

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Fly, train and judge what ``folder`` does not hold yet; see :class:`Study`."""
        stages = Stages(record=Record(folder), num_envs=self.num_envs, threads=self.threads, progress=progress)
        arms = list(self.all_arms())
        work = [(arm, tier) for arm in arms for tier in (self.tier, self.harder)]
        results = {
            key: stages.judged(key[0].training, key[1], self.judging_seeds) for key in bar(work, self.name, progress)
        }
        groups = list(grouped(arms))
        pooled = [_row(group, tier, results, stages) for group in groups for tier in (self.tier, self.harder)]
        gains = list(self._gains(groups, results, stages))
        practice = Practice(stages, [arm for arm in arms if not isinstance(arm.training, Cloned)], BASELINES)
        return Report(
            study=self,
            targets=(*self.targets_of(pooled, gains), *practice.targets()),
            tables={"Success": pooled, "Gains": gains, "Dips": practice.dips},
            notes=(*self.notes_of(arms), *stages.record.notes()),
            figures=self.drawn_figures(pooled, practice),
            details={
                "on_the_way": by_training(practice.on_the_way),
                "rounds": by_training(practice.listed),
                "failed_seeds": {
                    f"{a.name}: {a.training.label}, {t}": failed_seeds(r) for (a, t), r in results.items()
                },
            },
            wall_time_s=stages.seconds(),
        )

    @property
    def judging_seeds(self) -> range:
        """What judges the final policies."""
        return range(self.first_episode, self.first_episode + self.episodes)

    def drawn_figures(self, pooled: Sequence[Row], practice: Practice) -> dict[str, str]:
        """Return the figures, each task in the tier that it is practised in, or in ``tier`` where that is a third."""
        final = [row for row in pooled if row["tier"] == self._drawn_in(row["task"])]
        titles = {(row["task"], row["demos"]): self._panel(row["task"], row["demos"]) for row in final}
        wanted = {
            (task, demos): wanted.percent if self._drawn_in(task) == self.tier else wanted.harder
            for (robot, task, demos), wanted in WANTED.items()
            if robot == self.robot
        }
        return {
            f"{name}.svg": practice_lines(practice.lines, final, over=over, titles=titles, wanted=wanted)
            for name, over in (("by_steps", "flown"), ("by_minutes", "minutes"))
        }

    def _drawn_in(self, task: str) -> str:
        tier = self._practised_in(task)
        return tier if tier in (self.tier, self.harder) else self.tier

    def _panel(self, task: str, demos: int) -> str:
        """Return a panel's title, with the tier of its lines, and of its final policies where that is another."""
        practised, final = self._practised_in(task), self._drawn_in(task)
        return f"{task} from {demos}, in {practised}{'' if final == practised else f', final in {final}'}"

    def notes_of(self, arms: Sequence[Arm]) -> Iterator[str]:
        """Yield what flew, who demonstrated what how often, in which tier, and which seeds judge; then the usual."""
        begun = (
            f"{task} in {self._practised_in(task)}, {listed([str(count) for count in counts])} times"
            for task, counts in self.starts.items()
            if counts
        )
        yield (
            f"Robot: {demonstrator(self.robot, self.noise)}. Demonstrated, and practised in the same tier: "
            f'{"; ".join(begun)}; "many demonstrations" are {self.many}. Judged: on the seeds '
            f"{self.judging_seeds[0]} to {self.judging_seeds[-1]}."
        )
        yield from notes_on({arm.name for arm in arms}, NOTES, watched=self.watched)

    def _practised_in(self, task: str) -> str:
        return self.practised_in.get(task, self.tier)

    def all_arms(self) -> Iterator[Arm]:
        """Yield what is trained, draw by draw."""
        for draw, (task, counts) in product(self.draws, self.starts.items()):
            tier = self._practised_in(task)
            source = Source(robot=self.robot, task=task, tier=tier, noise=self.noise, draw=draw)
            names = [name for name in self.named_arms() if draw in self.draws[: self.fewer.get(name)]]
            scratch = [name for name in names if not self.practising[name].demonstrated and self._starts(name, task, 0)]
            many = Cloned("bc", source, self.many, self.policy, self.cloning)
            for count in counts:
                yield Arm(CLONE, count, Cloned("bc", source, count, self.policy, self.cloning))
                if task not in self.begun_by:
                    yield Arm(BEGINNING, count, self._beginning(source, count))
                for name in names:
                    if self.practising[name].demonstrated and self._starts(name, task, count):
                        yield Arm(name, count, self._practised(name, source, count))
                yield Arm(SHOWN_MORE, count, many)
            for name in scratch:
                yield Arm(name, 0, self._practised(name, source, 0))

    def named_arms(self) -> Sequence[str]:
        """Return the names of the arms that practise, in the order of the page."""
        order = [*_all_practising()]
        return self.arms or sorted(self.practising, key=lambda name: order.index(name) if name in order else len(order))

    def _starts(self, name: str, task: str, count: int) -> bool:
        """Return whether an arm is trained from so many demonstrations of a task."""
        return f"{task}_{count}" in self.only_from.get(name, (f"{task}_{count}",))

    def _practised(self, name: str, source: Source, count: int) -> Practised | Continued:
        algorithm = self._suited(source.task, name)
        if isinstance(algorithm, ExpertIteration | FilteredBC):
            return Practised(name, source, count, self.policy, algorithm)
        return Continued(name, source, count, self.policy, algorithm, self._beginning(source, count), self.watched)

    def _beginning(self, source: Source, count: int) -> Cloned | Practised:
        """Return what practice that learns step by step begins with."""
        if source.task not in self.begun_by:
            return Cloned("bc", source, count, self.policy, self._suited(source.task, BEGUN))
        name = self.begun_by[source.task]
        return Practised(name, source, count, self.policy, self._suited(source.task, name))

    def _suited(self, task: str, name: str) -> Any:
        """Return the settings of an arm, or of the clone that practice begins with, in a task."""
        usual = self.beginning if name == BEGUN else self.practising[name]
        return changed(usual, self.suited.get(task, {}).get(name, {}))

    def _gains(self, groups: Sequence[Sequence[Arm]], results: Results, stages: Stages) -> Iterator[Row]:
        """Yield what each arm added to the policies that its trainings began with, where there are any."""
        for group, tier in product(groups, (self.tier, self.harder)):
            pairs = [
                (stages.judged(arm.training.prior, tier, self.judging_seeds), results[arm, tier])
                for arm in group
                if isinstance(arm.training, Continued) and arm.training.prior
            ]
            if pairs:
                task, demos = group[0].cell
                yield {"task": task, "demos": demos, "arm": group[0].name, "tier": tier, **gain_row(pairs)}

    def targets_of(self, pooled: Sequence[Row], gains: Sequence[Row] = ()) -> Iterator[Target]:
        """Yield how many methods must reach what is wanted from each start, in both tiers and in time."""
        wanted = {(task, demos): asked for (robot, task, demos), asked in WANTED.items() if robot == self.robot}
        rows = [row for row in pooled if self._is_judged(row)]
        yield from targets_from(wanted, rows, gains, tiers=(self.tier, self.harder))

    def _is_judged(self, row: Row) -> bool:
        return row["arm"] in self.practising and row["arm"] not in BASELINES


def _row(group: Sequence[Arm], tier: str, results: Results, stages: Stages) -> Row:
    """Return success of the trainings of one arm in a tier, and what the mean one cost."""
    judged = [results[arm, tier] for arm in group]
    return {
        "task": group[0].cell[0],
        "demos": group[0].demos,
        "arm": group[0].name,
        "tier": tier,
        "flown": round(float(np.mean([arm.flown(stages) for arm in group]))),
        "minutes": round(float(np.mean([arm.minutes(stages) for arm in group])), 2),
        **pooled_row(judged),
        "time_s": mean_time_s(judged),
    }
