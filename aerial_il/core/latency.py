"""Latency between what is seen and what is done: how old an observation is, and how late an action comes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from aerial_il.core.errors import InvalidValueError

LONGEST_MS = 1000.0


@dataclass(frozen=True, kw_only=True)
class Latency:
    """How late things are.

    Attributes:
        observation_delay_ms: age of what is seen, when it is seen.
        action_delay_ms: from sending an action to its execution.
    """

    observation_delay_ms: float = 0.0
    action_delay_ms: float = 0.0

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if not 0 <= value <= LONGEST_MS:
                raise InvalidValueError(f"{name} is {value:g}; it must lie in [0, {LONGEST_MS:g}], in milliseconds.")

    @staticmethod
    def of(provenance: Mapping[str, Any], control_dt_s: float) -> Latency:
        """Return what an episode tells of its own: the delays in its settings, and what the tier drew for it."""
        said, drawn = provenance.get("settings", {}), provenance.get("drawn", {})
        tier_ms = 1000 * control_dt_s * drawn.get("latency_steps", 0)
        return Latency(
            observation_delay_ms=float(said.get("observation_delay_ms", 0.0)),
            action_delay_ms=float(said.get("action_delay_ms", 0.0)) + tier_ms,
        )

    @property
    def total_ms(self) -> float:
        """From what is seen to what is done about it."""
        return self.observation_delay_ms + self.action_delay_ms

    @property
    def said(self) -> dict[str, float]:
        """The delays that there are, by name, as settings of an episode keep them."""
        return {name: value for name, value in asdict(self).items() if value}

    def steps(self, control_dt_s: float) -> tuple[int, int]:
        """Return both delays in control steps.

        Raises:
            InvalidValueError: one of them is no whole number of steps.
        """
        return tuple(whole_steps(name, value, control_dt_s) for name, value in asdict(self).items())  # type: ignore[return-value]


NO_LATENCY = Latency()


def whole_steps(name: str, value_ms: float, control_dt_s: float) -> int:
    """Return a delay in control steps, or refuse one that is no whole number of them."""
    steps = round(value_ms / 1000 / control_dt_s)
    if not math.isclose(1000 * steps * control_dt_s, value_ms, abs_tol=1e-6):
        step = 1000 * control_dt_s
        raise InvalidValueError(
            f"{name} is {value_ms:g}; it must be a multiple of the control step, {step:g} ms: "
            f"{step * steps:g} or {step * (steps + (1 if value_ms > step * steps else -1)):g}."
        )
    return steps
