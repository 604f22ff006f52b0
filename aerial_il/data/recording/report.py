"""Checks of a recording beyond those that the gate makes of all, each naming file, topic, step and field."""

from pathlib import Path
from typing import NoReturn

import numpy as np

from aerial_il.core.errors import DemoError

UNIT_TOLERANCE = 1e-6


class Report:
    """Turns the first violated condition on a file's arrays into a :class:`DemoError`.

    Args:
        path: the file. every: steps from one row of the arrays to the next.
    """

    def __init__(self, path: Path | str, every: int = 1) -> None:
        self.path, self._every = path, every

    def fail(
        self,
        problem: str,
        topic: str,
        *,
        step: int | None = None,
        field: str | None = None,
        expected: object = None,
        got: object = None,
    ) -> NoReturn:
        raise DemoError(self.path, problem, topic=topic, step=step, field=field, expected=expected, got=got)

    def check_equal(self, topic: str, field: str, got: np.ndarray, expected: np.ndarray) -> None:
        """Require equality of two arrays over steps, bit for bit but for the kinds of NaN."""
        same = (got == expected) | ((got != got) & (expected != expected))
        if not same.all():
            where = tuple(np.argwhere(~same)[0].tolist())
            self.fail(
                "contradicts the rest of the file.", topic, step=where[0] * self._every, field=_name(field, where),
                expected=expected[where], got=got[where],
            )  # fmt: skip

    def check_unit(self, topic: str, field: str, quats: np.ndarray) -> None:
        norms = np.linalg.norm(quats, axis=-1)
        wrong = ~(np.abs(norms - 1) <= UNIT_TOLERANCE)
        if wrong.any():
            step = int(np.argmax(wrong))
            self.fail(
                "has a quaternion that is not a unit quaternion.",
                topic,
                step=step * self._every,
                field=field,
                expected=1,
                got=norms[step],
            )


def _name(field: str, where: tuple[int, ...]) -> str:
    return field + "".join(f"[{i}]" for i in where[1:])
