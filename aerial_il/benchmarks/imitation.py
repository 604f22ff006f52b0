"""How well imitation flies a robot's tasks: every policy class, from the same demonstrations, on the same unseen seeds.

Each policy is trained on a number of demonstrations of one task, flown by a noisy expert in one tier, and its final
checkpoint is judged in every tier asked for. Fewer and more demonstrations are tried in the first tier. Every stage
leaves its result in the folder of the benchmark: killed at any moment, the same call continues.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from itertools import product
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

import aerial_il
from aerial_il.algorithms.bc import BehaviourCloning
from aerial_il.algorithms.parts.run_folder import read_metrics
from aerial_il.benchmarks.parts.claim import claim
from aerial_il.benchmarks.parts.demonstrations import Source, collections, first, gather, origins
from aerial_il.benchmarks.parts.figures import learning_lines, method_dots
from aerial_il.benchmarks.parts.progress import bar
from aerial_il.benchmarks.parts.report import Report, Row, Target
from aerial_il.benchmarks.parts.success import failed_seeds, pooled_row
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.policy import Policy
from aerial_il.core.seeding import named_rng
from aerial_il.evaluation.result import FILE_NAME, EvaluationResult, load_result
from aerial_il.evaluation.rollouts import evaluate
from aerial_il.evaluation.statistics import bootstrap_macro
from aerial_il.policies.mlp import MlpConfig
from aerial_il.policies.parts.network import PolicyConfig
from aerial_il.suite import tiers

EVALUATION_SEED = 10_000
PLAIN, PLAIN_PERCENT, BEST_PERCENT = "mlp", 80.0, 90.0
MACRO = "all tasks"
NOTES = (
    "One final checkpoint per training run; none is chosen by its success.",
    "Per task: Wilson's 95 % interval over all episodes of all training seeds. Over all tasks: the mean of the tasks' "
    "rates, its 95 % interval by resampling training seeds and episodes within each task.",
    "The expert demonstrates with noise in its commands, labelled by what it meant to do; each number of "
    "demonstrations takes the first ones of one collection.",
    "Targets are judged in the first tier with the usual number of demonstrations, over all tasks.",
)


@dataclass(frozen=True)
class Training:
    """One policy: which class, from which demonstrations, with which seed."""

    method: str
    task: str
    tier: str
    demos: int
    seed: int

    @property
    def place(self) -> str:
        return f"{self.method}/{self.task}-{self.tier}/{self.demos}/{self.seed}"


@dataclass(frozen=True)
class Flight:
    """One evaluation: a policy and the tier that it is flown in."""

    training: Training
    tier: str

    @property
    def place(self) -> str:
        return f"{self.training.place}/{self.tier}"


Results = Mapping[Flight, EvaluationResult]


@dataclass(frozen=True, kw_only=True)
class Imitation:
    """Settings.

    Attributes:
        policies: name -> what is trained. algorithms: name -> how, of the same names. methods: which of the names;
            empty for all.
        robot: who flies. tasks: names; empty for all that it does with its end effector. demos: demonstrations of a
            task. sizes: other numbers of them, tried in the first tier only.
        trained_in, flown_in: tiers of demonstrations and of evaluations.
        noise: of the expert while it demonstrates. first_demo: seed of the first demonstration.
        seeds: of the training; the first alone for ``sizes`` and for demonstrations from further tiers.
        episodes: seeds per evaluation. first_episode: the first of them; below 10000 to try settings out.
        num_envs: worlds flown at once. threads: of the simulation; 0 for all cores.
    """

    name: ClassVar[str] = "imitation"
    question: ClassVar[str] = "How well do the policy classes imitate the experts, from few demonstrations and many?"

    policies: Mapping[str, PolicyConfig] = field(default_factory=lambda: {"mlp": MlpConfig()})
    algorithms: Mapping[str, BehaviourCloning] = field(default_factory=lambda: {"mlp": BehaviourCloning()})
    methods: tuple[str, ...] = ()
    robot: str = "fa_hexa_arm4"
    tasks: tuple[str, ...] = ()
    demos: int = 80
    sizes: tuple[int, ...] = (10, 20, 40, 160)
    trained_in: tuple[str, ...] = ("calm", "gusts")
    flown_in: tuple[str, ...] = ("calm", "gusts")
    noise: float = 0.3
    first_demo: int = 0
    seeds: tuple[int, ...] = (0, 1, 2)
    episodes: int = 100
    first_episode: int = EVALUATION_SEED
    num_envs: int = 50
    threads: int = 0

    def __post_init__(self) -> None:
        if set(self.policies) != set(self.algorithms) or not self.policies:
            raise InvalidValueError(f"policies {list(self.policies)} and algorithms {list(self.algorithms)} differ.")
        for chosen, valid, what in ((self.methods, self.policies, "method"), (self.tasks, self._able, "task")):
            for name in chosen:
                if name not in valid:
                    raise UnknownNameError(what, name, valid)
        for tier in (*self.trained_in, *self.flown_in):
            tiers.get(tier)
        if min(self.demos, self.episodes, *self.sizes) < 1 or not (self.seeds and self.trained_in and self.flown_in):
            raise InvalidValueError("demos, sizes and episodes start at 1; seeds and tiers must name at least one.")
        if self.first_demo + 2 * self._most > self.first_episode:
            raise InvalidValueError(
                f"Demonstrations from seed {self.first_demo} on would run into those of evaluation."
            )

    @property
    def _most(self) -> int:
        return max((self.demos, *self.sizes))

    @property
    def _able(self) -> list[str]:
        """Tasks that the robot does with its end effector."""
        return [task for robot, task in aerial_il.list_cells() if robot == self.robot and task != "hover"]

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Collect, train and evaluate what ``folder`` does not hold yet; see :class:`Benchmark`."""
        shared = {"robot", "noise", "first_demo", "episodes", "first_episode"}
        settings = self._plain()
        claim(folder, {key: settings[key] for key in sorted(shared)})
        for method in self._methods:
            own = {"policy": settings["policies"][method], "algorithm": settings["algorithms"][method]}
            claim(folder / "methods" / method, own)
        flights = list(self._flights())
        results = {flight: self._result(flight, folder, progress) for flight in bar(flights, self.name, progress)}
        usual = {f: r for f, r in results.items() if f.training.demos == self.demos}
        per_task, macro = self._per_task(usual, folder), self._macro(usual)
        scaling = self._scaling(results)
        return Report(
            name=self.name,
            question=self.question,
            settings=settings,
            targets=tuple(self._targets(macro)),
            tables={"All tasks": macro, "Each task": per_task, "Success over demonstrations": scaling},
            notes=(*NOTES, *_origins(folder, results)),
            figures={
                "tasks.svg": method_dots(per_task),
                "demonstrations.svg": learning_lines([{**row, "robot": row["method"]} for row in scaling], {}),
            },
            details={"failed_seeds": {f.place: failed_seeds(r) for f, r in results.items()}},
            wall_time_s=_seconds(folder, results),
        )

    @property
    def _methods(self) -> tuple[str, ...]:
        return self.methods or tuple(self.policies)

    @property
    def _tasks(self) -> list[str]:
        return [task for task in self._able if task in (self.tasks or self._able)]

    @property
    def _arms(self) -> list[tuple[str, int]]:
        """Tiers of the demonstrations and seeds of the trainings."""
        usual, *further = self.trained_in
        return [*((usual, seed) for seed in self.seeds), *((tier, self.seeds[0]) for tier in further)]

    def _flights(self) -> Iterator[Flight]:
        """Yield what is flown: first what is judged, method by method, then fewer and more demonstrations."""
        for method, (tier, seed), task in product(self._methods, self._arms, self._tasks):
            for flown in self.flown_in:
                yield Flight(Training(method, task, tier, self.demos, seed), flown)
        for method, demos, task in product(self._methods, sorted(set(self.sizes) - {self.demos}), self._tasks):
            yield Flight(Training(method, task, self.trained_in[0], demos, self.seeds[0]), self.flown_in[0])

    def _result(self, flight: Flight, folder: Path, progress: bool) -> EvaluationResult:
        """Return one evaluation, doing what is left to do for it."""
        judged, training = folder / "evaluations" / flight.place, flight.training
        if (judged / FILE_NAME).exists():
            return load_result(judged)
        dataset, run = _dataset(folder, training), _run(folder, training)
        source = (self.robot, training.task, training.tier, self.noise, self.first_demo, self.num_envs, self.threads)
        gather(Source(*source), dataset, max(self._most, training.demos), progress=progress)
        policy = self.algorithms[training.method].train(
            first(dataset, training.demos),
            self.policies[training.method],
            run=run,
            seed=training.seed,
            progress=progress,
        )
        result = self._evaluate(flight, policy, progress)
        result.save(judged)
        return result

    def _evaluate(self, flight: Flight, policy: Policy, progress: bool) -> EvaluationResult:
        task, worlds = flight.training.task, min(self.num_envs, self.episodes)
        seeds = range(self.first_episode, self.first_episode + self.episodes)
        env = aerial_il.load_batch(self.robot, task, num_envs=worlds, tier=flight.tier, num_threads=self.threads)
        try:
            return evaluate(env, policy, seeds, policy_name=flight.training.place, progress=progress)
        finally:
            env.close()

    def _per_task(self, results: Results, folder: Path) -> list[Row]:
        groups = _grouped(results, "method", "trained_in", "flown_in", "task")
        return [{**arm, **pooled_row(found.values()), **_effort(found, folder)} for arm, found in groups]

    def _macro(self, results: Results) -> list[Row]:
        groups = _grouped(results, "method", "trained_in", "flown_in")
        return [{**arm, "demos": self.demos, **_macro_row(found)} for arm, found in groups]

    def _scaling(self, results: Results) -> list[Row]:
        """Return success over demonstrations for all tasks and each, of the first tier and training seed."""
        tier, flown, seed = self.trained_in[0], self.flown_in[0], self.seeds[0]
        tried = {f: r for f, r in results.items() if (f.training.tier, f.tier, f.training.seed) == (tier, flown, seed)}
        rows = [{**arm, "task": MACRO, **_macro_row(found)} for arm, found in _grouped(tried, "method", "demos")]
        rows += [{**arm, **pooled_row(found.values())} for arm, found in _grouped(tried, "method", "demos", "task")]
        kept = ("method", "task", "demos", "percent", "ci95_low", "ci95_high")
        return [{key: row[key] for key in kept} for row in sorted(rows, key=lambda r: (r["method"], r["demos"]))]

    def _targets(self, macro: list[Row]) -> list[Target]:
        """Return the targets, where every task was flown in the tier that they are meant for."""
        where = (self.trained_in[0], self.flown_in[0])
        judged = [row for row in macro if (row["trained_in"], row["flown_in"]) == where]
        if set(self._tasks) != set(self._able):
            return []
        best = max(judged, key=lambda row: row["percent"])
        plain = [row for row in judged if row["method"] == PLAIN]
        wanted = [(row, PLAIN_PERCENT) for row in plain] + [(best, BEST_PERCENT)]
        return [
            Target(
                f"{row['method']}, {where[0]}, {self.demos} demonstrations: mean success of {row['tasks']} tasks",
                "at least",
                percent,
                row["percent"],
                "%",
                f"95 % interval {row['ci95_low']:g} to {row['ci95_high']:g} %",
            )
            for row, percent in wanted
        ]

    def _plain(self) -> dict[str, Any]:
        """The settings as JSON gives them back."""
        policies = {name: {"name": policy.name, **policy.to_dict()} for name, policy in self.policies.items()}
        return json.loads(json.dumps({**asdict(self), "policies": policies}))


