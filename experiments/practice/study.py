"""Practice as it is shipped: each method by its command and default settings, on the same demonstrations of each draw.

The study of :mod:`from_prior` without anything that is suited to a task. What it trains is what

    aerial-il train algorithm=NAME policy=mlp dataset=DEMONSTRATIONS

trains for ``NAME`` of the arms, and every method has every draw, so that their rows may be compared.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from experiments.from_prior.study import FromPrior


@dataclass(frozen=True, kw_only=True)
class Practice(FromPrior):
    """Settings, with other defaults than those of :class:`FromPrior`."""

    name: ClassVar[str] = "practice"
    question: ClassVar[str] = "What does practice add to a clone of ten demonstrations, by the shipped commands?"

    arms: tuple[str, ...] = ("expert_iteration", "filtered_bc", "bc_ppo", "residual", "dapg")
    fewer: Mapping[str, int] = field(default_factory=dict)
    starts: Mapping[str, tuple[int, ...]] = field(default_factory=lambda: {"pick_place": (10,)})
    begun_by: Mapping[str, str] = field(default_factory=dict)
    suited: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    watched: int = 10
