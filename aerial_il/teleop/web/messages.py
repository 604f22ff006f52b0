"""Messages from a page to the server: small JSON objects, checked before they are used."""

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from aerial_il.teleop.devices.phone import Pose, pose_of
from aerial_il.teleop.input.frame import STICK_AXES

MAX_BYTES = 4096
MAX_NAMES, MAX_NAME = 64, 32
MAX_RATE, BURST = 150.0, 300.0  # messages per second of one page, and at once: of 3 s, after the server was held up
KINDS = ("input", "blur", "ack", "ping", "ask", "grant", "scrub", "practice", "view", "bind")


class MessageError(Exception):
    """A message that no page of ours sends."""


@dataclass(frozen=True)
class Message:
    """A checked message.

    Attributes:
        kind: one of ``KINDS``. seq: its number, of an input; that of the picture, of an ack. t: ms, of the page's
            clock. held, pressed: names of controls. axes: stick positions by name. pose: where a phone is.
        share: of the episode, in [0, 1], to look back at. on: whether practice begins or ends.
        mapping: device -> command -> controls, as the person wants them; empty for those that are shipped.
    """

    kind: str
    seq: int = 0
    t: float = 0.0
    held: tuple[str, ...] = ()
    pressed: tuple[str, ...] = ()
    axes: dict[str, float] = field(default_factory=dict)
    pose: Pose | None = None
    share: float = 0.0
    on: bool = False
    mapping: Mapping[str, Mapping[str, tuple[str, ...]]] = field(default_factory=dict)


def read_message(text: str) -> Message:
    """Check one message.

    Raises:
        MessageError: it is too long, no JSON, or holds something that it should not.
    """
    if len(text) > MAX_BYTES:
        raise MessageError("oversized")
    try:
        raw = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise MessageError("malformed") from error
    if not isinstance(raw, dict) or raw.get("type") not in KINDS:
        raise MessageError("malformed")
    seq, axes = raw.get("seq", 0), raw.get("axes", {})
    if not isinstance(seq, int) or isinstance(seq, bool) or not 0 <= seq < 2**32 or not isinstance(axes, dict):
        raise MessageError("malformed")
    if not set(axes) <= set(STICK_AXES):
        raise MessageError("malformed")
    checked = {name: _number(value, 1.0) for name, value in axes.items()}
    held, pressed = _names(raw.get("held", [])), _names(raw.get("pressed", []))
    share = _number(raw.get("share", 0.0), 1.0)
    if share < 0.0 or not isinstance(raw.get("on", False), bool):
        raise MessageError("malformed")
    return Message(
        raw["type"],
        seq,
        _number(raw.get("t", 0.0), 1e15),
        held,
        pressed,
        checked,
        _pose(raw.get("pose")),
        share,
        raw.get("on", False),
        _mapping(raw.get("mapping", {})),
    )


def _mapping(raw: Any) -> dict[str, dict[str, tuple[str, ...]]]:
    """Check the shape of a mapping; what its words mean is for who reads mappings."""
    if not isinstance(raw, dict) or not all(isinstance(each, dict) and len(each) <= MAX_NAMES for each in raw.values()):
        raise MessageError("malformed")
    return {device: {command: _names(controls) for command, controls in each.items()} for device, each in raw.items()}


def _pose(raw: Any) -> Pose | None:
    try:
        return None if raw is None else pose_of(raw)
    except (TypeError, ValueError, OverflowError) as error:
        raise MessageError("malformed") from error


def _number(value: Any, most: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= most:  # so is nan refused
        raise MessageError("malformed")
    return float(value)


def _names(value: Any) -> tuple[str, ...]:
    if not isinstance(value, list) or len(value) > MAX_NAMES:
        raise MessageError("malformed")
    if not all(isinstance(name, str) and len(name) <= MAX_NAME for name in value):
        raise MessageError("malformed")
    return tuple(value)


class Bucket:
    """Lets ``MAX_RATE`` messages a second through, and ``BURST`` at once.

    Args:
        now: a clock in s, for tests.
    """

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now, self._last, self._left = now, now(), BURST

    def admits(self) -> bool:
        """Return whether one more message is welcome."""
        now = self._now()
        self._left = min(BURST, self._left + MAX_RATE * (now - self._last))
        self._last = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True
