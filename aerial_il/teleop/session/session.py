"""A recording session as a table: which event leads from which state to which; everything else leaves it alone."""

from collections.abc import Mapping
from enum import StrEnum


class State(StrEnum):
    """Where a session stands."""

    IDLE = "idle"  # free flight, nothing is kept
    COUNTDOWN = "countdown"  # the episode is about to begin; time stands still
    RECORDING = "recording"
    PAUSED = "paused"  # time stands still
    REVIEW = "review"  # it is over: keep it or not?
    SAVED = "saved"
    DISCARDED = "discarded"
    RESETTING = "resetting"


class Event(StrEnum):
    """What happens to a session: a person's commands first, then what the flight says."""

    RECORD = "record"
    SAVE = "save"
    DISCARD = "discard"
    PAUSE = "pause"
    COUNTED = "counted"
    SUCCEEDED = "succeeded"  # held long enough
    ENDED = "ended"  # crashed, or lost its object
    LOST = "lost"  # nobody is at the controls
    STORED = "stored"  # what was decided is under way to the disk
    RESET = "reset"


TABLE: Mapping[tuple[State, Event], State] = {
    (State.IDLE, Event.RECORD): State.COUNTDOWN,
    (State.IDLE, Event.ENDED): State.RESETTING,
    (State.COUNTDOWN, Event.COUNTED): State.RECORDING,
    (State.COUNTDOWN, Event.RECORD): State.IDLE,
    (State.COUNTDOWN, Event.DISCARD): State.IDLE,
    (State.COUNTDOWN, Event.LOST): State.IDLE,
    (State.RECORDING, Event.PAUSE): State.PAUSED,
    (State.RECORDING, Event.LOST): State.PAUSED,
    (State.RECORDING, Event.RECORD): State.REVIEW,
    (State.RECORDING, Event.SAVE): State.REVIEW,
    (State.RECORDING, Event.SUCCEEDED): State.REVIEW,
    (State.RECORDING, Event.ENDED): State.REVIEW,
    (State.RECORDING, Event.DISCARD): State.DISCARDED,
    (State.PAUSED, Event.PAUSE): State.RECORDING,
    (State.PAUSED, Event.RECORD): State.RECORDING,
    (State.PAUSED, Event.SAVE): State.REVIEW,
    (State.PAUSED, Event.DISCARD): State.DISCARDED,
    (State.REVIEW, Event.SAVE): State.SAVED,
    (State.REVIEW, Event.DISCARD): State.DISCARDED,
    (State.SAVED, Event.STORED): State.RESETTING,
    (State.DISCARDED, Event.STORED): State.RESETTING,
    (State.RESETTING, Event.RESET): State.IDLE,
}
FLYING = (State.IDLE, State.RECORDING)  # time passes
HOLDS_EPISODE = (State.RECORDING, State.PAUSED, State.REVIEW)


def after(state: State, event: Event) -> State:
    """Return the state that ``event`` leads to from ``state``: itself where the table says nothing."""
    return TABLE.get((state, event), state)


def answers(state: State) -> tuple[Event, ...]:
    """Return the events that mean something in ``state``."""
    return tuple(event for event in Event if (state, event) in TABLE)
