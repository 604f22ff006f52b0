"""Demonstration augmented policy gradient (DAPG): natural gradient steps, on demonstrations too, less and less.

A clone of the demonstrations goes on learning, chunk by chunk. Each turn collects ``rollout`` steps and moves the
clone's own network once, as ``npg`` does, along the gradient

    ``g = 1/N (sum over N decisions of A grad log pi(a | s)``
    ``+ lambda_0 lambda_1^k max A sum over the demonstrations of grad log pi(a* | s*))``

with the advantages A of the sampled chunks a, the demonstrated chunks a*, and k turns so far: the demonstrations keep
the clone where exploration teaches little, and their weight falls as it teaches more. Up to ``warmup`` the clone flies
alone, and a critic learns its value. The clone is handed over until what was learned flies as well (``trial``).

Metrics: ``actor/approx_kl`` (Kullback-Leibler divergence of the step), ``actor/step_length``, ``actor/surrogate``,
``actor/demonstrations`` (weight of each of them), ``critic/loss``, ``critic/value``; ``episode/return``,
``episode/length``, ``episode/success`` of the exploring policy; ``trial/return`` and ``trial/prior`` (mean returns in a
trial); ``evaluate/<name>`` of what would be handed over, at step 0 the clone;
``elapsed_s``.

Source: A. Rajeswaran et al., "Learning Complex Dexterous Manipulation with Deep Reinforcement Learning and
Demonstrations", 2018, equations 4 and 5; lambdas and discounts are those of its authors' code, mjrl. There an action is
one step, ``step_size`` is 0.05, and cloning takes five passes over a network of 32 by 32; here an action is a chunk,
of whose numbers the divergences add up (0.5), its noise is correlated, and the clone is an ordinary one. At most
``shown`` windows of the demonstrations are taken in a turn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from aerial_il.algorithms.decisions.chunk_actor import ChunkActor, ChunkPilot
from aerial_il.algorithms.decisions.practice import Practice, PractisedChunks
from aerial_il.algorithms.decisions.rollout import Judged, collect_decisions, judged
from aerial_il.algorithms.npg import NPG, NaturalGradientAgent
from aerial_il.algorithms.rl.baseline import Estimated
from aerial_il.algorithms.rl.returns import RewardNorm
from aerial_il.algorithms.run.checks import require_not_negative, require_positive, require_share
from aerial_il.algorithms.run.state import Generator, Snapshot, joined, separate
from aerial_il.algorithms.supervised.training_set import TrainingSet, cut_windows
from aerial_il.data.episode import Episode
from aerial_il.policies.parts.chunk_policy import ChunkPolicy


@dataclass(frozen=True, kw_only=True)
class DAPG(PractisedChunks, NPG):
    """Settings of a run, beside those of :class:`PractisedChunks` and of ``npg``.

    Attributes:
        demos_weight: lambda_0, the weight of a demonstration beside the best advantage, at the first turn.
        demos_decay: lambda_1, what is left of it from turn to turn.
        shown: windows of the demonstrations in a turn, at most.
    """

    name: ClassVar[str] = "dapg"

    steps: int = 16_000_000
    gamma: float = 0.995
    step_size: float = 0.5
    batch_size: int = 1024
    critic_hidden: tuple[int, ...] = (128, 128)
    demos_weight: float = 0.01
    demos_decay: float = 0.95
    shown: int = 2_048

    def __post_init__(self) -> None:
        super().__post_init__()
        require_not_negative(self, "demos_weight")
        require_share(self, "demos_decay")
        require_positive(self, "shown")

    def practise(self, practice: Practice) -> ChunkPolicy:
        run, prior, actor = practice.run, practice.prior, self.actor(practice)
        shown = Demonstrated(practice.demos, prior, actor, run.rng("demonstrations"))
        agent = AugmentedAgent(self, actor, prior.config.history * run.sizes[0], shown)
        pilot, reward_norm = ChunkPilot(actor, prior, run.collector), RewardNorm(run.collector.n, self.gamma)
        hand_over = self.hand_over(practice, actor)
        parts = {"agent": agent, "pilot": pilot, "reward_norm": reward_norm, "hand_over": hand_over}
        run.begin(actor.network, parts)

        while run.goes_on():
            warming_up = run.collector.steps < self.warmup
            decisions = collect_decisions(run.collector, pilot, self.rollout)
            rewards = reward_norm.scale(decisions.rewards, decisions.ended)
            found = judged(decisions, agent.values, rewards, gamma=self.gamma, gae_lambda=self.gae_lambda)
            run.log(agent.learn(found, improve=not warming_up))
            run.log({} if warming_up else hand_over.after_learning())
            run.end_turn()

        return hand_over.finish()


class Demonstrated(Generator):
    """Demonstrated chunks, as decisions that the actor might have made.

    Args:
        demos: the demonstrations. prior: how they are seen and normalised. actor: whose decisions. rng: samples them.
    """

    def __init__(
        self, demos: Sequence[Episode], prior: ChunkPolicy, actor: ChunkActor, rng: np.random.Generator
    ) -> None:
        super().__init__(rng)
        windows = cut_windows(demos, prior.interface.layout, prior.config)
        obs, actions, valid = TrainingSet(windows, prior.interface).gather(np.arange(len(windows)))
        whole = valid[:, : actor.execute].all(1)
        self._obs, self._drawn = obs[whole].flatten(1), actor.drawn_of(actions[whole])

    def draw(self, count: int) -> tuple[Tensor, Tensor]:
        """Return at most ``count`` of them: what was observed (B, To * Do) and the samples of the actions (B, R)."""
        chosen = torch.from_numpy(self.rng.permutation(len(self._obs))[:count])
        return self._obs[chosen], self._drawn[chosen]


class AugmentedAgent(NaturalGradientAgent):
    """An actor that takes natural gradient steps on flights and demonstrations, and the critic of its advantages.

    Args:
        settings: of the algorithm. actor: the clone, exploring. obs_size: To * Do. shown: the demonstrations.
    """

    def __init__(self, settings: DAPG, actor: ChunkActor, obs_size: int, shown: Demonstrated) -> None:
        super().__init__(settings, actor, obs_size)
        self._augmented, self._shown, self._turns = settings, shown, 0

    def values(self, obs: np.ndarray) -> np.ndarray:
        """Return the critic's values (...) of what decisions see (..., To * Do)."""
        return self._baseline.values(obs)

    def learn(self, found: Judged, *, improve: bool) -> dict[str, float]:
        """Learn from one rollout's decisions; ``improve`` says whether the actor is updated."""
        data, metrics = found.data, {}
        if improve:
            weight = self._weight
            advantages = (data.advantages - data.advantages.mean()) / (data.advantages.std() + 1e-8)
            metrics = {**self.improve(*data[:3], advantages), "actor/demonstrations": weight}
            self._turns += 1
        flown = Estimated(data.obs, data.advantages, data.targets, found.value)
        fitted = self._baseline.fit(flown, epochs=self._augmented.epochs, batch_size=self._augmented.batch_size)
        return {**metrics, "critic/loss": fitted, "critic/value": found.value}

    def gain(self, obs: Tensor, next_obs: Tensor, raw: Tensor, advantages: Tensor) -> Tensor:
        """Return the objective that a step ascends: advantages of samples, and the likelihood of demonstrations."""
        seen, drawn = self._shown.draw(self._augmented.shown)
        likelihood = self.actor.judge(seen[:, None], drawn)[0].sum() / len(obs)
        return super().gain(obs, next_obs, raw, advantages) + self._weight * advantages.max() * likelihood

    @property
    def _weight(self) -> float:
        return self._augmented.demos_weight * self._augmented.demos_decay**self._turns

    def snapshot(self) -> Snapshot:
        taken = joined({"agent": super(), "shown": self._shown})
        return Snapshot(taken.arrays, {**taken.values, "turns": self._turns})

    def restore(self, saved: Snapshot) -> None:
        separate(saved, {"agent": super(), "shown": self._shown})
        self._turns = saved.values["turns"]
