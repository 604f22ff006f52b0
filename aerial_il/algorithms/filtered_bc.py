"""Filtered cloning: fly the clone with noise, keep the flights that succeeded, clone again, and so on.

Round 0 clones the demonstrations; that clone, or another policy, is the prior. In each round the newest clone flies
``episodes`` worlds, each action shifted by noise that is correlated from step to step, and the next clone learns from
the demonstrations and all successes so far, the noise included: what was flown is imitated, not what was meant, so that
shifts which help are kept. It needs no critic and no advantage, and is the baseline that every reinforcement learning
from a prior has to beat.

Metrics, one row per round (``step`` is its number): ``flights``, ``flights_solved``, ``flight_steps``; the totals of
all rounds; ``evaluate/<name>`` of the clone alone. What is returned is the clone of the last round.

Source: P. Dayan and G. Hinton, "Using Expectation-Maximization for Reinforcement Learning", 1997, section 2, for a
reward of 0 or 1; J. Oh et al., "Self-Imitation Learning", 2018, keep past good episodes in the same way.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.dart import Disturbed, Noise
from aerial_il.algorithms.interactive.algorithm import InteractiveAlgorithm
from aerial_il.algorithms.interactive.rounds import Rounds
from aerial_il.algorithms.run.cadence import Evaluate
from aerial_il.algorithms.run.prior import load_prior
from aerial_il.core.checks import require_not_negative, require_share
from aerial_il.core.contracts import BatchEnv, Observation
from aerial_il.data.episode import Episode


@dataclass(frozen=True, kw_only=True)
class FilteredBC(InteractiveAlgorithm):
    """Filtered cloning.

    Attributes:
        prior: a run or policy of any class that flies the first round; None for the clone of the demonstrations.
        noise: its standard deviation, in those of the demonstrated actions, or in halves of their range where
            ``action_scaling`` is ``minmax``; elements that never varied, and switches, have none.
        correlation: of the noise from one step to the next.
        reward_patience: flown steps after which a run stops that no flight has solved yet; 0 for never.
    """

    name: ClassVar[str] = "filtered_bc"
    needs: ClassVar[tuple[str, ...]] = ("env", "collect")

    rounds: int = 4
    episodes: int = 250
    training: BC = BC()
    between_steps: int = 2_000
    patience: float = 2.0
    demos_share: float = 0.2
    warm_start: bool = True
    evaluate_every: int = 1
    keep_checkpoints: int = 3
    prior: str | None = None
    noise: float = 0.1
    correlation: float = 0.95
    reward_patience: int = 200_000

    def __post_init__(self) -> None:
        super().__post_init__()
        require_not_negative(self, "noise", "reward_patience")
        require_share(self, "correlation", below_one=True)

    def learns_from(self, flight: Episode) -> bool:
        return flight.success

    def learn(self, rounds: Rounds, evaluate: Evaluate | None) -> None:
        for number in rounds.left():
            if number:
                rounds.fly(number, lambda number=number: self._explorer(rounds, number))
                rounds.refuse_silence(self.reward_patience)
            rounds.learn(number)
            rounds.end_round(number, evaluate)

    def _explorer(self, rounds: Rounds, number: int) -> Unlabelled:
        """Return the newest clone, or the prior in the first round, with noise."""
        policy = rounds.learner
        if number == 1 and self.prior is not None:
            policy = load_prior(self.prior, rounds.problem.env.spec)
        assert policy is not None
        moved = policy.interface.varied & np.isnan(policy.interface.switches.low)
        root = np.diag(self.noise * policy.interface.action.scale * moved)
        return Unlabelled(Disturbed(policy, Noise(root, self.correlation, self.noise)))


class Unlabelled:
    """A disturbed policy of which only what it flew is recorded, not what it meant."""

    def __init__(self, pilot: Disturbed) -> None:
        self._pilot = pilot

    def attach(self, env: BatchEnv) -> None:
        self._pilot.attach(env)

    def begin(self, seeds: np.ndarray, mask: np.ndarray | None = None) -> None:
        self._pilot.begin(seeds, mask)

    def reset(self, mask: np.ndarray | None = None) -> None:
        self._pilot.reset(mask)

    def act(self, obs: Observation) -> np.ndarray:
        return self._pilot.act(obs)
