"""Settings that adversarial imitation has in common, on-policy and off-policy."""

from __future__ import annotations

from dataclasses import dataclass

from aerial_il.algorithms.adversarial.discriminator import Reward
from aerial_il.algorithms.adversarial.reward_net import Shape
from aerial_il.algorithms.online.algorithm import Algorithm
from aerial_il.core.checks import (
    require_choice,
    require_not_negative,
    require_positive,
    require_share,
    require_widths,
)


@dataclass(frozen=True, kw_only=True)
class LearnedReward:
    """The discriminator, whose output is the reward.

    Attributes:
        form: of the reward, ``gail``, ``airl`` or ``exit``.
        hidden: widths of the discriminator.
        lr: its learning rate.
        updates: how often it learns.
        gradient_penalty: weight of that penalty; 0 for none.
        spectral_norm: normalise its matrices.
        dropout: of its inputs and hidden units.
        action_noise: give it demonstrated actions with the noise that the agent explores with. Else that noise is what
            it recognises the agent by, long before it sees where the agent errs.
    """

    form: Reward
    hidden: tuple[int, ...]
    lr: float
    updates: float
    gradient_penalty: float
    spectral_norm: bool
    dropout: float
    action_noise: bool

    def __post_init__(self) -> None:
        require_positive(self, "lr", "updates")
        require_share(self, "dropout", below_one=True)
        require_widths(self, "hidden")
        require_not_negative(self, "gradient_penalty")
        require_choice(self, "form", Reward)

    def shape(self, *, running_norm: bool, actions: bool = True) -> Shape:
        """Return of what form the discriminator is: whether it standardises its inputs itself, and sees actions."""
        return {
            "hidden": self.hidden,
            "spectral": self.spectral_norm,
            "dropout": self.dropout,
            "running_norm": running_norm,
            "actions": actions,
            "form": self.form,
        }


def starts_cloned(settings: Algorithm) -> bool:
    """Whether it starts with behavioural cloning, as the control without demonstrations does not."""
    return settings.bc_pretrain_steps > 0 and settings.demonstrations.control != "constant_reward"
