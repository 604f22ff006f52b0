"""Contrastive preference learning (CPL): clone everything, then learn from which of two segments was the better one.

All demonstrations are cloned first, failures too. Then, with a new optimiser, pairs of segments are learned from. Who
prefers the segment + to the segment - is taken to prefer the smaller regret, which the policy itself tells: the log
likelihood of a segment's actions is the sum of their advantages. So

    loss = -log exp A(+) / (exp A(+) + exp lambda A(-)),   A = alpha sum_t log pi(a_t | s_t),   log pi = -|a - mu(s)|^2

over the actions of a segment, normalised, those of a chunk on average. ``lambda`` below 1 (``bias``) holds the policy
to what was flown: with 1, and without cloning before, the likelihoods of both segments fall. The variance is that of a
unit; a learned one would be exploited. The reward plays no part: who judges does, a person (``aerial-il prefer``) or a
script (:mod:`aerial_il.data.preferences.judge`).

Metrics, after those of the clone in ``prior/``: ``loss``; ``preferred``, the share of pairs whose better segment is the
likelier one; ``likelihood/better`` and ``likelihood/worse``, means of log pi; ``grad_norm``, ``lr``, ``elapsed_s``,
``wait_share``; ``evaluate/<name>`` from closed-loop flights.

Source: J. Hejna et al., "Contrastive Preference Learning: Learning from Human Feedback without RL", 2023, equations 5
and 6, with its batch size and segments. There alpha is 0.1, lambda 0.5 and the learning rate 1e-4, for policies of
single actions of 4 numbers, and sums are over all steps of a segment; the values here are for chunks of 10 numbers.
"""

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import torch
from torch import Tensor
from torch.nn import functional

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.run.cadence import Cadence, Evaluate
from aerial_il.algorithms.run.folder import PRIOR
from aerial_il.algorithms.supervised.learner import Learner, cosine, precision
from aerial_il.algorithms.supervised.segment_pairs import SegmentPairs
from aerial_il.algorithms.supervised.supervised_run import SUCCESS, SupervisedRun, open_run, require_end
from aerial_il.algorithms.supervised.training_set import Prepared, Shuffle, check_recorded, digest_of
from aerial_il.core.checkpoint import Checkpoint, digest
from aerial_il.core.checks import require_not_negative, require_positive, require_share
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.episode import Episode
from aerial_il.data.preferences.file import read_preferences
from aerial_il.data.preferences.judge import ScriptedJudge
from aerial_il.data.preferences.pairs import Preference, draw_pairs
from aerial_il.data.windows import Windows
from aerial_il.policies import load_policy
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.layout import Layout
from aerial_il.policies.parts.network import PolicySettings
from aerial_il.policies.parts.vision import build_network


