"""What interactive algorithms share: rounds of flying and learning that grow one dataset and survive any kill.

A run's folder holds, besides what every run has::

    dataset/             everything labelled so far as one ordinary dataset; provenance tells each flight's round
    rounds/003/alone/    flights that the learner made alone, unlabelled, where the gate wants them
    rounds/003/flights/  labelled flights of the round; they appear all at once, and are flown anew until they do
    rounds/003/training/ the supervised run that followed, an ordinary one
    checkpoints/00000003 the policy after it

A round is a function of the round before and of the seed, and so are the bytes of everything in it.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from aerial_il.algorithms.bc import BehaviourCloning, Evaluate
from aerial_il.algorithms.parts.run_folder import RunFolder
from aerial_il.algorithms.parts.threads import torch_threads
from aerial_il.algorithms.parts.training_set import cut_windows, digest_of, read_demos
from aerial_il.core.checkpoint import Checkpoint
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.files import sync_folder
from aerial_il.core.policy import Policy
from aerial_il.core.provenance import provenance
from aerial_il.core.specs import EnvSpec, ObservationSpec
from aerial_il.data.dataset import open_dataset
from aerial_il.data.episode import Episode
from aerial_il.data.folder import DatasetFolder
from aerial_il.data.recording.writer import write_episode
from aerial_il.policies import load_policy
from aerial_il.policies.parts.chunk_policy import UNIMPORTANT, ChunkPolicy
from aerial_il.policies.parts.network import PolicyConfig

ROUNDS, DATASET = "rounds", "dataset"
FLIGHTS, ALONE, TRAINING = "flights", "alone", "training"
FIRST_SEED, SEEDS_PER_RUN = (
    1_000_000,
    100_000,
)  # of flights: far from demonstrations (0 ...) and evaluations (10000 ...)


class Collect(Protocol):
    """Records flights; ``aerial_il.collection.collect.collect`` is one."""

    def __call__(
        self,
        env: Any,
        policy: Policy,
        seeds: Iterable[int],
        out: str | os.PathLike[str],
        *,
        policy_name: str,
        settings: Mapping[str, Any],
        progress: bool,
    ) -> object: ...


@dataclass(frozen=True)
class Workplace:
    """Where an interactive algorithm flies, and with whom.

    Attributes:
        env: a batch environment.
        expert: whom it learns from; it can take over from any state.
        collect: records flights.
    """

    env: Any
    expert: Policy
    collect: Collect


@dataclass(frozen=True)
class Tally:
    """What some flights cost and brought.

    Attributes:
        flights, successes: how many. steps: control steps flown. queries: steps that the expert labelled.
        interventions: times that it took over. expert_steps: steps that it flew.
    """

    flights: int
    successes: int
    steps: int
    queries: int
    interventions: int
    expert_steps: int

    @staticmethod
    def of(episodes: Sequence[Episode]) -> Tally:
        return Tally(
            flights=len(episodes),
            successes=sum(e.success for e in episodes),
            steps=sum(map(len, episodes)),
            queries=sum(int(e.asked.sum()) for e in episodes),
            interventions=sum(
                int((np.diff(e.is_intervention, prepend=False) & e.is_intervention).sum()) for e in episodes
            ),
            expert_steps=sum(int(e.is_intervention.sum()) for e in episodes),
        )


class Rounds:
    """One interactive run; open it with :meth:`open`.

    Attributes:
        demos: the demonstrations that it began with. lessons: all labelled episodes so far.
        tallies: of the labelled flights of each round, from round 1.
        learner: the policy after the newest round that is complete, or None.
    """

    def __init__(self, folder: RunFolder, workplace: Workplace, training: Training, demos: Sequence[Episode]) -> None:
        self._folder, self._at, self._training = folder, workplace, training
        self.demos, self.lessons = list(demos), list(demos)
        self.tallies: list[Tally] = []
        self.learner: ChunkPolicy | None = None
        self.finished = load_policy(folder.path) if folder.finished else None
        self._next = 0
        if folder.resumed and not self.finished:
            self._next = int(folder.resumed.state["round"]) + 1
            self.learner = load_policy(self.place(self._next - 1) / TRAINING)
            for number in range(1, self._next):
                self._take_in(self._read(self.place(number) / FLIGHTS))

    @staticmethod
    @contextmanager
    def open(
        run: str | os.PathLike[str],
        dataset: Iterable[Episode],
        workplace: Workplace,
        training: Training,
        *,
        resume: bool,
    ) -> Iterator[Rounds]:
        """Check that all fits together, claim the folder, and find where to go on.

        Raises:
            InvalidValueError: the demonstrations were flown in another environment, the expert is missing, the folder
                holds another run, and whatever supervised learning refuses.
        """
        if workplace.expert is None:
            raise InvalidValueError(f"{training.name} asks an expert, and there is none. Try expert=scripted.")
        spec = workplace.env.spec
        _, demos = read_demos((_as_shown(episode, spec) for episode in dataset), training.policy)
        _check(demos[0].spec, spec)
        with RunFolder.open(
            run, training.describe(demos, spec, workplace.env.num_envs), cadence=training.cadence, resume=resume
        ) as folder:
            if not resume:
                for name in (ROUNDS, DATASET):
                    shutil.rmtree(folder.path / name, ignore_errors=True)
            with torch_threads(training.bc.threads):
                yield Rounds(folder, workplace, training, demos)

    @property
    def seed(self) -> int:
        return self._training.seed

    def place(self, number: int) -> Path:
        return self._folder.path / ROUNDS / f"{number:03d}"

    def left(self, rounds: int) -> range:
        """Return the numbers of the rounds that are not complete; round 0 only learns."""
        return range(self._next, rounds + 1)

    def fly(self, number: int, pilot: Callable[[], Policy], episodes: int, *, progress: bool) -> None:
        """Have ``pilot`` fly the labelled flights of a round, unless they are there, and take them in."""
        folder = self.place(number) / FLIGHTS
        if not folder.exists():
            self._have_flown(
                folder, pilot(), range(episodes), number=number, name=self._training.name, progress=progress
            )
        self._take_in(self._read(folder))
        self._aggregate(number)

    def alone(self, number: int, first: int, episodes: int, *, progress: bool) -> list[Episode]:
        """Return the flights that learners made alone in all rounds up to this one, having this round's made."""
        folder = self.place(number) / ALONE
        if not folder.exists():
            assert self.learner is not None
            seeds = range(first, first + episodes)
            self._have_flown(folder, self.learner, seeds, number=number, name="learner", progress=progress)
        return [flight for k in range(1, number + 1) for flight in self._read(self.place(k) / ALONE)]

    def learn(self, number: int, *, last: bool, progress: bool) -> ChunkPolicy:
        """Learn from all lessons, at length in the first and the last round."""
        going_on = self._training.warm and self.learner is not None
        settings = self._training.between if number and not last else self._training.bc
        place = self.place(number) / TRAINING
        settings.train(
            self.lessons,
            self._training.policy,
            run=place,
            seed=self._training.seed,
            progress=progress,
            failures=True,
            initial=self.learner if going_on else None,
        )
        self.learner = load_policy(place)  # as a resumed run has it, on the processor, wherever it was trained
        return self.learner

    def auxiliary(
        self, number: int, name: str, lessons: Sequence[Episode], *, seed: int, progress: bool
    ) -> ChunkPolicy:
        """Return a policy that only serves to judge the learner, trained afresh on ``lessons``."""
        return replace(self._training.between, validation=0.0).train(
            lessons,
            self._training.policy,
            run=self.place(number) / name,
            seed=seed,
            progress=progress,
            failures=True,
        )

    def report(self, number: int, *, evaluate: Evaluate | None, extra: Mapping[str, float], keep: int) -> None:
        """Log the round, judged by ``evaluate`` if it is given, and make it the one to go on from."""
        assert self.learner is not None
        policy = self._signed(number)
        judged = {f"evaluate/{k}": v for k, v in evaluate(policy, number).items()} if evaluate else {}
        self._folder.log(number, {**self._costs(number), **extra, **judged})
        saved = policy.to_checkpoint()
        self._folder.save(number, Checkpoint(saved.arrays, {**saved.state, "round": number}, saved.config), keep=keep)

    def finish(self, number: int) -> ChunkPolicy:
        """Save the last round's policy as the run's."""
        policy = self._signed(number)
        self._folder.finish(policy)
        return policy

    def _signed(self, number: int) -> ChunkPolicy:
        assert self.learner is not None
        costs = {k: int(v) for k, v in self._costs(number).items()}
        origin = {**self._training.origin(self.demos), "round": number, **costs, "provenance": provenance()}
        return ChunkPolicy(self._training.policy, self.learner.interface, self.learner.network, origin)

    def _costs(self, number: int) -> dict[str, float]:
        """What the round cost and what all of them did, demonstrations included."""
        tally = self.tallies[number - 1] if number else Tally(0, 0, 0, 0, 0, 0)
        shown = sum(map(len, self.demos))
        return {
            "flights": tally.flights,
            "flights_solved": tally.successes,
            "flight_steps": tally.steps,
            "queries": tally.queries,
            "interventions": tally.interventions,
            "expert_steps": tally.expert_steps,
            "total/queries": sum(t.queries for t in self.tallies),
            "total/labelled_steps": shown + sum(t.queries for t in self.tallies),
            "total/episodes": len(self.demos) + sum(t.flights for t in self.tallies),
            "total/lessons": len(self.lessons),
        }

    def _have_flown(self, folder: Path, pilot: Policy, which: range, *, number: int, name: str, progress: bool) -> None:
        """Record flights, all or none: a kill in between leaves nothing, and the next call flies the same."""
        aside, seed = folder.with_name(f"{folder.name}.flying"), self._training.seed
        shutil.rmtree(aside, ignore_errors=True)
        first = FIRST_SEED + SEEDS_PER_RUN * seed + number * max(1, self._training.seeds_per_round)
        tags = {"algorithm": self._training.name, "run_seed": seed, "round": number}
        seeds = [first + i for i in which]
        self._at.collect(self._at.env, pilot, seeds, aside, policy_name=name, settings=tags, progress=progress)
        os.replace(aside, folder)
        sync_folder(folder.parent)

    def _read(self, folder: Path) -> list[Episode]:
        return list(open_dataset(folder, cameras=self._training.policy.images, failures=True))

    def _take_in(self, flights: Sequence[Episode]) -> None:
        """Count the flights of a round and learn from those with labels that are as long as a chunk."""
        self.tallies.append(Tally.of(flights))
        self.lessons += [f for f in flights if f.asked.any() and len(f) >= self._training.policy.chunk]

    def _aggregate(self, number: int) -> None:
        dataset, spec = DatasetFolder(self._folder.path / DATASET), self._at.env.spec
        dataset.claim(spec)
        for episode in self.demos:
            if dataset.find(episode.uid) is None:
                write_episode(episode, dataset.file(episode.uid))
        dataset.adopt(DatasetFolder(self.place(number) / FLIGHTS))
        dataset.write_index(spec)


