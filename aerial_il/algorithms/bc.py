"""Behaviour cloning: supervised learning of the demonstrator's action chunks.

One step draws a minibatch of windows, takes the network's own loss, clips the gradient, moves the weights with AdamW
under a cosine schedule and averages them. The averaged weights are what flies. A run is a function of its data,
settings, seed and thread count: killed at any moment and started again, it ends with the same bytes.

Metrics: ``loss`` and ``grad_norm`` (means since the last row), ``lr``, ``elapsed_s``, ``wait_share`` (of the step time,
spent waiting for minibatches); on held-out demonstrations
``validation/loss`` and, in the action's units, ``validation/<element>``; ``evaluate/<name>`` from closed-loop flights.
The loss on held-out demonstrations does not tell which of two policies flies better: only flights do. The policy that
flew best on the way is kept beside the finished one, labelled as such and never in its place: picked among several, its
success is told too high.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field, replace

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from aerial_il.algorithms.rl.settings import require_not_negative, require_positive, require_share
from aerial_il.algorithms.run.folder import BEST, RunFolder, read_metrics
from aerial_il.algorithms.run.signals import SignalWatch
from aerial_il.algorithms.run.threads import torch_threads
from aerial_il.algorithms.supervised.best_checkpoint import Standing
from aerial_il.algorithms.supervised.learner import Learner
from aerial_il.algorithms.supervised.loader import AHEAD, Loader
from aerial_il.algorithms.supervised.optimisation import cosine
from aerial_il.algorithms.supervised.selection import Selection
from aerial_il.algorithms.supervised.training_set import (
    Demonstrations,
    Shuffle,
    TrainingSet,
    check_recorded,
    cut_windows,
    digest_of,
    fit_interface,
    read_demos,
    split,
    window_weights,
)
from aerial_il.core.checkpoint import Checkpoint, digest
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.provenance import provenance
from aerial_il.core.seeding import torch_rng
from aerial_il.data.episode import Episode
from aerial_il.policies import load_policy
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.layout import Interface
from aerial_il.policies.parts.network import ChunkNetwork, PolicyConfig, masked_mean
from aerial_il.policies.parts.vision import build_network

Evaluate = Callable[[ChunkPolicy, int], Mapping[str, float]]
CADENCE = ("log_every", "validate_every", "evaluate_every", "checkpoint_every", "keep_checkpoints")


@dataclass(frozen=True, kw_only=True)
class BehaviourCloning:
    """Settings of a run.

    Attributes:
        steps: optimisation steps.
        minutes: end after this time even if steps are left; the schedule then follows the time, and the result depends
            on the speed of the machine. None for steps alone.
        batch_size: windows in a minibatch.
        lr: peak learning rate.
        lr_floor: learning rate at the end, as a share of the peak.
        warmup_steps: steps of linear warm-up.
        weight_decay: AdamW's decay of matrices.
        ema: decay of the averaged weights.
        clip_norm: largest gradient norm.
        obs_noise: deviation of the Gaussian noise added to normalised state fields while training.
        selection: which demonstrations are learned from, and how much each counts.
        validation: share of the episodes held out to report the error per action element.
        best_by: number told by the rollouts by which the best policy on the way is kept.
        patience: end after so many evaluations by rollouts in a row that were no better than the best; 0 for never.
            The learning rate is then still high, so that the policy may be worse than at the end of a whole run.
        log_every, validate_every, evaluate_every, checkpoint_every: steps between two; 0 for never.
        keep_checkpoints: how many of the newest stay on disk.
        device: torch device.
        mixed_precision: compute in bfloat16 where that loses little, on a GPU; a CPU always computes in float32.
        threads: torch threads; results repeat bit for bit at a fixed number only.
    """

    steps: int = 10_000
    minutes: float | None = None
    batch_size: int = 256
    lr: float = 1e-3
    lr_floor: float = 0.01
    warmup_steps: int = 200
    weight_decay: float = 1e-4
    ema: float = 0.999
    clip_norm: float = 1.0
    obs_noise: float = 0.0
    selection: Selection = field(default_factory=Selection)
    validation: float = 0.05
    best_by: str = "success"
    patience: int = 0
    log_every: int = 100
    validate_every: int = 1000
    evaluate_every: int = 0
    checkpoint_every: int = 1000
    keep_checkpoints: int = 3
    device: str = "cpu"
    mixed_precision: bool = False
    threads: int = 1

    def __post_init__(self) -> None:
        require_positive(self, "steps", "batch_size", "lr", "clip_norm", "keep_checkpoints", "threads")
        require_share(self, "lr_floor", "ema", "validation", below_one=True)
        require_not_negative(self, "warmup_steps", "weight_decay", "obs_noise", "patience", *CADENCE[:-1])
        if self.minutes is not None and self.minutes <= 0:
            raise InvalidValueError(f"minutes is {self.minutes}; it must be positive, or null for no limit.")
        if self.patience and not self.evaluate_every:
            raise InvalidValueError(f"patience is {self.patience}; it needs rollouts: set evaluate_every too.")

    def train(
        self,
        dataset: Iterable[Episode],
        policy: PolicyConfig,
        *,
        run: str | os.PathLike[str],
        seed: int = 0,
        expect: Mapping[str, str] | None = None,
        evaluate: Evaluate | None = None,
        resume: bool = True,
        progress: bool = True,
        failures: bool = False,
        initial: ChunkPolicy | None = None,
    ) -> ChunkPolicy:
        """Clone the demonstrator.

        Args:
            dataset: episodes of one environment; failures among them are left out unless ``failures`` says otherwise.
            policy: what to train.
            run: folder for configuration, metrics, checkpoints and the finished policy.
            seed: decides initial weights, validation split, minibatches and noise.
            expect: what the dataset must have been recorded with; see :func:`check_recorded`.
            evaluate: ``(policy, step) -> named numbers`` to log every ``evaluate_every`` steps and at the end; the best
                policy by the number ``best_by`` is kept in ``run/best``.
            resume: continue what ``run`` holds; a finished run returns its policy at once.
            progress: show a progress bar.
            failures: learn from failed episodes too, as from those that an expert has labelled.
            initial: a policy of the same configuration whose weights and normalisers training goes on from.

        Returns:
            The policy with averaged weights, as saved in ``run/policy``.

        Raises:
            InvalidValueError: nothing to learn from, other data than expected, ``initial`` has another configuration,
                or ``run`` holds another run.
            TrainingDivergedError: the loss or its gradient is not finite; the last checkpoint is intact.
            CheckpointError: the disk is full, or all checkpoints of ``run`` are damaged.
            KeyboardInterrupt, SystemExit: after SIGINT or SIGTERM, once a checkpoint is written.
        """
        layout, kept, shares, held_out = self.divide(dataset, policy, seed=seed, failures=failures)
        if initial and (initial.config != policy or initial.interface.layout.names != layout.names):
            raise InvalidValueError("The initial policy has another configuration than the one to train.")
        check_recorded(layout.spec, expect or {})
        windows = cut_windows(kept, layout, policy)
        weights = window_weights(shares, windows)
        interface = initial.interface if initial else fit_interface(layout, windows, policy)
        training = TrainingSet(windows, interface, self.device)
        unseen = TrainingSet(cut_windows(held_out, layout, policy), interface, self.device) if held_out else None
        order = Shuffle(len(training), self.batch_size, seed=seed, weights=weights)
        found = len(kept) + len(held_out)
        data = {"demonstrations": found, "frames": len(training), "digest": digest_of(windows, weights)}
        origin = {"algorithm": "bc", "seed": seed, "dataset": data}
        if initial:
            origin["initial"] = digest(Checkpoint(initial.to_checkpoint().arrays))
        config = {**origin, "settings": asdict(self), "policy": {"name": policy.name, **policy.to_dict()}}

        with ExitStack() as stack:
            folder = stack.enter_context(RunFolder.open(run, config, cadence=self._cadence, resume=resume))
            if folder.finished:
                return load_policy(folder.path)
            require_device(self.device)
            stack.enter_context(torch_threads(self.threads))
            stack.enter_context(torch_rng(seed, "bc"))
            signals = stack.enter_context(SignalWatch())
            network = build_network(policy, layout).to(self.device)
            if initial:
                network.load_state_dict(initial.network.state_dict())
            learner = Learner(network, weight_decay=self.weight_decay, ema=self.ema, clip_norm=self.clip_norm)
            if folder.resumed:
                learner.restore(folder.resumed)
            flying = ChunkPolicy(policy, interface, learner.averaged, {**origin, "provenance": provenance()})
            ahead = AHEAD if training.has_images else 0
            steps = {"first": learner.step, "last": self.steps}
            loader = stack.enter_context(Loader(lambda step: training.gather(order[step]), **steps, ahead=ahead))
            loader.wait_share(learner.elapsed_s)
            bar = stack.enter_context(_bar(self.steps, learner.step, progress))

            while True:  # evaluating comes first: a run killed while it evaluates resumes just before
                step = flying.origin["step"] = learner.step
                done = self._share(learner) >= 1
                if evaluate and step and (done or due(self.evaluate_every, step)):
                    with signals.at_once(), torch.random.fork_rng():
                        folder.log(step, {f"evaluate/{k}": v for k, v in evaluate(flying, step).items()})
                    standing = Standing.of(read_metrics(folder.path), f"evaluate/{self.best_by}")
                    self._keep_best(folder, flying, standing)
                    done = done or self._gives_up(standing)
                if done:
                    break
                started = time.perf_counter()
                lr = self.lr * cosine(self._share(learner), step, warmup_steps=self.warmup_steps, floor=self.lr_floor)
                obs, actions, valid = loader.take(step)
                obs = _shaken(obs, layout.size, self.obs_noise) if self.obs_noise else obs
                with self._precision():
                    loss, logged = learner.network.loss(obs, actions, valid)
                learner.descend(loss, lr=lr, logged=logged)
                learner.elapsed_s += time.perf_counter() - started

                step, done = learner.step, self._share(learner) >= 1
                bar.update()
                row: dict[str, float] = {}
                if done or due(self.log_every, step):
                    row = {**learner.report(), "lr": lr, "elapsed_s": learner.elapsed_s}
                    row["wait_share"] = loader.wait_share(learner.elapsed_s)
                    bar.set_postfix_str(f"loss {row['loss']:.4f}", refresh=False)
                if unseen and (done or due(self.validate_every, step)):
                    row |= validation_errors(learner.averaged, unseen, interface)
                if row:
                    folder.log(step, row)
                if done or signals.pending or due(self.checkpoint_every, step) or due(self.evaluate_every, step):
                    flying.origin["step"] = step
                    folder.save(step, learner.to_checkpoint(flying), keep=self.keep_checkpoints)
                if signals.pending:
                    signals.stop()

            folder.finish(flying)
            return flying

    def divide(
        self, dataset: Iterable[Episode], policy: PolicyConfig, *, seed: int, failures: bool = False
    ) -> Demonstrations:
        """Return what :meth:`train` learns from and what it holds out with this ``seed``; refuse what it refuses."""
        selection = replace(self.selection, failures=self.selection.failures or 1.0) if failures else self.selection
        layout, demos = read_demos(dataset, policy, failures=selection.failures > 0)
        demos, weights = selection.apply(demos)
        kept, held_out = split(list(zip(demos, weights.tolist(), strict=True)), self.validation, seed=seed)
        shares = np.array([weight for _, weight in kept])
        return Demonstrations(layout, [demo for demo, _ in kept], shares, [demo for demo, _ in held_out])

    def _keep_best(self, folder: RunFolder, flying: ChunkPolicy, standing: Standing | None) -> None:
        """Save the policy that was just evaluated if none before it flew better, saying how it was chosen."""
        if standing is None or standing.step != flying.origin["step"]:
            return
        label = {"by": self.best_by, "value": standing.best, "evaluations": standing.evaluations}
        chosen = ChunkPolicy(flying.config, flying.interface, flying.network, {**flying.origin, "chosen": label})
        chosen.save(folder.path / BEST)

    def _gives_up(self, standing: Standing | None) -> bool:
        """Whether the rollouts have not become better for too long."""
        if standing is None and (self.patience or self.best_by != BehaviourCloning.best_by):
            raise InvalidValueError(f"The rollouts tell no {self.best_by!r}, by which they are judged. See best_by.")
        return bool(self.patience and standing and standing.stale >= self.patience)

    @property
    def _cadence(self) -> tuple[str, ...]:
        """Settings that no weight depends on; with patience the rollouts decide where training ends."""
        return tuple(name for name in CADENCE if not (self.patience and name == "evaluate_every"))

    def _precision(self) -> torch.autocast:
        """Return the context in which the loss is computed."""
        mixed = self.mixed_precision and self.device.startswith("cuda")
        return torch.autocast("cuda" if mixed else "cpu", dtype=torch.bfloat16, enabled=mixed)

    def _share(self, learner: Learner) -> float:
        """Return the share of the training that is done."""
        by_time = learner.elapsed_s / (60 * self.minutes) if self.minutes else 0.0
        return max(learner.step / self.steps, by_time)


def require_device(name: str) -> None:
    """Refuse a torch device that is not there, or that there cannot be."""
    try:
        device = torch.device(name)
    except RuntimeError as error:
        raise InvalidValueError(f"device={name} is none that torch knows. Use cpu, cuda or cuda:1.") from error
    found = torch.cuda.device_count()
    if device.type == "cuda" and not found:
        raise InvalidValueError(f"device={name} needs a GPU that torch can use; there is none here. Use device=cpu.")
    if device.type == "cuda" and (device.index or 0) >= found:
        raise InvalidValueError(f"device={name}: there are {found} GPUs here, counted from 0.")


def due(every: int, step: int) -> bool:
    """Whether something done every so many steps (0 for never) is due after ``step``."""
    return every > 0 and step % every == 0


@torch.no_grad()
def validation_errors(network: ChunkNetwork, unseen: TrainingSet, interface: Interface) -> dict[str, float]:
    """Return the loss on held-out demonstrations and the mean absolute error of each action element in its unit."""
    obs, actions, valid = unseen.gather(unseen.sample())
    with torch_rng(0, "validation"):  # a loss with chance in it is judged by the same draws each time
        loss, _ = network.loss(obs, actions, valid)
    errors = (network(obs) - actions).abs()
    scale, labels = interface.action.scale, interface.layout.spec.action.labels
    means = [masked_mean(errors[..., i : i + 1], valid).item() * float(scale[i]) for i in range(len(labels))]
    return {"validation/loss": loss.item(), **{f"validation/{k}": v for k, v in zip(labels, means, strict=True)}}


def _shaken(obs: Tensor, size: int, deviation: float) -> Tensor:
    """Return ``obs`` (B, To, Do, pixels behind them) with Gaussian noise on its ``size`` state elements."""
    state, pixels = obs[..., :size], obs[..., size:]
    return torch.cat([state + deviation * torch.randn_like(state), pixels], dim=-1)


def _bar(steps: int, done: int, progress: bool) -> tqdm:
    return tqdm(total=steps, initial=done, desc="train bc", unit="step", dynamic_ncols=True, disable=not progress)
