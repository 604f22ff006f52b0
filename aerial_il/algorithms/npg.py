"""Natural policy gradient (NPG): each rollout moves the actor once, by a fixed KL divergence of its actions.

Each turn collects ``rollout`` steps, estimates generalised advantages A, and moves the actor's weights w by

    ``w + sqrt(step_size / (g' F^-1 g)) F^-1 g``,    g = E[A grad log pi],    F = E[grad log pi grad log pi'],

where F, the Fisher information, is never written down: conjugate gradients need its products with vectors alone, which
are second derivatives of the KL divergence from the policy that acted. A critic learns the returns after each step.

Observations are standardised by their running moments, rewards divided by the running standard deviation of returns;
where an episode was only cut by its time limit, its return bootstraps from the critic.

Metrics: ``actor/approx_kl`` (Kullback-Leibler divergence of the step), ``actor/step_length``, ``actor/surrogate`` (gain
of the advantages, linear), ``critic/loss``, ``critic/value``; ``episode/return``, ``episode/length``,
``episode/success`` of the exploring policy; ``evaluate/<name>``; ``elapsed_s``.

Source: S. Kakade, "A Natural Policy Gradient", 2001, as A. Rajeswaran et al. use it in "Learning Complex Dexterous
Manipulation with Deep Reinforcement Learning and Demonstrations", 2018; defaults are those of its authors' library,
mjrl, for that paper, whose policy is ``hidden=(32, 32)``, ``activation=tanh``, ``spread=free``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.utils import parameters_to_vector, vector_to_parameters

from aerial_il.algorithms.online.interface import standardised
from aerial_il.algorithms.online.moments import RunningMoments
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.rl.baseline import Baseline
from aerial_il.algorithms.rl.on_policy import OnPolicy, Rollout, collect_rollout, require_compared
from aerial_il.algorithms.rl.reinforcement import Reinforcement
from aerial_il.algorithms.rl.returns import RewardNorm
from aerial_il.algorithms.run.checks import require_not_negative, require_positive
from aerial_il.algorithms.run.state import Snapshot, joined, separate
from aerial_il.algorithms.run.train_state import Weights
from aerial_il.core.tensors import tensor
from aerial_il.policies.categorical import Categorical
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.network import PolicySettings, StochasticNetwork
from aerial_il.policies.squashed_gaussian import SquashedGaussian


@dataclass(frozen=True, kw_only=True)
class NPG(Reinforcement, OnPolicy):
    """Settings of a run, beside those of :class:`Reinforcement` and :class:`OnPolicy`; ``lr`` is the critic's.

    Attributes:
        step_size: twice the KL divergence of a step of the actor, to second order.
        cg_iterations: of conjugate gradients. cg_damping: added to the Fisher information's diagonal.
        epochs: the critic's passes over a rollout. batch_size: transitions in its minibatches.
    """

    name: ClassVar[str] = "npg"
    trains: ClassVar[tuple[type[PolicySettings], ...]] = (SquashedGaussian, Categorical)

    rollout: int = 20_000
    gamma: float = 0.995
    gae_lambda: float = 0.97
    lr: float = 1e-3
    step_size: float = 0.05
    cg_iterations: int = 10
    cg_damping: float = 1e-4
    epochs: int = 2
    batch_size: int = 64

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "step_size", "cg_iterations", "epochs")
        require_not_negative(self, "cg_damping")
        require_compared(self, "batch_size")

    def flown_before_learning(self, worlds: int) -> dict[str, int]:
        return {}  # its steps do not shrink: even a single rollout moves the actor

    def learn(self, run: OnlineRun) -> ChunkPolicy:
        agent = NaturalGradientAgent(self, run.build_actor(StochasticNetwork), run.sizes[0])
        obs_norm, reward_norm = RunningMoments(run.sizes[0]), RewardNorm(run.collector.n, self.gamma)
        run.begin(agent.actor, {"agent": agent, "obs_norm": obs_norm, "reward_norm": reward_norm})
        run.interface = standardised(run.interface, obs_norm)

        while run.goes_on():
            rollout = collect_rollout(run.collector, run.interface, agent, self.rollout)
            run.log(agent.update(rollout, reward_norm.scale(rollout.rewards, rollout.ended)))
            obs_norm.add(run.interface.layout.relate(rollout.flat("frames")))
            run.interface = standardised(run.interface, obs_norm)
            run.end_turn()

        return run.finish()


class NaturalGradientAgent:
    """An actor that takes natural gradient steps, and the critic that estimates advantages.

    Args:
        settings: of the algorithm.
        actor: the policy's network.
        obs_size: Do.
    """

    def __init__(self, settings: NPG, actor: StochasticNetwork, obs_size: int) -> None:
        self.settings, self.actor = settings, actor
        self._baseline = Baseline(obs_size, settings.critic_hidden, lr=settings.lr)

    @torch.no_grad()
    def explore(self, obs: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Sample actions (n, Da), ``raw`` samples (n, R) and log densities (n,) for observations (n, Do)."""
        drawn = self.actor.sample(tensor(obs)[:, None])
        return drawn[0].numpy(), drawn[1].numpy(), drawn[2].numpy()

    def update(self, rollout: Rollout, rewards: np.ndarray) -> dict[str, float]:
        """Learn from one rollout and its scaled rewards (T, n)."""
        settings = self.settings
        found = self._baseline.advantages(rollout, rewards, gamma=settings.gamma, gae_lambda=settings.gae_lambda)
        advantages = (found.advantages - found.advantages.mean()) / (found.advantages.std() + 1e-8)
        names = ("obs", "next_obs", "raw")
        obs, after, raw = (tensor(np.asarray(rollout.flat(name), np.float32)) for name in names)
        metrics = self.improve(obs, after, raw, advantages)
        critic_loss = self._baseline.fit(found, epochs=settings.epochs, batch_size=settings.batch_size)
        return {**metrics, "critic/loss": critic_loss, "critic/value": found.value}

    def improve(self, obs: Tensor, next_obs: Tensor, raw: Tensor, advantages: Tensor) -> dict[str, float]:
        """Take one natural gradient step up the advantages (B,) of samples ``raw`` (B, R) for ``obs`` (B, Do)."""
        weights = [weight for weight in self.actor.parameters() if weight.requires_grad]
        gradient = flat_gradient(self.gain(obs, next_obs, raw, advantages), weights)
        direction = conjugate_gradients(self._fisher(obs, weights), gradient, self.settings.cg_iterations)
        slope = float(gradient @ direction)
        if slope <= 0:  # no advantage differs from another: there is nowhere to go
            return {"actor/approx_kl": 0.0, "actor/step_length": 0.0, "actor/surrogate": 0.0}
        length = math.sqrt(self.settings.step_size / slope)
        with torch.no_grad():
            before = self.actor.distribution(obs[:, None])
            vector_to_parameters(parameters_to_vector(weights) + length * direction, weights)
            moved = self.actor.divergence(before, self.actor.distribution(obs[:, None])).mean().item()
        return {"actor/approx_kl": moved, "actor/step_length": length, "actor/surrogate": length * slope}

    def gain(self, obs: Tensor, next_obs: Tensor, raw: Tensor, advantages: Tensor) -> Tensor:
        """Return the objective that a step ascends, as in :meth:`improve`."""
        log_prob, _ = self.actor.judge(obs[:, None], raw)
        rough = self.settings.smoothness.loss(self.actor, obs, next_obs, execute=self.actor.execute)
        return (log_prob * advantages).mean() - rough

    def _fisher(self, obs: Tensor, weights: list[nn.Parameter]) -> Callable[[Tensor], Tensor]:
        """Return what multiplies vectors (W,) with the Fisher information over ``obs`` (B, Do), and damping."""
        now = self.actor.distribution(obs[:, None])
        divergence = self.actor.divergence(tuple(part.detach() for part in now), now).mean()
        slope = flat_gradient(divergence, weights, differentiable=True)

        def product(vector: Tensor) -> Tensor:
            return flat_gradient(slope @ vector, weights, keep=True) + self.settings.cg_damping * vector

        return product

    def snapshot(self) -> Snapshot:
        return Snapshot(joined({"actor": Weights(self.actor), "critic": self._baseline}).arrays)

    def restore(self, saved: Snapshot) -> None:
        separate(saved, {"actor": Weights(self.actor), "critic": self._baseline})


