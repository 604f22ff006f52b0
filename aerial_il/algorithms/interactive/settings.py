"""What algorithms that learn in rounds of flights can be told, and the loop that they share."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar, NamedTuple

from aerial_il.algorithms.bc import CADENCE, BehaviourCloning, Evaluate, due
from aerial_il.algorithms.interactive.rounds import Rounds, Training
from aerial_il.algorithms.rl.settings import require_not_negative, require_positive
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.policy import Policy
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.network import PolicyConfig


@dataclass(frozen=True, kw_only=True)
class Interactive:
    """Settings of every run that flies and learns in turn.

    Attributes:
        rounds: of flying and learning, after a first training on the demonstrations.
        episodes: labelled flights per round.
        training: supervised learning, used as it is in the first and in the last round.
        between_steps: optimisation steps of the rounds between.
        warm: all rounds but the first go on from the weights of the round before; otherwise each starts afresh.
        evaluate_every: rounds between two evaluations; the last one is always evaluated; 0 for that one only.
        keep_checkpoints: how many of the newest rounds' policies stay on disk.
        needs: what a command hands to ``train``.
    """

    needs: ClassVar[tuple[str, ...]] = ("env", "expert", "collect")

    rounds: int = 10
    episodes: int = 5
    training: BehaviourCloning = field(default_factory=BehaviourCloning)
    between_steps: int = 2_000
    warm: bool = True
    evaluate_every: int = 1
    keep_checkpoints: int = 3

    def __post_init__(self) -> None:
        require_positive(self, "rounds", "episodes", "between_steps", "keep_checkpoints")
        require_not_negative(self, "evaluate_every")
        if self.training.evaluate_every:
            raise InvalidValueError(
                f"training.evaluate_every is {self.training.evaluate_every}; rounds are judged when they end, every so "
                "many of them: set evaluate_every."
            )

    @property
    def worlds(self) -> int:
        """How many worlds it flies in at once, if nobody says otherwise."""
        return self.episodes

    def learning(self, name: str, policy: PolicyConfig, seed: int, *, alone: int = 0) -> Training:
        """Return how a run of the algorithm ``name`` learns; ``alone``: flights of a round that nobody labels."""
        return Training(
            name=name,
            settings=self,
            policy=policy,
            bc=self.training,
            between=replace(self.training, steps=self.between_steps),
            warm=self.warm,
            seed=seed,
            seeds_per_round=self.episodes + alone,
            cadence=CADENCE,
        )


class Pilot(NamedTuple):
    """Who flies a round.

    Attributes:
        take_off: returns the policy that flies; called only if the flights have not been made yet.
        metrics: what to log of it with the round.
    """

    take_off: Callable[[], Policy]
    metrics: Mapping[str, float]


def fly_and_learn(
    rounds: Rounds,
    settings: Interactive,
    pilot: Callable[[int], Pilot],
    *,
    evaluate: Evaluate | None,
    progress: bool,
) -> ChunkPolicy:
    """Go through the rounds that are left: learn from the demonstrations, then fly and learn from all so far.

    Args:
        rounds: the run. settings: of the algorithm.
        pilot: who flies the round of a number, from 1.
        evaluate: judges the learner after a round, see :class:`Interactive`.
        progress: show progress bars.

    Returns:
        The policy of the last round, as saved with the run.
    """
    if rounds.finished:
        return rounds.finished
    for number in rounds.left(settings.rounds):
        last, metrics = number == settings.rounds, {}
        if number:
            take_off, metrics = pilot(number)
            rounds.fly(number, take_off, settings.episodes, progress=progress)
        rounds.learn(number, last=last, progress=progress)
        judge = evaluate if last or due(settings.evaluate_every, number) else None
        rounds.report(number, evaluate=judge, extra=metrics, keep=settings.keep_checkpoints)
    return rounds.finish(settings.rounds)
