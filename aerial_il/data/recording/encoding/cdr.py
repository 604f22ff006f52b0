"""Fixed-size ROS 2 messages as templates: thousands of them become bytes in one NumPy assignment.

Every message of a demonstration has the same size from the first step to the last, so its CDR bytes differ only in a
few slots. A template holds the constant bytes and says where the slots lie; writing k messages is then k copies of the
template and one array assignment per slot, and reading them back is the same with the arrows reversed.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

ENCAPSULATION = b"\x00\x01\x00\x00"  # CDR, little-endian, no options


class CdrTemplate:
    """The bytes of one message type, built field by field in the order of its definition."""

    def __init__(self) -> None:
        self._bytes = bytearray(ENCAPSULATION)
        self._slots: dict[str, tuple[np.dtype, int]] = {}

    def constant(self, dtype: str, value: float) -> CdrTemplate:
        """Append a number that is the same in every message."""
        self._align(np.dtype(dtype).itemsize)
        self._bytes += np.asarray(value, dtype).tobytes()
        return self

    def string(self, text: str) -> CdrTemplate:
        """Append a string that is the same in every message."""
        raw = text.encode() + b"\0"
        self.constant("<u4", len(raw))
        self._bytes += raw
        return self

    def strings(self, texts: tuple[str, ...]) -> CdrTemplate:
        """Append a sequence of constant strings."""
        self.constant("<u4", len(texts))
        for text in texts:
            self.string(text)
        return self

    def slot(self, name: str, dtype: str, count: int | None = None) -> CdrTemplate:
        """Append a value that varies: a scalar, or ``count`` elements of a fixed-size array."""
        element = np.dtype(dtype)
        self._align(element.itemsize)
        self._slots[name] = (element if count is None else np.dtype((element, (count,))), len(self._bytes))
        self._bytes += bytes(element.itemsize * (1 if count is None else count))
        return self

    def sequence(self, name: str, dtype: str, count: int) -> CdrTemplate:
        """Append a sequence whose length is constant and whose elements vary."""
        self.constant("<u4", count)
        return self.slot(name, dtype, count) if count else self

    def header(self, frame: str, suffix: str = "") -> CdrTemplate:
        """Append a ``std_msgs/Header``; its stamp becomes the slots ``sec`` and ``nanosec``."""
        return self.slot(f"sec{suffix}", "<i4").slot(f"nanosec{suffix}", "<u4").string(frame)

    @property
    def content(self) -> bytes:
        return bytes(self._bytes)

    @cached_property
    def dtype(self) -> np.dtype:
        """Structured dtype of one message; its fields are the slots."""
        formats, offsets = zip(*self._slots.values(), strict=True)
        return np.dtype(
            {"names": list(self._slots), "formats": formats, "offsets": offsets, "itemsize": len(self._bytes)}
        )

    @cached_property
    def constant_mask(self) -> np.ndarray:
        """(size,) bool: True for the bytes that lie in no slot."""
        mask = np.ones(len(self._bytes), bool)
        for dtype, offset in self._slots.values():
            mask[offset : offset + dtype.itemsize] = False
        return mask

    def _align(self, size: int) -> None:
        self._bytes += bytes(-(len(self._bytes) - len(ENCAPSULATION)) % size)
