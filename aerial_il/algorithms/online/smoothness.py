"""Smoothness: penalties on how fast actions change, subtracted from the reward, and regularisers of the actor.

CAPS pulls the actor's answers to one observation and the next together, and its answers to an observation and to one
nearby. Penalties are the other way: changes from action to action cost reward, so that the critic learns of them.
Their cause, the actions before, is not observed.

Source: S. Mysore et al., "Regularizing Action Policies for Smooth Control with Reinforcement Learning", 2021, equations
2 to 4. It measures distances between actions by their length; here it is their mean square, smooth at zero.
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from aerial_il.core.checks import require_not_negative
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import ActionSpec
from aerial_il.policies.parts.network import ChunkNetwork

OF_CHOICES = (
    "smoothness.temporal is {:g} and smoothness.spatial {:g}; choices among discrete actions have no gradient to be "
    "regularised by. Set both to 0, and algorithm.smoothness.rate_penalty instead."
)


@dataclass(frozen=True, kw_only=True)
class Smoothness:
    """Weights; 0 asks for nothing. Actions count from -1 to 1 over their bounds.

    Attributes:
        temporal: CAPS, of the squared difference between the actor's mean actions from one step to the next.
        spatial: CAPS, of the one between those for an observation and another sampled near it.
        radius: standard deviation of that sample, in the network's units.
        rate_penalty: subtracted from the reward for each unit of the squared difference between two actions, mean over
            elements.
        jerk_penalty: the same of the squared third difference of four actions.
    """

    temporal: float
    spatial: float
    radius: float
    rate_penalty: float
    jerk_penalty: float

    def __post_init__(self) -> None:
        require_not_negative(self, "temporal", "spatial", "radius", "rate_penalty", "jerk_penalty")

    def check_for_choices(self) -> None:
        """Raise :class:`InvalidValueError` where discrete actions are to be regularised."""
        if self.temporal or self.spatial:
            raise InvalidValueError(OF_CHOICES.format(self.temporal, self.spatial))

    def loss(self, actor: ChunkNetwork, obs: Tensor, next_obs: Tensor, *, execute: int = 1) -> Tensor | float:
        """Return the term of the actor's loss for encoded observations (B, Do) and the next ones (B, Do).

        Args:
            execute: actions of an answer that are flown from an observation to the next.

        Raises:
            InvalidValueError: the actor chooses among discrete actions, which have no gradient.
        """
        if not (self.temporal or self.spatial):
            return 0.0
        here, total = actor(obs[:, None]), torch.zeros(())
        if not here.requires_grad:
            self.check_for_choices()
        if self.temporal:
            flown = torch.cat([here[:, :execute], actor(next_obs[:, None])[:, :1]], 1)
            total = total + self.temporal * (flown.diff(dim=1) ** 2).mean()
        if self.spatial:
            near = obs + self.radius * torch.randn_like(obs)
            total = total + self.spatial * ((here - actor(near[:, None]))[:, :execute] ** 2).mean()
        return total

    @property
    def penalises(self) -> bool:
        """Whether rough actions cost anything."""
        return self.rate_penalty > 0 or self.jerk_penalty > 0

    def penalties(self, recent: np.ndarray, ages: np.ndarray, bounds: ActionSpec) -> np.ndarray:
        """Return the penalty for the last action of each world, (n,).

        Args:
            recent: (n, 4, Da) its last actions, the newest last. ages: (n,) how many of them there are. bounds: theirs.
        """
        cost, low, high = np.zeros(len(recent)), bounds.low, bounds.high
        scaled = (2.0 * recent - low - high) / (high - low)
        for weight, order in ((self.rate_penalty, 1), (self.jerk_penalty, 3)):
            if weight:
                change = np.diff(scaled, n=order, axis=1)[:, -1]
                cost += np.where(ages > order, weight * (change**2).mean(axis=1), 0.0)
        return cost


NO_SMOOTHNESS = Smoothness(temporal=0.0, spatial=0.0, radius=0.05, rate_penalty=0.0, jerk_penalty=0.0)
