"""DAgger: fly the learner, let the expert label what it meets, learn from everything so far, and again.

Behaviour cloning learns on the expert's states and flies on its own: its errors lead where no demonstration has been,
and grow with the square of the horizon. DAgger trains on the distribution that the learner itself brings about. In
round i a mixture flies, the expert's share being beta_i; the labels are the expert's whoever flew; the next policy is
trained on the union of all rounds:

    pi_i = beta_i pi* + (1 - beta_i) pi^_i          D <- D u {(s, pi*(s)) : s visited by pi_i}

What decides who flies, and which states are labelled, is the gate: a coin (classic), the ensemble's disagreement and
the risk of failing (ThriftyDAgger), or a supervisor (HG-DAgger). :mod:`aerial_il.algorithms.interactive.gates` has
one file for each, with its source. The loss of the supervised learning in each round is that of
:mod:`aerial_il.algorithms.bc`.

Metrics, one row per round (``step`` is its number): ``flights``, ``flights_solved``, ``flight_steps``, ``queries``
(steps that the expert labelled), ``interventions`` (times it took over), ``expert_steps`` (steps it flew), the totals
of all rounds, ``beta`` where a coin decides, and ``evaluate/<name>`` from flights of the learner alone. With somebody
at the controls also ``solved_alone``: flights that were solved and in which they never took over.

Source: S. Ross, G. Gordon and D. Bagnell, "A reduction of imitation learning and structured prediction to no-regret
online learning", AISTATS 2011, algorithm 3.1.
"""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.interactive.algorithm import InteractiveAlgorithm
from aerial_il.algorithms.interactive.disagreement import ActionScale
from aerial_il.algorithms.interactive.gates.coin import CoinGate
from aerial_il.algorithms.interactive.gates.gate import GateSettings, Round
from aerial_il.algorithms.interactive.mixture import Mixture, newcomer_of
from aerial_il.algorithms.interactive.problem import Operator
from aerial_il.algorithms.interactive.rounds import Rounds
from aerial_il.algorithms.run.cadence import Evaluate
from aerial_il.core.checks import require_not_negative
from aerial_il.core.contracts import Policy
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.schema import Choice
from aerial_il.core.seeding import named_rng
from aerial_il.policies.parts.chunk_policy import ChunkPolicy

MEMBER_SEED = 1_000_003  # between the seeds of an ensemble's members


@dataclass(frozen=True, kw_only=True)
class DAgger(InteractiveAlgorithm):
    """DAgger, and what differs from it by its gate alone.

    Attributes:
        stale_rounds: evaluations in a row, none better than the best, after which it ends; 0 for never.
        gate: who flies and who is asked.
    """

    name: ClassVar[str] = "dagger"

    rounds: int = 5
    episodes: int = 10
    training: BC = BC()
    between_steps: int = 2_000
    patience: float = 1.2
    demos_share: float = 0.5
    warm_start: bool = True
    evaluate_every: int = 1
    keep_checkpoints: int = 3
    stale_rounds: int = 0
    gate: Annotated[GateSettings, Choice("gate")] = CoinGate()

    def __post_init__(self) -> None:
        super().__post_init__()
        require_not_negative(self, "stale_rounds")
        if self.stale_rounds and not self.evaluate_every:
            raise InvalidValueError(f"stale_rounds is {self.stale_rounds}; it needs evaluations: set evaluate_every.")

    @property
    def seeds_per_round(self) -> int:
        return self.episodes + self.gate.alone

    def learn(self, rounds: Rounds, evaluate: Evaluate | None) -> None:
        for number in rounds.left():
            if 0 < self.stale_rounds <= rounds.stale():
                break
            if number:
                rounds.fly(number, lambda number=number: self._pilot(rounds, number))
            rounds.learn(number)
            rounds.end_round(number, evaluate, self._more(rounds, number) if number else {})

    def _more(self, rounds: Rounds, number: int) -> dict[str, float]:
        """Return what else there is to log of round ``number``."""
        if isinstance(rounds.problem.expert, Operator):
            return {"solved_alone": rounds.costs[-1].solved_alone}
        return self.gate.metrics(number)

    def _pilot(self, rounds: Rounds, number: int) -> Policy:
        """Return what flies round ``number``: the mixture of learner and expert, or the learner, whom somebody watches.

        Raises:
            InvalidValueError: somebody at the controls, and a gate that would decide in their place.
        """
        assert rounds.learner is not None
        if not isinstance(rounds.expert, Operator):
            return self._mixture(rounds, number, rounds.learner, rounds.expert)
        if not self.gate.of_operator:
            raise InvalidValueError(
                f"The gate is {type(self.gate).__name__}, and somebody sits at the controls, who decides by themselves "
                "when to take over. Say algorithm=hg_dagger."
            )
        return rounds.learner

    def _mixture(self, rounds: Rounds, number: int, learner: ChunkPolicy, expert: Policy) -> Policy:
        others = [self._member(rounds, number, k) for k in range(1, self.gate.ensemble)]
        probes = rounds.alone(number, self.gate.alone) if self.gate.alone else []
        of = Round(number, rounds.problem.seed, [learner, *others], rounds.dataset, probes)
        return Mixture(learner, expert, self.gate.open(of), ActionScale.of(learner), newcomer_of(expert))

    def _member(self, rounds: Rounds, number: int, k: int) -> ChunkPolicy:
        """Return member k > 0 of the ensemble: other first weights, and episodes drawn with replacement."""
        seed, count = rounds.problem.seed + MEMBER_SEED * k, len(rounds.dataset)
        drawn = named_rng(seed, "bagging", str(number)).integers(count, size=count)
        return rounds.auxiliary(number, f"member_{k}", [rounds.dataset[i] for i in drawn], seed=seed)
