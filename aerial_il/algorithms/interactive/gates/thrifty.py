"""The gate of ThriftyDAgger and EnsembleDAgger: the expert is called where the ensemble disagrees or failure is likely.

Sources:
    K. Menda, K. Driggs-Campbell and M. Kochenderfer, "EnsembleDAgger", IROS 2019: novelty as the ensemble's variance.
    R. Hoque et al., "ThriftyDAgger: budget-aware novelty and risk gating for interactive imitation learning",
    CoRL 2021: section 4 (novelty, risk, switching back, thresholds from quantiles).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aerial_il.algorithms.interactive.disagreement import ActionScale, actions_along, disagreement
from aerial_il.algorithms.interactive.gates.gate import GateSettings, Round
from aerial_il.algorithms.interactive.mixture import Decision, Gate, GateInput
from aerial_il.algorithms.interactive.risk import RiskModel, fit_risk
from aerial_il.core.checks import require_positive
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.episode import Episode
from aerial_il.policies.parts.chunk_policy import ChunkPolicy


@dataclass(frozen=True, kw_only=True)
class ThriftyGate(GateSettings):
    """ThriftyDAgger: the expert is called where the ensemble disagrees or failure is likely, and soon sent away.

    It takes over where ``novelty > n`` or ``risk > r``, and hands back where neither holds any more, the learner's
    action is near to its own, ``discrepancy < d``, and ``risk <= m``. Only the steps that it flies are queries. The
    thresholds come from data: n and r are the ``1 - alarms`` quantiles of novelty and risk over the states of the
    learner's own successful flights (over the labelled episodes where there is none), d is ``agreement`` times the
    mean discrepancy on the labelled episodes, m the median risk.

    Three things differ from the paper. Risk is not learned by bootstrapping from demonstrations, but as the frequency
    of failure in flights that the learner makes alone and nobody labels (``alone``). The quantiles are taken over
    flights that went well: over all of them, a learner that is often stuck would find being stuck ordinary. And the
    mean discrepancy is multiplied: it is a training error, on episodes that a learner may know by heart, and one
    that is asked to be as near elsewhere is hardly ever trusted again.

    Attributes:
        ensemble: policies whose disagreement is novelty.
        alone: flights per round of the learner alone.
        alarms: share of the states of a good flight at which the expert is called, by novelty and by risk each.
        least: steps that it flies at least: a chunk of actions is learned from a run of them.
        agreement: how many mean discrepancies on labelled episodes the learner may be away when it hands back.
        patience: steps in a row that must be alarming before it is called.
        novelty, risk: which of the two alarms there are; novelty alone is EnsembleDAgger's doubt rule.
    """

    ensemble: int = 3
    alone: int = 10
    alarms: float = 0.02
    least: int = 10
    agreement: float = 1.0
    patience: int = 1
    novelty: bool = True
    risk: bool = True

    def __post_init__(self) -> None:
        if self.ensemble < 2:
            raise InvalidValueError(f"ensemble is {self.ensemble}; disagreement takes at least 2 policies.")
        if not 0 < self.alarms < 1:
            raise InvalidValueError(f"alarms is {self.alarms}; it is a share of states, in (0, 1).")
        require_positive(self, "alone", "least", "patience", "agreement")
        if not (self.novelty or self.risk):
            raise InvalidValueError("novelty and risk are both off: the expert would never be called.")

    def open(self, of: Round) -> Gate:
        learner, scale = of.members[0], ActionScale.of(of.members[0])
        risk = fit_risk(of.probes, learner, seed=of.seed) if self.risk else None
        good = [flight for flight in of.probes if flight.success] or list(of.dataset)
        proposed = [actions_along(member, good) for member in of.members]
        novelty = disagreement(np.stack(proposed), scale)
        risky = risk.of_episodes(good, proposed[0]) if risk else np.zeros(1)
        return _Thrifty(
            of.members[1:],
            scale,
            risk,
            Thresholds(
                novelty=float(np.quantile(novelty, 1 - self.alarms)) if self.novelty else np.inf,
                risk=float(np.quantile(risky, 1 - self.alarms)) if self.risk else np.inf,
                discrepancy=self.agreement * _mean_discrepancy(learner, of.dataset, scale),
                calm=float(np.median(risky)) if self.risk else np.inf,
            ),
            least=self.least,
            patience=self.patience,
        )


@dataclass(frozen=True)
class Thresholds:
    """Where the expert is called (novelty, risk) and sent away (discrepancy, calm); infinite for never, or always."""

    novelty: float
    risk: float
    discrepancy: float
    calm: float


class _Thrifty:
    """Remembers, per world, for how long it has been alarming and for how long the expert has flown."""

    def __init__(
        self,
        others: Sequence[ChunkPolicy],
        scale: ActionScale,
        risk: RiskModel | None,
        thresholds: Thresholds,
        *,
        least: int,
        patience: int,
    ) -> None:
        self.others, self.scale, self.risk, self.thresholds = others, scale, risk, thresholds
        self.least, self.patience = least, patience
        self._alarmed_steps, self._flown_steps, self._leave = np.zeros(0, int), np.zeros(0, int), np.zeros(0, bool)

    def begin(self, seeds: np.ndarray, mask: np.ndarray) -> None:
        if len(self._flown_steps) != len(seeds):
            self._alarmed_steps, self._flown_steps = np.zeros((2, len(seeds)), int)
            self._leave = np.zeros(len(seeds), bool)
            mask = np.ones(len(seeds), bool)
            for other in self.others:
                other.reset()
        self._alarmed_steps[mask], self._flown_steps[mask], self._leave[mask] = 0, 0, False
        for other in self.others:
            other.reset(mask)

    def decide(self, given: GateInput) -> Decision:
        opinions = np.stack([given.learner_action, *(other.act(given.obs) for other in self.others)])
        novelty = disagreement(opinions, self.scale)
        risk = self.risk.of(given.obs, given.learner_action) if self.risk else np.zeros(len(novelty))
        alarming = (novelty > self.thresholds.novelty) | (risk > self.thresholds.risk)
        self._alarmed_steps = np.where(alarming, self._alarmed_steps + 1, 0)
        flies = np.where(given.expert_flew, ~self._leave, self._alarmed_steps >= self.patience)
        self._flown_steps = np.where(flies, self._flown_steps + 1, 0)
        agreed = self.scale.distance(given.learner_action, given.expert_action) < self.thresholds.discrepancy
        calm = risk <= self.thresholds.calm
        self._leave = flies & (self._flown_steps >= self.least) & agreed & calm & ~alarming
        return Decision(flies, flies)


def _mean_discrepancy(learner: ChunkPolicy, dataset: Sequence[Episode], scale: ActionScale) -> float:
    """Mean distance between the learner's actions and the labels along labelled episodes."""
    labels = np.concatenate([episode.labels for episode in dataset])
    labelled = np.concatenate([episode.asked for episode in dataset])
    labelled = labelled if labelled.any() else np.ones_like(labelled)
    distance = scale.distance(actions_along(learner, dataset), labels)
    return float(distance[labelled].mean())
