"""Behaviour cloning: supervised learning of the demonstrator's action chunks.

One step draws a minibatch of windows, takes the network's own loss, clips the gradient, moves the weights with AdamW
under a cosine schedule and averages them. The averaged weights are what flies. A run is a function of its data,
settings, seed and thread count: killed at any moment and started again, it ends with the same bytes.

Metrics: ``loss`` and ``grad_norm`` (means since the last row), ``lr``, ``elapsed_s``, ``wait_share`` (of the step time,
spent waiting for minibatches); on held-out demonstrations
``validation/loss`` and, in the action's units, ``validation/<element>``; ``evaluate/<name>`` from closed-loop flights.
The loss on held-out demonstrations does not tell which of two policies flies better: only flights do.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass

import torch
from tqdm import tqdm

from aerial_il.algorithms.parts.learner import Learner
from aerial_il.algorithms.parts.loader import AHEAD, Loader
from aerial_il.algorithms.parts.optimisation import cosine
from aerial_il.algorithms.parts.run_folder import RunFolder
from aerial_il.algorithms.parts.signals import SignalWatch
from aerial_il.algorithms.parts.training_set import (
    Shuffle,
    TrainingSet,
    cut_windows,
    digest_of,
    fit_interface,
    read_demos,
    split,
)
from aerial_il.core.checkpoint import Checkpoint, digest
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.provenance import provenance
from aerial_il.core.seeding import torch_rng
from aerial_il.core.specs import EnvSpec
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
        obs_noise: deviation of the Gaussian noise added to normalised observations while training.
        validation: share of the episodes held out to report the error per action element.
        log_every, validate_every, evaluate_every, checkpoint_every: steps between two; 0 for never.
        keep_checkpoints: how many of the newest stay on disk.
        device: torch device.
        threads: torch threads; results repeat bit for bit at a fixed number only.
    """

    steps: int = 6_000
    minutes: float | None = None
    batch_size: int = 256
    lr: float = 1e-3
    lr_floor: float = 0.01
    warmup_steps: int = 200
    weight_decay: float = 1e-4
    ema: float = 0.999
    clip_norm: float = 1.0
    obs_noise: float = 0.0
    validation: float = 0.05
    log_every: int = 100
    validate_every: int = 1000
    evaluate_every: int = 0
    checkpoint_every: int = 1000
    keep_checkpoints: int = 3
    device: str = "cpu"
    threads: int = 1

    def __post_init__(self) -> None:
        for name in ("steps", "batch_size", "lr", "clip_norm", "keep_checkpoints", "threads"):
            if not getattr(self, name) > 0:
                raise InvalidValueError(f"{name} is {getattr(self, name)}; it must be positive.")
        for name in ("lr_floor", "ema", "validation"):
            if not 0 <= getattr(self, name) < 1:
                raise InvalidValueError(f"{name} is {getattr(self, name)}; it must lie in [0, 1).")
        for name in ("warmup_steps", "weight_decay", "obs_noise", *CADENCE[:-1]):
            if getattr(self, name) < 0:
                raise InvalidValueError(f"{name} is {getattr(self, name)}; it must not be negative.")
        if self.minutes is not None and self.minutes <= 0:
            raise InvalidValueError(f"minutes is {self.minutes}; it must be positive, or null for no limit.")

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
            expect: ``robot``, ``task`` or ``action`` (level) that the dataset must have.
            evaluate: ``(policy, step) -> named numbers`` to log every ``evaluate_every`` steps and at the end.
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
        layout, demos = read_demos(dataset, policy, failures=failures)
        if initial and (initial.config != policy or initial.interface.layout.names != layout.names):
            raise InvalidValueError("The initial policy has another configuration than the one to train.")
        _check(layout.spec, expect or {})
        kept, held_out = split(demos, self.validation, seed=seed)
        windows = cut_windows(kept, layout, policy)
        interface = initial.interface if initial else fit_interface(layout, windows, policy)
        training = TrainingSet(windows, interface, self.device)
        unseen = TrainingSet(cut_windows(held_out, layout, policy), interface, self.device) if held_out else None
        order = Shuffle(len(training), self.batch_size, seed=seed)
        data = {"demonstrations": len(demos), "frames": len(training), "digest": digest_of(windows)}
        origin = {"algorithm": "bc", "seed": seed, "dataset": data}
        if initial:
            origin["initial"] = digest(Checkpoint(initial.to_checkpoint().arrays))
        config = {**origin, "settings": asdict(self), "policy": {"name": policy.name, **policy.to_dict()}}

        with ExitStack() as stack:
            folder = stack.enter_context(RunFolder.open(run, config, cadence=CADENCE, resume=resume))
            if folder.finished:
                return load_policy(folder.path)
            stack.enter_context(_threads(self.threads))
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
                step, done = learner.step, self._share(learner) >= 1
                if evaluate and step and (done or due(self.evaluate_every, step)):
                    with signals.at_once(), torch.random.fork_rng():
                        folder.log(step, {f"evaluate/{k}": v for k, v in evaluate(flying, step).items()})
                if done:
                    break
                started = time.perf_counter()
                lr = self.lr * cosine(self._share(learner), step, warmup_steps=self.warmup_steps, floor=self.lr_floor)
                obs, actions, valid = loader.take(step)
                obs = obs + self.obs_noise * torch.randn_like(obs) if self.obs_noise else obs
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

    def _share(self, learner: Learner) -> float:
        """Return the share of the training that is done."""
        by_time = learner.elapsed_s / (60 * self.minutes) if self.minutes else 0.0
        return max(learner.step / self.steps, by_time)


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


def _check(spec: EnvSpec, expect: Mapping[str, str]) -> None:
    found = {"robot": spec.robot, "task": spec.task, "action": spec.action.level}
    for key, wanted in expect.items():
        if found[key] != wanted:
            raise InvalidValueError(f"The dataset was recorded with {key}={found[key]}; {key}={wanted} was asked for.")


@contextmanager
def _threads(count: int) -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def _bar(steps: int, done: int, progress: bool) -> tqdm:
    return tqdm(total=steps, initial=done, desc="train bc", unit="step", dynamic_ncols=True, disable=not progress)
