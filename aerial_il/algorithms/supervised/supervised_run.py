"""One run of supervised learning: its folder, minibatches, metrics, checkpoints and evaluations."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from typing import Any

import torch
from torch import Tensor

from aerial_il.algorithms.run.cadence import CADENCE, Cadence, Evaluate, due
from aerial_il.algorithms.run.folder import BEST, RunFolder, read_metrics
from aerial_il.algorithms.run.signals import SignalWatch
from aerial_il.algorithms.run.state import pack, unpack
from aerial_il.algorithms.seeing.auxiliary import Telling
from aerial_il.algorithms.supervised.learner import Learner, require_device
from aerial_il.algorithms.supervised.loader import AHEAD, Loader
from aerial_il.algorithms.supervised.training_set import Prepared, TrainingSet
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.progress import Progress
from aerial_il.core.provenance import provenance
from aerial_il.core.seeding import torch_rng, torch_threads
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.layout import Interface
from aerial_il.policies.parts.network import ChunkNetwork, Shown, masked_mean
from aerial_il.policies.parts.vision import VisionNetwork, build_network

SUCCESS = "success"
LOWER_IS_BETTER = ("crashes", "dropped", "time_to_success_s")


def require_end(minutes: float | None, patience: int, cadence: Cadence) -> None:
    """Refuse ends of a run that cannot come: a time that is not positive, patience without rollouts to wait for."""
    if minutes is not None and not minutes > 0:
        raise InvalidValueError(f"minutes is {minutes}; it must be positive, or null for no limit.")
    if patience and not cadence.evaluate_every:
        raise InvalidValueError(f"patience is {patience}; it needs rollouts: set cadence.evaluate_every too.")


class SupervisedRun:
    """One run from its first step, or from its newest checkpoint, to its finished policy.

    Use it as ``start(learner)``, then ``while run.goes_on(): ... run.minibatch() ...; run.end_step(lr)``, then
    ``finish()``.
    """

    def __init__(
        self,
        stack: ExitStack,
        folder: RunFolder,
        settings: Any,
        data: Prepared,
        *,
        origin: dict[str, Any],
        evaluate: Evaluate | None,
        progress: bool,
    ) -> None:
        self._stack, self._folder, self._settings, self._data = stack, folder, settings, data
        self._signals = stack.enter_context(SignalWatch())
        self._origin, self._evaluate, self._progress = origin, evaluate, progress
        self._started = 0.0
        self._learner: Learner
        self._policy: ChunkPolicy
        self._loader: Loader
        self._bar: Progress

    def build_network(self) -> ChunkNetwork:
        """Return a new network of the policy, with the initial policy's weights if there is one; it may tell, too."""
        network = build_network(self._data.policy, self._data.interface.layout)
        if self._data.initial:
            network.load_state_dict(self._data.initial.network.state_dict())
        if self._data.hidden and isinstance(network, VisionNetwork):
            network = Telling(network, self._data.hidden)
        return network.to(self._settings.device)

    def start(self, learner: Learner) -> None:
        """Go on with ``learner`` from the newest checkpoint, if there is one."""
        self._learner = learner
        if self._folder.resumed:
            unpack(self._folder.resumed, {"learner": learner})
        origin, data, total = {**self._origin, "provenance": provenance()}, self._data, self._settings.steps
        self._policy = ChunkPolicy(data.policy, data.interface, learner.averaged.flown, origin)
        loader = Loader(
            lambda step: data.training.gather(data.order[step]),
            first=learner.step,
            last=total,
            ahead=AHEAD if data.training.has_images else 0,
        )
        self._loader = self._stack.enter_context(loader)
        self._loader.wait_share(learner.elapsed_s)
        bar = {"desc": f"train {self._origin['algorithm']}", "unit": "step", "disable": not self._progress}
        minutes = self._settings.minutes
        limit_s = 60 * minutes - learner.elapsed_s if minutes else None
        self._bar = Progress(total=total, initial=learner.step, limit_s=limit_s, dynamic_ncols=True, **bar)

    @property
    def progress(self) -> float:
        """Share of the training that is done, by steps or by time."""
        learner, minutes = self._learner, self._settings.minutes
        return max(learner.step / self._settings.steps, learner.elapsed_s / (60 * minutes) if minutes else 0.0)

    def goes_on(self) -> bool:
        """Evaluate where that is due; return whether there is something left to learn.

        A run killed while it evaluates resumes just before.
        """
        step, done = self._learner.step, self.progress >= 1
        self._policy.origin["step"] = step
        if self._evaluate and step and (done or due(self._settings.cadence.evaluate_every, step)):
            done = self._judged(self._evaluate, step) or done
        self._started = time.perf_counter()
        return not done

    def minibatch(self) -> tuple[Shown, Tensor, Tensor]:
        """Return the observations, actions and validity of this step; see :meth:`TrainingSet.gather`."""
        obs, actions, valid = self._loader.take(self._learner.step)
        return obs, actions, valid

    def end_step(self, lr: float) -> None:
        """End one optimisation step: log, validate, take a checkpoint, leave on a signal, each where it is due."""
        learner, cadence = self._learner, self._settings.cadence
        learner.elapsed_s += time.perf_counter() - self._started
        self._bar.update()
        step, done = learner.step, self.progress >= 1
        self._report(lr, step, done)
        saves = due(cadence.checkpoint_every, step) or due(cadence.evaluate_every, step)
        if done or self._signals.pending or saves:
            self._policy.origin["step"] = step
            self._folder.save(step, pack({"learner": learner}, self._policy), keep=cadence.keep_checkpoints)
        if self._signals.pending:
            self._signals.stop()

    def finish(self) -> ChunkPolicy:
        """Save the trained policy and return it; from now on the run is finished."""
        self._folder.finish(self._policy)
        return self._policy

    def _report(self, lr: float, step: int, done: bool) -> None:
        row: dict[str, float] = {}
        if done or due(self._settings.cadence.log_every, step):
            elapsed_s = self._learner.elapsed_s
            row = {**self._learner.means.take(), "lr": lr, "elapsed_s": elapsed_s}
            row["wait_share"] = self._loader.wait_share(elapsed_s)
            self._bar.set_postfix_str(f"loss {row['loss']:.4f}", refresh=False)
        if self._data.held_out and (done or due(self._settings.validate_every, step)):
            row |= validation_errors(self._policy.network, self._data.held_out, self._data.interface)
        if row:
            self._folder.log(step, row)

    def _judged(self, evaluate: Evaluate, step: int) -> bool:
        """Evaluate by rollouts, keep the policy if none was better; return whether patience has run out."""
        with self._signals.at_once(), torch.random.fork_rng():
            told = evaluate(self._policy, step)
            self._folder.log(step, {f"evaluate/{name}": value for name, value in told.items()})
        best_by, patience = self._settings.best_by, self._settings.patience
        if best_by not in told and (patience or best_by != SUCCESS):
            raise InvalidValueError(f"The rollouts tell no {best_by!r}, by which they are judged. See best_by.")
        best = BestCheckpoint.of(read_metrics(self._folder.path), f"evaluate/{best_by}")
        if best is None:
            return False
        if best.step == step and math.isfinite(best.value):
            label = {"by": best_by, "value": best.value, "evaluations": best.evaluations}
            acting, origin = self._policy, {**self._policy.origin, "chosen": label}
            ChunkPolicy(acting.config, acting.interface, acting.network, origin).save(self._folder.path / BEST)
        return bool(patience and best.stale >= patience)


