"""Rounds of flying and learning that grow one dataset and survive any kill.

A run's folder holds, besides what every run has::

    dataset/             everything labelled so far as one ordinary dataset; provenance tells each flight's round
    rounds/003/alone/    flights that the learner made alone, unlabelled, where the gate wants them
    rounds/003/flights/  labelled flights of the round; they appear all at once, and are flown anew until they do
    rounds/003/turns.json  what each pilot's flights cost, where several flew in turn; only successes are kept then
    rounds/003/training/ the supervised run that followed, an ordinary one
    checkpoints/00000003 the policy after it

A round is a function of the round before and of the seed, and so are the bytes of everything in it.
"""

from __future__ import annotations

import math
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from aerial_il.algorithms.interactive.costs import FlightCosts, metrics_of
from aerial_il.algorithms.interactive.settings import InteractiveSettings
from aerial_il.algorithms.run.cadence import CADENCE, Evaluate, due
from aerial_il.algorithms.run.folder import RunFolder
from aerial_il.algorithms.run.threads import torch_threads
from aerial_il.algorithms.supervised.algorithm import SupervisedAlgorithm
from aerial_il.algorithms.supervised.training_set import cut_windows, digest_of, read_demos
from aerial_il.core.bounded import read_json
from aerial_il.core.checkpoint import Checkpoint
from aerial_il.core.contracts import BatchEnv, Policy
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.files import sync_folder, write_json
from aerial_il.core.provenance import provenance
from aerial_il.core.settings import plain
from aerial_il.core.specs import EnvSpec, ObservationSpec
from aerial_il.data.dataset import open_dataset
from aerial_il.data.episode import Episode
from aerial_il.data.folder import FAILURES, KINDS, DatasetFolder
from aerial_il.data.recording.writer import write_episode
from aerial_il.policies import load_policy
from aerial_il.policies.parts.chunk_policy import UNIMPORTANT, ChunkPolicy
from aerial_il.policies.parts.network import PolicyConfig

ROUNDS, DATASET = "rounds", "dataset"
FLIGHTS, ALONE, TRAINING = "flights", "alone", "training"
TURNS = "turns.json"
FIRST_SEED, SEEDS_PER_RUN = (
    1_000_000,
    100_000,
)  # of flights: far from demonstrations (0 ...) and evaluations (10000 ...)


class Collected(Protocol):
    """What came of recording flights: seeds by outcome, and control steps flown."""

    demos: list[int]
    failures: list[int]
    steps: int


class Collect(Protocol):
    """Records flights; ``aerial_il.collection.collect.collect`` is one."""

    def __call__(
        self,
        env: BatchEnv,
        policy: Policy,
        seeds: Iterable[int],
        out: str | os.PathLike[str],
        *,
        policy_name: str,
        settings: Mapping[str, Any],
        longest: int | None,
        progress: bool,
    ) -> Collected: ...


@runtime_checkable
class Operator(Protocol):
    """Somebody at the controls, a person or a model of one, who watches a learner fly and takes over as they see fit.

    What they do is no function of the seed, so what they have finished is kept through any kill.
    """

    def record(
        self, env: BatchEnv, learner: Policy, out: str | os.PathLike[str], *, seeds: range, tags: Mapping[str, Any]
    ) -> None:
        """Record flights until ``out`` holds as many as there are ``seeds``; those it holds already count.

        Args:
            env: one world of the suite. learner: flies while nobody takes over. out: a dataset folder.
            seeds: from the first on, one after another. tags: plain values for the provenance.

        Raises:
            InvalidValueError: a person cannot fly ``env``.
        """
        ...

    def told(self, rounds: Sequence[FlightCosts], message: str) -> None:
        """Take note of how the rounds so far went, and of what happens now."""
        ...


@dataclass(frozen=True, eq=False)
class InteractiveProblem:
    """What an interactive run learns on.

    Attributes:
        settings: of its algorithm. policy: what is trained. seed: decides all randomness.
        env: a batch environment. expert: whom it learns from; it can take over from any state. An operator records
            the flights themselves. None where nobody is asked.
        collect: records flights. progress: show progress bars.
    """

    settings: InteractiveSettings
    policy: PolicyConfig
    seed: int
    env: BatchEnv
    expert: Policy | Operator | None
    collect: Collect
    progress: bool

    def origin(self, demos: Sequence[Episode]) -> dict[str, Any]:
        """Return where a policy comes from, as it is kept with it."""
        data = {"demonstrations": len(demos), "frames": sum(map(len, demos))}
        return {"algorithm": self.settings.name, "seed": self.seed, "dataset": data}

    def describe(self, demos: Sequence[Episode]) -> dict[str, Any]:
        """Return plain values that determine the run."""
        layout, _ = read_demos(demos, self.policy)
        origin, spec = self.origin(demos), self.env.spec
        where = {key: getattr(spec, key) for key in ("robot", "task", "tier", "controller")}
        return {
            **origin,
            "dataset": {**origin["dataset"], "digest": digest_of(cut_windows(demos, layout, self.policy))},
            "environment": {**where, "num_envs": self.env.num_envs},
            "settings": plain(self.settings),
            **self.settings.inputs(spec),
            "policy": {"name": self.policy.name, **self.policy.to_dict()},
        }


