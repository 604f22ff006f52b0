"""DART: the expert flies throughout, disturbed as the learner would disturb it, so that it shows how to recover.

Off-policy like behaviour cloning, yet robust like DAgger: noise whose distribution is that of the learner's own errors
takes the expert to the states that the learner will meet, and the expert's clean intention there is the label. The
covariance is the maximum-likelihood estimate from the learner's errors on labelled flights that it did not train on,

    Sigma = alpha / (T tr S) S,     S = 1/T sum_t (pi^(s_t) - pi*(s_t)) (pi^(s_t) - pi*(s_t))^T

where alpha scales the estimate up to the deviation expected of the final learner; here alpha is ``scale`` times
``T tr S``, so that ``Sigma = scale S``. Labels have no noise. Before each round the errors are those of a second
policy, trained without a share of the dataset, on that share.

Two things differ from the paper. The noise has the correlation over time that the errors have (``coloured``): a
vehicle is deaf to white noise at 50 Hz, and a policy errs the same way for many steps. And elements that the
demonstrations only switch between two values, such as a gripper, are left alone.

Source: M. Laskey, J. Lee, R. Fox, A. Dragan and K. Goldberg, "DART: noise injection for robust imitation learning",
CoRL 2017, section 4.2 and algorithm 1.

Metrics: those of :mod:`aerial_il.algorithms.dagger`, and ``noise`` (root of the trace of the covariance, scaled by the
spread of demonstrated actions) and ``noise_correlation`` (from one step to the next).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.interactive.algorithm import InteractiveAlgorithm
from aerial_il.algorithms.interactive.disagreement import actions_along
from aerial_il.algorithms.interactive.problem import Operator
from aerial_il.algorithms.interactive.rounds import Rounds
from aerial_il.algorithms.run.cadence import Evaluate
from aerial_il.algorithms.supervised.training_set import split
from aerial_il.core.checks import require_positive
from aerial_il.core.contracts import (
    BatchEnv,
    Observation,
    Policy,
    SeededPolicy,
    attach,
    label_of,
    phase_names_of,
    phase_of,
)
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.seeding import restarted
from aerial_il.data.episode import Episode
from aerial_il.policies.parts.chunk_policy import ChunkPolicy

MOST = 0.98  # largest correlation from one step to the next: a decay over 50 steps


@dataclass(frozen=True, kw_only=True)
class DART(InteractiveAlgorithm):
    """Disturbances for augmenting robot trajectories.

    Attributes:
        scale: factor on the covariance of the learner's errors.
        coloured: give the noise the correlation over time that the errors have; white otherwise, as in the paper.
        held_out: share of the dataset on which the errors are measured.
    """

    name: ClassVar[str] = "dart"

    rounds: int = 4
    episodes: int = 10
    training: BC = BC()
    between_steps: int = 2_000
    patience: float = 1.2
    demos_share: float = 0.5
    warm_start: bool = True
    evaluate_every: int = 1
    keep_checkpoints: int = 3
    scale: float = 1.0
    coloured: bool = True
    held_out: float = 0.2

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "scale")
        if not 0 < self.held_out < 1:
            raise InvalidValueError(f"held_out is {self.held_out}; it must lie in (0, 1).")

    def learn(self, rounds: Rounds, evaluate: Evaluate | None) -> None:
        expert = rounds.expert
        if isinstance(expert, Operator):
            raise InvalidValueError(
                "dart disturbs the flights of an expert that can be asked at any state, and somebody sits at the "
                "controls. Say algorithm=hg_dagger, or leave expert= out."
            )
        for number in rounds.left():
            metrics: dict[str, float] = {}
            if number:
                noise = self._noise(rounds, number)
                rounds.fly(number, lambda noise=noise: Disturbed(expert, noise))
                metrics = {"noise": noise.size, "noise_correlation": noise.correlation}
            rounds.learn(number)
            rounds.end_round(number, evaluate, metrics)

    def _noise(self, rounds: Rounds, number: int) -> Noise:
        """Estimate how a learner errs from one that did not see a share of the dataset."""
        seed = rounds.problem.seed
        kept, held = split(rounds.dataset, self.held_out, seed=seed + number)
        other = rounds.auxiliary(number, "held_out", kept, seed=seed)
        return Noise.of(other, held or kept, scale=self.scale, coloured=self.coloured)


@dataclass(frozen=True, eq=False)
class Noise:
    """A stationary Gaussian process.

    Attributes:
        root: (Da, Da) matrix L with L Lᵀ = covariance, in the action's units.
        correlation: from one step to the next, in [0, 1).
        size: root of the trace of the covariance in units of the spread of demonstrated actions.
    """

    root: np.ndarray
    correlation: float
    size: float

    @staticmethod
    def of(policy: ChunkPolicy, flights: Sequence[Episode], *, scale: float, coloured: bool) -> Noise:
        """Estimate the noise from the errors of ``policy`` along labelled flights that it did not learn from."""
        switched = np.isfinite(policy.interface.switches.low)
        labels = np.concatenate([flight.labels for flight in flights])
        errors = np.where(switched, 0.0, actions_along(policy, flights) - labels)
        spread = policy.interface.action.scale
        pieces = np.split(errors / spread, np.cumsum([len(f) for f in flights])[:-1])
        together = sum(float((e[1:] * e[:-1]).sum()) for e in pieces)
        values, vectors = np.linalg.eigh(scale * errors.T @ errors / len(errors))
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        correlation = min(MOST, max(0.0, together / max(1e-12, float(((errors / spread) ** 2).sum()))))
        return Noise(root, correlation if coloured else 0.0, float(np.sqrt(((root / spread[:, None]) ** 2).sum())))


class Disturbed:
    """The expert, its actions disturbed while what it meant is recorded.

    Args:
        expert: who flies. noise: what is added; each episode has a stream of its own.

    Attributes:
        expert_action: (n, Da) what it meant.
    """

    def __init__(self, expert: Policy, noise: Noise) -> None:
        self.expert, self.noise = expert, noise
        self.expert_action = np.zeros((0, 0))
        self._rngs: list[np.random.Generator] = []
        self._drift = np.zeros((0, len(noise.root)))

    @property
    def phase_names(self) -> tuple[str, ...]:
        return phase_names_of(self.expert)

    @property
    def phase(self) -> np.ndarray:
        return phase_of(self.expert, len(self._rngs))

    def attach(self, env: BatchEnv) -> None:
        attach(self.expert, env)

    def reset(self, mask: np.ndarray | None = None) -> None:
        self.expert.reset(mask)

    def begin(self, seeds: np.ndarray, mask: np.ndarray | None = None) -> None:
        self._rngs, begins = restarted(self._rngs, seeds, mask, "dart noise")
        if len(self._drift) != len(seeds):
            self._drift = np.zeros((len(seeds), len(self.noise.root)))
        for world in np.flatnonzero(begins):
            self._drift[world] = self._drawn(world)
        if isinstance(self.expert, SeededPolicy):
            self.expert.begin(seeds, mask)

    def act(self, obs: Observation) -> np.ndarray:
        action = np.asarray(self.expert.act(obs), float)
        self.expert_action = label_of(self.expert, action)
        disturbed, kept = action + self._drift, self.noise.correlation
        fresh = np.stack([self._drawn(world) for world in range(len(self._rngs))])
        self._drift = kept * self._drift + np.sqrt(1.0 - kept**2) * fresh
        return disturbed

    def _drawn(self, world: int) -> np.ndarray:
        return self.noise.root @ self._rngs[world].standard_normal(len(self.noise.root))