@dataclass(frozen=True)
class BestCheckpoint:
    """The best of a run's evaluations so far, read from its metrics alone, so that a resumed run decides alike.

    Attributes:
        value: highest value, or the lowest of what had better be low; NaN where it was nowhere a number, as the time
            to success is without one. step: where it was reached, for the last time.
        stale: evaluations since it was reached for the first time.
        evaluations: how many there were.
    """

    value: float
    step: int
    stale: int
    evaluations: int

    @staticmethod
    def of(rows: Iterable[Mapping[str, float]], name: str) -> BestCheckpoint | None:
        """Compare evaluations by the number called ``name``, those without it being the worst; None without any."""
        number = name.rpartition("/")[2]
        prefix = name.removesuffix(number)
        judged = [row for row in rows if any(key.startswith(prefix) and key != "step" for key in row)]
        values = [(row.get(name, math.nan), int(row["step"])) for row in judged]
        if not values:
            return None
        sign = -1.0 if number in LOWER_IS_BETTER else 1.0
        merits = [-math.inf if math.isnan(value) else sign * value for value, _ in values]
        place = merits.index(max(merits))
        step = max(step for merit, (_, step) in zip(merits, values, strict=True) if merit == merits[place])
        return BestCheckpoint(values[place][0], step, len(values) - 1 - place, len(values))


@contextmanager
def open_run(
    settings: Any,
    data: Prepared,
    run: str | os.PathLike[str],
    *,
    algorithm: str,
    seed: int,
    evaluate: Evaluate | None,
    resume: bool,
    progress: bool,
) -> Iterator[SupervisedRun | None]:
    """Open a run's folder and set torch's threads and generator, until the ``with`` block ends.

    Yields None where the run is finished.

    Args:
        settings: of the ``algorithm``. data: what it learns from. run: the folder.
        evaluate: ``(policy, step) -> named numbers``. resume: see :class:`RunFolder`. progress: show a progress bar.
    """
    origin = {"algorithm": algorithm, "seed": seed, **data.description}
    config = {**origin, "settings": asdict(settings), "policy": {"name": data.policy.name, **data.policy.to_dict()}}
    with ExitStack() as stack:
        folder = stack.enter_context(RunFolder.open(run, config, cadence=_free(settings), resume=resume))
        if folder.finished:
            yield None
            return
        require_device(settings.device)
        stack.enter_context(torch_threads(settings.threads))
        stack.enter_context(torch_rng(seed, algorithm))
        yield SupervisedRun(stack, folder, settings, data, origin=origin, evaluate=evaluate, progress=progress)


def _free(settings: Any) -> tuple[str, ...]:
    """Return the settings that no weight depends on; with patience the rollouts decide where training ends."""
    return tuple(name for name in CADENCE if not (settings.patience and name == "evaluate_every"))


@torch.no_grad()
def validation_errors(network: ChunkNetwork, held_out: TrainingSet, interface: Interface) -> dict[str, float]:
    """Return the loss on held-out demonstrations and the mean absolute error of each action element in its unit."""
    obs, actions, valid = held_out.gather(held_out.sample())
    with torch_rng(0, "validation"):  # a stochastic loss is evaluated with the same samples each time
        loss, _ = network.loss(obs, actions, valid)
    errors = (network(obs) - actions).abs()
    scale, labels = interface.action.scale, interface.layout.spec.action.labels
    means = [masked_mean(errors[..., i : i + 1], valid).item() * float(scale[i]) for i in range(len(labels))]
    return {"validation/loss": loss.item(), **{f"validation/{k}": v for k, v in zip(labels, means, strict=True)}}
