"""DAgger: fly the learner, let the expert label what it meets, learn from everything so far, and again.

Behaviour cloning learns on the expert's states and flies on its own: its errors lead where no demonstration has been,
and grow with the square of the horizon. DAgger trains on the distribution that the learner itself brings about. In
round i a mixture flies, the expert's share being beta_i; the labels are the expert's whoever flew; the next policy is
trained on the union of all rounds:

    pi_i = beta_i pi* + (1 - beta_i) pi^_i          D <- D u {(s, pi*(s)) : s visited by pi_i}

What decides who flies, and which states are labelled, is the gate: a coin (classic), the ensemble's disagreement and the
risk of failing (ThriftyDAgger), or a supervisor (HG-DAgger). :mod:`aerial_il.algorithms.interactive.gates` names the
sources.

Metrics, one row per round (``step`` is its number): ``flights``, ``flights_solved``, ``flight_steps``, ``queries``
(steps that the expert labelled), ``interventions`` (times it took over), ``expert_steps`` (steps it flew), the totals
of all rounds, and ``evaluate/<name>`` from flights of the learner alone.

Source: S. Ross, G. Gordon and D. Bagnell, "A reduction of imitation learning and structured prediction to no-regret
online learning", AISTATS 2011, algorithm 3.1.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from aerial_il.algorithms.bc import Evaluate
from aerial_il.algorithms.interactive.disagreement import Scale
from aerial_il.algorithms.interactive.gates import CoinGate, GateSettings, Round
from aerial_il.algorithms.interactive.mixture import Mixture
from aerial_il.algorithms.interactive.rounds import Collect, Rounds, Workplace
from aerial_il.algorithms.interactive.settings import Interactive, Pilot, fly_and_learn
from aerial_il.core.policy import Policy
from aerial_il.core.seeding import named_rng
from aerial_il.data.episode import Episode
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.network import PolicyConfig

MEMBER_SEED = 1_000_003  # between the seeds of an ensemble's members


@dataclass(frozen=True, kw_only=True)
class DAgger(Interactive):
    """Settings of a run.

    Attributes:
        gate: who flies and who is asked.
    """

    gate: GateSettings = field(default_factory=CoinGate)

    def train(
        self,
        dataset: Iterable[Episode],
        policy: PolicyConfig,
        *,
        run: str | os.PathLike[str],
        env: object,
        expert: Policy,
        collect: Collect,
        seed: int = 0,
        evaluate: Evaluate | None = None,
        resume: bool = True,
        progress: bool = True,
    ) -> ChunkPolicy:
        """Learn by flying.

        Args:
            dataset: demonstrations to begin with, flown in the same kind of environment; failures are left out.
            policy: what to train.
            run: folder of the run; see :mod:`aerial_il.algorithms.interactive.rounds`.
            env: batch environment to fly in. expert: whom to ask. collect: records flights.
            seed: decides weights, minibatches, coins and the seeds of the flights.
            evaluate: ``(policy, round) -> named numbers`` from flights on seeds of its own.
            resume: continue what ``run`` holds; a finished run returns its policy at once.
            progress: show progress bars.

        Returns:
            The policy of the last round, as saved in ``run/policy``.

        Raises:
            InvalidValueError: demonstrations of another environment, no expert, or ``run`` holds another run.
            SimulationDivergedError, StorageError: from the flights. The errors of behaviour cloning.
        """
        workplace = Workplace(env, expert, collect)
        learning = self.learning("dagger", policy, seed, alone=self.gate.alone)
        with Rounds.open(run, dataset, workplace, learning, resume=resume) as rounds:

            def pilot(number: int) -> Pilot:
                return Pilot(lambda: self._mixture(rounds, number, workplace, progress), self._beta(number))

            return fly_and_learn(rounds, self, pilot, evaluate=evaluate, progress=progress)

    def _mixture(self, rounds: Rounds, number: int, at: Workplace, progress: bool) -> Policy:
        """Return the mixture that flies round ``number``."""
        assert rounds.learner is not None
        others = [self._member(rounds, number, k, progress) for k in range(1, self.gate.ensemble)]
        alone = self.gate.alone
        probes = rounds.alone(number, self.episodes, alone, progress=progress) if alone else []
        of = Round(number, rounds.seed, [rounds.learner, *others], rounds.lessons, probes)
        return Mixture(rounds.learner, at.expert, self.gate.open(of), Scale.of(rounds.learner))

    def _member(self, rounds: Rounds, number: int, k: int, progress: bool) -> ChunkPolicy:
        """Return member k > 0 of the ensemble: other first weights, and other lessons, drawn with replacement."""
        seed = rounds.seed + MEMBER_SEED * k
        drawn = named_rng(seed, "bagging", str(number)).integers(len(rounds.lessons), size=len(rounds.lessons))
        lessons = [rounds.lessons[i] for i in drawn]
        return rounds.auxiliary(number, f"member_{k}", lessons, seed=seed, progress=progress)

    def _beta(self, number: int) -> Mapping[str, float]:
        return {"beta": self.gate.share(number)} if isinstance(self.gate, CoinGate) else {}
