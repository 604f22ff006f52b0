"""How chunks are flown: settings of a flight, which no weight depends on.

A chunk begins with the action for the moment that the observation shows. With a latency of d control steps, its first d
actions come too late: they belong to what has been sent already.

``plain``: flown as if there were no latency. ``dropped``: the first d actions are left out, the others are in time.
``realtime``: moreover, half a chunk is flown before the next one is due; while that is denoised, the actions that were
sent are held, and those still planned are held the less the later they are, so that chunks join (see :mod:`.guiding`).

Source: C. Chi et al., "Universal Manipulation Interface", 2024, section IV-B (outdated actions are discarded).
"""

from dataclasses import asdict, dataclass
from typing import Any, Literal

from aerial_il.core.checks import require_choice, require_not_negative
from aerial_il.core.errors import InvalidValueError

Chunks = Literal["plain", "dropped", "realtime"]


@dataclass(frozen=True, kw_only=True)
class Execution:
    """How chunks are flown.

    Attributes:
        chunks: with latency: plain, dropped or realtime.
        newest: control steps that the newest chunk is flown for before the next one, without the mean over older ones;
            0: as the policy was trained to.
        delay_ms: the latency that chunks are flown for (null: that of the robot).
        guidance: how strongly denoising is led to what the robot can follow; 0: not at all, 1.5 in the source.
    """

    chunks: Chunks = "plain"
    newest: int = 0
    delay_ms: float | None = None
    guidance: float = 0.0

    def __post_init__(self) -> None:
        require_choice(self, "chunks", Chunks)
        require_not_negative(self, "guidance", "newest", *(["delay_ms"] if self.delay_ms is not None else []))
        if self.newest and self.chunks == "realtime":
            raise InvalidValueError(
                "execution.chunks=realtime flies half of each chunk: execution.newest has no effect with it."
            )
        if self.delay_ms is not None and self.chunks == "plain":
            raise InvalidValueError(
                "execution.delay_ms has no effect with execution.chunks=plain. Valid with it: dropped, realtime."
            )

    @property
    def said(self) -> dict[str, Any]:
        """What differs from flying chunks as trained, by name."""
        return {name: value for name, value in asdict(self).items() if value != getattr(type(self), name)}


AS_TRAINED = Execution()
