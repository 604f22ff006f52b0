"""Expert iteration by a policy that looks away: what solves a start that the clone fails is cloned too.

A clone of few demonstrations fails where something it has learned to look at misleads it: that the bowl always lay to
the right, say, or how the base leaned. It comes to rest there, and noise leads it back to the same place. So there are
two clones of the same flights: the learner, and an explorer trained with fields of the observation hidden at random.
In each round ``episodes`` new starts are flown up to ``attempts`` times: first by the learner (or, in the first round,
by another prior), then by the explorer with some fields hidden, others from time to time, each attempt only from the
starts that none before it has solved. What is kept, one success for each start, has hard starts in it as well as easy
ones, and in it no one direction goes along with another any more. Both are then trained on the demonstrations and all
successes so far.

It needs no critic and no expert; its reward is 1 for success. What no attempt solves, it cannot learn.

Metrics, one row per round (``step`` is its number): ``flights``, ``flights_solved``, ``flight_steps`` of all attempts;
``starts_solved_first``, the share of the round's starts that the first attempt solved; ``starts_solved``, the share
that any did; ``total/flight_steps``; ``evaluate/<name>`` of the learner. What is returned is the learner of the last
round.

Source: T. Anthony, Z. Tian, D. Barber, "Thinking Fast and Slow with Deep Learning and Tree Search", 2017, section 3,
for learning from a better policy made of the learner, there by search; P. de Haan, D. Jayaraman, S. Levine, "Causal
Confusion in Imitation Learning", 2019, section 4, for policies of masked observations chosen by their reward.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.interactive.algorithm import InteractiveAlgorithm
from aerial_il.algorithms.interactive.costs import FlightCosts
from aerial_il.algorithms.interactive.rounds import Rounds
from aerial_il.algorithms.run.cadence import Evaluate
from aerial_il.algorithms.run.prior import load_prior
from aerial_il.core.checks import require_not_negative, require_positive, require_share
from aerial_il.core.contracts import Policy
from aerial_il.data.episode import Episode
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.masked import MaskedPolicy

EXPLORER_SEED = 2_000_003  # apart from the learner's


@dataclass(frozen=True, kw_only=True)
class ExpertIteration(InteractiveAlgorithm):
    """Expert iteration by a policy that looks away.

    Attributes:
        episodes: starts of a round.
        training: behaviour cloning of the dataset so far; its loss is the policy network's. The explorer's is that of
            the rounds between, with fields hidden.
        explorer_dropout: its ``field_dropout``. A learner trained so, too, flies worse once it has flights enough.
        prior: a run or policy of any class that flies first in the first round; None for the clone of the
            demonstrations.
        attempts: at each start, at most.
        hidden: largest probability with which a field is hidden from the explorer; the probability itself is
            sampled with the fields, from 0 on.
        hold: mean number of steps before others are hidden.
        reward_patience: flown steps after which a run stops that no flight has solved yet; 0 for never.
    """

    name: ClassVar[str] = "expert_iteration"
    needs: ClassVar[tuple[str, ...]] = ("env", "collect")

    rounds: int = 8
    episodes: int = 400
    training: BC = BC(steps=6_000, validation=0.0)
    between_steps: int = 4_000
    patience: float = 1.3
    demos_share: float = 0.1
    warm_start: bool = False
    evaluate_every: int = 1
    keep_checkpoints: int = 3
    explorer_dropout: float = 0.6
    prior: str | None = None
    attempts: int = 8
    hidden: float = 0.7
    hold: float = 60.0
    reward_patience: int = 1_000_000

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "attempts", "hold")
        require_not_negative(self, "reward_patience")
        require_share(self, "hidden")
        require_share(self, "explorer_dropout", below_one=True)

    @property
    def worlds(self) -> int:
        return min(200, self.episodes)

    def learns_from(self, flight: Episode) -> bool:
        return flight.success

    def learn(self, rounds: Rounds, evaluate: Evaluate | None) -> None:
        for number in rounds.left():
            metrics: dict[str, float] = {}
            if number:
                turns = rounds.fly_in_turn(number, self._pilots(rounds, number))
                rounds.refuse_silence(self.reward_patience)
                metrics = _shares(turns, rounds)
            rounds.learn(number)
            rounds.end_round(number, evaluate, metrics)

    def _pilots(self, rounds: Rounds, number: int) -> Iterator[Policy]:
        """Yield the pilots of a round, attempt by attempt; the explorer is trained where there is a second one."""
        learner, spec = rounds.learner, rounds.problem.env.spec
        assert learner is not None
        yield load_prior(self.prior, spec) if self.prior and number == 1 else learner
        if self.attempts == 1:
            return
        explorer = self._explorer(rounds, number)
        for attempt in range(1, self.attempts):
            yield MaskedPolicy(explorer, most=self.hidden, hold=self.hold, stream=attempt)

    def _explorer(self, rounds: Rounds, number: int) -> ChunkPolicy:
        """Return a clone of the dataset so far that can do without any field."""
        return rounds.auxiliary(
            number,
            "explorer",
            rounds.dataset,
            seed=rounds.problem.seed + EXPLORER_SEED,
            training=replace(self.training, steps=self.between_steps, field_dropout=self.explorer_dropout),
            weights=rounds.weights,
        )


def _shares(turns: list[FlightCosts], rounds: Rounds) -> dict[str, float]:
    starts = turns[0].flights
    return {
        "starts_solved_first": turns[0].successes / starts,
        "starts_solved": sum(turn.successes for turn in turns) / starts,
        "total/flight_steps": sum(costs.steps for costs in rounds.costs),
    }
