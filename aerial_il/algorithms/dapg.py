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

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.npg import NaturalGradientAgent
from aerial_il.algorithms.on_policy.advantages import Advantages
from aerial_il.algorithms.on_policy.chunk_actor import ChunkActor, ChunkPilot
from aerial_il.algorithms.on_policy.from_clone import FromClone, Start
from aerial_il.algorithms.on_policy.hand_over import HandOver
from aerial_il.algorithms.on_policy.loop import learn_on_policy
from aerial_il.algorithms.on_policy.settings import Exploration, Rollout, Trial
from aerial_il.algorithms.online.problem import Source
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.online.smoothness import Smoothness
from aerial_il.algorithms.run.cadence import Cadence
from aerial_il.algorithms.run.state import Part
from aerial_il.algorithms.supervised.training_set import TrainingSet, cut_windows
from aerial_il.core.checks import require_not_negative, require_positive, require_share
from aerial_il.data.episode import Episode
from aerial_il.policies.parts.chunk_policy import ChunkPolicy


@dataclass(frozen=True, kw_only=True)
class DAPG(FromClone):
    """Demonstration augmented policy gradient (Rajeswaran et al. 2018, equations 4 and 5).

    Attributes:
        lr: the critic's learning rate, which stays.
        demos_weight: lambda_0, the weight of a demonstration beside the best advantage, at the first turn.
        demos_decay: lambda_1, what is left of it from turn to turn.
        shown: windows of the demonstrations in a turn, at most.
        rollout: epochs and batch_size are the critic's; the actor takes one step.
    """

    name: ClassVar[str] = "dapg"

    steps: int = 4_000_000
    warmup: int = 50_000
    gamma: float = 0.995
    gae_lambda: float = 0.97
    lr: float = 1e-3
    critic_hidden: tuple[int, ...] = (128, 128)
    step_size: float = 0.5
    cg_iterations: int = 10
    cg_damping: float = 1e-4
    demos_weight: float = 0.01
    demos_decay: float = 0.95
    shown: int = 2_048
    rollout: Rollout = Rollout(steps=65_536, epochs=2, batch_size=1024)
    exploration: Exploration = Exploration(execute=10, noise=0.15, correlation=0.9)
    trial: Trial = Trial(flights=128, every=400_000)
    prior: str | None = None
    cloning: BC = BC(steps=6_000, validation=0.0, field_dropout=0.6)
    patience: float = 2.0
    reward: Source = "sparse"
    reward_patience: int = 200_000
    smoothness: Smoothness = Smoothness(temporal=0.0, spatial=0.0, radius=0.05, rate_penalty=0.0, jerk_penalty=0.0)
    cadence: Cadence = Cadence(log_every=50_000, evaluate_every=0, checkpoint_every=50_000, keep_checkpoints=2)
    threads: int = 1

    def __post_init__(self) -> None:
        super().__post_init__()
        require_not_negative(self, "demos_weight")
        require_share(self, "demos_decay")
        require_positive(self, "shown")

    def learn(self, run: OnlineRun) -> None:
        start: Start = run.problem.start
        actor = start.chunk_actor(run, self.exploration)
        shown = Demonstrated(start.demos, start.prior, actor, run.rng("demonstrations"))
        agent = AugmentedAgent(self, actor, start.prior.config.history * run.sizes[0], shown)
        pilot = ChunkPilot(actor, start.prior, run.collector)
        hand_over = HandOver(run, start.alone, actor.network, self.trial)
        learn_on_policy(run, self, pilot, agent, actor.network, warmup=self.warmup, hand_over=hand_over)


class Demonstrated(Part):
    """Demonstrated chunks, as decisions that the actor might have made.

    Args:
        demos: the demonstrations. prior: how they are seen and normalised. actor: whose decisions. rng: samples them.
    """

    changing = ("_rng",)

    def __init__(
        self, demos: Sequence[Episode], prior: ChunkPolicy, actor: ChunkActor, rng: np.random.Generator
    ) -> None:
        self._rng = rng
        windows = cut_windows(demos, prior.interface.layout, prior.config)
        obs, actions, valid = TrainingSet(windows, prior.interface).gather(np.arange(len(windows)))
        assert isinstance(obs, Tensor), "a prior that sees images is refused before"
        whole = valid[:, : actor.execute].all(1)
        self._obs, self._drawn = obs[whole].flatten(1), actor.drawn_of(actions[whole])

    def draw(self, count: int) -> tuple[Tensor, Tensor]:
        """Return at most ``count`` of them: what was observed (B, To * Do) and the samples of the actions (B, R)."""
        chosen = torch.from_numpy(self._rng.permutation(len(self._obs))[:count])
        return self._obs[chosen], self._drawn[chosen]


class AugmentedAgent(NaturalGradientAgent):
    """An actor that takes natural gradient steps on flights and demonstrations, and the critic of its advantages.

    Args:
        settings: of the algorithm. actor: the clone, exploring. obs_size: To * Do. shown: the demonstrations.
    """

    changing = (*NaturalGradientAgent.changing, "_shown", "_turns")

    def __init__(self, settings: DAPG, actor: ChunkActor, obs_size: int, shown: Demonstrated) -> None:
        super().__init__(settings, actor, obs_size)
        self._shown, self._turns = shown, 0

    def improve(self, data: Advantages) -> dict[str, float]:
        """Take one natural gradient step, and count a turn."""
        metrics = {**super().improve(data), "actor/demonstrations": self._weight}
        self._turns += 1
        return metrics

    def gain(self, data: Advantages) -> Tensor:
        """Return the objective that a step ascends: advantages of samples, and the likelihood of demonstrations."""
        seen, drawn = self._shown.draw(self.settings.shown)
        likelihood = self.actor.judge(seen[:, None], drawn)[0].sum() / len(data.obs)
        return super().gain(data) + self._weight * data.standardised.max() * likelihood

    @property
    def _weight(self) -> float:
        return self.settings.demos_weight * self.settings.demos_decay**self._turns
