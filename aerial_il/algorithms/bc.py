"""Behaviour cloning: supervised learning of the demonstrator's action chunks.

One step draws a minibatch of windows (what was seen, the actions that followed), takes the loss that the policy's own
network defines (a distance of actions, a likelihood, a denoising error; see :mod:`aerial_il.policies`), clips the
gradient, moves the weights with AdamW under a cosine schedule and averages them. The averaged weights are what flies. A
run is a function of its data, settings, seed and thread count: killed at any moment and started again, it ends with the
same bytes.

Metrics: ``loss`` and ``grad_norm`` (means since the last row), ``lr``, ``elapsed_s``, ``wait_share`` (of the step time,
spent waiting for minibatches); on held-out demonstrations
``validation/loss`` and, in the action's units, ``validation/<element>``; ``evaluate/<name>`` from closed-loop flights.
The loss on held-out demonstrations does not tell which of two policies flies better: only flights do. The policy that
flew best on the way is kept beside the finished one, labelled as such and never in its place: picked among several, its
success rate is biased upwards.
"""

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
import torch

from aerial_il.algorithms.run.cadence import Cadence, Evaluate
from aerial_il.algorithms.supervised.learner import Learner, cosine, precision
from aerial_il.algorithms.supervised.selection import Selection
from aerial_il.algorithms.supervised.supervised_run import SUCCESS, SupervisedRun, open_run, require_end
from aerial_il.algorithms.supervised.training_set import Demonstrations, check_recorded, prepare, read_demos, split
from aerial_il.core.checks import require_not_negative, require_positive, require_share
from aerial_il.data.episode import Episode
from aerial_il.data.joined import Joined
from aerial_il.data.waypoints import Waypoints
from aerial_il.policies import load_policy
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.layout import Layout
from aerial_il.policies.parts.masked import columns_of
from aerial_il.policies.parts.network import PolicySettings, Shown, state_of, with_state


