"""A robot over a link as an environment of one world: a step sends a set point, waits for the tick, and reads.

So whatever flies environments flies robots: recording, taking over, evaluating. In lockstep with a simulated robot it
is the suite's own environment, number for number. Otherwise ticks have absolute deadlines, late ones are counted, and
no set point is sent while the guard objects: the robot then hovers by itself.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np

from aerial_il.control.actions import ActionLevel, hover_action
from aerial_il.core.contracts import BatchEnvBase, StepResult
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import camera_name
from aerial_il.links.guard import Guard
from aerial_il.links.link import Link, LinkError, Mode, Order, Reading
from aerial_il.links.robot import SimulatedRobot
from aerial_il.links.watch import Watch
from aerial_il.suite.engine import ENGINE
from aerial_il.suite.scenario import Scenario
from aerial_il.teleop.session.clock import LATE_S, Metronome, Pace

PATIENCE_S = 10.0  # for a robot that was told to begin
UNTOLD = {"sparse_reward": 0.0, "ee_error_m": np.nan, "effort": np.nan, "contacts": 0, "force_in_band_raw": np.nan}


@dataclass
class Timing:
    """How the ticks of a flight kept time, one number for each.

    Attributes:
        late_s: how long after its deadline a tick began. work_s: from there to its set point being sent.
        age: ticks since the newest reading came.
    """

    late_s: list[float] = field(default_factory=list)
    work_s: list[float] = field(default_factory=list)
    age: list[int] = field(default_factory=list)

    def __add__(self, other: Timing) -> Timing:
        return Timing(self.late_s + other.late_s, self.work_s + other.work_s, self.age + other.age)

    def summary(self) -> dict[str, float]:
        """Return what there is to say of them: counts, and milliseconds."""
        late, work = (1000.0 * np.array(each or [0.0]) for each in (self.late_s, self.work_s))
        return {
            "ticks": len(self.work_s),
            "late": int((late > 1000.0 * LATE_S).sum()),
            "work_ms_p50": round(float(np.percentile(work, 50)), 3),
            "work_ms_p99": round(float(np.percentile(work, 99)), 3),
            "late_ms_p99": round(float(np.percentile(late, 99)), 3),
            "oldest_reading_ticks": max(self.age, default=0),
        }


class LinkedEnvironment(BatchEnvBase):
    """One robot over a link.

    Args:
        link: to the robot; the environment closes it. guard: what must hold for set points to be sent.

    Attributes:
        timing: of the running episode. held: its ticks in which the guard objected. timings: of all episodes.
    """

    num_envs = 1
    engine: str | None = ENGINE

    def __init__(self, link: Link, guard: Guard | None = None) -> None:
        self.link, self.spec = link, link.spec
        self._here: SimulatedRobot | None = getattr(link, "robot", None)
        self.watch = Watch(guard or Guard(), self.spec)
        spec = self.spec
        cameras = [camera_name(each.name) for each in spec.observation.of_group("image")]
        cell = spec.robot, spec.task, spec.tier, spec.action.level
        self.scenario = Scenario(*cell, cameras, controller=spec.controller)
        self.model, self.model_xml = self.scenario.compile(), self.scenario.xml
        self._data = mujoco.MjData(self.model)
        self._seed, self._steps, self.held = 0, 0, 0
        self._reading: Reading | None = None
        self._obs: dict[str, np.ndarray] = {}
        self.timing, self._woke = Timing(), time.perf_counter()
        self.timings: list[Timing] = []
        self._metronome: Metronome | None = None

    @property
    def trouble(self) -> str:
        """Why the policy is not to fly now; empty if it may."""
        return self.watch.trouble

    @property
    def told(self) -> Mapping[str, Any]:
        """What a simulator told besides with the last reading."""
        return {} if self._reading is None else self._reading.told

    @property
    def pace(self) -> Pace | None:
        """How the loop keeps time; None in lockstep."""
        return None if self._metronome is None else self._metronome.pace

    @property
    def simulation(self) -> Any:
        """The simulator, for experts; only of a robot that is simulated in this process.

        Raises:
            InvalidValueError: the robot is elsewhere.
        """
        if self._here is None or not self.link.lockstep:
            raise InvalidValueError("An expert looks into the simulator: that works with link=simulated in lockstep.")
        return self._here.env.simulation

    @property
    def seeds(self) -> np.ndarray:
        return np.array([self._seed])

    @property
    def sim_time(self) -> np.ndarray:
        return np.array([self._steps * self.spec.control_dt_s])

    @property
    def ctrl(self) -> np.ndarray:
        """(1, R + nu) actuator commands, zeros where the robot does not tell them."""
        size = self.scenario.robot.num_rotors + self.model.nu
        return np.atleast_2d(self._told("ctrl", np.zeros(size)))

    def drawn(self, seed: int) -> dict[str, Any]:
        """Return the disturbances of an episode; a robot that is elsewhere does not tell them."""
        return {} if self._here is None else self._here.env.drawn(seed)

    def get_state(self) -> np.ndarray:
        """(1, S) the simulator's state, or one made of what the robot shows: objects stay where a model has them."""
        told = self._told("state", None)
        return np.atleast_2d(self._mirrored() if told is None else told)

    def set_state(self, states: np.ndarray, mask: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """Refuse: robots cannot be put somewhere.

        Raises:
            InvalidValueError: always.
        """
        raise InvalidValueError("A robot over a link cannot continue from a state.")

    def reset(self, seeds: np.ndarray | int, mask: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """Let the robot stand at the start of an episode, arm it, and release it there."""
        if mask is not None and not mask[0]:
            return self.observe()
        self._seed = int(np.atleast_1d(seeds)[0])
        self.link.order(Order.RESET, seed=self._seed)
        self.link.order(Order.ARM)
        self.link.order(Order.TAKE_OFF, height_m=0.0)
        self._await_start()
        self._steps, self.held, self.timing = 0, 0, Timing()
        self.timings.append(self.timing)
        self.watch.begin()
        self.watch.see(self._reading)
        speed = getattr(self.link, "speed", 1.0)
        self._metronome = None if self.link.lockstep else Metronome(self.spec.control_dt_s / speed)
        self._woke = time.perf_counter()
        return self.observe()

    def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> StepResult:
        """Send a set point unless the guard objects, let 20 ms pass, and return what the robot shows then."""
        action = self.spec.action.clip(np.asarray(actions, float)[0])
        if mask is None or mask[0]:
            if self.trouble:
                self.held += 1
            else:
                self.link.send(self.spec.action.level, action)
            self._pass(time.perf_counter() - self._woke)
        return self._result(action)

    def hold_action(self) -> np.ndarray:
        """Return the action (1, Da) that keeps the robot where it shows itself, gripper open."""
        obs, vehicle, level = self._obs, self.scenario.robot.vehicle, self.scenario.level
        base = obs.get("base_rot6d", np.array([1.0, 0.0]))
        yaw = float(np.arctan2(base[1], base[0]))
        action = hover_action(level, vehicle, obs["ee_pos"], obs["ee_rot6d"], base_pos=obs.get("base_pos"), yaw=yaw)
        if level is ActionLevel.BASE_JOINT and (joints := obs.get("joint_pos")) is not None:
            first = 0 if self.scenario.robot.fixed else 4
            action[first : first + joints.size] = joints
        return self.spec.action.clip(action)[None]

    def look(self) -> dict[str, np.ndarray]:
        """Wait for what the robot shows before a flight, and return it: name -> (1, ...).

        Raises:
            LinkError: it shows nothing.
        """
        until = time.perf_counter() + PATIENCE_S
        while (reading := self.link.read()) is None:
            if time.perf_counter() > until:
                raise LinkError(f"The robot has shown nothing for {PATIENCE_S:g} s.")
            time.sleep(0.002)
        return {name: value[None] for name, value in reading.obs.items()}

    def observe(self) -> dict[str, np.ndarray]:
        """Return what the robot shows, as last read: name -> (1, ...)."""
        return {name: value[None].copy() for name, value in self._obs.items()}

    def close(self) -> None:
        self.link.close()

    def _await_start(self) -> None:
        """Wait for a reading of a robot that was released."""
        until = time.perf_counter() + PATIENCE_S
        while (reading := self.link.read()) is None or reading.mode is not Mode.FLYING:
            if self.link.lockstep or time.perf_counter() > until:
                mode = "shows nothing" if reading is None else f"is {reading.mode}"
                raise LinkError(f"The robot {mode}, {PATIENCE_S:g} s after it was told to begin.")
            time.sleep(0.002)
        self._take(reading)

    def _pass(self, worked: float) -> None:
        """Let a tick pass and read."""
        if self._metronome is None:
            self.link.step()
            late = 0.0
        else:
            late = self._metronome.wait()
        self._woke = time.perf_counter()
        self._steps += 1
        reading = self.link.read()
        self.watch.see(reading)
        if reading is not None and (not self.trouble or reading.mode is Mode.CRASHED):
            self._take(reading)
        self.timing.late_s.append(late)
        self.timing.work_s.append(worked)
        self.timing.age.append(self.watch.age)

    def _take(self, reading: Reading) -> None:
        self._reading, self._obs = reading, dict(reading.obs)

    def _told(self, name: str, otherwise: Any) -> Any:
        return self.told.get(name, otherwise)

    def _result(self, action: np.ndarray) -> StepResult:
        flags = {name: np.array([bool(self._told(name, False))]) for name in ("success", "crash", "dropped")}
        crash = flags["crash"] | np.array([self._reading is not None and self._reading.mode is Mode.CRASHED])
        subtasks = self._told("subtasks", np.zeros(len(self.spec.subtasks)))
        info = {
            **flags,
            "crash": crash,
            "subtasks": np.asarray(subtasks)[None],
            "executed_action": action[None],
            **{name: np.array([self._told(name, otherwise)]) for name, otherwise in UNTOLD.items()},
        }
        return StepResult(
            obs=self.observe(),
            reward=np.array([float(self._told("reward", 0.0))]),
            terminated=crash | flags["dropped"] | np.array([self.watch.over]),
            truncated=np.array([self._steps >= self.spec.max_steps]),
            info=info,
        )

    def _mirrored(self) -> np.ndarray:
        """Return a state (S,) with the robot where its readings have it."""
        data, robot, obs = self._data, self.scenario.robot, self._obs
        (first, _), count = robot.first_joint, robot.num_joints
        if "base_pos" in obs and not robot.fixed:
            data.qpos[:3], data.qpos[3:7] = obs["base_pos"], _quaternion(obs["base_rot6d"])
        if "joint_pos" in obs:
            data.qpos[first : first + count] = obs["joint_pos"]
        if "gripper" in obs and robot.has_gripper:
            data.qpos[first + count : first + count + 2] = obs["gripper"][0] * robot.gripper.stroke
        state = np.zeros(self.spec.state_size)
        mujoco.mj_getState(self.model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
        return state


def _quaternion(rot6d: np.ndarray) -> np.ndarray:
    """Return the unit quaternion (w, x, y, z) of the first two columns of a rotation matrix (6,)."""
    x, y = rot6d[:3], rot6d[3:]
    matrix, quaternion = np.column_stack([x, y, np.cross(x, y)]), np.empty(4)
    mujoco.mju_mat2Quat(quaternion, matrix.ravel())
    return quaternion
