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

import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.interactive.costs import FlightCosts, metrics_of
from aerial_il.algorithms.interactive.problem import InteractiveProblem, Operator, as_shown
from aerial_il.algorithms.interactive.round_flights import RoundFlights
from aerial_il.algorithms.online.demonstrations import check_same
from aerial_il.algorithms.run.cadence import CADENCE, Evaluate, due
from aerial_il.algorithms.run.folder import RunFolder, read_metrics
from aerial_il.algorithms.supervised.supervised_run import SUCCESS, BestCheckpoint
from aerial_il.algorithms.supervised.training_set import read_demos
from aerial_il.core.checkpoint import Checkpoint
from aerial_il.core.contracts import Policy
from aerial_il.core.errors import InvalidValueError, NoRewardError
from aerial_il.core.provenance import provenance
from aerial_il.core.seeding import torch_threads
from aerial_il.data.episode import Episode
from aerial_il.policies import load_policy
from aerial_il.policies.parts.chunk_policy import ChunkPolicy

TRAINING = "training"


class Rounds:
    """One interactive run; open it with :meth:`open`.

    Attributes:
        problem: what it learns on.
        demos: the demonstrations that it began with. dataset: all labelled episodes so far.
        costs: of the labelled flights of each round, from round 1.
        learner: the policy after the newest round that is complete, or None.
        finished: the policy of a run that is finished, or None.
        elapsed_s: time of all complete rounds, flown and learned, evaluations left out; of a round that was killed on
            the way, only that of the call which completed it.
    """

    def __init__(self, folder: RunFolder, problem: InteractiveProblem, demos: Sequence[Episode]) -> None:
        self._folder, self.problem, self._settings = folder, problem, problem.settings
        self.demos, self.dataset = list(demos), list(demos)
        self._flights = RoundFlights(folder.path, problem, self.demos)
        self.costs: list[FlightCosts] = []
        self.learner: ChunkPolicy | None = None
        self.finished = load_policy(folder.path) if folder.finished else None
        self._next, self.elapsed_s, self._clock = 0, 0.0, time.perf_counter()
        if folder.resumed and not self.finished:
            self._next = int(folder.resumed.state["round"]) + 1
            self.elapsed_s = float(folder.resumed.state.get("elapsed_s", 0.0))  # older checkpoints do not have it
            self.learner = load_policy(self._flights.place(self._next - 1) / TRAINING)
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
            raise InvalidValueError(
                f"{problem.settings.name} asks an expert, and there is none. Name one: expert=module:factory."
            )
        spec = problem.env.spec
        _, demos = read_demos((as_shown(episode, spec) for episode in dataset), problem.policy)
        check_same(demos[0].spec, spec)
        with RunFolder.open(run, problem.describe(demos), cadence=CADENCE, resume=resume) as folder:
            if not resume:
                RoundFlights(folder.path, problem, demos).clear()
            with torch_threads(problem.settings.training.threads):
                yield Rounds(folder, problem, demos)

    @property
    def expert(self) -> Policy | Operator:
        """Whom it asks."""
        assert self.problem.expert is not None, "checked when the run was opened"
        return self.problem.expert

    def left(self) -> range:
        """Return the numbers of the rounds that are not complete; round 0 only learns."""
        return range(self._next, self._settings.rounds + 1)

    def fly(self, number: int, pilot: Callable[[], Policy]) -> None:
        """Add the labelled flights of a round to the dataset: those that are there, else flown by ``pilot()``."""

        def announced() -> Policy:
            self._notify(number, "watch it fly")
            return pilot()

        self._flights.labelled(number, announced)
        self._take_in(number)

    def fly_in_turn(self, number: int, pilots: Iterable[Policy]) -> list[FlightCosts]:
        """Have one pilot after another fly the starts of a round that none has solved; only successes are kept.

        Returns:
            What the flights of each pilot cost; the last ones need not have flown.
        """
        costs = self._flights.in_turn(number, pilots)
        self._take_in(number)
        return costs

    def refuse_silence(self, patience: int) -> None:
        """Stop a run in which no flight has succeeded in ``patience`` environment steps; 0 for never.

        Raises:
            NoRewardError: there is nothing to keep after so many steps.
        """
        flown = sum(costs.steps for costs in self.costs)
        if 0 < patience <= flown and not any(costs.successes for costs in self.costs):
            raise NoRewardError(flown, 0.0, "Ways out: more demonstrations, or a better prior (algorithm.prior=RUN).")

    def alone(self, number: int, episodes: int) -> list[Episode]:
        """Return the flights that learners made alone in all rounds up to this one, having this round's made."""
        return self._flights.alone(number, self.learner, episodes)

    def learn(self, number: int) -> ChunkPolicy:
        """Train the learner on the whole dataset, at length in the first and the last round."""
        settings, place = self._settings, self._flights.place(number) / TRAINING
        self._notify(number, "it learns")
        training = settings.training if number in (0, settings.rounds) else settings.between
        initial = self.learner if settings.warm_start else None
        self._train(training, self.dataset, place, self.problem.seed, initial, self.weights)
        self.learner = load_policy(place)  # as a resumed run has it, on the processor, wherever it was trained
        return self.learner

    @property
    def weights(self) -> list[float] | None:
        """How often each episode of the dataset is visited; see :func:`demonstration_weights`."""
        return demonstration_weights(self.demos, self.dataset[len(self.demos) :], self._settings.demos_share)

    def auxiliary(
        self,
        number: int,
        name: str,
        dataset: Sequence[Episode],
        *,
        seed: int,
        training: BC | None = None,
        weights: Sequence[float] | None = None,
    ) -> ChunkPolicy:
        """Return a policy that only serves beside the learner, trained afresh on ``dataset``.

        Args:
            number: of the round in whose folder it is kept, under ``name``. training: how; None for as the learner's in
                the rounds between. weights: how often each episode is visited; None for all alike.
        """
        training = replace(training or self._settings.between, validation=0.0)
        return self._train(training, dataset, self._flights.place(number) / name, seed, None, weights)

    def end_round(self, number: int, evaluate: Evaluate | None, metrics: Mapping[str, float] | None = None) -> None:
        """Log the round, evaluated where that is due, and make it the one to go on from.

        Args:
            evaluate: ``(policy, round) -> named numbers``. metrics: more to log.
        """
        settings, policy = self._settings, self._signed(number)
        self.elapsed_s += time.perf_counter() - self._clock
        judges = number == settings.rounds or due(settings.evaluate_every, number)
        judged = {f"evaluate/{k}": v for k, v in evaluate(policy, number).items()} if evaluate and judges else {}
        self._folder.log(number, {**self._metrics(), **(metrics or {}), **judged, "elapsed_s": self.elapsed_s})
        saved = policy.to_checkpoint()
        state = {**saved.state, "round": number, "elapsed_s": self.elapsed_s}
        self._folder.save(number, Checkpoint(saved.arrays, state, saved.config), keep=settings.keep_checkpoints)
        self._next, self._clock = number + 1, time.perf_counter()

    def stale(self) -> int:
        """Return how many evaluations there have been since the best one."""
        best = BestCheckpoint.of(read_metrics(self._folder.path), f"evaluate/{SUCCESS}")
        return best.stale if best else 0

    def finish(self) -> ChunkPolicy:
        """Save the last round's policy as the run's."""
        policy = self._signed(self._next - 1)
        self._folder.finish(policy)
        return policy

    def _train(
        self,
        training: BC,
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

    def _metrics(self) -> dict[str, float]:
        return metrics_of(self.costs, self.demos, self.dataset)

    def _take_in(self, number: int) -> None:
        """Count the flights of a round and learn from those with labels."""
        flights, costs = self._flights.read(number)
        self.costs.append(costs)
        self.dataset += flights

    def _notify(self, number: int, what: str) -> None:
        """Say to an operator how far the run is."""
        if isinstance(self.problem.expert, Operator):
            self.problem.expert.notify(self.costs, f"Round {number} of {self._settings.rounds}: {what}.")


def demonstration_weights(demos: Sequence[Episode], flights: Sequence[Episode], share: float) -> list[float] | None:
    """Return how often each episode is visited, so that ``share`` of the steps learned from are demonstrations'.

    Of a flight in which somebody was asked now and then, only the steps with a label are learned from.

    Returns:
        The weights of the demonstrations and then of the flights; None, all alike, where they have that share anyway.
    """
    shown, flown = (sum(int(e.known.sum()) for e in episodes) for episodes in (demos, flights))
    if shown >= share * (shown + flown):
        return None
    return [share / shown] * len(demos) + [(1.0 - share) / flown] * len(flights)