class Rounds:
    """One interactive run; open it with :meth:`open`.

    Attributes:
        problem: what it learns on.
        demos: the demonstrations that it began with. dataset: all labelled episodes so far.
        costs: of the labelled flights of each round, from round 1.
        learner: the policy after the newest round that is complete, or None.
        finished: the policy of a run that is finished, or None.
    """

    def __init__(self, folder: RunFolder, problem: InteractiveProblem, demos: Sequence[Episode]) -> None:
        self._folder, self.problem, self._settings = folder, problem, problem.settings
        self.demos, self.dataset = list(demos), list(demos)
        self.costs: list[FlightCosts] = []
        self.learner: ChunkPolicy | None = None
        self.finished = load_policy(folder.path) if folder.finished else None
        self._next = 0
        if folder.resumed and not self.finished:
            self._next = int(folder.resumed.state["round"]) + 1
            self.learner = load_policy(self._place(self._next - 1) / TRAINING)
            for number in range(1, self._next):
                self._take_in(number)

    @staticmethod
    @contextmanager
    def open(
        run: str | os.PathLike[str], dataset: Iterable[Episode], problem: InteractiveProblem, *, resume: bool
    ) -> Iterator[Rounds]:
        """Check that all fits together, claim the folder, and find where to go on.

        Raises:
            InvalidValueError: the demonstrations were flown in another environment, the expert is missing, the folder
                holds another run, and whatever supervised learning refuses.
        """
        if problem.expert is None and "expert" in problem.settings.needs:
            raise InvalidValueError(f"{problem.settings.name} asks an expert, and there is none. Try expert=scripted.")
        spec = problem.env.spec
        _, demos = read_demos((_as_shown(episode, spec) for episode in dataset), problem.policy)
        _check(demos[0].spec, spec)
        with RunFolder.open(run, problem.describe(demos), cadence=CADENCE, resume=resume) as folder:
            if not resume:
                for name in (ROUNDS, DATASET):
                    shutil.rmtree(folder.path / name, ignore_errors=True)
            with torch_threads(problem.settings.training.threads):
                yield Rounds(folder, problem, demos)

    @property
    def teacher(self) -> Policy | Operator:
        """Whom it asks."""
        assert self.problem.expert is not None, "checked when the run was opened"
        return self.problem.expert

    def left(self) -> range:
        """Return the numbers of the rounds that are not complete; round 0 only learns."""
        return range(self._next, self._settings.rounds + 1)

    def fly(self, number: int, pilot: Callable[[], Policy]) -> None:
        """Add the labelled flights of a round to the dataset: those that are there, else flown by ``pilot()``."""
        folder = self._place(number) / FLIGHTS
        if not folder.exists():
            self._record(folder, pilot(), range(self._settings.episodes), number=number, name=self._settings.name)
        self._take_in(number)
        self._aggregate(number)

    def fly_in_turn(self, number: int, pilots: Iterable[Policy]) -> list[FlightCosts]:
        """Have one pilot after another fly the starts of a round that none has solved; only successes are kept.

        Returns:
            What the flights of each pilot cost; the last ones need not have flown.
        """
        place = self._place(number)
        if not (place / FLIGHTS).exists():
            self._fly_in_turn(number, pilots)
        self._take_in(number)
        self._aggregate(number)
        return _read_turns(place)

    def alone(self, number: int, episodes: int) -> list[Episode]:
        """Return the flights that learners made alone in all rounds up to this one, having this round's made."""
        folder = self._place(number) / ALONE
        if not folder.exists():
            assert self.learner is not None
            which = range(self._settings.episodes, self._settings.episodes + episodes)
            self._record(folder, self.learner, which, number=number, name="learner")
        return [flight for k in range(1, number + 1) for flight in self._read(self._place(k) / ALONE)]

    def learn(self, number: int) -> ChunkPolicy:
        """Train the learner on the whole dataset, at length in the first and the last round."""
        settings, place = self._settings, self._place(number) / TRAINING
        if isinstance(self.problem.expert, Operator):
            self.problem.expert.told(self.costs, f"Round {number} of {settings.rounds}: it learns.")
        training = settings.training if number in (0, settings.rounds) else settings.between
        initial = self.learner if settings.warm_start else None
        weights = demonstration_weights(self.demos, self.dataset[len(self.demos) :], settings.demos_share)
        self._train(training, self.dataset, place, self.problem.seed, initial, weights)
        self.learner = load_policy(place)  # as a resumed run has it, on the processor, wherever it was trained
        return self.learner

    def auxiliary(self, number: int, name: str, dataset: Sequence[Episode], *, seed: int) -> ChunkPolicy:
        """Return a policy that only serves to judge the learner, trained afresh on ``dataset``."""
        training = replace(self._settings.between, validation=0.0)
        return self._train(training, dataset, self._place(number) / name, seed, None)

    def end_round(self, number: int, evaluate: Evaluate | None, metrics: Mapping[str, float] | None = None) -> None:
        """Log the round, evaluated where that is due, and make it the one to go on from.

        Args:
            evaluate: ``(policy, round) -> named numbers``. metrics: more to log.
        """
        settings, policy = self._settings, self._signed(number)
        judges = number == settings.rounds or due(settings.evaluate_every, number)
        judged = {f"evaluate/{k}": v for k, v in evaluate(policy, number).items()} if evaluate and judges else {}
        self._folder.log(number, {**self._metrics(), **(metrics or {}), **judged})
        saved = policy.to_checkpoint()
        checkpoint = Checkpoint(saved.arrays, {**saved.state, "round": number}, saved.config)
        self._folder.save(number, checkpoint, keep=settings.keep_checkpoints)

    def finish(self) -> ChunkPolicy:
        """Save the last round's policy as the run's."""
        policy = self._signed(self._settings.rounds)
        self._folder.finish(policy)
        return policy

    def _place(self, number: int) -> Path:
        return self._folder.path / ROUNDS / f"{number:03d}"

    def _train(
        self,
        training: SupervisedAlgorithm,
        dataset: Sequence[Episode],
        run: Path,
        seed: int,
        initial: ChunkPolicy | None,
        weights: Sequence[float] | None = None,
    ) -> ChunkPolicy:
        progress = self.problem.progress
        return training.train(
            dataset,
            self.problem.policy,
            run=run,
            seed=seed,
            progress=progress,
            failures=True,
            weights=weights,
            initial=initial,
        )

    def _signed(self, number: int) -> ChunkPolicy:
        """Return the learner with where it comes from."""
        assert self.learner is not None
        costs = {name: int(value) for name, value in self._metrics().items()}
        origin = {**self.problem.origin(self.demos), "round": number, **costs, "provenance": provenance()}
        return ChunkPolicy(self.problem.policy, self.learner.interface, self.learner.network, origin)

    @property
    def _longest(self) -> int | None:
        """Control steps after which a flight is cut off."""
        return math.ceil(self._settings.patience * max(map(len, self.demos))) or None

    def _metrics(self) -> dict[str, float]:
        return metrics_of(self.costs, self.demos, self.dataset)

    def _record(self, folder: Path, pilot: Policy, which: range, *, number: int, name: str) -> None:
        """Record flights, all or none: a kill in between leaves nothing, and the next call flies the same.

        An operator goes on after the flights that were finished.
        """
        aside, settings = folder.with_name(f"{folder.name}.flying"), self._settings
        seeds, tags = self._seeds(number, which), self._tags(number)
        if isinstance(self.problem.expert, Operator):
            self.problem.expert.told(self.costs, f"Round {number} of {settings.rounds}: watch it fly.")
            self.problem.expert.record(self.problem.env, pilot, aside, seeds=seeds, tags=tags)
        else:
            shutil.rmtree(aside, ignore_errors=True)
            self._collect(pilot, list(seeds), aside, tags, name)
        os.replace(aside, folder)
        sync_folder(folder.parent)

    def _fly_in_turn(self, number: int, pilots: Iterable[Policy]) -> None:
        """Record the successes of a round, all or none, and what each turn cost."""
        place, left = self._place(number), list(self._seeds(number, range(self._settings.episodes)))
        aside, turns = place / f"{FLIGHTS}.flying", list[FlightCosts]()
        shutil.rmtree(aside, ignore_errors=True)
        kept = DatasetFolder(aside)
        kept.claim(self.problem.env.spec)
        for turn, pilot in enumerate(pilots):
            flown = DatasetFolder(place / "turn.flying")
            shutil.rmtree(flown.path, ignore_errors=True)
            tags = {**self._tags(number), "turn": turn}
            found = self._collect(pilot, left, flown.path, tags, self._settings.name)
            shutil.rmtree(flown.path / FAILURES, ignore_errors=True)
            kept.adopt(flown)
            shutil.rmtree(flown.path)
            turns.append(FlightCosts(len(left), len(found.demos), found.steps, solved_alone=len(found.demos)))
            left = sorted(found.failures)
            if not left:
                break
        kept.write_index(self.problem.env.spec)
        write_json(place / TURNS, [asdict(costs) for costs in turns])
        os.replace(aside, place / FLIGHTS)
        sync_folder(place)

    def _collect(self, pilot: Policy, seeds: list[int], out: Path, tags: Mapping[str, Any], name: str) -> Collected:
        """Record the flights of ``pilot`` in ``out``."""
        options = {"progress": self.problem.progress, "longest": self._longest}
        return self.problem.collect(self.problem.env, pilot, seeds, out, policy_name=name, settings=tags, **options)

    def _seeds(self, number: int, which: range) -> range:
        """Return the seeds of some flights of a round."""
        first = FIRST_SEED + SEEDS_PER_RUN * self.problem.seed + number * max(1, self._settings.seeds_per_round)
        return range(first + which.start, first + which.stop)

    def _tags(self, number: int) -> dict[str, Any]:
        return {"algorithm": self._settings.name, "run_seed": self.problem.seed, "round": number}

    def _read(self, folder: Path) -> list[Episode]:
        if not any(DatasetFolder(folder).files(kind) for kind in KINDS):
            return []
        return list(open_dataset(folder, cameras=self.problem.policy.images, failures=True))

    def _take_in(self, number: int) -> None:
        """Count the flights of a round and learn from those with labels that are as long as a chunk."""
        place = self._place(number)
        flights = self._read(place / FLIGHTS)
        turns = _read_turns(place) if (place / TURNS).exists() else [FlightCosts.of(flights)]
        self.costs.append(sum(turns, start=FlightCosts()))
        self.dataset += [f for f in flights if self._settings.learns_from(f) and len(f) >= self.problem.policy.chunk]

    def _aggregate(self, number: int) -> None:
        """Add the flights of a round to the dataset on disk."""
        dataset, spec = DatasetFolder(self._folder.path / DATASET), self.problem.env.spec
        dataset.claim(spec)
        for episode in self.demos:
            if dataset.find(episode.uid) is None:
                write_episode(episode, dataset.file(episode.uid))
        dataset.adopt(DatasetFolder(self._place(number) / FLIGHTS))
        dataset.write_index(spec)


