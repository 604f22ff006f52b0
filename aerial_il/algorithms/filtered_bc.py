"""Filtered cloning: fly the clone with noise, keep the flights that succeeded, clone again, and so on.

Round 0 clones the demonstrations; that is the prior. In each round the newest clone flies ``episodes`` worlds, each
action shifted by noise that is correlated from step to step, and the next clone learns from the demonstrations and all
successes so far, the noise included: what was flown is imitated, not what was meant, so that shifts which help are
kept. It needs no critic and no advantage, and is what every reinforcement learning from a prior has to beat.

Metrics, one row per round (``step`` is its number): ``flights``, ``flights_solved``, ``flight_steps``; the totals of
all rounds; ``evaluate/<name>`` of the clone alone. What is returned is the clone of the last round.

Source: P. Dayan and G. Hinton, "Using Expectation-Maximization for Reinforcement Learning", 1997, section 2, for a
reward of 0 or 1; J. Oh et al., "Self-Imitation Learning", 2018, keep past good episodes in the same way.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from aerial_il.algorithms.bc import BehaviourCloning
from aerial_il.algorithms.dart import Disturbed, Noise
from aerial_il.algorithms.interactive.algorithm import InteractiveAlgorithm
from aerial_il.algorithms.interactive.rounds import Rounds
from aerial_il.algorithms.run.cadence import Evaluate
from aerial_il.algorithms.run.checks import require_not_negative, require_share
from aerial_il.core.contracts import Observation
from aerial_il.data.episode import Episode
from aerial_il.policies.parts.chunk_policy import ChunkPolicy


@dataclass(frozen=True, kw_only=True)
class FilteredCloning(InteractiveAlgorithm):
    """Settings of a run, beside those of :class:`InteractiveSettings`.

    Attributes:
        training: behaviour cloning of the dataset so far; its loss is the policy network's.
        noise: its deviation, in those of the demonstrated actions; elements that never varied, and switches, have none.
        correlation: of the noise from one step to the next.
    """

    name: ClassVar[str] = "filtered_bc"
    needs: ClassVar[tuple[str, ...]] = ("env", "collect")

    rounds: int = 4
    episodes: int = 250
    training: BehaviourCloning = field(default_factory=BehaviourCloning)
    noise: float = 0.1
    correlation: float = 0.95
    demos_share: float = 0.2

    def __post_init__(self) -> None:
        super().__post_init__()
        require_not_negative(self, "noise")
        require_share(self, "correlation", below_one=True)

    def learns_from(self, flight: Episode) -> bool:
        return flight.success

    def learn(self, rounds: Rounds, evaluate: Evaluate | None) -> ChunkPolicy:
        for number in rounds.left():
            if number:
                rounds.fly(number, lambda: self._explorer(rounds))
            rounds.learn(number)
            rounds.end_round(number, evaluate)
        return rounds.finish()

    def _explorer(self, rounds: Rounds) -> Unlabelled:
        """Return the newest clone with noise."""
        assert rounds.learner is not None
        interface = rounds.learner.interface
        moved = interface.varied & np.isnan(interface.switches.low)
        root = np.diag(self.noise * interface.action.scale * moved)
        return Unlabelled(Disturbed(rounds.learner, Noise(root, self.correlation, self.noise)))


class Unlabelled:
    """A disturbed policy of which only what it flew is recorded, not what it meant."""

    def __init__(self, pilot: Disturbed) -> None:
        self._pilot = pilot

    def begin(self, seeds: np.ndarray, mask: np.ndarray | None = None) -> None:
        self._pilot.begin(seeds, mask)

    def reset(self, mask: np.ndarray | None = None) -> None:
        self._pilot.reset(mask)

    def act(self, obs: Observation) -> np.ndarray:
        return self._pilot.act(obs)
