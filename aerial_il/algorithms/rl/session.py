"""What surrounds a loop that flies while it learns: folder, signals, metrics, checkpoints, evaluations on the way."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from typing import Any

import numpy as np
import torch
from tqdm import tqdm

from aerial_il.algorithms.rl.collector import EndlessFlight, report_over
from aerial_il.algorithms.rl.settings import Flying
from aerial_il.algorithms.run.folder import RunFolder
from aerial_il.algorithms.run.signals import SignalWatch
from aerial_il.algorithms.run.state import Part, Snapshot, pack, unpack
from aerial_il.algorithms.run.threads import torch_threads
from aerial_il.core.errors import TrainingDivergedError
from aerial_il.core.provenance import provenance
from aerial_il.core.seeding import torch_rng
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.layout import Interface
from aerial_il.policies.parts.network import ChunkNetwork, PolicyConfig

Evaluate = Callable[[ChunkPolicy, int], Mapping[str, float]]
CADENCE = ("log_every", "evaluate_every", "checkpoint_every", "keep_checkpoints")
HINT = "Lower the learning rate; the last checkpoint is intact."


class Session:
    """One run from its first step, or from its newest checkpoint, to its finished policy.

    Use it as ``begin(...)``, then ``while session.goes_on(flying): ...; session.turn(flying)``, then ``finish``.

    Attributes:
        folder: of the run; ``folder.finished`` tells that there is nothing left to do.
        elapsed_s: time spent in the loop, over all calls, evaluations and checkpoints left out.
    """

    def __init__(
        self,
        folder: RunFolder,
        signals: SignalWatch,
        settings: Flying,
        origin: Mapping[str, Any],
        evaluate: Evaluate | None,
        progress: bool,
    ) -> None:
        self.folder, self._signals, self._settings = folder, signals, settings
        self._origin = {**origin, "provenance": provenance()}
        self._evaluate, self._progress = evaluate, progress
        self.elapsed_s, self._clock = 0.0, time.perf_counter()
        self._sums: dict[str, list[float]] = {}
        self._parts: dict[str, Part] = {}
        self._flight: EndlessFlight
        self._bar: tqdm
        self._before = 0

    def begin(self, flight: EndlessFlight, parts: Mapping[str, Part]) -> None:
        """Go on from the newest checkpoint, if there is one, with ``flight`` and all other ``parts`` of the run."""
        self._flight, self._parts = flight, {"flight": flight, "session": self, **parts}
        if self.folder.resumed:
            unpack(self.folder.resumed, self._parts)
        self._clock = time.perf_counter()
        self._bar = tqdm(
            total=self._settings.steps,
            initial=flight.steps,
            desc=f"train {self._origin['algorithm']}",
            unit="step",
            dynamic_ncols=True,
            disable=not self._progress,
        )

    @property
    def left(self) -> float:
        """Share of the environment steps that are left."""
        return max(0.0, 1.0 - self._flight.steps / self._settings.steps)

    @property
    def _done(self) -> bool:
        return self._flight.steps >= self._settings.steps

    def owed(self, rate: float) -> int:
        """Return how many of ``rate`` updates for each environment step fall due in this turn."""
        return int(rate * self._flight.steps) - int(rate * (self._flight.steps - self._flight.n))

    def pilot(self, policy: PolicyConfig, interface: Interface, network: ChunkNetwork) -> ChunkPolicy:
        """Return the policy as it stands, with where it comes from."""
        return ChunkPolicy(policy, interface, network, {**self._origin, "step": self._flight.steps})

    def goes_on(self, flying: Callable[[], ChunkPolicy]) -> bool:
        """Evaluate where that is due; return whether there are steps left.

        A run killed while it evaluates resumes just before.
        """
        step = self._flight.steps
        if self._evaluate and step and (self._done or self._due(self._settings.evaluate_every)):
            with self._signals.at_once(), torch.random.fork_rng():
                self.folder.log(step, {f"evaluate/{k}": v for k, v in self._evaluate(flying(), step).items()})
        self._before, self._clock = step, time.perf_counter()
        return not self._done

    def note(self, values: Mapping[str, float]) -> None:
        """Remember named numbers, whose means the next row of the metrics tells.

        Raises:
            TrainingDivergedError: one is not finite.
        """
        for name, value in values.items():
            if not np.isfinite(value):
                raise TrainingDivergedError(name, step=self._flight.steps, hint=HINT)
            total = self._sums.setdefault(name, [0.0, 0.0])
            total[0] += value
            total[1] += 1

    def turn(self, flying: Callable[[], ChunkPolicy]) -> None:
        """End one turn of the loop: log, take a checkpoint, leave on a signal, each where it is due."""
        step, settings = self._flight.steps, self._settings
        self.elapsed_s += time.perf_counter() - self._clock
        self._bar.update(step - self._before)
        if self._done or self._due(settings.log_every):
            episodes = self._flight.report()
            means = {name: total / count for name, (total, count) in self._sums.items()}
            self._sums = {}
            self.folder.log(step, {**means, **episodes, "elapsed_s": self.elapsed_s})
            self._bar.set_postfix_str(report_over(episodes), refresh=False)
        due = self._due(settings.checkpoint_every) or self._due(settings.evaluate_every)
        if self._done or self._signals.pending or due:
            self.folder.save(step, pack(self._parts, flying()), keep=settings.keep_checkpoints)
        if self._signals.pending:
            self._signals.stop()

    def finish(self, flying: ChunkPolicy) -> ChunkPolicy:
        """Save the trained policy and return it; from now on the run is finished."""
        self._bar.close()
        self.folder.finish(flying)
        return flying

    def _due(self, every: int) -> bool:
        """Whether a multiple of ``every`` lies within the steps of this turn."""
        return every > 0 and self._flight.steps // every > self._before // every

    def snapshot(self) -> Snapshot:
        sums = {name: list(total) for name, total in self._sums.items()}
        return Snapshot({}, {"elapsed_s": self.elapsed_s, "sums": sums, "before": self._before})

    def restore(self, saved: Snapshot) -> None:
        self.elapsed_s, self._before = saved.values["elapsed_s"], saved.values["before"]
        self._sums = {name: list(total) for name, total in saved.values["sums"].items()}


@contextmanager
def open_session(
    settings: Flying,
    run: str | os.PathLike[str],
    origin: Mapping[str, Any],
    *,
    policy: PolicyConfig,
    evaluate: Evaluate | None,
    resume: bool,
    progress: bool,
) -> Iterator[Session]:
    """Open a run's folder and set torch's threads and generator, until the ``with`` block ends.

    Args:
        settings: of the algorithm. run: the folder.
        origin: ``algorithm``, ``seed`` and whatever else determines the run besides settings and policy.
        policy: what is trained. evaluate: ``(policy, step) -> named numbers``. resume: see :class:`RunFolder`.
        progress: show a progress bar.
    """
    name, seed = str(origin["algorithm"]), int(origin["seed"])
    config = {**origin, "settings": asdict(settings), "policy": {"name": policy.name, **policy.to_dict()}}
    with ExitStack() as stack:
        folder = stack.enter_context(RunFolder.open(run, config, cadence=CADENCE, resume=resume))
        stack.enter_context(torch_threads(settings.threads))
        stack.enter_context(torch_rng(seed, name))
        signals = stack.enter_context(SignalWatch())
        yield Session(folder, signals, settings, origin, evaluate, progress)


def origin_of(algorithm: str, seed: int, env: Any, dataset: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return what determines a run besides its settings: names, seed, environment and demonstrations."""
    spec = env.spec
    flown = {
        "robot": spec.robot,
        "task": spec.task,
        "tier": spec.tier,
        "action": spec.action.level,
        "num_envs": int(env.num_envs),
    }
    learned = {"dataset": dict(dataset)} if dataset else {}
    return {"algorithm": algorithm, "seed": seed, "environment": flown, **learned}
