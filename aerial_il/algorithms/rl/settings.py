"""What algorithms that fly while they learn can be told: one dataclass for each family, checking itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal, get_args

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.settings import make_tuples

Control = Literal["none", "random_actions", "constant_reward"]
Bounds = Literal["environment", "demonstrations"]
Labels = Literal["executed", "expert"]


@dataclass(frozen=True, kw_only=True)
class Flying:
    """Settings of every run that flies while it learns.

    Attributes:
        steps: environment steps, of all worlds together.
        gamma: discount.
        log_every, evaluate_every, checkpoint_every: environment steps between two; 0 for never.
        keep_checkpoints: how many of the newest stay on disk.
        threads: torch threads; results repeat bit for bit at a fixed number only.
        needs, worlds: what a command hands to ``train``, and how many worlds that has.
        rewarded: whether it learns from the environment's reward, and so without demonstrations.
    """

    needs: ClassVar[tuple[str, ...]] = ("env",)
    rewarded: ClassVar[bool] = False
    worlds: ClassVar[int] = 8

    steps: int = 300_000
    gamma: float = 0.99
    log_every: int = 5_000
    evaluate_every: int = 0
    checkpoint_every: int = 50_000
    keep_checkpoints: int = 2
    threads: int = 1

    def __post_init__(self) -> None:
        make_tuples(self)
        require_positive(self, "steps", "keep_checkpoints", "threads")
        require_share(self, "gamma", below_one=True)
        require_not_negative(self, "log_every", "evaluate_every", "checkpoint_every")


@dataclass(frozen=True, kw_only=True)
class OffPolicy(Flying):
    """Settings of runs that learn from a replay memory.

    Attributes:
        warmup: environment steps with random actions, before anything is learned.
        updates: gradient steps of the critics for each environment step.
        actor_every: of these, how many for each one of actor and temperature.
        batch_size: transitions in a minibatch.
        memory: transitions kept.
        lr: learning rate of actor, critics and temperature, at the start; it changes linearly.
        lr_floor: what is left of it at the end, as a share; 1 for all. Below that the final policy swings less.
        tau: share by which target critics follow at each update.
        critic_hidden: widths of the critics.
        alpha: temperature at the start.
        entropy: wanted entropy for each action element.
    """

    warmup: int = 5_000
    updates: float = 1.0
    actor_every: int = 2
    batch_size: int = 256
    memory: int = 1_000_000
    lr: float = 3e-4
    lr_floor: float = 1.0
    tau: float = 0.005
    critic_hidden: tuple[int, ...] = (256, 256)
    alpha: float = 0.1
    entropy: float = -1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "warmup", "updates", "actor_every", "batch_size", "memory", "lr", "tau", "alpha")
        require_share(self, "lr_floor")
        require_widths(self, "critic_hidden")

    def lr_at(self, left: float) -> float:
        """Return the learning rate when the share ``left`` of the training is left."""
        return self.lr * (self.lr_floor + (1.0 - self.lr_floor) * left)


@dataclass(frozen=True, kw_only=True)
class OnPolicy(Flying):
    """Settings of runs that learn from one rollout at a time.

    Attributes:
        rollout: environment steps in a rollout, of all worlds together.
        epochs: passes over it. batch_size: transitions in a minibatch.
        lr: learning rate at the start; it falls linearly to zero.
        decay: lambda of the advantages.
        clip: how far the ratio of probabilities counts.
        entropy: weight of the entropy. clip_norm: largest gradient norm.
        target_kl: where a rollout's updates of the actor stop; 0 for nowhere.
        critic_hidden: widths of the critic.
    """

    rollout: int = 2048
    epochs: int = 10
    batch_size: int = 64
    lr: float = 3e-4
    decay: float = 0.95
    clip: float = 0.2
    entropy: float = 0.0
    clip_norm: float = 0.5
    target_kl: float = 0.0
    critic_hidden: tuple[int, ...] = (64, 64)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "epochs", "lr", "clip", "clip_norm")
        for name in ("rollout", "batch_size"):
            if getattr(self, name) < 2:
                raise InvalidValueError(f"{name} is {getattr(self, name)}; advantages are compared, so at least 2.")
        require_share(self, "decay")
        require_widths(self, "critic_hidden")


@dataclass(frozen=True, kw_only=True)
class Imitating(Flying):
    """What imitators are shown; stands before :class:`OffPolicy` or :class:`OnPolicy` among the bases.

    Attributes:
        trajectories: how many demonstrations, the first ones; None for all. subsample: keep each so manieth step.
        bounds: what actions of ±1 stand for, the ``environment``'s bounds or the range of the ``demonstrations``.
        labels: what counts as the demonstrator's action where it was perturbed: what was ``executed``, or what the
            ``expert`` meant, which tells how to come back.
        control: ``none``, or what stands in for demonstrations: ``random_actions`` or ``constant_reward``.
        absorbing: whether ends that matter lead to an absorbing state; otherwise they are worth nothing.
    """

    trajectories: int | None = None
    subsample: int = 1
    bounds: Bounds = "environment"
    labels: Labels = "executed"
    control: Control = "none"
    absorbing: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "subsample")
        if self.trajectories is not None:
            require_positive(self, "trajectories")
        require_choice(self, "bounds", Bounds)
        require_choice(self, "labels", Labels)
        require_choice(self, "control", Control)


def require_positive(settings: object, *names: str) -> None:
    """Raise :class:`InvalidValueError` unless every named setting is positive."""
    for name in names:
        if not getattr(settings, name) > 0:
            raise InvalidValueError(f"{name} is {getattr(settings, name)}; it must be positive.")


def require_not_negative(settings: object, *names: str) -> None:
    """Raise :class:`InvalidValueError` if a named setting is negative."""
    for name in names:
        if getattr(settings, name) < 0:
            raise InvalidValueError(f"{name} is {getattr(settings, name)}; it must not be negative.")


def require_share(settings: object, *names: str, below_one: bool = False) -> None:
    """Raise :class:`InvalidValueError` unless every named setting lies between 0 and 1."""
    for name in names:
        value = getattr(settings, name)
        if not 0 <= value <= 1 or (below_one and value == 1):
            raise InvalidValueError(f"{name} is {value}; it must lie in [0, 1{')' if below_one else ']'}.")


def require_widths(settings: object, name: str) -> None:
    """Raise :class:`InvalidValueError` unless the named setting is at least one positive width."""
    value = getattr(settings, name)
    if not value or min(value) < 1:
        raise InvalidValueError(f"{name} is {value}; it must name at least one positive width.")


def require_choice(settings: object, name: str, choices: object) -> None:
    """Raise :class:`InvalidValueError` unless the named setting is one of a ``Literal``'s values."""
    if getattr(settings, name) not in get_args(choices):
        valid = ", ".join(get_args(choices))
        raise InvalidValueError(f"Unknown {name} {getattr(settings, name)!r}. Valid: {valid}.")
