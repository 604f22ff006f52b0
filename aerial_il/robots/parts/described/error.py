"""The error for a model file that cannot be used; its message says what to change."""

from __future__ import annotations

from pathlib import Path

from aerial_il.core.errors import AerialError


class ModelFileError(AerialError, ValueError):
    """A URDF or MJCF file from which no part of a robot can be built.

    Args:
        source: the file. problem: what is wrong, where, and what to do.
    """

    def __init__(self, source: Path | str, problem: str) -> None:
        self.source = str(source)
        super().__init__(f"{source}: {problem}")
