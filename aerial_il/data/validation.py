"""Checks of a recording beyond those that the gate makes of all, each naming file, topic, step and field."""

from __future__ import annotations

from pathlib import Path
from typing import NoReturn

import numpy as np

from aerial_il.core.errors import DemoError
from aerial_il.data.episode import Episode

UNIT_TOLERANCE = 1e-6
TIME_TOLERANCE_S = 1e-6
BOUND_TOLERANCE = 1e-9


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


def check_flight(report: Report, episode: Episode) -> None:
    """Require that actions are within bounds, time advances evenly, and the end comes last."""
    _check_bounds(report, episode)
    _check_time(report, episode)
    _check_end(report, episode)


def _check_bounds(report: Report, episode: Episode) -> None:
    action = episode.spec.action
    slack = BOUND_TOLERANCE * (action.high - action.low)
    outside = (episode.actions < action.low - slack) | (episode.actions > action.high + slack)
    if outside.any():
        step, i = np.argwhere(outside)[0].tolist()
        limits = f"{action.low[i]}..{action.high[i]}"
        report.fail(
            "has an action outside its bounds.", "/step", step=step, field=f"action.{action.labels[i]}",
            expected=limits, got=episode.actions[step, i],
        )  # fmt: skip


def _check_time(report: Report, episode: Episode) -> None:
    dt = episode.spec.control_dt_s
    late = ~(np.abs(np.diff(episode.sim_time) - dt) <= TIME_TOLERANCE_S)
    if late.any() or episode.sim_time[0] < 0:
        step = int(np.argmax(late)) + 1
        got = episode.sim_time[step - 1 : step + 1]
        report.fail(
            "has time stamps that do not advance evenly.",
            "/step",
            step=step,
            field="sim_time",
            expected=f"steps of {dt} s",
            got=got,
        )


def _check_end(report: Report, episode: Episode) -> None:
    if len(episode) == 0:
        report.fail("has no steps.", "/step")
    for name in ("terminated", "truncated"):
        early = np.flatnonzero(getattr(episode, name)[:-1])
        if early.size:
            report.fail(f"goes on after it was {name}.", "/step", step=int(early[0]), field=name)
    if episode.terminated[-1] and episode.success and not episode.spec.is_outside:  # others may end by being solved
        report.fail("claims success although it ended in a crash.", "/step", step=len(episode) - 1, field="terminated")


def _name(field: str, where: tuple[int, ...]) -> str:
    return field + "".join(f"[{i}]" for i in where[1:])
