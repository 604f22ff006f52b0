"""Imitation on the Adroit hand, against published numbers: cloning the DAPG experts from many and from few flights.

The experts are flown and recorded, with the noise they were trained with and without it; each learner then gets the
first demonstrations of those recordings. What is judged is the final policy, over fixed seeds that nothing else uses.
Every stage leaves its result in the folder of the benchmark: killed at any moment, the same call continues.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from importlib import metadata
from itertools import islice
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

import aerial_il
from aerial_il import policies
from aerial_il.algorithms.bc import BehaviourCloning
from aerial_il.algorithms.parts.run_folder import read_metrics
from aerial_il.benchmarks.parts.adroit import POLICIES, TASKS, AdroitTask, PublishedRewards, expert_of
from aerial_il.benchmarks.parts.demonstrations import SEEDS_PER_DRAW
from aerial_il.benchmarks.parts.figures import learning_lines
from aerial_il.benchmarks.parts.ground import learning_code
from aerial_il.benchmarks.parts.progress import bar
from aerial_il.benchmarks.parts.record import Record
from aerial_il.benchmarks.parts.report import Report, Row, Target
from aerial_il.benchmarks.parts.stages import EVALUATION_SEED, described, steps_of, without_cadence
from aerial_il.benchmarks.parts.success import failed_seeds, success_target
from aerial_il.collection.collect import collect
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.files import sha256_of, write_json
from aerial_il.core.policy import Policy
from aerial_il.core.seeding import named_rng
from aerial_il.data.episode import Episode
from aerial_il.data.folder import FAILURES, DatasetFolder
from aerial_il.evaluation.result import FILE_NAME, EvaluationResult, load_result
from aerial_il.evaluation.rollouts import evaluate
from aerial_il.evaluation.statistics import Interval, bootstrap_mean, newcombe, t_interval, wilson
from aerial_il.policies.parts.network import PolicyConfig

MANY = 100
SCORES = {"door": 103.0, "relocate": 88.0}  # of cloning from 100 demonstrations
FEW_SUCCESS_PERCENT = 62.0  # 31 of 50: a perceptron on 25 demonstrations of relocate
HORIZON = 200  # steps of every episode
CHUNKED = ("act", "diffusion", "flow")
EXPERT, CLONED, OWN_RETURNS = "expert", "bc", "own_returns.json"
AS = "bc_as_"  # and the name of an interactive algorithm: cloning with as many optimisation steps as that
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
    f"{AS}dagger, {AS}thrifty: cloning with as many optimisation steps as that takes over all its rounds.",
    "Queries: steps at which a flying learner had the expert's action; labelled steps has the first demonstrations, "
    "too. ThriftyDAgger flies more often than DAgger, because a flight of its learner costs nobody anything; the ten "
    "flights alone before each of its rounds are not counted among its own.",
    "The final policy of each training is judged, on the same fixed seeds. Low and high: over the flights of these "
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
            ``bc``, a name in ``interactive``, or ``bc_as_`` and such a name: cloning with as many steps as that.
            Ways that are near to each other are told apart by many trainings only.
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
        ways = ("demos", CLONED, *self.interactive, *(f"{AS}{name}" for name in self.interactive))
        for wanted in self.clean:
            if "demos" not in wanted or not set(wanted) <= set(ways):
                raise InvalidValueError(f"clean says {dict(wanted)}; it names demos and any of {', '.join(ways[1:])}.")

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Record, train and judge what ``folder`` does not hold yet; see :class:`Benchmark`."""
        if not Path(self.data).is_dir():
            return _skipped(self)
        record = Record(folder)
        experts = {task: self._expert(TASKS[task], record, progress) for task in self.tasks}
        results = {point: self._result(point, record, progress) for point in bar(self.points(), self.name, progress)}
        return self._report(record, experts, results)

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

    def demonstrations(self, point: Point, count: int, record: Record, progress: bool) -> list[Episode]:
        """Return the first successful flights of the expert in a draw, recording what is missing."""
        task, wanted = TASKS[point.task], max(MANY if not point.clean else 0, count)
        dataset = DatasetFolder(record.place("datasets", "/".join(self._source(point)), self._shown_by(point)))
        first = SEEDS_PER_DRAW * point.seed
        while len(dataset.files()) < wanted:
            flown = wanted + len(dataset.files(FAILURES))  # a failure costs one more seed
            if flown > 2 * wanted:
                raise InvalidValueError(f"{dataset.path}: the expert fails too often to give {wanted} demonstrations.")
            self._record(task, range(first, first + flown), dataset.path, clean=point.clean, progress=progress)
        return list(islice(_successes(dataset.path), count))

    def _source(self, point: Point) -> tuple[str, ...]:
        return point.task, point.place.parts[1], str(point.seed)

    def _shown_by(self, point: Point) -> dict[str, Any]:
        """Return what decides the demonstrations of a draw."""
        return {"source": self._source(point), **self._stands_on}

    @property
    def _stands_on(self) -> dict[str, str]:
        """Whatever decides flights here: the experts, and the environments' versions."""
        versions = {name: metadata.version(name) for name in ("gymnasium", "gymnasium-robotics", "mujoco")}
        return {"experts": sha256_of(Path(self.data) / POLICIES), **versions}

    def _record(self, task: AdroitTask, seeds: range, out: Path, *, clean: bool, progress: bool) -> None:
        env = PublishedRewards(task, min(self.num_envs, len(seeds)))
        noise = 0.0 if clean else 1.0
        try:
            expert = expert_of(task, Path(self.data), noise=noise)
            collect(env, expert, seeds, out, policy_name="dapg", settings={"noise": noise}, progress=progress)
        finally:
            env.close()

    @property
    def _judging(self) -> dict[str, Any]:
        return {"seeds": [EVALUATION_SEED, EVALUATION_SEED + self.episodes], **self._stands_on}

    def _expert(self, task: AdroitTask, record: Record, progress: bool) -> EvaluationResult:
        """Judge the expert's mean action on the seeds that the learners are judged on."""
        expert = expert_of(task, Path(self.data), noise=0.0)
        return self._judged(task, lambda: expert, self.expert_place(task.name, record), EXPERT, progress)

    def expert_place(self, task: str, record: Record) -> Path:
        """Return where the evaluation of a task's expert lies."""
        return record.place("evaluations", f"{task}/{EXPERT}", self._judging)

    def judged_place(self, point: Point, record: Record) -> Path:
        """Return where the evaluation of a training lies."""
        return record.place("evaluations", str(point.place), {"training": self._decided_by(point), **self._judging})

    def run_of(self, point: Point, record: Record) -> Path:
        """Return the folder of a training."""
        return record.place("training", str(point.place), self._decided_by(point))

    def _decided_by(self, point: Point) -> dict[str, Any]:
        """Return all that decides a training."""
        asks = point.method in self.interactive
        return {
            "shown": self._shown_by(point),
            "demos": self.first if asks else point.demos,
            "algorithm": without_cadence(self.learner(point)),
            "policy": described(self.policy_config(point.policy)),
            "learning": learning_code("bc", "dagger"),
        }

    def learner(self, point: Point) -> Any:
        """Return the algorithm of a training, with ``point.demos`` labelled flights in all."""
        if point.method in self.interactive:
            algorithm = self.interactive[point.method]
            return replace(algorithm, episodes=max(1, (point.demos - self.first) // algorithm.rounds))
        cloning = replace(self.algorithm, **self.training.get(point.policy, {}))
        if point.method == CLONED:
            return cloning
        return replace(cloning, steps=steps_of(self.interactive[point.method.removeprefix(AS)]))

    def _result(self, point: Point, record: Record, progress: bool) -> EvaluationResult:
        judged = self.judged_place(point, record)
        return self._judged(
            TASKS[point.task], lambda: self._trained(point, record, progress), judged, str(point.place), progress
        )

    def _trained(self, point: Point, record: Record, progress: bool) -> Policy:
        learner, policy, task = self.learner(point), self.policy_config(point.policy), TASKS[point.task]
        told = {"run": self.run_of(point, record), "seed": point.seed, "progress": progress}
        if point.method not in self.interactive:
            return learner.train(self.demonstrations(point, point.demos, record, progress), policy, **told)
        env = PublishedRewards(task, min(self.num_envs, learner.episodes))
        try:
            shown, expert = (
                self.demonstrations(point, self.first, record, progress),
                expert_of(task, Path(self.data), noise=0.0),
            )
            return learner.train(shown, policy, env=env, expert=expert, collect=collect, **told)
        finally:
            env.close()

    def policy_config(self, name: str) -> PolicyConfig:
        """Return the settings of a policy class."""
        return policies.policy_config(name)(**self.policies[name])

    def _judged(
        self, task: AdroitTask, policy: Callable[[], Policy], judged: Path, name: str, progress: bool
    ) -> EvaluationResult:
        """Return the kept evaluation, or fly and keep it with the returns that the environment itself paid."""
        if (judged / FILE_NAME).exists():
            return load_result(judged)
        made = policy()
        env = PublishedRewards(task, min(self.num_envs, self.episodes))
        try:
            seeds = range(EVALUATION_SEED, EVALUATION_SEED + self.episodes)
            result = evaluate(env, made, seeds, policy_name=name, progress=progress)
        finally:
            env.close()
        write_json(judged / OWN_RETURNS, {str(seed): env.own_returns[seed] for seed in seeds})
        result.save(judged)
        return result

    def _report(
        self, record: Record, experts: Mapping[str, EvaluationResult], results: Mapping[Point, EvaluationResult]
    ) -> Report:
        flown = {
            point: Flown(r, self.judged_place(point, record), self.run_of(point, record))
            for point, r in results.items()
        }
        rows = [_expert_row(task, Flown(r, self.expert_place(task, record), None)) for task, r in experts.items()]
        for arm in dict.fromkeys(point.arm for point in results):
            rows.append(_arm_row({p: found for p, found in flown.items() if p.arm == arm}))
        singles = [_single_row(point, found, self.learner(point)) for point, found in flown.items()]
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
            wall_time_s=_seconds([*experts.values(), *results.values()], flown.values()),
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


@dataclass(frozen=True, eq=False)
class Flown:
    """An evaluation, where it lies, and the run of its training, None of an expert."""

    result: EvaluationResult
    judged: Path
    run: Path | None

    @property
    def own_returns(self) -> list[float]:
        """The return of each episode by the environment's own reward."""
        return list(json.loads((self.judged / OWN_RETURNS).read_text()).values())

    def scores(self, task: AdroitTask) -> np.ndarray:
        """(episodes,) normalised scores."""
        return task.score(np.array([episode.return_ for episode in self.result.episodes]))


def _numbers(task: str, found: Sequence[Flown]) -> Row:
    """Return success, score and returns of the trainings of an arm, with intervals over flights and over trainings."""
    solved = [[episode.success for episode in one.result.episodes] for one in found]
    count, flights = sum(map(sum, solved)), sum(map(len, solved))
    returns = np.array([episode.return_ for one in found for episode in one.result.episodes])
    scores = np.array([one.scores(TASKS[task]) for one in found])
    success, score = wilson(count, flights), bootstrap_mean(scores.ravel(), rng=named_rng(0, "adroit score"))
    return {
        "success": count, "episodes": flights, "percent": round(100 * count / flights, 1),
        **_ends("ci95", success, 100), **_ends("trainings", t_interval(np.mean(solved, axis=1)), 100),
        "score": round(float(scores.mean()), 1), **_ends("score", score),
        **_ends("score_trainings", t_interval(scores.mean(axis=1))), "return": round(float(returns.mean()), 1),
        "own_return": round(float(np.mean([value for one in found for value in one.own_returns])), 1),
    }  # fmt: skip


def _ends(name: str, found: Interval, scale: float = 1.0) -> Row:
    known = np.isfinite(found.lo)
    ends = {"low": found.lo, "high": found.hi}
    return {f"{name}_{end}": round(scale * value, 1) if known else None for end, value in ends.items()}


def _expert_row(task: str, found: Flown) -> Row:
    head = {"task": task, "policy": "expert, mean", "demos": None, "noise_free": None, "seeds": None}
    return {**head, **_numbers(task, [found]), "labelled_steps": None, "queries": None}


def _arm_row(found: Mapping[Point, Flown]) -> Row:
    any_of = next(iter(found))
    head = {"task": any_of.task, "policy": any_of.place.parts[3], "demos": any_of.demos, "noise_free": any_of.clean}
    told = [_told(point, one) for point, one in found.items()]
    means = {name: round(float(np.mean([row[name] for row in told]))) for name in told[0]}
    return {**head, "seeds": len(found), **_numbers(any_of.task, list(found.values())), **means}


def _told(point: Point, found: Flown) -> dict[str, float]:
    """Return for how many steps the learner was told what the expert does, and for how many of them it asked."""
    assert found.run is not None
    last = read_metrics(found.run)[-1]
    if "total/queries" not in last:
        return {"labelled_steps": point.demos * HORIZON, "queries": 0}
    return {name: last[f"total/{name}"] for name in ("labelled_steps", "queries")}


def _single_row(point: Point, found: Flown, learner: Any) -> Row:
    assert found.run is not None
    seconds = read_metrics(found.run)[-1].get("elapsed_s")
    training = {"train_steps": steps_of(learner), "train_min": None if seconds is None else round(seconds / 60, 2)}
    return {**asdict(point), **_numbers(point.task, [found]), **training}


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
    """Yield what asking the expert must bring against cloning as many of its flights with as many steps."""
    arms = {(row["policy"], row["demos"]): row for row in rows if row["noise_free"]}
    cloned, taught = arms.get((f"mlp-{AS}{DAGGER}", 15)), arms.get((f"mlp-{DAGGER}", 15))
    if cloned and taught:
        what = "relocate, 15 noise-free flights: lower end of DAgger's interval, above the upper end of cloning's"
        spread = f"{taught['percent']} % against {cloned['percent']} %, both with as many optimisation steps"
        yield Target(what, "at least", cloned["ci95_high"], taught["ci95_low"], "%", spread)
    if row := arms.get((f"mlp-{DAGGER}", 30)):
        yield success_target("relocate, 30 noise-free flights: DAgger", 95.0, row)
        yield from _thrift(row, [found for (policy, _), found in arms.items() if policy == f"mlp-{THRIFTY}"])


def _thrift(taught: Row, thrifty: list[Row]) -> Iterator[Target]:
    """Yield what ThriftyDAgger, with the most flights that it was given, must save and keep against DAgger."""
    if not thrifty:
        return
    row = max(thrifty, key=lambda found: found["demos"])
    names = f"relocate, ThriftyDAgger with {row['demos']} flights, DAgger with {taught['demos']}"
    labels = f"{row['labelled_steps'] / taught['labelled_steps']:.2f} of its labels, with the first demonstrations"
    share = row["queries"] / taught["queries"]
    yield Target(f"{names}: share of its queries", "at most", 0.5, share, "", labels)
    low, high = newcombe(taught["success"], taught["episodes"], row["success"], row["episodes"])
    spread = f"{row['percent']} % against {taught['percent']} %, difference {100 * low:+.1f} to {100 * high:+.1f}"
    what = f"{names}: lower end of the difference in success"
    yield Target(what, "at least", AS_GOOD_POINTS, round(100 * low, 1), "points", spread)
    spread = f"{row['score_low']} to {row['score_high']} against {taught['score_low']} to {taught['score_high']}"
    yield Target(f"{names}: normalised score", "at least", taught["score_low"], row["score"], "", spread)


def _lines(rows: list[Row]) -> list[Row]:
    """Return the learners' rows as the figure wants them: a panel per task, a line per class."""
    return [
        {**row, "robot": f"{row['policy']}{', noise-free' * row['noise_free']}"}
        for row in rows
        if row["demos"] is not None
    ]


def _seconds(evaluations: Iterable[EvaluationResult], trained: Iterable[Flown]) -> float:
    """Return how long training and judging took, whenever it was done."""
    runs = [one.run for one in trained if one.run is not None]
    return sum(read_metrics(run)[-1].get("elapsed_s", 0.0) for run in runs) + sum(
        result.provenance["wall_time_s"] for result in evaluations
    )


BENCHMARK = Adroit
