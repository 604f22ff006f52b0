"""Groups of settings that on-policy algorithms share by composition; each algorithm states their values itself."""

import math
from dataclasses import dataclass

from aerial_il.core.checks import require_integer, require_positive, require_share
from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.squashed_gaussian import LOG_STD_HIGH, LOG_STD_LOW

MOST_FLIGHTS = 100_000  # of a trial


def require_deviation(noise: float) -> None:
    """Raise :class:`InvalidValueError` unless ``noise`` is a standard deviation that can be flown and learned."""
    if not LOG_STD_LOW < math.log(max(noise, 1e-99)) < LOG_STD_HIGH:
        low, high = math.exp(LOG_STD_LOW), math.exp(LOG_STD_HIGH)
        raise InvalidValueError(f"noise is {noise}; it must lie in ({low:.2g}, {high:.2g}).")


@dataclass(frozen=True, kw_only=True)
class Rollout:
    """What is flown before each turn of learning, and how often it is gone over.

    Attributes:
        steps: environment steps in a rollout, of all worlds together.
        epochs: passes over a rollout, of whatever learns in minibatches.
        batch_size: transitions in a minibatch; null for the whole rollout.
    """

    steps: int
    epochs: int
    batch_size: int | None

    def __post_init__(self) -> None:
        require_positive(self, "epochs")
        for name in ("steps", "batch_size"):
            if (value := getattr(self, name)) is not None and not value >= 2:
                raise InvalidValueError(f"{name} is {value}; advantages are compared, so at least 2.")


@dataclass(frozen=True, kw_only=True)
class Exploration:
    """How a clone explores: chunks around its own, whose noise is correlated from step to step.

    Attributes:
        execute: steps of a chunk that are flown before the next one is sampled, no more than it has.
        noise: standard deviation of the samples at first, in actions normalised by ``action_scaling``; it is learned.
        correlation: of that noise from one step of a chunk to the next.
    """

    execute: int
    noise: float
    correlation: float

    def __post_init__(self) -> None:
        require_positive(self, "execute")
        require_deviation(self.noise)
        require_share(self, "correlation", below_one=True)


@dataclass(frozen=True, kw_only=True)
class Trial:
    """Flights in which what was learned is compared with the clone by itself, before it is handed over.

    Attributes:
        flights: of one trial, rounded up to whole batches of worlds; 0 for none.
        every: environment steps between two trials.
    """

    flights: int
    every: int

    def __post_init__(self) -> None:
        require_positive(self, "every")
        require_integer("flights", self.flights, 0, MOST_FLIGHTS)
