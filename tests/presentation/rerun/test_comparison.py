"""Two flights on one timeline: their milestones fall together, and time never runs backwards."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from aerial_il.data.episode import Episode
from aerial_il.presentation.rerun.comparison import align, common, phase_starts
from aerial_il.presentation.rerun.flight import Flight
from tests.presentation.rerun.conftest import Shown


def test_phases_fall_together(episodes: list[Episode]) -> None:
    first, second = (Flight.of(episode) for episode in episodes)
    found = align(first, second)
    assert found.by == "phases"
    assert len(found.milestones) >= 5
    ours, theirs = phase_starts(first), phase_starts(second)
    assert any(abs(ours[name] - theirs[name]) > 0.05 for name in found.milestones)  # they need aligning
    assert found.first.aligned == pytest.approx(episodes[0].sim_time)
    for name in found.milestones:
        step = int(np.searchsorted(episodes[1].sim_time, theirs[name]))
        assert found.second.aligned is not None
        assert found.second.aligned[step] == pytest.approx(ours[name])
    assert (np.diff(found.second.aligned) > 0).all()
    assert found.second.aligned[-1] == pytest.approx(episodes[0].sim_time[-1])


def test_without_phases_sub_tasks_or_the_ends_align(episodes: list[Episode]) -> None:
    def blind(episode: Episode, at: int | None) -> Flight:
        flags = None if at is None else np.repeat(np.arange(len(episode))[:, None] >= at, 5, axis=1).astype(float)
        return Flight.of(replace(episode, phase=np.full(len(episode), -1)), flags)

    found = align(blind(episodes[0], 40), blind(episodes[1], 90))
    assert found.by == "sub-tasks"
    assert np.interp(episodes[1].sim_time[91], found.second.sim_time, found.second.aligned) == pytest.approx(
        episodes[0].sim_time[41]
    )
    assert align(blind(episodes[0], None), Flight.of(episodes[1])).by == "start and end"


def test_what_was_done_in_another_order_is_left_out() -> None:
    assert common({"a": 0.0, "b": 1.0, "c": 2.0, "d": 3.0}, {"a": 0.0, "c": 1.0, "b": 2.0, "d": 3.0}) == ["a", "b", "d"]
    assert common({"a": 1.0}, {"b": 1.0}) == []


def test_both_flights_are_in_one_recording(episodes: list[Episode], write: Callable[..., Shown]) -> None:
    flights = [Flight.of(episode) for episode in episodes]
    found = align(*flights)
    shown = write({"one/": flights[0], "two/": flights[1]}, clocks={"one/": found.first, "two/": found.second})
    for root, flight in zip(("one", "two"), flights, strict=True):
        assert flight.motion is not None
        told = shown.numbers(f"/{root}/scene/robot/base", "Transform3D:translation").reshape(-1, 3)
        base = flight.motion.model.body("base").id
        assert told == pytest.approx(flight.motion.body_pos[:, base], abs=1e-5)
        assert len(shown.column(f"/{root}/scene/robot/base", "aligned")) == len(flight.episode) + 1
