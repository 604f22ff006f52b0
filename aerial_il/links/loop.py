"""One robot over a link, tick by tick: send what is commanded unless the guard objects, wait for the tick, read.

Ticks have absolute deadlines; late ones are counted, and none is left out. Needs nothing but NumPy.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import EnvSpec
from aerial_il.links.guard import Guard
from aerial_il.links.link import Link, LinkError, Mode, Order, Reading
from aerial_il.links.watch import Watch
from aerial_il.teleop.session.clock import LATE_S, Metronome, Pace

PATIENCE_S = 10.0  # for a robot that was told to begin
LOST_S = 5.0  # without news of a robot for longer, its flight is given up
POLL_S = 0.002


@dataclass
class Timing:
    """How the ticks of a flight kept time, one number for each.

    Attributes:
        late_s: how long after its deadline a tick began. work_s: from there to its set point being sent.
        age_s: how long ago the newest reading came, s of the robot's time.
    """

    late_s: list[float] = field(default_factory=list)
    work_s: list[float] = field(default_factory=list)
    age_s: list[float] = field(default_factory=list)

    def __add__(self, other: Timing) -> Timing:
        return Timing(self.late_s + other.late_s, self.work_s + other.work_s, self.age_s + other.age_s)

    def summary(self) -> dict[str, float]:
        """Return what there is to say of them: counts, and milliseconds."""
        late, work = (1000.0 * np.array(each or [0.0]) for each in (self.late_s, self.work_s))
        return {
            "ticks": len(self.work_s),
            "late": int((late > 1000.0 * LATE_S).sum()),
            "work_ms_p50": round(float(np.percentile(work, 50)), 3),
            "work_ms_p99": round(float(np.percentile(work, 99)), 3),
            "late_ms_p99": round(float(np.percentile(late, 99)), 3),
            "oldest_reading_ms": round(1000.0 * max(self.age_s, default=0.0), 1),
        }


class RobotLoop:
    """Flies one robot.

    Args:
        link: to the robot. guard: what must hold for set points to be sent.

    Attributes:
        obs: what the robot showed last, name -> (*shape,). reading: that reading.
        steps, held: ticks of the flight, and those that the guard or the robot itself held in. timing: of its ticks.
        sent: (Da,) the last set point of the flight; None before the first.
        timings: of all flights. troubles: seed -> ticks in which the guard objected, and to what it did so first.
    """

    def __init__(self, link: Link, guard: Guard | None = None) -> None:
        self.link, self.spec = link, link.spec
        self.watch = Watch(guard or Guard(), self.spec)
        self.obs: dict[str, np.ndarray] = {}
        self.reading: Reading | None = None
        self.steps = self.held = self.seed = 0
        self.sent: np.ndarray | None = None
        self.timing, self._woke = Timing(), time.perf_counter()
        self.timings: list[Timing] = []
        self.troubles: dict[int, tuple[int, str]] = {}
        self._metronome: Metronome | None = None
        self._speed: float = getattr(link, "speed", 1.0)

    @property
    def trouble(self) -> str:
        """Why the policy is not to fly now; empty if it may."""
        return self.watch.trouble

    @property
    def told(self) -> Mapping[str, Any]:
        """What a simulator told besides with the last reading."""
        return {} if self.reading is None else self.reading.told

    @property
    def _now_s(self) -> float:
        """The loop's time, which passes as fast as the robot's, s."""
        lockstep = self._metronome is None
        return self.steps * self.spec.control_dt_s if lockstep else self._speed * time.perf_counter()

    @property
    def pace(self) -> Pace | None:
        """How the loop keeps time; None in lockstep."""
        return None if self._metronome is None else self._metronome.pace

    def begin(self, seed: int) -> None:
        """Let the robot stand at the start of an episode, arm it, and release it there.

        Raises:
            LinkError: it does not begin. RefusedError: it refuses, and says why.
            InvalidValueError: it begins beyond the fence.
        """
        self.seed = seed
        self.link.order(Order.RESET, seed=seed)
        self.link.order(Order.ARM)
        self.link.order(Order.TAKE_OFF, height_m=0.0)
        self.troubles.pop(seed, None)
        self.join(seed)

    def join(self, seed: int | None = None) -> None:
        """Begin to fly a robot that is in the air, in the episode of ``seed`` if there is one.

        Raises:
            LinkError: it is not. InvalidValueError: it is beyond the fence.
        """
        self._take(self._awaited(Mode.FLYING, Mode.HOLDING, seed=seed))
        self.steps, self.held, self.sent, self.timing = 0, 0, None, Timing()
        self.timings.append(self.timing)
        self._metronome = None if self.link.lockstep else Metronome(self.spec.control_dt_s / self._speed)
        self.watch.begin()
        self.watch.see(self.reading, self._now_s)
        if self.watch.over:
            raise InvalidValueError(f"The flight would end where it begins: {self.trouble}. Set guard.fence wider.")
        self._woke = time.perf_counter()

    def tick(self, action: np.ndarray) -> None:
        """Send a set point (Da,) at the level of the specification unless the guard objects; wait; read.

        Raises:
            LinkError: the robot has shown nothing for long.
        """
        held = self.held
        if trouble := self.trouble:
            self.held += 1
            self._note(trouble)
        else:
            self.sent = self.spec.action.clip(action)
            self.link.send(self.spec.action.level, self.sent)
        worked = time.perf_counter() - self._woke
        late = 0.0
        if self._metronome is None:
            self.link.step()
        else:
            late = self._metronome.wait()
        self._woke = time.perf_counter()
        self.steps += 1
        reading, was_over = self.link.read(), self.watch.over
        self.watch.see(reading, self._now_s)
        if trouble := self.trouble:
            self._note(trouble)
        elif self.watch.hovers and self.held == held:
            self.held += 1
            self._note("it was not heard, or was told to")
        if self.watch.age_s > LOST_S:
            raise LinkError(f"The robot is lost: {self.trouble}. This flight is not kept.")
        ends = self.watch.over and not was_over  # by a sound reading, the last of the flight
        if reading is not None and (not self.trouble or ends or reading.mode is Mode.CRASHED):
            self._take(reading)
        self.timing.late_s.append(late)
        self.timing.work_s.append(worked)
        self.timing.age_s.append(self.watch.age_s)

    def _note(self, trouble: str) -> None:
        """Count the ticks in which the guard objected, and keep to what it did so first."""
        self.troubles[self.seed] = self.held, self.troubles.get(self.seed, (0, trouble))[1]

    def look(self) -> dict[str, np.ndarray]:
        """Wait for what the robot shows before a flight, and return it: name -> (1, ...).

        Raises:
            LinkError: it shows nothing.
        """
        return {name: value[None] for name, value in self._awaited(*Mode).obs.items()}

    def hold(self) -> np.ndarray:
        """Return the action (Da,) that keeps the robot where it shows itself, the gripper as it was commanded last."""
        action = hold_action(self.spec, self.obs)
        if self.sent is not None and self.spec.action.labels[-1] == "gripper":
            action[-1] = self.sent[-1]
        return action

    def _awaited(self, *modes: Mode, seed: int | None = None) -> Reading:
        """Wait for a reading in one of these modes, and not of another episode than that of ``seed``, if it tells."""
        until = time.perf_counter() + PATIENCE_S
        while (
            (reading := self.link.read()) is None
            or reading.mode not in modes
            or (seed is not None and reading.told.get("seed", seed) != seed)
        ):
            if self.link.lockstep or time.perf_counter() > until:
                mode = "shows nothing" if reading is None else f"is {reading.mode}"
                hint = " Take it off first." if reading is not None and reading.mode is Mode.STANDING else ""
                raise LinkError(f"The robot {mode}, {PATIENCE_S:g} s after it was asked.{hint}")
            time.sleep(POLL_S)
        return reading

    def _take(self, reading: Reading) -> None:
        self.reading, self.obs = reading, dict(reading.obs)


def hold_action(spec: EnvSpec, obs: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the action (Da,) that keeps a robot where it shows itself, name -> (*shape,), with the gripper open."""
    grip = [1.0] * (spec.action.labels[-1] == "gripper")
    if spec.action.level == "ee_pose":
        return spec.action.clip(np.array([*obs["ee_pos"], *obs["ee_rot6d"], *grip]))
    if spec.action.level == "velocity":
        return np.array([*np.zeros(spec.action.size - len(grip)), *grip])
    base = obs.get("base_rot6d")
    place = [] if base is None else [*obs["base_pos"], np.arctan2(base[1], base[0])]
    return spec.action.clip(np.array([*place, *obs.get("joint_pos", ()), *grip]))