def _grouped(results: Results, *names: str) -> Iterator[tuple[Row, Results]]:
    """Group flights by some of their properties, in the order in which they were flown."""
    groups: dict[tuple[Any, ...], dict[Flight, EvaluationResult]] = {}
    for flight, result in results.items():
        every = {**asdict(flight.training), "trained_in": flight.training.tier, "flown_in": flight.tier}
        groups.setdefault(tuple(every[name] for name in names), {})[flight] = result
    return ((dict(zip(names, key, strict=True)), found) for key, found in groups.items())


def _macro_row(results: Results) -> Row:
    """Return the mean success over tasks with its interval, and the worst task."""
    tasks = {str(arm["task"]): list(found.values()) for arm, found in _grouped(results, "task")}
    counts = [[result.success["count"] for result in found] for found in tasks.values()]
    episodes = len(next(iter(results.values())).episodes)
    rates = {task: float(np.mean(count)) / episodes for task, count in zip(tasks, counts, strict=True)}
    low, high = bootstrap_macro(counts, episodes, rng=named_rng(0, "benchmarks", "imitation"))
    worst = min(rates, key=lambda task: rates[task])
    return {
        "tasks": len(tasks),
        "seeds": max(len(count) for count in counts),
        "percent": round(100 * float(np.mean(list(rates.values()))), 1),
        "ci95_low": round(100 * low, 1),
        "ci95_high": round(100 * high, 1),
        "worst": f"{worst} ({100 * rates[worst]:.0f} %)",
    }


def _effort(results: Results, folder: Path) -> Row:
    """Return the mean wall time of the trainings behind some flights."""
    ends = [read_metrics(_run(folder, flight.training))[-1] for flight in results]
    return {"train_min": round(float(np.mean([end["elapsed_s"] for end in ends])) / 60, 2)}


def _dataset(folder: Path, training: Training) -> Path:
    return folder / "datasets" / f"{training.task}-{training.tier}"


def _run(folder: Path, training: Training) -> Path:
    return folder / "training" / training.place


def _seconds(folder: Path, results: Results) -> float:
    """Return how long all stages took, whenever they were done."""
    trainings = dict.fromkeys(flight.training for flight in results)
    collecting = sum(run["seconds"] for run in collections(_dataset(folder, training) for training in trainings))
    training = sum(read_metrics(_run(folder, training))[-1]["elapsed_s"] for training in trainings)
    return collecting + training + sum(result.provenance["wall_time_s"] for result in results.values())


def _origins(folder: Path, results: Results) -> list[str]:
    trainings = dict.fromkeys(flight.training for flight in results)
    datasets, runs = ([where(folder, training) for training in trainings] for where in (_dataset, _run))
    return origins(datasets, runs, list(results.values()))


BENCHMARK = Imitation
