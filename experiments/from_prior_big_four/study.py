"""Reinforcement learning from a prior on a heavy vehicle: a peg inserted in gusts, from a clone of few demonstrations.

The study of :mod:`from_prior` on ``big_four_z1``, which weighs 20.7 kg and has to tilt to move sideways. Where half of
the flights succeed, the usual trials of 128 flights let a policy pass that was 13.5 points worse than its prior on 200
other flights. A trial therefore has 512 here, a quarter as often, and practice lasts longer.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from experiments.from_prior.study import SUITED, FromPrior

LARGER_TRIALS: Mapping[str, Mapping[str, Any]] = {
    "insert_peg": {
        **SUITED["insert_peg"],
        "bc_ppo": {
            **SUITED["insert_peg"]["bc_ppo"],
            "steps": 16_000_000,
            "trial": {"flights": 512, "every": 1_600_000},
        },
    }
}


@dataclass(frozen=True, kw_only=True)
class FromPriorBigFour(FromPrior):
    """Settings, with other defaults than those of :class:`FromPrior`."""

    name: ClassVar[str] = "from_prior_big_four"
    question: ClassVar[str] = "How much does practice improve a clone of few demonstrations on a heavy vehicle?"

    arms: tuple[str, ...] = ("expert_iteration", "filtered_bc", "bc_ppo")
    robot: str = "big_four_z1"
    starts: Mapping[str, tuple[int, ...]] = field(default_factory=lambda: {"insert_peg": (40,)})
    suited: Mapping[str, Mapping[str, Any]] = field(default_factory=lambda: dict(LARGER_TRIALS))