def _read_turns(place: Path) -> list[FlightCosts]:
    """Return what each pilot's flights of a round cost."""
    return [FlightCosts(**costs) for costs in read_json(place / TURNS)]


def demonstration_weights(demos: Sequence[Episode], flights: Sequence[Episode], share: float) -> list[float] | None:
    """Return how often each episode is visited, so that a step in ``share`` of all is one of the demonstrations.

    Returns:
        The weights of the demonstrations and then of the flights; None, all alike, where they have that share anyway.
    """
    shown, flown = (sum(map(len, episodes)) for episodes in (demos, flights))
    if shown >= share * (shown + flown):
        return None
    return [share / shown] * len(demos) + [(1.0 - share) / flown] * len(flights)


def _as_shown(episode: Episode, spec: EnvSpec) -> Episode:
    """Return the episode without fields that the environment does not show, e.g. cameras that it flies without."""
    shown = tuple(f for f in episode.spec.observation.fields if f.name in spec.observation.names)
    if len(shown) == len(episode.spec.observation.fields):
        return episode
    obs = {name: values for name, values in episode.obs.items() if name in spec.observation.names}
    return replace(episode, spec=replace(episode.spec, observation=ObservationSpec(shown)), obs=obs)


def _check(recorded: EnvSpec, spec: EnvSpec) -> None:
    if differing := recorded.differences(spec, ignore=UNIMPORTANT):
        raise InvalidValueError(
            f"The demonstrations show {recorded.task} on {recorded.robot}, the environment is {spec.task} on "
            f"{spec.robot}. It differs in: {'; '.join(differing)}. Fly where the demonstrations were flown."
        )