@dataclass(frozen=True, kw_only=True)
class CPL:
    """Contrastive preference learning (Hejna et al. 2023).

    Attributes:
        cloning: of all demonstrations, before preferences are learned from.
        preferences: file of them, as ``aerial-il prefer`` writes it; null for pairs that are judged by script.
        pairs: how many of those. length: steps of each of their segments. judge: how they are judged.
        looked_at: steps of each segment that are learned from, evenly spread; they stand for the others.
        alpha: temperature: how much one step's log likelihood counts.
        bias: lambda, how much the likelihood of the worse segment counts, in [0, 1].
        steps: optimisation steps that learn from preferences.
        minutes: end after this time even if steps are left; null for steps alone.
        batch_size: pairs in a minibatch.
        lr: peak learning rate. lr_floor: at the end, as a share of it. warmup_steps: of its linear warm-up.
        weight_decay: AdamW's decay of matrices. ema: decay of the averaged weights. clip_norm: largest gradient norm.
        best_by: number of the rollouts by which the best policy on the way is kept.
        patience: evaluations in a row, none better than the best, after which it ends; 0 for never.
        cadence: when it logs, flies rollouts and saves.
        device: torch device. mixed_precision: as in ``bc``. threads: torch threads.
    """

    name: ClassVar[str] = "cpl"
    needs: ClassVar[tuple[str, ...]] = ()
    rewarded: ClassVar[bool] = False
    demonstrated: ClassVar[bool] = True
    worlds: ClassVar[int] = 1
    failures: ClassVar[bool] = True

    cloning: BC = BC()
    preferences: str | None = None
    pairs: int = 5_000
    length: int = 64
    judge: ScriptedJudge = ScriptedJudge(horizon_s=10.0, followed=0.25, margin=0.01, flipped=0.0, seed=0)
    looked_at: int = 4
    alpha: float = 0.02
    bias: float = 0.25
    steps: int = 4_000
    minutes: float | None = None
    batch_size: int = 96
    lr: float = 1e-3
    lr_floor: float = 0.01
    warmup_steps: int = 200
    weight_decay: float = 1e-4
    ema: float = 0.999
    clip_norm: float = 1.0
    best_by: str = SUCCESS
    patience: int = 0
    cadence: Cadence = Cadence(log_every=100, evaluate_every=0, checkpoint_every=500, keep_checkpoints=3)
    device: str = "cpu"
    mixed_precision: bool = False
    threads: int = 1

    def __post_init__(self) -> None:
        require_positive(self, "pairs", "length", "looked_at", "alpha", "steps", "batch_size", "lr", "clip_norm")
        require_positive(self, "threads")
        require_share(self, "bias")
        require_share(self, "lr_floor", "ema", below_one=True)
        require_not_negative(self, "warmup_steps", "weight_decay", "patience")
        require_end(self.minutes, self.patience, self.cadence)
        if self.cloning.evaluate_every or self.cloning.waypoints.lookahead_s:
            raise InvalidValueError("cloning flies no rollouts on the way, and learns from flights as recorded.")

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
    ) -> ChunkPolicy:
        """Clone all demonstrations in ``run/prior``, then learn from preferences; arguments and errors as of ``BC``.

        Raises:
            InvalidValueError: the policy has no most likely action of its own, too.
            DemoError: the file of preferences is damaged, or about other episodes.
        """
        episodes = list(dataset)
        demos = self.cloning.divide(episodes, policy, seed=seed, failures=True)
        check_recorded(demos.layout.spec, expect or {})
        check_policy(policy, demos.layout)
        flown = [*demos.kept, *demos.held_out]
        judged = self._judged(flown)
        place = Path(run) / PRIOR
        clone = self.cloning.train(
            episodes, policy, run=place, seed=seed, resume=resume, progress=progress, failures=True
        )
        data, training = self._prepared(flown, judged, clone, seed)
        options = {"evaluate": evaluate, "resume": resume, "progress": progress}
        with open_run(self, data, run, algorithm=self.name, seed=seed, **options) as opened:
            return self._learn(opened, training) if opened else load_policy(run)

    def _judged(self, flown: Sequence[Episode]) -> list[Preference]:
        """Return the preferences to learn from: those of the file, or those of the script."""
        lengths = {episode.uid: len(episode) for episode in flown}
        if self.preferences is None:
            pairs = draw_pairs(lengths, self.pairs, length=self.length, seed=self.judge.seed)
            return list(self.judge.judge(flown, pairs))
        judged = read_preferences(self.preferences, lengths)
        if not judged:
            raise InvalidValueError(f"{self.preferences} holds no preference yet. Say some: aerial-il prefer.")
        return judged

    def _prepared(
        self, flown: Sequence[Episode], judged: Sequence[Preference], clone: ChunkPolicy, seed: int
    ) -> tuple[Prepared, SegmentPairs]:
        """Return what the run is given, and the pairs of segments in it."""
        interface, policy = clone.interface, clone.config
        windows = Windows(
            flown,
            interface.layout.names,
            history=policy.history,
            chunk=policy.chunk,
            target="executed_actions",
            successes_only=False,
            images=interface.layout.images,
        )
        training = SegmentPairs(flown, windows, judged, interface, steps=self.looked_at, device=self.device)
        order = Shuffle(len(training), self.batch_size, seed=seed, weights=training.weights)
        description = {
            "dataset": {"demonstrations": len(flown), "frames": len(windows), "digest": digest_of(windows)},
            "preferred": {"pairs": len(judged), "digest": training.digest},
            "initial": digest(Checkpoint(clone.to_checkpoint().arrays)),
        }
        return Prepared(policy, clone, interface, training, None, order, description), training

    def _learn(self, run: SupervisedRun, pairs: SegmentPairs) -> ChunkPolicy:
        """Take optimisation steps until the run is done."""
        learner = Learner(run.build_network(), weight_decay=self.weight_decay, ema=self.ema, clip_norm=self.clip_norm)
        run.start(learner)

        while run.goes_on():
            lr = self.lr * cosine(run.progress, learner.step, warmup_steps=self.warmup_steps, floor=self.lr_floor)
            obs, actions, valid = run.minibatch()
            with precision(self.device, mixed=self.mixed_precision):
                better, worse = pairs.by_segment(log_likelihood(learner.network(obs), actions, valid))
                loss = contrast(better, worse, scale=self.alpha * pairs.length, bias=self.bias)
            likelihoods = {"likelihood/better": better.mean(), "likelihood/worse": worse.mean()}
            learner.descend(loss, lr=lr, logged={"preferred": (better > worse).float().mean(), **likelihoods})
            run.end_step(lr)

        return run.finish()

    @property
    def evaluate_every(self) -> int:
        """Steps between two calls of ``evaluate``, as a workflow asks every algorithm."""
        return self.cadence.evaluate_every


def log_likelihood(mean: Tensor, actions: Tensor, valid: Tensor) -> Tensor:
    """Return log pi (B,) of chunks up to a constant: of unit variance, and of a chunk's steps the mean.

    Args:
        mean: (B, Ta, Da) most likely actions. actions: (B, Ta, Da) flown. valid: (B, Ta), 1 within the episode.
    """
    squares = ((actions - mean) ** 2).sum(-1)
    return -(squares * valid).sum(-1) / valid.sum(-1).clamp(min=1.0)


def contrast(better: Tensor, worse: Tensor, *, scale: float, bias: float) -> Tensor:
    """Return the mean of -log exp A(+) / (exp A(+) + exp bias A(-)) of pairs.

    Args:
        better, worse: (B,) mean log likelihoods of the preferred and the other segments. scale: of A by these.
    """
    return functional.softplus(scale * (bias * worse - better)).mean()


def check_policy(policy: PolicySettings, layout: Layout) -> None:
    """Raise :class:`InvalidValueError` unless a policy has one most likely chunk, a smooth function of what it sees."""
    with torch.random.fork_rng():
        network = build_network(policy, layout)
    if network.noise_size or policy.name == "categorical":
        raise InvalidValueError(
            f"policy={policy.name} draws its actions, and has no single most likely one that preferences could move. "
            "algorithm=cpl trains policy=mlp, act, recurrent, gaussian or squashed_gaussian."
        )
