"""The session's table: every way through it ends and nothing is kept without a word; the reel is bounded."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerial_il.teleop.session.reel import Reel
from aerial_il.teleop.session.session import HOLDS_EPISODE, TABLE, Event, State, after, answers

EVENTS = st.lists(st.sampled_from(Event), max_size=60)


def walk(events: list[Event], state: State = State.IDLE) -> list[State]:
    """Return the states passed through, the first included."""
    states = [state]
    for event in events:
        states.append(after(states[-1], event))
    return states


@given(EVENTS)
def test_what_is_saved_was_reviewed_first(events: list[Event]) -> None:
    states = walk(events)
    assert all(a is State.REVIEW for a, b in pairwise(states) if b is State.SAVED and a is not b)


@given(EVENTS)
def test_an_episode_ends_only_by_a_decision_of_a_person(events: list[Event]) -> None:
    states = walk(events)
    for event, a, b in zip(events, states, states[1:], strict=False):
        if a in HOLDS_EPISODE and b not in HOLDS_EPISODE:
            assert event in (Event.SAVE, Event.DISCARD)


@given(EVENTS)
def test_nothing_is_recorded_without_a_countdown(events: list[Event]) -> None:
    states = walk(events)
    for a, b in pairwise(states):
        assert not (b is State.RECORDING and a not in (State.COUNTDOWN, State.PAUSED, State.RECORDING))


@given(EVENTS)
def test_nobody_at_the_controls_never_goes_on_recording(events: list[Event]) -> None:
    assert after(walk(events)[-1], Event.LOST) is not State.RECORDING


def test_every_state_is_reached_and_left() -> None:
    def reached(start: State) -> set[State]:
        result, waiting = {start}, [start]
        while waiting:
            state = waiting.pop()
            for event in answers(state):
                if (following := after(state, event)) not in result:
                    result.add(following)
                    waiting.append(following)
        return result

    assert reached(State.IDLE) == set(State)
    assert all(State.IDLE in reached(state) for state in State)


def test_the_table_holds_no_line_that_changes_nothing() -> None:
    assert all(state is not following for (state, _), following in TABLE.items())


def test_the_way_of_a_demonstration() -> None:
    way = [
        Event.RECORD,
        Event.COUNTED,
        Event.PAUSE,
        Event.PAUSE,
        Event.SUCCEEDED,
        Event.SAVE,
        Event.STORED,
        Event.RESET,
    ]
    assert [state.value for state in walk(way)] == [
        "idle", "countdown", "recording", "paused", "recording", "review", "saved", "resetting", "idle",
    ]  # fmt: skip


@pytest.mark.parametrize("length", [1, 5, 10, 11, 23, 400])
def test_memory_is_bounded_and_the_states_are_evenly_spaced(length: int) -> None:
    reel = Reel(most=10)
    for k in range(length):
        reel.keep(np.array([float(k)]))
        assert len(reel) <= 10
    result = [float(state[0]) for share in np.linspace(0, 1, 21) if (state := reel.at(share)) is not None]
    assert result[0] == 0.0
    assert result == sorted(result)
    assert result[-1] > 0.8 * (length - 1) - 1
    if length <= 10:
        assert result[-1] == length - 1


def test_an_empty_one_has_nothing_to_show() -> None:
    assert Reel().at(0.5) is None
