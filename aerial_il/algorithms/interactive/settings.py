"""Settings of algorithms that learn in rounds of flights."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from aerial_il.algorithms.run.checks import require_not_negative, require_positive, require_share
from aerial_il.algorithms.supervised.algorithm import SupervisedAlgorithm
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import EnvSpec
from aerial_il.data.episode import Episode


@dataclass(frozen=True, kw_only=True)
class InteractiveSettings:
    """Settings of every run that flies and learns in turn.

    Attributes:
        rounds: of flying and learning, after a first training on the demonstrations.
        episodes: labelled flights per round.
        training: supervised learning, used as it is in the first and in the last round.
        between_steps: optimisation steps of the rounds between.
        patience: a labelled flight that has not ended is cut off when it has lasted this many times as long as the
            longest demonstration: a learner that hangs would fill the dataset with one state; 0 for the task's limit.
        demos_share: of each minibatch, at least, that comes from the demonstrations, however much is flown after them.
            What a learner brings about is mostly where it hangs. Half and half is what intervention weighted regression
            gives the two kinds of steps (A. Mandlekar et al., "Human-in-the-loop imitation learning using remote
            teleoperation", 2020); 0 visits all steps alike, as the paper of DAgger does.
        warm_start: all rounds but the first go on from the weights of the round before; otherwise each starts afresh.
        evaluate_every: rounds between two evaluations; the last one is always evaluated; 0 for that one only.
        keep_checkpoints: how many of the newest rounds' policies stay on disk.
        name: of the algorithm, that of its module.
        needs: what a command hands to ``train``.
        rewarded, demonstrated: it learns from demonstrations, never from the environment's reward.
    """

    name: ClassVar[str]
    needs: ClassVar[tuple[str, ...]] = ("env", "expert", "collect")
    rewarded: ClassVar[bool] = False
    demonstrated: ClassVar[bool] = True

    rounds: int = 5
    episodes: int = 10
    training: SupervisedAlgorithm
    patience: float = 1.2
    demos_share: float = 0.5
    between_steps: int = 2_000
    warm_start: bool = True
    evaluate_every: int = 1
    keep_checkpoints: int = 3

    def __post_init__(self) -> None:
        require_positive(self, "rounds", "episodes", "between_steps", "keep_checkpoints")
        require_not_negative(self, "evaluate_every", "patience")
        require_share(self, "demos_share", below_one=True)
        if self.training.evaluate_every:
            raise InvalidValueError(
                f"training.evaluate_every is {self.training.evaluate_every}; rounds are judged when they end, every so "
                "many of them: set evaluate_every."
            )

    @property
    def worlds(self) -> int:
        """How many worlds it flies in at once, if nobody says otherwise."""
        return self.episodes

    @property
    def seeds_per_round(self) -> int:
        """How many flights of any kind a round makes."""
        return self.episodes

    def learns_from(self, flight: Episode) -> bool:
        """Whether a flight of a round joins the dataset; here one with labels."""
        return bool(flight.asked.any())

    def inputs(self, spec: EnvSpec) -> Mapping[str, Any]:
        """Return what decides a run in ``spec`` besides settings, policy and demonstrations, all of it checked."""
        del spec
        return {}

    @property
    def between(self) -> SupervisedAlgorithm:
        """Supervised learning in the rounds between the first and the last."""
        return replace(self.training, steps=self.between_steps)
