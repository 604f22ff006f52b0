"""One run that collects experience while it learns: its folder, state, metrics, checkpoints and evaluations."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from typing import TYPE_CHECKING

import numpy as np
import torch

from aerial_il.algorithms.online.collector import Collector, Transition
from aerial_il.algorithms.online.problem import Problem
from aerial_il.algorithms.run.cadence import CADENCE, Evaluate, due
from aerial_il.algorithms.run.folder import RunFolder
from aerial_il.algorithms.run.metrics import MetricMeans
from aerial_il.algorithms.run.signals import SignalWatch
from aerial_il.algorithms.run.state import Part, Stateful, pack, unpack
from aerial_il.core.errors import NoRewardError, TrainingDivergedError
from aerial_il.core.progress import Progress
from aerial_il.core.provenance import provenance
from aerial_il.core.seeding import named_rng, torch_rng, torch_threads
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.network import ChunkNetwork

if TYPE_CHECKING:
    from aerial_il.algorithms.online.algorithm import Algorithm

log = logging.getLogger(__name__)

NOTHING_LEARNED = (
    "In all {} environment steps no reward but {:g} has come: the policy has learned nothing. {} Or train for longer: "
    "algorithm.steps."
)
HINT = "Lower the learning rate; the last checkpoint is intact."


class OnlineRun(Part):
    """One run from its first step, or from its newest checkpoint, to its finished policy.

    Use it as ``start(...)``, then ``while run.goes_on(): ...; run.end_turn()``, then ``finish()``; what is learned
    before the first flight stands between, in ``for _ in run.offline(steps): ...``.

    Attributes:
        folder: of the run.
        problem: what it learns on.
        collector: the environment with auto-reset.
        interface: the way into and out of the network; an algorithm that learns it replaces it.
        elapsed_s: time spent in the loop, over all calls, evaluations and checkpoints left out.
        wrap: makes of the trained network's policy the one that is evaluated and saved; an algorithm may replace it.
    """

    changing = ("elapsed_s", "_before", "_offline", "_means")

    def __init__(
        self,
        folder: RunFolder,
        signals: SignalWatch,
        settings: Algorithm,
        problem: Problem,
        evaluate: Evaluate | None,
        progress: bool,
    ) -> None:
        self.folder, self._signals, self._settings, self.problem = folder, signals, settings, problem
        self._origin = {**problem.describe(), "provenance": provenance()}
        self._evaluate, self._progress = evaluate, progress
        self.interface, self.elapsed_s, self._means = problem.interface, 0.0, MetricMeans()
        layout, scheme = problem.interface.layout, problem.scheme
        self.collector = Collector(problem.env, layout, seed=problem.seed, scheme=scheme)
        self._clock, self._before, self._offline = time.perf_counter(), 0, 0
        self.wrap: Callable[[ChunkPolicy], ChunkPolicy] = lambda policy: policy
        self._parts: dict[str, Stateful] = {}
        self._actor: ChunkNetwork
        self._bar: Progress

    @property
    def sizes(self) -> tuple[int, int]:
        """Elements of an observation and of an action, Do and Da."""
        layout = self.problem.interface.layout
        return layout.size, layout.spec.action.size

    @property
    def demos(self) -> Transition:
        """The transitions to imitate."""
        assert self.problem.demos is not None, "the algorithm asked for demonstrations when the run was opened"
        return self.problem.demos

    def build_actor[Network: ChunkNetwork](self, kind: type[Network]) -> Network:
        """Return a new network of the policy, which the algorithm knows to be of this ``kind``.

        It flies while it learns, and is in evaluation mode from the start: dropout is for cloning.
        """
        network = self.problem.policy.build(*self.sizes)
        assert isinstance(network, kind), "the algorithm says which policies it trains"
        if self.problem.initial is not None:
            network.load_state_dict(self.problem.initial)
        return network.eval()

    def rng(self, purpose: str) -> np.random.Generator:
        """Return a generator of its own for each ``purpose``."""
        return named_rng(self.problem.seed, self.problem.algorithm, purpose)

    def start(self, actor: ChunkNetwork, parts: Mapping[str, Stateful]) -> None:
        """Go on from the newest checkpoint, if there is one, with ``actor`` and all ``parts`` that change."""
        self._actor, self._parts = actor, {"collector": self.collector, "run": self, **parts}
        if self.folder.resumed:
            unpack(self.folder.resumed, self._parts)
        self._clock = time.perf_counter()
        self._bar = Progress(
            total=self._settings.steps,
            initial=self.collector.steps,
            desc=f"train {self.problem.algorithm}",
            unit="step",
            dynamic_ncols=True,
            disable=not self._progress,
        )

    def offline(self, steps: int) -> Iterator[None]:
        """Yield once for each of ``steps`` gradient steps before the first flight; they are saved on the way.

        Metrics count them up to zero: the last one is step 0, where the flights start.
        """
        hidden = not self._progress or self._offline >= steps
        name = f"learn {self.problem.algorithm} offline"
        bar = Progress(total=steps, initial=self._offline, desc=name, unit="update", dynamic_ncols=True, disable=hidden)
        while self._offline < steps:
            self._clock = time.perf_counter()
            yield
            self._offline += 1
            self.elapsed_s += time.perf_counter() - self._clock
            bar.update()
            self._end_offline_step(self._offline, steps)
        bar.close()

    def _end_offline_step(self, done: int, steps: int) -> None:
        """Write metrics, take a checkpoint, leave on a signal, each where it is due."""
        cadence, last = self._settings.cadence, done == steps
        if last or due(cadence.log_every, done):
            self.folder.log(done - steps, {**self._means.take(), "elapsed_s": self.elapsed_s})
        if last or self._signals.pending or due(cadence.checkpoint_every, done):
            self.folder.save(0, pack(self._parts, self.policy()), keep=cadence.keep_checkpoints)
        if self._signals.pending:
            self._signals.stop()

    @property
    def left(self) -> float:
        """Share of the environment steps that are left."""
        return max(0.0, 1.0 - self.collector.steps / self._settings.steps)

    def updates_due(self, ratio: float, every: int = 1) -> int:
        """Return how many of ``ratio`` updates for each environment step fall due in this turn of one step.

        Args:
            every: environment steps from one block of updates to the next.
        """
        steps, worlds = self.collector.steps, self.collector.n
        due, done = (int(ratio * (n - n % every)) for n in (steps, steps - worlds))
        return due - done

    def policy(self) -> ChunkPolicy:
        """Return the policy as it stands, with where it comes from."""
        return self.wrap(self.policy_of(self._actor))

    def policy_of(self, network: ChunkNetwork) -> ChunkPolicy:
        """Return a network of the policy's as one that flies."""
        origin = {**self._origin, "step": self.collector.steps}
        return ChunkPolicy(self.problem.policy, self.interface, network, origin)

    def goes_on(self) -> bool:
        """Evaluate where that is due; return whether there are steps left.

        A run killed while it evaluates resumes just before.
        """
        step = self.collector.steps
        due_now = self._done or self._due(self._settings.cadence.evaluate_every) if step else self._flies_already
        if self._evaluate and due_now:
            with self._signals.at_once(), torch.random.fork_rng():
                self.folder.log(step, {f"evaluate/{k}": v for k, v in self._evaluate(self.policy(), step).items()})
        self._before, self._clock = step, time.perf_counter()
        return not self._done

    def log(self, values: Mapping[str, float]) -> None:
        """Remember named numbers, whose means the next row of the metrics holds.

        Raises:
            TrainingDivergedError: one is not finite.
        """
        for name, value in values.items():
            if not np.isfinite(value):
                raise TrainingDivergedError(name, step=self.collector.steps, hint=HINT)
        self._means.add(values)

    def end_turn(self) -> None:
        """End one turn of the loop: write metrics, take a checkpoint, leave on a signal, each where it is due."""
        step, cadence = self.collector.steps, self._settings.cadence
        self.elapsed_s += time.perf_counter() - self._clock
        self._bar.update(step - self._before)
        if self._done or self._due(cadence.log_every):
            episodes = self.collector.episode_means()
            self.folder.log(step, {**self._means.take(), **episodes, "elapsed_s": self.elapsed_s})
            self._bar.set_postfix_str(f"return {episodes['episode/return']:.0f}" if episodes else "", refresh=False)
        saves = self._due(cadence.checkpoint_every) or self._due(cadence.evaluate_every)
        if self._done or self._signals.pending or saves:
            self.folder.save(step, pack(self._parts, self.policy()), keep=cadence.keep_checkpoints)
        if self._signals.pending:
            self._signals.stop()
        self._refuse_silence()

    def finish(self) -> ChunkPolicy:
        """Save the trained policy and return it; from now on the run is finished."""
        self._bar.close()
        policy = self.policy()
        self.folder.finish(policy)
        if self.problem.scheme.patience and not self.collector.informed:
            steps, reward, advice = self.collector.steps, self.collector.first_reward, self.problem.scheme.advice
            log.warning(NOTHING_LEARNED.format(steps, reward, advice))
        return policy

    def _refuse_silence(self) -> None:
        """End a run in which rewards have carried no information for too long; what it has done is kept."""
        step, patience = self.collector.steps, self.problem.scheme.patience
        if patience and step >= patience and not self.collector.informed and not self._done:
            self.folder.save(step, pack(self._parts, self.policy()), keep=self._settings.cadence.keep_checkpoints)
            raise NoRewardError(step, self.collector.first_reward, self.problem.scheme.advice)

    @property
    def _flies_already(self) -> bool:
        """Whether the policy can do something before its first flight, and could lose it."""
        cloned = getattr(self._settings, "bc_pretrain_steps", 0)
        return "prior" in self.problem.inputs or bool(cloned or self._offline)

    @property
    def _done(self) -> bool:
        return self.collector.steps >= self._settings.steps

    def _due(self, every: int) -> bool:
        """Whether a multiple of ``every`` lies within the steps of this turn."""
        return due(every, self.collector.steps, since=self._before)


@contextmanager
def open_run(
    settings: Algorithm,
    problem: Problem,
    run: str | os.PathLike[str],
    *,
    evaluate: Evaluate | None,
    resume: bool,
    progress: bool,
) -> Iterator[OnlineRun | None]:
    """Open a run's folder and set torch's threads and generator, until the ``with`` block ends.

    Yields None where the run is finished.

    Args:
        settings: of the algorithm. problem: what it learns on. run: the folder.
        evaluate: ``(policy, step) -> named numbers``. resume: see :class:`RunFolder`. progress: show a progress bar.
    """
    policy = {"name": problem.policy.name, **problem.policy.to_dict()}
    config = {**problem.describe(), "settings": asdict(settings), "policy": policy}
    with ExitStack() as stack:
        folder = stack.enter_context(RunFolder.open(run, config, cadence=CADENCE, resume=resume))
        if folder.finished:
            yield None
            return
        stack.enter_context(torch_threads(settings.threads))
        stack.enter_context(torch_rng(problem.seed, problem.algorithm))
        signals = stack.enter_context(SignalWatch())
        yield OnlineRun(folder, signals, settings, problem, evaluate, progress)
