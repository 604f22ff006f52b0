"""Estimation: errors of what a policy is shown, in the place of the truth.

Settings, strengths and memory; how a scene is seen with them, object by object, is the work of ``episode.perception``
and ``episode.estimation``, since it needs what the task names in the scene.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from aerial_il.core.errors import InvalidValueError
from aerial_il.suite.disturbances.disturbance import Disturbance, Start, Strength
from aerial_il.suite.physics import episode_state as layout

ERRORS = (
    "frame_bias", "position_bias", "position_noise", "angle_bias", "angle_noise", "force_bias", "force_noise",
)  # fmt: skip
NUM_ERRORS = layout.ERRORS.stop - layout.ERRORS.start


@dataclass(frozen=True)
class Estimation(Disturbance):
    """Errors of what a policy is shown, in the place of the truth.

    The robot's own pose is shown as the flight controller estimates it, with the errors of ``noise``. Objects are
    seen: each has a pose error of its own, which moves all of it as one, and is seen late. Biases stay the same for an
    episode, noise is Gauss–Markov; all are standard deviations along or about each axis. ``docs/disturbances.md``
    has the sources.

    Attributes:
        frame_bias: m, between the frame of the robot's estimate and that in which objects are seen; common to all.
        position_bias, position_noise: m. angle_bias, angle_noise: rad.
        time: correlation time of the noise, s.
        lag: control steps of 20 ms by which objects are seen late.
        force_bias, force_noise: N, of force sensors; this noise is independent from one control step to the next.

    Raises:
        InvalidValueError: a negative number, or more lag than the episode's memory holds.
    """

    frame_bias: float = 0.002
    position_bias: float = 0.002
    position_noise: float = 0.001
    angle_bias: float = 0.01
    angle_noise: float = 0.005
    time: float = 0.1
    lag: int = 3
    force_bias: float = 0.1
    force_noise: float = 0.1
    strength: ClassVar[Strength | None] = Strength("times the errors in `gusts`, as late as there", 0.0, 5.0)
    memory: ClassVar[int] = NUM_ERRORS + layout.MAX_LAG * layout.PAST_SIZE

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if value < 0 or (name == "time" and value == 0):
                raise InvalidValueError(f"Estimation's {name} is {value}; it must not be negative, nor time zero.")
        if self.lag > layout.MAX_LAG:
            raise InvalidValueError(
                f"Estimation's lag is {self.lag} control steps; at most {layout.MAX_LAG} are remembered."
            )

    @classmethod
    def of(cls, strength: float) -> Estimation:
        return replace(cls(), **{name: strength * getattr(cls, name) for name in ERRORS})

    def start(self, at: Start) -> np.ndarray:
        return np.concatenate([at.rng.standard_normal(NUM_ERRORS), np.zeros(self.memory - NUM_ERRORS)])


TIERS = {
    "gusts": Estimation(),
    "hard": Estimation(  # half as much again
        frame_bias=0.003,
        position_bias=0.003,
        position_noise=0.0015,
        angle_bias=0.015,
        angle_noise=0.0075,
        lag=4,
        force_bias=0.15,
        force_noise=0.15,
    ),
}
