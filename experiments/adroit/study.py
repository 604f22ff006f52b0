"""Imitation on the Adroit hand, against published numbers: cloning the DAPG experts from many and from few flights.

The experts are flown and recorded, with the noise they were trained with and without it; each learner then gets the
first demonstrations of those recordings. What is judged is the final policy, over fixed seeds that nothing else uses.
Every stage leaves its result in the folder of the benchmark: killed at any moment, the same call continues.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from importlib import metadata
from itertools import islice
from pathlib import Path
from typing import Any, ClassVar

import aerial_il
from aerial_il import policies
from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.dagger import DAgger
from aerial_il.algorithms.interactive.gates.coin import CoinGate
from aerial_il.algorithms.interactive.gates.thrifty import ThriftyGate
from aerial_il.collection.collect import collect
from aerial_il.core.contracts import Policy
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.files import sha256_of, write_json
from aerial_il.data.episode import Episode
from aerial_il.data.folder import FAILURES, DatasetFolder
from aerial_il.evaluation.result import FILE_NAME, EvaluationResult, load_result
from aerial_il.evaluation.rollouts import evaluate
from aerial_il.policies.parts.network import PolicySettings
from experiments.adroit.tables import (
    AS,
    CLONED,
    FEW_SUCCESS_PERCENT,
    MANY,
    OWN_RETURNS,
    Flown,
    Point,
    arm_row,
    cloning_targets,
    expert_row,
    interactive_targets,
    lines,
    single_row,
    total_seconds,
)
from experiments.adroit.tasks import POLICIES, TASKS, AdroitTask, PublishedRewards, expert_of
from experiments.common.demonstrations import SEEDS_PER_DRAW
from experiments.common.figures import learning_lines
from experiments.common.record import Record
from experiments.common.report import Report, bar, skipped
from experiments.common.seeds import EVALUATION_SEED
from experiments.common.stages import described, steps_of, without_cadence
from experiments.common.success import failed_seeds

EXPERT = "expert"
NOTES = (
    "Success: the goal is held in more than 25 of 200 steps (DAPG). Score: 100 · (return − random) / (expert − random) "
    "with D4RL's reference returns (d4rl/infos.py): door −56.512833 and 2880.5693087, relocate −6.425911 and "
    "4233.8777977.",
    "The v1 environments of gymnasium-robotics add 0.1 · distance from palm to handle (door) or object (relocate) to "
    "the reward where D4RL's and DAPG's subtract it. Returns and scores are those of the published reward: twice that "
    "term is taken off in each step. The column own_return has what the environment itself paid.",
    "Demonstrations are flown by the experts of DAPG as they were trained, with sampled actions, except where "
    "noise-free is said, which flies their mean. Learners see the action that was flown, never the mean.",
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

PEERS = {"chunk": 4, "execute": 4, "ensemble": None, "masked_fields": [], "redraw": False}
CLONED_BY: Mapping[str, Mapping[str, Any]] = {
    "mlp": {"chunk": 1, "ensemble": None, "hidden": [256, 256], "loss": "l2", "masked_fields": []},
    "act": {"chunk": 10, "ensemble": 0.01, "masked_fields": []},
    "diffusion": PEERS,
    "flow": PEERS,
}
CLONING = BC(steps=8_000, validation=0.0)
IN_ROUNDS: Mapping[str, Any] = {"patience": 0.0, "demos_share": 0.0, "evaluate_every": 0, "between_steps": 4_000}
ASKING = {
    "dagger": DAgger(rounds=5, gate=CoinGate(hold=1), training=CLONING, **IN_ROUNDS),
    "thrifty": DAgger(rounds=10, gate=ThriftyGate(ensemble=3, least=1, agreement=3.0), training=CLONING, **IN_ROUNDS),
}
CLEAN: tuple[Mapping[str, int], ...] = (
    {"demos": 15, CLONED: 10, f"{AS}dagger": 10, "dagger": 10},
    {"demos": 30, CLONED: 3, f"{AS}dagger": 3, "dagger": 3},
    {"demos": 35, f"{AS}thrifty": 3, "thrifty": 3},
)


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
            Ways that are near to each other are options apart by many trainings only.
        interactive: name -> algorithm that flies and asks the expert, with as many flights in all as ``clean`` says.
            first: of them, flown by the expert.
        episodes: flown to judge one. first_episode: the first of them. num_envs: worlds flown at once.
    """

    name: ClassVar[str] = "adroit"
    question: ClassVar[str] = "How well are the Adroit hand's experts cloned, from many and from few demonstrations?"

    data: str = "datasets/adroit"
    policies: Mapping[str, Mapping[str, Any]] = field(default_factory=lambda: dict(CLONED_BY), hash=False)
    algorithm: BC = CLONING
    training: Mapping[str, Mapping[str, Any]] = field(default_factory=dict, hash=False)
    tasks: tuple[str, ...] = ("door", "relocate")
    few: tuple[int, ...] = (10, 25)
    clean: tuple[Mapping[str, int], ...] = field(default=CLEAN, hash=False)
    interactive: Mapping[str, DAgger] = field(default_factory=lambda: dict(ASKING), hash=False)
    first: int = 5
    seeds: int = 3
    episodes: int = 100
    first_episode: int = EVALUATION_SEED
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
        """Record, train and judge what ``folder`` does not hold yet; see :class:`Study`."""
        if not Path(self.data).is_dir():
            what = (
                f"{self.data} does not exist: nothing was measured. Say where the experts lie with bench.data=FOLDER."
            )
            return skipped(self, what)
        record = Record(folder)
        experts = {task: self._expert(TASKS[task], record, progress) for task in self.tasks}
        results = {point: self._result(point, record, progress) for point in bar(self.points(), self.name, progress)}
        return self._report(record, experts, results)

    def points(self) -> list[Point]:
        """Return all trainings, those that the targets ask for first."""
        classes = [name for name in self.policies if name in policies.names()]
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
        return {"seeds": [self.first_episode, self.first_episode + self.episodes], **self._stands_on}

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
        options = {"run": self.run_of(point, record), "seed": point.seed, "progress": progress}
        if point.method not in self.interactive:
            return learner.train(self.demonstrations(point, point.demos, record, progress), policy, **options)
        env = PublishedRewards(task, min(self.num_envs, learner.episodes))
        try:
            shown, expert = (
                self.demonstrations(point, self.first, record, progress),
                expert_of(task, Path(self.data), noise=0.0),
            )
            return learner.train(shown, policy, env=env, expert=expert, collect=collect, **options)
        finally:
            env.close()

    def policy_config(self, name: str) -> PolicySettings:
        """Return the settings of a policy class."""
        return policies.get(name)(**self.policies[name])

    def _judged(
        self, task: AdroitTask, policy: Callable[[], Policy], judged: Path, name: str, progress: bool
    ) -> EvaluationResult:
        """Return the kept evaluation, or fly and keep it with the returns that the environment itself paid."""
        if (judged / FILE_NAME).exists():
            return load_result(judged)
        made = policy()
        env = PublishedRewards(task, min(self.num_envs, self.episodes))
        try:
            seeds = range(self.first_episode, self.first_episode + self.episodes)
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
        rows = [expert_row(task, Flown(r, self.expert_place(task, record), None)) for task, r in experts.items()]
        for arm in dict.fromkeys(point.arm for point in results):
            rows.append(arm_row({p: found for p, found in flown.items() if p.arm == arm}))
        singles = [single_row(point, found, self.learner(point)) for point, found in flown.items()]
        left_out = [name for name in self.policies if name not in policies.names()]
        notes = (*NOTES, *([f"Not registered, so left out: {', '.join(left_out)}."] if left_out else []))
        return Report(
            study=self,
            targets=(*cloning_targets(rows), *interactive_targets(rows)),
            tables={"Learners and experts": rows, "Single trainings": singles},
            notes=notes,
            figures={"adroit.svg": learning_lines(lines(rows), {"relocate": FEW_SUCCESS_PERCENT})} if singles else {},
            details={"failed_seeds": {str(p.place): failed_seeds(r) for p, r in results.items()}},
            wall_time_s=total_seconds([*experts.values(), *results.values()], flown.values()),
        )


def _successes(dataset: Path) -> Iterator[Episode]:
    return (episode for episode in aerial_il.open_dataset(str(dataset)) if episode.success)