@dataclass(frozen=True, kw_only=True)
class BC:
    """Behaviour cloning.

    Attributes:
        steps: optimisation steps.
        minutes: end after this time even if steps are left; the schedule then follows the time, and the result depends
            on the speed of the machine. null for steps alone.
        batch_size: windows in a minibatch.
        lr: peak learning rate.
        lr_floor: learning rate at the end, as a share of the peak.
        warmup_steps: steps of linear warm-up.
        weight_decay: AdamW's decay of matrices.
        ema: decay of the averaged weights.
        clip_norm: largest gradient norm.
        obs_noise: standard deviation of the Gaussian noise added to normalised state fields while training.
        field_dropout: largest probability with which each state field of a window is hidden while training, as its
            mean; the probability itself is sampled anew for each window, from 0 on. A network that has learned to do
            without any field can be flown with some of them hidden (P. de Haan et al., "Causal Confusion in Imitation
            Learning", 2019).
        auxiliary: weight of the auxiliary loss of a policy with eyes: how well what is hidden from it, such as where
            objects are, can be told of each image by a linear layer that does not fly; 0 for none.
        selection: which demonstrations are learned from, and how much each counts.
        waypoints: how the actions of flights by hand are relabelled before they are learned from.
        validation: share of the episodes held out to report the error per action element.
        validate_every: steps between two such reports; 0 for never.
        best_by: number of the rollouts by which the best policy on the way is kept.
        patience: evaluations by rollouts in a row, none better than the best, after which it ends; 0 for never.
            The learning rate is then still high, so that the policy may be worse than at the end of a whole run.
        cadence: when it logs, flies rollouts and saves.
        device: torch device.
        mixed_precision: compute in bfloat16 where that loses little: faster on a GPU, and on a CPU that knows bfloat16.
        threads: torch threads; results repeat bit for bit at a fixed number only.
    """

    name: ClassVar[str] = "bc"
    needs: ClassVar[tuple[str, ...]] = ()
    rewarded: ClassVar[bool] = False
    demonstrated: ClassVar[bool] = True
    worlds: ClassVar[int] = 1

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
    field_dropout: float = 0.0
    auxiliary: float = 0.0
    selection: Selection = Selection(
        operators=(), quality="duration", keep=1.0, sharpness=0.0, operator_weights={}, failures=0.0
    )
    waypoints: Waypoints = Waypoints(lookahead_s=0.0, flown_by="hand")
    validation: float = 0.05
    validate_every: int = 1000
    best_by: str = SUCCESS
    patience: int = 0
    cadence: Cadence = Cadence(log_every=100, evaluate_every=0, checkpoint_every=1000, keep_checkpoints=3)
    device: str = "cpu"
    mixed_precision: bool = False
    threads: int = 1

    def __post_init__(self) -> None:
        require_positive(self, "steps", "batch_size", "lr", "clip_norm", "threads")
        require_share(self, "lr_floor", "ema", "field_dropout", "validation", below_one=True)
        require_not_negative(
            self, "warmup_steps", "weight_decay", "obs_noise", "auxiliary", "patience", "validate_every"
        )
        require_end(self.minutes, self.patience, self.cadence)

    def train(
        self,
        dataset: Iterable[Episode],
        policy: PolicySettings,
        *,
        run: str | os.PathLike[str],
        seed: int = 0,
        expect: Mapping[str, str] | None = None,
        evaluate: Evaluate | None = None,
        resume: bool = True,
        progress: bool = True,
        failures: bool = False,
        weights: Sequence[float] | None = None,
        initial: ChunkPolicy | None = None,
    ) -> ChunkPolicy:
        """Clone the demonstrator.

        Args:
            dataset: episodes of one environment; failures among them are left out unless ``failures`` says otherwise.
            policy: what to train.
            run: folder for configuration, metrics, checkpoints and the finished policy.
            seed: decides initial weights, validation split, minibatches and noise.
            expect: what the dataset must have been recorded with; see :func:`check_recorded`.
            evaluate: ``(policy, step) -> named numbers`` to log every ``cadence.evaluate_every`` steps and at the end;
                the best policy by the number ``best_by`` is kept in ``run/best``.
            resume: continue what ``run`` holds; a finished run returns its policy at once.
            progress: show a progress bar.
            failures: learn from failed episodes too, as from those that an expert has labelled.
            weights: how often each episode of ``dataset`` is visited, relative to the others; all alike if None.
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
        demos = self.divide(dataset, policy, seed=seed, failures=failures, weights=weights)
        check_recorded(demos.layout.spec, expect or {})
        given = {"batch_size": self.batch_size, "device": self.device, "seed": seed, "initial": initial}
        data = prepare(demos, policy, **given, auxiliary=self.auxiliary)
        options = {"evaluate": evaluate, "resume": resume, "progress": progress}
        with open_run(self, data, run, algorithm=self.name, seed=seed, **options) as opened:
            return self._learn(opened, data.interface.layout) if opened else load_policy(run)

    def _learn(self, run: SupervisedRun, layout: Layout) -> ChunkPolicy:
        """Take optimisation steps until the run is done."""
        ema, decay, clip_norm = self.ema, self.weight_decay, self.clip_norm
        learner = Learner(run.build_network(), weight_decay=decay, ema=ema, clip_norm=clip_norm)
        run.start(learner)

        while run.goes_on():
            lr = self.lr * cosine(run.progress, learner.step, warmup_steps=self.warmup_steps, floor=self.lr_floor)
            obs, actions, valid = run.minibatch()
            obs = with_noise(obs, self.obs_noise) if self.obs_noise else obs
            obs = with_dropout(obs, layout, self.field_dropout) if self.field_dropout else obs
            with precision(self.device, mixed=self.mixed_precision):
                loss, logged = learner.network.loss(obs, actions, valid)
            learner.descend(loss, lr=lr, logged=logged)
            run.end_step(lr)

        return run.finish()

    def divide(
        self,
        dataset: Iterable[Episode],
        policy: PolicySettings,
        *,
        seed: int,
        failures: bool = False,
        weights: Sequence[float] | None = None,
    ) -> Demonstrations:
        """Return what :meth:`train` learns from and what it holds out with this ``seed``; refuse what it refuses."""
        selection = replace(self.selection, failures=self.selection.failures or 1.0) if failures else self.selection
        layout, demos = read_demos(dataset, policy, failures=selection.failures > 0)
        demos, shares = selection.apply(demos, weights)
        demos = [self.waypoints.apply(demo) for demo in demos]
        kept, held_out = split(list(zip(demos, shares.tolist(), strict=True)), self.validation, seed=seed)
        demos, shares = [demo for demo, _ in kept], np.array([share for _, share in kept])
        if isinstance(dataset, Joined):
            shares = dataset.weighted(demos, shares)
        return Demonstrations(layout, demos, shares, [demo for demo, _ in held_out])

    @property
    def evaluate_every(self) -> int:
        """Steps between two calls of ``evaluate``, as a workflow asks every algorithm."""
        return self.cadence.evaluate_every

    @property
    def failures(self) -> bool:
        """Whether it learns from failed demonstrations too."""
        return self.selection.failures > 0

    def relabelling(self, waypoints: Waypoints) -> Self:
        """Return the same settings for flights by hand that are relabelled so."""
        return replace(self, waypoints=waypoints)


def with_noise(obs: Shown, deviation: float) -> Shown:
    """Return ``obs`` with Gaussian noise on its state (B, To, Do)."""
    state = state_of(obs)
    return with_state(obs, state + deviation * torch.randn_like(state))


def with_dropout(obs: Shown, layout: Layout, most: float) -> Shown:
    """Return ``obs`` with fields of its state (B, To, Do) hidden, each at its window's rate up to ``most``."""
    state = state_of(obs)
    chance = most * torch.rand(len(state), 1)
    shown = columns_of(layout, torch.rand(len(state), len(layout.names)) >= chance)
    return with_state(obs, state * shown[:, None].to(state))
