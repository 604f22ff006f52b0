"""Natural policy gradient (NPG): each rollout moves the actor once, by a fixed KL divergence of its actions.

Each turn collects ``rollout.steps`` steps, estimates generalised advantages A, and moves the actor's weights w by

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

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor, nn
from torch.nn.utils import parameters_to_vector, vector_to_parameters

from aerial_il.algorithms.on_policy.actor_critic import ActorCritic
from aerial_il.algorithms.on_policy.advantages import Advantages, Judged
from aerial_il.algorithms.on_policy.loop import learn_step_by_step
from aerial_il.algorithms.on_policy.settings import Rollout
from aerial_il.algorithms.online.algorithm import Algorithm
from aerial_il.algorithms.online.problem import Given, Problem, Source, from_reward
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.online.smoothness import Smoothness
from aerial_il.algorithms.run.cadence import Cadence
from aerial_il.policies.categorical import Categorical
from aerial_il.policies.parts.network import PolicySettings, StochasticNetwork
from aerial_il.policies.squashed_gaussian import SquashedGaussian


@dataclass(frozen=True, kw_only=True)
class NPG(Algorithm):
    """Natural policy gradient (Kakade 2001), with the values of Rajeswaran et al. 2018.

    Attributes:
        lr: the critic's learning rate, which stays.
        rollout: epochs and batch_size are the critic's; the actor takes one step.
    """

    name: ClassVar[str] = "npg"
    trains: ClassVar[tuple[type[PolicySettings], ...]] = (SquashedGaussian, Categorical)

    steps: int = 300_000
    gamma: float = 0.995
    gae_lambda: float = 0.97
    lr: float = 1e-3
    step_size: float = 0.05
    cg_iterations: int = 10
    cg_damping: float = 1e-4
    critic_hidden: tuple[int, ...] = (64, 64)
    rollout: Rollout = Rollout(steps=20_000, epochs=2, batch_size=64)
    reward: Source = "environment"
    reward_patience: int = 200_000
    smoothness: Smoothness = Smoothness(temporal=0.0, spatial=0.0, radius=0.05, rate_penalty=0.0, jerk_penalty=0.0)
    cadence: Cadence = Cadence(log_every=5_000, evaluate_every=0, checkpoint_every=50_000, keep_checkpoints=2)
    threads: int = 1

    def problem(self, given: Given) -> Problem:
        return from_reward(self, given)  # whatever the steps: even a single rollout moves the actor

    def learn(self, run: OnlineRun) -> None:
        learn_step_by_step(run, self, NaturalGradientAgent)


class NaturalGradientAgent(ActorCritic[StochasticNetwork]):
    """An actor that takes natural gradient steps, and the critic that estimates advantages."""

    def learn(self, judged: Judged, *, left: float, improve: bool = True) -> dict[str, float]:
        """Learn from one rollout; no step depends on the share of the training that is ``left``."""
        metrics = self.improve(judged.data) if improve else {}
        return {**metrics, "critic/loss": self._critic.fit(judged.data, self.settings.rollout)}

    def improve(self, data: Advantages) -> dict[str, float]:
        """Take one natural gradient step up the standardised advantages."""
        weights = [weight for weight in self.actor.parameters() if weight.requires_grad]
        gradient = flat_gradient(self.gain(data), weights)
        direction = conjugate_gradients(self._fisher(data.obs, weights), gradient, self.settings.cg_iterations)
        slope = float(gradient @ direction)
        if slope <= 0:  # no advantage differs from another: there is nowhere to go
            return {"actor/approx_kl": 0.0, "actor/step_length": 0.0, "actor/surrogate": 0.0}
        length = math.sqrt(self.settings.step_size / slope)
        with torch.no_grad():
            before = self.actor.distribution(data.obs[:, None])
            vector_to_parameters(parameters_to_vector(weights) + length * direction, weights)
            moved = self.actor.divergence(before, self.actor.distribution(data.obs[:, None])).mean().item()
        return {"actor/approx_kl": moved, "actor/step_length": length, "actor/surrogate": length * slope}

    def gain(self, data: Advantages) -> Tensor:
        """Return the objective that a step ascends."""
        log_prob, _ = self.actor.judge(data.obs[:, None], data.raw)
        rough = self.settings.smoothness.loss(self.actor, data.obs, data.next_obs, execute=self.actor.execute)
        return (log_prob * data.standardised).mean() - rough

    def _fisher(self, obs: Tensor, weights: list[nn.Parameter]) -> Callable[[Tensor], Tensor]:
        """Return what multiplies vectors (W,) with the Fisher information over ``obs`` (B, Do), and damping."""
        now = self.actor.distribution(obs[:, None])
        divergence = self.actor.divergence(tuple(part.detach() for part in now), now).mean()
        slope = flat_gradient(divergence, weights, differentiable=True)

        def product(vector: Tensor) -> Tensor:
            return flat_gradient(slope @ vector, weights, keep=True) + self.settings.cg_damping * vector

        return product


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
    solution, rest = torch.zeros_like(wanted), wanted.clone()
    way, left = rest.clone(), rest @ rest
    for _ in range(iterations):
        if left <= 1e-10:
            break
        image = product(way)
        step = left / (way @ image)
        solution, rest = solution + step * way, rest - step * image
        before, left = left, rest @ rest
        way = rest + left / before * way
    return solution
