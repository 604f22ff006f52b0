"""A robot over a link as an environment of one world, whose step is a tick of its loop.

So whatever flies environments flies robots: recording, taking over, evaluating. In lockstep with a simulated robot it
is the suite's own environment, number for number.
"""

from typing import Any

import mujoco
import numpy as np

from aerial_il.core.contracts import BatchEnvBase, StepResult
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import camera_text
from aerial_il.links.guard import Guard
from aerial_il.links.link import Link, Mode
from aerial_il.links.loop import RobotLoop
from aerial_il.links.robot import SimulatedRobot
from aerial_il.suite.engine import ENGINE
from aerial_il.suite.scenario import Scenario

UNTOLD = {"sparse_reward": 0.0, "ee_error_m": np.nan, "effort": np.nan, "contacts": 0, "force_in_band_raw": np.nan}


class LinkedEnvironment(BatchEnvBase):
    """One robot over a link.

    Args:
        link: to the robot; the environment closes it. guard: what must hold for set points to be sent.

    Attributes:
        loop: what flies it.
    """

    num_envs = 1
    engine: str | None = ENGINE

    def __init__(self, link: Link, guard: Guard | None = None) -> None:
        self.loop, self.spec = RobotLoop(link, guard), link.spec
        self._here: SimulatedRobot | None = getattr(link, "robot", None)
        spec = self.spec
        cameras = [camera_text(each, spec.control_dt_s) for each in spec.observation.of_group("image")]
        cell = spec.robot, spec.task, spec.tier, spec.action.level
        self.scenario = Scenario(*cell, cameras, controller=spec.controller)
        self.model, self.model_xml = self.scenario.compile(), self.scenario.xml
        self._data = mujoco.MjData(self.model)

    @property
    def simulation(self) -> Any:
        """The simulator, for experts; only of a robot that is simulated in this process.

        Raises:
            InvalidValueError: the robot is elsewhere.
        """
        if self._here is None or not self.loop.link.lockstep:
            raise InvalidValueError("An expert looks into the simulator: that works with link=simulated in lockstep.")
        return self._here.env.simulation

    @property
    def seeds(self) -> np.ndarray:
        return np.array([self.loop.seed])

    @property
    def sim_time(self) -> np.ndarray:
        return np.array([self.loop.steps * self.spec.control_dt_s])

    @property
    def ctrl(self) -> np.ndarray:
        """(1, R + nu) actuator commands, zeros where the robot does not tell them."""
        size = self.scenario.robot.num_rotors + self.model.nu
        return np.atleast_2d(self.loop.told.get("ctrl", np.zeros(size)))

    def drawn(self, seed: int) -> dict[str, Any]:
        """Return the disturbances of an episode; a robot that is elsewhere does not tell them."""
        return {} if self._here is None else self._here.env.drawn(seed)

    def get_state(self) -> np.ndarray:
        """(1, S) the simulator's state, or one made of what the robot shows: objects stay where a model has them."""
        told = self.loop.told.get("state")
        return np.atleast_2d(self._mirrored() if told is None else told)

    def set_state(self, states: np.ndarray, mask: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """Refuse: robots cannot be put somewhere.

        Raises:
            InvalidValueError: always.
        """
        raise InvalidValueError("A robot over a link cannot continue from a state.")

    def reset(self, seeds: np.ndarray | int, mask: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """Let the robot begin an episode."""
        if mask is None or mask[0]:
            self.loop.begin(int(np.atleast_1d(seeds)[0]))
        return self.observe()

    def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> StepResult:
        """Send a set point unless the guard objects, let 20 ms pass, and return what the robot shows then."""
        action = self.spec.action.clip(np.asarray(actions, float)[0])
        if mask is None or mask[0]:
            self.loop.tick(action)
        return self._result(action)

    def observe(self) -> dict[str, np.ndarray]:
        """Return what the robot shows, as last read: name -> (1, ...)."""
        return {name: value[None].copy() for name, value in self.loop.obs.items()}

    def close(self) -> None:
        self.loop.link.close()

    def _result(self, action: np.ndarray) -> StepResult:
        loop = self.loop
        told = loop.told
        success, crash, dropped = (np.array([bool(told.get(each, False))]) for each in ("success", "crash", "dropped"))
        crash |= loop.reading is not None and loop.reading.mode is Mode.CRASHED
        info = {
            "success": success,
            "crash": crash,
            "dropped": dropped,
            "subtasks": np.atleast_2d(told.get("subtasks", np.zeros(len(self.spec.subtasks)))),
            "executed_action": np.atleast_2d(told.get("executed_action", action)),
            "ended": np.array([loop.trouble if loop.watch.over else ""]),
            **{name: np.array([told.get(name, otherwise)]) for name, otherwise in UNTOLD.items()},
        }
        return StepResult(
            obs=self.observe(),
            reward=np.array([float(told.get("reward", 0.0))]),
            terminated=crash | dropped,
            truncated=np.array([loop.steps >= self.spec.max_steps]) | loop.watch.over,
            info=info,
        )

    def _mirrored(self) -> np.ndarray:
        """Return a state (S,) with the robot where its readings have it."""
        data, robot, obs = self._data, self.scenario.robot, self.loop.obs
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