def flat_gradient(
    of: Tensor, weights: list[nn.Parameter], *, differentiable: bool = False, keep: bool = False
) -> Tensor:
    """Return the gradient (W,) of a scalar, zero by weights that it does not depend on.

    Args:
        differentiable: whether it is to be differentiated once more. keep: whether the scalar's graph is needed again.
    """
    parts = torch.autograd.grad(
        of, weights, create_graph=differentiable, retain_graph=keep or differentiable, allow_unused=True
    )
    return torch.cat(
        [
            torch.zeros(weight.numel()) if part is None else part.reshape(-1)
            for part, weight in zip(parts, weights, strict=True)
        ]
    )


def conjugate_gradients(product: Callable[[Tensor], Tensor], wanted: Tensor, iterations: int) -> Tensor:
    """Return x with ``product(x)`` near ``wanted`` (W,), for a symmetric positive ``product``.

    Source: J. Nocedal, S. Wright, "Numerical Optimization", 2006, algorithm 5.2.
    """
    found, rest = torch.zeros_like(wanted), wanted.clone()
    way, left = rest.clone(), rest @ rest
    for _ in range(iterations):
        if left <= 1e-10:
            break
        image = product(way)
        step = left / (way @ image)
        found, rest = found + step * way, rest - step * image
        before, left = left, rest @ rest
        way = rest + left / before * way
    return found
