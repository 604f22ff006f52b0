"""Where one episode ends and the next begins: rows put in order, and cut where the data say that they do not go on."""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from aerial_il.data.source import Later, Raw, Rows

SAME = 1e-4  # of what a field varies by: what was seen next may be rounded otherwise than what is seen then
GAP = 1.5  # control periods between two rows that are one step apart
SERIES = ("actions", "rewards", "terminated", "truncated", "done", "frames", "times")  # T rows


def ordered(raw: Raw) -> tuple[Raw, int | None]:
    """Return a demonstration with its rows by their numbers, and which row is the first out of place, if one is."""
    if raw.frames is None or (np.diff(raw.frames) > 0).all():
        return raw, None
    order = np.argsort(raw.frames, kind="stable")
    return rows_of(raw, order), int(np.argmax(order != np.arange(len(order))))


def cuts(raw: Raw, period_s: float | None, *, borders: bool) -> dict[int, str]:
    """Return the steps with which another episode begins, and why.

    Args:
        raw: whose rows are as many as its actions. period_s: between two rows, if known.
        borders: whether it is one episode as far as its format knows; ends within it are then none.
    """
    found = dict.fromkeys(_after(_broken(raw)), "what was seen next is not what is seen then")
    if raw.frames is not None:
        found |= dict.fromkeys(_after(np.diff(raw.frames) > 1), "frames are missing")
    if raw.times is not None and period_s and not off_rate(raw.times, period_s):
        passed = np.diff(raw.times)
        found |= dict.fromkeys(_after((passed > GAP * period_s) | (passed < -period_s)), "time leaps")
    if not borders:
        found |= dict.fromkeys(_after(ends_of(raw)[:-1]), "an episode ended")
    return found


def oddities(raw: Raw, *, borders: bool) -> Iterator[str]:
    """Yield in words where a demonstration contradicts itself, although it can be used."""
    ends = ends_of(raw)
    if borders and raw.done is not None:
        done = np.asarray(raw.done).reshape(-1) != 0
        if (again := np.flatnonzero(done[:-1] & ~done[1:])).size:
            yield f"is done at step {again[0]}, and not at the next."
    if not borders and raw.next_obs and (on := np.flatnonzero(ends[:-1] & ~_broken(raw))).size:
        yield f"goes on after {on.size} of its ends, first at step {on[0]}: what was seen next is what is seen then."


def ends_of(raw: Raw) -> np.ndarray:
    """(T,) bool: the steps that a file says to end an episode, for whatever reason."""
    ends = np.zeros(len(raw.actions), bool)
    for flags in (raw.terminated, raw.truncated, raw.done):
        ends |= False if flags is None else np.asarray(flags).reshape(len(ends)).astype(bool)
    return ends


def off_rate(times: Rows, period_s: float) -> float | None:
    """Return the period (s) that most time stamps keep instead of ``period_s``, or None where there is none."""
    passed = np.diff(np.asarray(times, float).reshape(-1)) if len(times) > 1 else np.full(1, period_s)
    middle = float(np.median(passed))
    kept = 2 * np.count_nonzero(np.abs(passed - middle) <= 0.1 * middle) > len(passed)
    return middle if kept and middle > 0 and abs(middle - period_s) > 0.1 * period_s else None


def piece(raw: Raw, first: int, last: int) -> Raw:
    """Return steps ``first`` to before ``last``, and of its observations the one after them where it is known."""
    steps, part = len(raw.actions), rows_of(raw, slice(first, last))
    obs = _taken(raw.obs, slice(first, None)) if last == steps else part.obs
    return replace(part, obs=obs, steps=raw.steps if last - first == steps else None)


def rows_of(raw: Raw, rows: slice | np.ndarray) -> Raw:
    """Return some of the steps; a terminal observation beside T others goes with none of them."""
    held = {name: getattr(raw, name) for name in (*SERIES, "states")}
    changed = {name: values[rows] for name, values in held.items() if values is not None}
    seen = {name: _taken(getattr(raw, name), rows) for name in ("obs", "next_obs")}
    return replace(raw, **changed, **seen)


def _taken(values: Mapping[str, Rows], rows: slice | np.ndarray) -> dict[str, Rows]:
    return {name: each[rows] for name, each in values.items()}


def _after(ends: np.ndarray) -> Iterator[int]:
    """Yield the step after each one that is marked."""
    return (int(step) + 1 for step in np.flatnonzero(ends))


def _broken(raw: Raw) -> np.ndarray:
    """(T - 1,) bool: what was seen after a step is not what the following one begins with; pictures are not read."""
    broken = np.zeros(max(len(raw.actions) - 1, 0), bool)
    for name, after in raw.next_obs.items():
        if name not in raw.obs or isinstance(after, Later) or isinstance(seen := raw.obs[name], Later):
            continue
        pair = seen[1 : len(after)], after[:-1]
        if min(values.size for values in pair):
            now, then = (values.reshape(len(values), -1).astype(float) for values in pair)
            broken |= (np.abs(now - then) > SAME * np.ptp(now, axis=0)).any(1)
    return broken
