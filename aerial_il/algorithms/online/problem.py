"""What a run learns on: the environment and its reward, demonstrations, or weights to start from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from operator import attrgetter
from typing import Any

from torch import Tensor

from aerial_il.algorithms.online.collector import RewardScheme
from aerial_il.algorithms.online.demonstrations import Transitions
from aerial_il.core.contracts import BatchEnv
from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.parts.layout import Interface
from aerial_il.policies.parts.network import PolicySettings

TOO_SHORT = (
    "steps is {} and {} {}: the run would end before its policy has learned anything. Set algorithm.steps well above "
    "{}, or lower algorithm.{}."
)


@dataclass(frozen=True, eq=False)
class Problem:
    """What a run learns on.

    Attributes:
        algorithm: its name. seed: decides all randomness. policy: what is trained. env: a batch environment.
        interface: the way into and out of its network.
        demos: transitions to imitate, or flown at random in a control run; None where the reward alone teaches.
        dataset: which demonstrations these are, for the run's configuration.
        scheme: how its steps are rewarded.
        inputs: name -> digest of whatever else it learns from, such as a prior.
        initial: weights that its network starts from; None for random ones.
    """

    algorithm: str
    seed: int
    policy: PolicySettings
    env: BatchEnv
    interface: Interface
    demos: Transitions | None = None
    dataset: Mapping[str, Any] | None = None
    scheme: RewardScheme = field(default_factory=RewardScheme)
    inputs: Mapping[str, str] = field(default_factory=dict)
    initial: Mapping[str, Tensor] | None = None

    def describe(self) -> dict[str, Any]:
        """Return what determines the run besides its settings and policy."""
        spec, learned = self.env.spec, {"dataset": dict(self.dataset)} if self.dataset else {}
        where = {"robot": spec.robot, "task": spec.task, "tier": spec.tier, "action": spec.action.level}
        environment = {**where, "num_envs": int(self.env.num_envs)}
        return {"algorithm": self.algorithm, "seed": self.seed, "environment": environment, **learned, **self.inputs}


def check_steps(settings: Any, name: str, flown: int) -> None:
    """Raise :class:`InvalidValueError` where a run ends with the steps ``flown`` that the setting ``name`` asks for."""
    if settings.steps <= flown:
        raise InvalidValueError(TOO_SHORT.format(settings.steps, name, attrgetter(name)(settings), flown, name))


def whole_turns(steps: int, worlds: int) -> int:
    """Return the environment steps, ``steps`` or a few more, after which all ``worlds`` have taken equally many."""
    return -(-steps // worlds) * worlds
