"""Which seeds judge a study and which are for trying settings out, so that no headline figure is of seeds tuned on.

Seeds 20000 to 29999 are reserved: the studies judge on them, with the settings that are shipped. Seeds from 10000 on
judged earlier redesigns and are worn. Seeds 5000 to 5999 are for trials.

What a study may change and still judge is how much it measures and of what: names, and the numbers in :data:`COUNTS`.
Policies, algorithms and all other numbers, such as the noise of a demonstrator or the rounds that it flies, are
settings that something can be tuned by.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any, get_args

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.schema import hints_of

EVALUATION_SEED, TUNING_SEEDS = 20_000, range(5_000, 6_000)
RESERVED = range(EVALUATION_SEED, 30_000)
# Counts of demonstrations, trainings and evaluations, and what they are flown with: results do not depend on that.
COUNTS = frozenset(
    (
        "demos", "few", "many", "watched", "flights", "trajectories", "suite_demos", "poor_demos", "first", "sizes",
        "draws", "seeds", "controls", "others", "pushes", "episodes", "first_episode", "curve_episodes", "num_envs",
        "threads",
    )
)  # fmt: skip


def check_seeds(first_episode: int, episodes: int) -> None:
    """Refuse evaluations that are neither judgement, from 20000 to 29999, nor tuning, from 5000 to 5999.

    Raises:
        InvalidValueError: the seeds lie elsewhere, where something was tuned or demonstrations may have been flown.
    """
    seeds = range(first_episode, first_episode + episodes)
    if not any(seeds.start in known and seeds[-1] in known for known in (RESERVED, TUNING_SEEDS)):
        raise InvalidValueError(
            f"Evaluations on seeds {seeds.start} to {seeds[-1]} are refused: to judge take some from 20000 to 29999, "
            "to tune some from 5000 to 5999; demonstrations use others."
        )


def check_distinct(study: Any) -> None:
    """Refuse names, numbers and draws that are said twice: each would count as one more.

    Raises:
        InvalidValueError: one is.
    """
    for name, hint in hints_of(type(study)).items():
        several = getattr(study, name) if get_args(hint)[-1:] == (...,) else ()  # tuple[str, ...], no pair of numbers
        if twice := [each for k, each in enumerate(several) if each in several[:k]]:
            raise InvalidValueError(f"bench.{name} has {twice[0]} twice; once is enough.")


def check_untuned(study: Any) -> None:
    """Refuse to judge on the reserved seeds what is learned or flown with other settings than the shipped ones.

    Args:
        study: as it is about to run.

    Raises:
        InvalidValueError: it has settings of its own by which something is learned or flown, and reserved seeds.
    """
    changed = list(_changed_methods(study))
    first = getattr(study, "first_episode", None)
    if changed and first in RESERVED:
        raise InvalidValueError(
            f"bench.{changed[0]} differs from what is shipped, and seeds {first} on are reserved for judging that: "
            "trying settings out on them would wear them. Add bench.first_episode=5000; what proves better there "
            f"becomes the default in the study or its algorithm, and is judged by aerial-il bench {study.name}."
        )


def _changed_methods(study: Any) -> Iterator[str]:
    """Yield the names of policies, algorithms and real numbers that differ from those of the study's own."""
    shipped = type(study)()
    for name in (each.name for each in fields(study)):
        mine, own = getattr(study, name), getattr(shipped, name)
        if (is_dataclass(own) or (_is_number(own) and name not in COUNTS)) and mine != own:
            yield name
        elif isinstance(own, Mapping) and isinstance(mine, Mapping):
            yield from (f"{name}.{k}" for k, v in mine.items() if _is_method(v) and v != own.get(k))


def _is_number(value: Any) -> bool:
    """Whether a setting is a number or several."""
    numbers = value if isinstance(value, tuple) and value else (value,)
    return all(isinstance(n, int | float) and not isinstance(n, bool) for n in numbers)


def _is_method(value: Any) -> bool:
    return is_dataclass(value) or isinstance(value, Mapping)