@dataclass(frozen=True)
class Training:
    """How an interactive run learns.

    Attributes:
        name: of the algorithm. settings: its settings. policy: what is trained. bc: how, in the first and last round.
        between: how in the rounds between. warm: whether all but the first go on from the round before.
        seed: of the run. seeds_per_round: flights of a round, of all kinds. cadence: settings no weight depends on.
    """

    name: str
    settings: Any
    policy: PolicyConfig
    bc: BehaviourCloning
    between: BehaviourCloning
    warm: bool
    seed: int
    seeds_per_round: int
    cadence: tuple[str, ...]

    def origin(self, demos: Sequence[Episode]) -> dict[str, Any]:
        data = {"demonstrations": len(demos), "frames": sum(map(len, demos))}
        return {"algorithm": self.name, "seed": self.seed, "dataset": data}

    def describe(self, demos: Sequence[Episode], spec: EnvSpec, num_envs: int) -> dict[str, Any]:
        """Return plain values that determine the run."""
        layout, _ = read_demos(demos, self.policy)
        data = {**self.origin(demos)["dataset"], "digest": digest_of(cut_windows(demos, layout, self.policy))}
        where = {key: getattr(spec, key) for key in ("robot", "task", "tier", "controller")} | {"num_envs": num_envs}
        policy = {"name": self.policy.name, **self.policy.to_dict()}
        return {
            **self.origin(demos),
            "dataset": data,
            "environment": where,
            "settings": plain(self.settings),
            "policy": policy,
        }


def plain(settings: Any) -> Any:
    """Return nested dataclasses as plain values, with the name of their class where they stand for a choice."""
    if is_dataclass(settings) and not isinstance(settings, type):
        inner = {f.name: plain(getattr(settings, f.name)) for f in fields(settings)}
        return {"kind": type(settings).__name__, **inner}
    if isinstance(settings, Mapping):
        return {str(key): plain(value) for key, value in settings.items()}
    if isinstance(settings, (tuple, list)):
        return [plain(value) for value in settings]
    return settings if isinstance(settings, (int, float, str, bool, type(None))) else type(settings).__name__


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
