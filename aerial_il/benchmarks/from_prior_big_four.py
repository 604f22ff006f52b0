"""Reinforcement learning from a prior on a heavy vehicle: a peg inserted in gusts, from a clone of few demonstrations.

The study of :mod:`from_prior` on ``big_four_z1``, which weighs 20.7 kg and has to tilt to move sideways.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

from aerial_il.benchmarks.from_prior import FromPrior


@dataclass(frozen=True, kw_only=True)
class BigFour(FromPrior):
    """Settings, with other defaults than those of :class:`FromPrior`."""

    name: ClassVar[str] = "from_prior_big_four"
    question: ClassVar[str] = "How much does practice improve a clone of few demonstrations on a heavy vehicle?"

    arms: tuple[str, ...] = ("expert_iteration", "filtered_bc", "bc_ppo")
    robot: str = "big_four_z1"
    starts: Mapping[str, tuple[int, ...]] = field(default_factory=lambda: {"insert_peg": (40,)})


BENCHMARK = BigFour
