"""What a person is shown of a session."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Status:
    """What a person is shown of a session after a tick."""

    state: str
    tick: int
    seed: int
    mode: str
    modes: tuple[str, ...]
    precise: bool
    dead: bool
    opening: float
    success: bool
    label: bool
    subtasks: Mapping[str, bool]
    lost: tuple[str, ...]  # sub-tasks whose loss nothing makes good in this flight
    held: float  # share of the time that success must hold for, until it is believed
    sim_time: float
    countdown: int
    steps: int
    speed: float
    input_seq: int
    message: str
    counts: Mapping[str, int]
    waiting: int
    time_scale: float
    flier: str  # policy, person, or nobody
    shared: bool  # there is a policy to take over from
    practice: bool  # nothing is kept
    marks: Mapping[str, float]  # sub-task -> share of the episode after which it was first solved
    person_steps: int  # of this episode's, those in which the person had taken over
    numbers: tuple[float, ...]
