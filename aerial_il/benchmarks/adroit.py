"""Imitation on the Adroit hand, against published numbers: cloning the DAPG experts from many and from few flights.

The experts are flown and recorded, with the noise they were trained with and without it; each learner then gets the
first demonstrations of those recordings. What is judged is the final policy, over fixed seeds that nothing else uses.
Every stage leaves its result in the folder of the benchmark: killed at any moment, the same call continues.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

import aerial_il
from aerial_il import policies
from aerial_il.algorithms.bc import BehaviourCloning
from aerial_il.algorithms.parts.run_folder import read_metrics
from aerial_il.benchmarks.parts.adroit import TASKS, AdroitTask, PublishedRewards, expert_of
from aerial_il.benchmarks.parts.claim import claim
from aerial_il.benchmarks.parts.figures import learning_lines
from aerial_il.benchmarks.parts.progress import bar
from aerial_il.benchmarks.parts.report import Report, Row, Target
from aerial_il.benchmarks.parts.success import failed_seeds, success_target
from aerial_il.collection.collect import collect
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.files import write_json
from aerial_il.core.policy import Policy
from aerial_il.core.seeding import named_rng
from aerial_il.data.episode import Episode
from aerial_il.data.folder import FAILURES, DatasetFolder
from aerial_il.evaluation.result import FILE_NAME, EvaluationResult, load_result
from aerial_il.evaluation.rollouts import evaluate
from aerial_il.evaluation.statistics import bootstrap_mean, wilson
from aerial_il.policies.parts.network import PolicyConfig

EVALUATION_SEED = 10_000
MANY = 100
SCORES = {"door": 103.0, "relocate": 88.0}  # of cloning from 100 demonstrations
FEW_SUCCESS_PERCENT = 62.0  # 31 of 50: a perceptron on 25 demonstrations of relocate
HORIZON = 200  # steps of every episode
CHUNKED = ("act", "diffusion", "flow")
EXPERT, CLONED, OWN_RETURNS = "expert", "bc", "own_returns.json"
LONGER = "bc_as_many_steps"  # cloning with the optimisation steps of classic DAgger
DAGGER, THRIFTY = "dagger", "thrifty"
AS_GOOD_POINTS = -5.0  # the most that a difference in success may be worth, at the lower end of its interval
NOTES = (
    "Success: the goal is held in more than 25 of 200 steps (DAPG). Score: 100 · (return − random) / (expert − random) "
    "with D4RL's reference returns (d4rl/infos.py): door −56.512833 and 2880.5693087, relocate −6.425911 and "
    "4233.8777977.",
    "The v1 environments of gymnasium-robotics add 0.1 · distance from palm to handle (door) or object (relocate) to "
    "the reward where D4RL's and DAPG's subtract it. Returns and scores are those of the published reward: twice that "
    "term is taken off in each step. The column own_return has what the environment itself paid.",
    "Demonstrations are flown by the experts of DAPG as they were trained, drawing their actions, except where "
    "noise-free is said, which flies their mean. Learners see the action that was flown, never the mean beside it.",
    "Trainings of an arm differ in their draw: in demonstrations (flown with other seeds), weights and minibatches. Of "
    "each draw, each number of demonstrations takes the first ones, so that larger sets contain the smaller.",
    f"{LONGER}: cloning with as many optimisation steps as DAgger takes over all its rounds; ThriftyDAgger takes more, "
    "for it has more rounds; train_steps tells how many.",
    "Queries: steps at which a flying learner had the expert's action; labelled steps has the first demonstrations, "
    "too. ThriftyDAgger flies more often than DAgger, because a flight of its learner costs nobody anything; the ten "
    "flights alone before each of its rounds are not counted among its own.",
    "The final policy of each training is judged, on the same fixed seeds. Low and high: over the flights of these very "
    "policies, of success Wilson's 95 % interval, of the score a bootstrap. Trainings: Student's 95 % interval with a "
    "training as the unit.",
)


@dataclass(frozen=True, order=True)
class Point:
    """One training.

    Attributes:
        task: its name. demos: flights of the expert, or labelled by it. clean: whether it flies without noise.
        policy: class of the learner. seed: of the training. method: ``bc``, or the name of an interactive algorithm.
    """

    task: str
    demos: int
    clean: bool
    policy: str
    seed: int
    method: str = CLONED

    @property
    def arm(self) -> tuple[str, int, bool, str, str]:
        """Everything but the seed."""
        return self.task, self.demos, self.clean, self.policy, self.method

    @property
    def place(self) -> Path:
        """Where its results lie below the folder of the benchmark."""
        source = "clean" if self.clean else "noisy"
        learner = self.policy if self.method == CLONED else f"{self.policy}-{self.method}"
        return Path(self.task) / source / str(self.demos) / learner / str(self.seed)


@dataclass(frozen=True, kw_only=True)
class Adroit:
    """Settings.

    Attributes:
        data: folder of ``dapg_policies.npz``. policies: policy class -> its settings; classes that are not registered
            are left out, and the report says so. algorithm: how they are trained. training: class -> what differs.
        tasks: cloned from 100 demonstrations by the perceptron. few: smaller numbers of demonstrations of relocate, for
            all classes. seeds: trainings of each of these arms.
        clean: for the perceptron, ``{demos: N, WAY: TRAININGS}`` for each number of noise-free ones, where a way is
            ``bc`` or a name in ``interactive``. Ways that are near to each other are told apart by many trainings only.
        interactive: name -> algorithm that flies and asks the expert, with as many flights in all as ``clean`` says.
            first: of them, flown by the expert.
        episodes: flown to judge one. num_envs: worlds flown at once.
    """

    name: ClassVar[str] = "adroit"
    question: ClassVar[str] = "How well are the Adroit hand's experts cloned, from many and from few demonstrations?"

    data: str = "../shared/data/adroit"
    policies: Mapping[str, Mapping[str, Any]] = field(default_factory=lambda: {"mlp": {"chunk": 1}}, hash=False)
    algorithm: BehaviourCloning = field(default_factory=BehaviourCloning)
    training: Mapping[str, Mapping[str, Any]] = field(default_factory=dict, hash=False)
    tasks: tuple[str, ...] = ("door", "relocate")
    few: tuple[int, ...] = (10, 25)
    clean: tuple[Mapping[str, int], ...] = field(default=({"demos": 15, CLONED: 3},), hash=False)
    interactive: Mapping[str, Any] = field(default_factory=dict, hash=False)
    first: int = 5
    seeds: int = 3
    episodes: int = 100
    num_envs: int = 25

    def __post_init__(self) -> None:
        for task in self.tasks:
            if task not in TASKS:
                raise InvalidValueError(f"{task!r} is no task of this study; it has {', '.join(TASKS)}.")
        if min(self.seeds, self.episodes, self.num_envs, *self.few) < 1:
            raise InvalidValueError("seeds, episodes, num_envs and numbers of demonstrations start at 1.")
        ways = ("demos", CLONED, *self.interactive)
        for wanted in self.clean:
            if "demos" not in wanted or not set(wanted) <= set(ways):
                raise InvalidValueError(f"clean says {dict(wanted)}; it names demos and any of {', '.join(ways[1:])}.")

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Record, train and judge what ``folder`` does not hold yet; see :class:`Benchmark`."""
        if not Path(self.data).is_dir():
            return _skipped(self)
        claim(folder, self._plain(), free=FREE)
        for name, settings in self._plain()["interactive"].items():
            claim(folder / "classes" / name, settings)
        for name, settings in self.policies.items():  # one class after another may be added to a folder
            claim(folder / "classes" / name, {"policy": settings, "training": self.training.get(name, {})})
        experts = {task: self._expert(TASKS[task], folder, progress) for task in self.tasks}
        results = {point: self._result(point, folder, progress) for point in bar(self.points(), self.name, progress)}
        return self._report(folder, experts, results)

    def points(self) -> list[Point]:
        """Return all trainings, those that the targets ask for first."""
        classes = [name for name in self.policies if name in policies.list_policies()]
        noisy = [(task, MANY, "mlp") for task in self.tasks]
        clean: list[tuple[int, str, int]] = []
        if "relocate" in self.tasks:
            noisy += [("relocate", demos, name) for demos in self.few for name in classes]
            clean = [(wanted["demos"], *way) for wanted in self.clean for way in wanted.items() if way[0] != "demos"]
        points = [Point(*arm[:2], False, arm[2], seed) for arm in noisy for seed in range(self.seeds)]
        points += [Point("relocate", n, True, "mlp", seed, way) for n, way, count in clean for seed in range(count)]
        return sorted(points, key=lambda point: point.seed)

    def demonstrations(self, point: Point, folder: Path, progress: bool) -> list[Episode]:
        """Return the first successful flights of the expert, recording what is missing."""
        task, wanted = TASKS[point.task], max(MANY if not point.clean else 0, point.demos)
        dataset = DatasetFolder(folder / "datasets" / point.task / point.place.parts[1])
        while len(dataset.files()) < wanted:
            flown = wanted + len(dataset.files(FAILURES))  # a failure costs one more seed
            if flown > 2 * wanted:
                raise InvalidValueError(f"{dataset.path}: the expert fails too often to give {wanted} demonstrations.")
            self._record(task, range(flown), dataset.path, clean=point.clean, progress=progress)
        return list(islice(_successes(dataset.path), point.demos))

    def _record(self, task: AdroitTask, seeds: range, out: Path, *, clean: bool, progress: bool) -> None:
        env = PublishedRewards(task, min(self.num_envs, len(seeds)))
        noise = 0.0 if clean else 1.0
        try:
            expert = expert_of(task, Path(self.data), noise=noise)
            collect(env, expert, seeds, out, policy_name="dapg", settings={"noise": noise}, progress=progress)
        finally:
            env.close()

    def _expert(self, task: AdroitTask, folder: Path, progress: bool) -> EvaluationResult:
        """Judge the expert's mean action on the seeds that the learners are judged on."""
        judged = folder / "evaluations" / task.name / EXPERT
        expert = expert_of(task, Path(self.data), noise=0.0)
        return self._judged(task, expert, judged, EXPERT, progress)

    def _result(self, point: Point, folder: Path, progress: bool) -> EvaluationResult:
        judged = folder / "evaluations" / point.place
        if (judged / FILE_NAME).exists():
            return load_result(judged)
        policy = (self._cloned if point.method == CLONED else self._taught)(point, folder, progress)
        return self._judged(TASKS[point.task], policy, judged, str(point.place), progress)

    def _cloned(self, point: Point, folder: Path, progress: bool) -> Policy:
        algorithm = replace(self.algorithm, **self.training.get(point.policy, {}))
        return algorithm.train(
            self.demonstrations(point, folder, progress),
            self.policy_config(point.policy),
            run=folder / "training" / point.place,
            seed=point.seed,
            progress=progress,
        )

    def _taught(self, point: Point, folder: Path, progress: bool) -> Policy:
        """Train with an algorithm that flies and asks, with ``point.demos`` labelled flights in all."""
        algorithm, task = self.interactive[point.method], TASKS[point.task]
        algorithm = replace(algorithm, episodes=max(1, (point.demos - self.first) // algorithm.rounds))
        env = PublishedRewards(task, min(self.num_envs, algorithm.episodes))
        try:
            return algorithm.train(
                self.demonstrations(point, folder, progress)[: self.first],
                self.policy_config(point.policy),
                run=folder / "training" / point.place,
                env=env,
                expert=expert_of(task, Path(self.data), noise=0.0),
                collect=collect,
                seed=point.seed,
                progress=progress,
            )
        finally:
            env.close()

    def policy_config(self, name: str) -> PolicyConfig:
        """Return the settings of a policy class."""
        return policies.policy_config(name)(**self.policies[name])

    def _judged(self, task: AdroitTask, policy: Policy, judged: Path, name: str, progress: bool) -> EvaluationResult:
        """Return the kept evaluation, or fly and keep it with the returns that the environment itself paid."""
        if (judged / FILE_NAME).exists():
            return load_result(judged)
        env = PublishedRewards(task, min(self.num_envs, self.episodes))
        try:
            seeds = range(EVALUATION_SEED, EVALUATION_SEED + self.episodes)
            result = evaluate(env, policy, seeds, policy_name=name, progress=progress)
        finally:
            env.close()
        write_json(judged / OWN_RETURNS, {str(seed): env.own_returns[seed] for seed in seeds})
        result.save(judged)
        return result

    def _report(
        self, folder: Path, experts: Mapping[str, EvaluationResult], results: Mapping[Point, EvaluationResult]
    ) -> Report:
        arms = dict.fromkeys(point.arm for point in results)
        rows = [_expert_row(folder, task, result) for task, result in experts.items()]
        rows += [_arm_row(folder, {p: r for p, r in results.items() if p.arm == arm}) for arm in arms]
        singles = [_single_row(folder, point, result) for point, result in results.items()]
        left_out = [name for name in self.policies if name not in policies.list_policies()]
        notes = (*NOTES, *([f"Not registered, so left out: {', '.join(left_out)}."] if left_out else []))
        return Report(
            name=self.name,
            question=self.question,
            settings=self._plain(),
            targets=(*_targets(rows), *_interactive_targets(rows)),
            tables={"Learners and experts": rows, "Single trainings": singles},
            notes=notes,
            figures={"adroit.svg": learning_lines(_lines(rows), {"relocate": FEW_SUCCESS_PERCENT})} if singles else {},
            details={"failed_seeds": {str(p.place): failed_seeds(r) for p, r in results.items()}},
            wall_time_s=_seconds(folder, [*experts.values(), *results.values()], results),
        )

    def _plain(self) -> dict[str, Any]:
        """The settings as JSON gives them back."""
        return json.loads(json.dumps(asdict(self)))


def _skipped(study: Adroit) -> Report:
    """Say that the experts are not there."""
    what = f"{study.data} does not exist: nothing was measured. Say where the experts lie with bench.data=FOLDER."
    return Report(
        name=study.name,
        question=study.question,
        settings=study._plain(),
        targets=(),
        tables={"Skipped": [{"why": what}]},
        notes=(what,),
    )


def _successes(dataset: Path) -> Iterator[Episode]:
    return (episode for episode in aerial_il.open_dataset(str(dataset)) if episode.success)


def _numbers(task: str, places: Iterable[Path], results: Iterable[EvaluationResult], folder: Path) -> Row:
    """Return success, score and returns over all episodes of some evaluations of one task."""
    results = list(results)
    solved = [episode.success for result in results for episode in result.episodes]
    returns = np.array([episode.return_ for result in results for episode in result.episodes])
    own = [json.loads((folder / "evaluations" / place / OWN_RETURNS).read_text()) for place in places]
    scores = TASKS[task].score(returns)
    low, high = (round(100 * share, 1) for share in wilson(sum(solved), len(solved)))
    score_low, score_high = bootstrap_mean(scores, rng=named_rng(0, "adroit score"))
    return {
        "success": sum(solved), "episodes": len(solved), "percent": round(100 * float(np.mean(solved)), 1),
        "ci95_low": low, "ci95_high": high, "score": round(float(scores.mean()), 1),
        "score_low": round(score_low, 1), "score_high": round(score_high, 1), "return": round(float(returns.mean()), 1),
        "own_return": round(float(np.mean([value for paid in own for value in paid.values()])), 1),
    }  # fmt: skip


def _expert_row(folder: Path, task: str, result: EvaluationResult) -> Row:
    numbers = _numbers(task, [Path(task) / EXPERT], [result], folder)
    return {
        "task": task,
        "policy": "expert, mean",
        "demos": None,
        "noise_free": None,
        "seeds": None,
        **numbers,
        "labelled_steps": None,
        "queries": None,
    }


def _arm_row(folder: Path, results: Mapping[Point, EvaluationResult]) -> Row:
    any_of = next(iter(results))
    learner = any_of.place.parts[3]
    numbers = _numbers(any_of.task, [point.place for point in results], results.values(), folder)
    head = {"task": any_of.task, "policy": learner, "demos": any_of.demos, "noise_free": any_of.clean}
    told = [_told(folder, point) for point in results]
    means = {name: round(float(np.mean([row[name] for row in told]))) for name in told[0]}
    return {**head, "seeds": len(results), **numbers, **means}


def _told(folder: Path, point: Point) -> dict[str, float]:
    """Return for how many steps the learner was told what the expert does, and for how many of them it asked."""
    if point.method == CLONED:
        return {"labelled_steps": point.demos * HORIZON, "queries": 0}
    last = read_metrics(folder / "training" / point.place)[-1]
    return {name: last[f"total/{name}"] for name in ("labelled_steps", "queries")}


def _single_row(folder: Path, point: Point, result: EvaluationResult) -> Row:
    trained = read_metrics(folder / "training" / point.place)[-1]
    numbers = _numbers(point.task, [point.place], [result], folder)
    seconds = trained.get("elapsed_s")
    training = {"train_steps": int(trained["step"]), "train_min": None if seconds is None else round(seconds / 60, 2)}
    return {**asdict(point), **numbers, **training}


def _targets(rows: list[Row]) -> Iterator[Target]:
    """Yield what was asked for, of the arms that were measured."""
    for row in rows:
        if row["demos"] == MANY and row["policy"] == "mlp":
            spread = (
                f"95 % interval {row['score_low']} to {row['score_high']}, {row['success']}/{row['episodes']} solved"
            )
            what = f"{row['task']}, {MANY} demonstrations: normalised score"
            yield Target(what, "at least", SCORES[row["task"]], row["score"], "", spread)
    few = [r for r in rows if r["task"] == "relocate" and r["demos"] == 25 and r["policy"] in CHUNKED]
    if few:
        best = max(few, key=lambda row: row["percent"])
        spread = f"{best['policy']}, 95 % interval {best['ci95_low']} to {best['ci95_high']} %"
        what = "relocate, 25 demonstrations: best chunked class"
        yield Target(what, "at least", FEW_SUCCESS_PERCENT, best["percent"], "%", spread)


def _interactive_targets(rows: list[Row]) -> Iterator[Target]:
    """Yield what asking the expert must bring against cloning as many of its flights."""
    arms = {(row["policy"], row["demos"]): row for row in rows if row["noise_free"]}
    cloned, taught = arms.get(("mlp", 15)), arms.get(("mlp-dagger", 15))
    if cloned and taught:
        what = "relocate, 15 noise-free flights: lower end of DAgger's interval, above the upper end of cloning's"
        spread = f"{taught['percent']} % against {cloned['percent']} %"
        yield Target(what, "at least", cloned["ci95_high"], taught["ci95_low"], "%", spread)
    if row := arms.get(("mlp-dagger", 30)):
        yield success_target("relocate, 30 noise-free flights: DAgger", 95.0, row)
        yield from _thrift(row, [found for (policy, _), found in arms.items() if policy == "mlp-thrifty"])


def _thrift(taught: Row, thrifty: list[Row]) -> Iterator[Target]:
    """Yield what ThriftyDAgger, with the most flights that it was given, must save against DAgger with its own."""
    if not thrifty:
        return
    row = max(thrifty, key=lambda found: found["demos"])
    names = f"relocate, ThriftyDAgger with {row['demos']} flights, DAgger with {taught['demos']}"
    labels = f"{row['labelled_steps'] / taught['labelled_steps']:.2f} of its labels, with the first demonstrations"
    share = row["queries"] / taught["queries"]
    yield Target(f"{names}: share of its queries", "at most", 0.5, share, "", labels)
    spread = f"{row['percent']} % against {taught['percent']} %"
    what = f"{names}: upper end of its interval of success, above the lower end of DAgger's"
    yield Target(what, "at least", taught["ci95_low"], row["ci95_high"], "%", spread)


def _lines(rows: list[Row]) -> list[Row]:
    """Return the learners' rows as the figure wants them: a panel per task, a line per class."""
    return [
        {**row, "robot": f"{row['policy']}{', noise-free' * row['noise_free']}"}
        for row in rows
        if row["demos"] is not None
    ]


def _seconds(folder: Path, evaluations: Iterable[EvaluationResult], points: Iterable[Point]) -> float:
    """Return how long training and judging took, whenever it was done."""
    training = sum(read_metrics(folder / "training" / point.place)[-1].get("elapsed_s", 0.0) for point in points)
    return training + sum(result.provenance["wall_time_s"] for result in evaluations)


BENCHMARK = Adroit
