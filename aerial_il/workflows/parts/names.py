"""Types of settings that stand for something by name, and limits that settings share."""

from typing import Annotated, Any, Literal

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.schema import Choice, Name

Robot = Annotated[str, Name("robot")]
Task = Annotated[str, Name("task")]
Tier = Annotated[str, Name("tier")]
Controller = Annotated[str, Name("controller")]
MaybeRobot = Annotated[str | None, Name("robot")]
MaybeTask = Annotated[str | None, Name("task")]
MaybeTier = Annotated[str | None, Name("tier")]
Policy = Annotated[Any, Choice("policy")]
Algorithm = Annotated[Any, Choice("algorithm")]
License = Literal[  # as the Hugging Face Hub spells them
    "cc-by-4.0", "cc-by-sa-4.0", "cc-by-nc-4.0", "cc0-1.0", "odc-by", "odbl", "cdla-permissive-2.0", "mit",
    "apache-2.0", "bsd-3-clause", "other",
]  # fmt: skip

MOST = {  # key -> the most that is believed: what is beyond was mistyped, or would fill any memory
    "seed": 2**62, "evaluate_seed": 2**62, "evaluation_seed": 2**62,
    "episodes": 1_000_000, "evaluate_episodes": 1_000_000, "evaluation_episodes": 1_000_000,
    "num_envs": 16_384, "threads": 4096, "port": 65_535,
}  # fmt: skip


def at_least(settings: Any, **limits: float) -> None:
    """Refuse values below their limits, e.g. ``at_least(self, episodes=1, seed=0)``, or beyond what any may be."""
    for name, limit in limits.items():
        value = getattr(settings, name)
        if value is not None and not value >= limit:  # nor NaN
            raise InvalidValueError(f"{name}={value} is too small: the minimum is {limit}.")
        if value is not None and name in MOST and value > MOST[name]:
            raise InvalidValueError(f"{name}={value} is too large: the maximum is {MOST[name]}.")
