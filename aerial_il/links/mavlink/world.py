"""One world of the suite as an autopilot's simulator steps it: rotors and servos at 250 Hz, a cradle, true motion.

The vehicle stands in a cradle where its episode begins, because an arm leaves no room for landing gear. Rotors that
carry most of its weight release it; disarmed, it is caught within 10 cm of the cradle if it is slow, and held as it is.
"""

import numpy as np

from aerial_il.control.vehicle import GRAVITY
from aerial_il.links.mavlink.channels import THRUST_CURVE, Channels, RotorLag
from aerial_il.links.mavlink.frames import matrix
from aerial_il.links.mavlink.sensors import Motion
from aerial_il.suite import tiers
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.episode.assessment import Assessment
from aerial_il.suite.scenario import Scenario
from aerial_il.suite.timing import PHYSICS_DT_S, SUBSTEPS

RELEASED_AT = 0.9  # share of the weight that the rotors are told to carry
CATCH_M, CATCH_M_S = 0.1, 0.2
REAL_HERE = ("latency", "noise", "estimation")  # components of a tier that stand for sensors and links


class CradledWorld:
    """A robot in its scene, and in its cradle.

    Args:
        robot, task: registry names. tier: disturbances, of which latency, noise and estimation are left out: sensors,
            estimator and link are there instead. seed: of the episode. curve: see :class:`Channels`.

    Attributes:
        held: whether it is in the cradle. crashed, solved: what has become of the task.
    """

    def __init__(
        self, robot: str, task: str, tier: str = "calm", *, seed: int = 0, curve: float = THRUST_CURVE
    ) -> None:
        parts = tiers.get(tier).components
        tier = "".join([tier, *(f"-{part}" for part in REAL_HERE if part in parts)])
        self.env = BatchEnvironment(Scenario(robot, task, tier, "rotor"), 1, 1)
        vehicle = self.env.scenario.robot.vehicle
        self.channels, self._vehicle = Channels(vehicle, curve), vehicle
        self.reset(seed)

    def reset(self, seed: int) -> None:
        """Stand in the cradle at the start of the episode of ``seed``."""
        self.env.reset(seed)
        self.held, self.crashed, self.solved = True, False, False
        self._lag, self._steps = RotorLag(self._vehicle, PHYSICS_DT_S), 0
        view = self.env.simulation.view
        view.thrust[0] = 0.0
        self.cradle = view.base_pos[0].copy()
        self.motion = self._at_rest()

    @property
    def joints(self) -> np.ndarray:
        """(J,) rad, as the encoders have them."""
        return self.env.simulation.view.joint_pos[0]

    @property
    def joint_speeds(self) -> np.ndarray:
        """(J,) rad/s."""
        return self.env.simulation.view.joint_vel[0]

    @property
    def opening(self) -> float:
        """Of the gripper, from 0 to 1; 1 without one."""
        return float(self.env.simulation.view.gripper[0, 0]) if self.channels.grips else 1.0

    @property
    def assessment(self) -> Assessment:
        """What the task makes of it, as of the last control step of 20 ms."""
        return self.env.simulation.assessment

    def step(self, controls: np.ndarray, armed: bool) -> None:
        """Go on by 4 ms.

        Args:
            controls: (16,), see :mod:`aerial_il.links.mavlink.channels`. armed: without, the rotors stand still.

        Raises:
            SimulationDivergedError: the physics failed.
        """
        thrust = self.channels.thrust(controls) if armed else np.zeros(self.channels.rotors)
        if self.held:
            self._hold(thrust)
        elif not armed and self._in_reach():
            self.held, self.motion = True, self._at_rest()
        if not self.held:
            self._fly(np.array([*thrust, *self.channels.arm(controls)]))

    def close(self) -> None:
        """Free what the world holds."""
        self.env.close()

    def _hold(self, thrust: np.ndarray) -> None:
        self._lag.follow(thrust)
        lift = float(thrust @ self._vehicle.rotor_axis[:, 2])
        if lift > RELEASED_AT * self._vehicle.mass * GRAVITY:
            self.held, self._steps = False, 0
            view = self.env.simulation.view
            view.thrust[0] = self._lag.thrust
            view.qvel[0, : 6 + self.channels.joints] = 0.0

    def _in_reach(self) -> bool:
        motion = self.motion
        near = np.linalg.norm(motion.pos - self.cradle) < CATCH_M
        caught = bool(near and np.linalg.norm(motion.vel) < CATCH_M_S)
        if caught:
            self._lag.thrust = self.env.simulation.view.thrust[0].copy()
        return caught

    def _fly(self, action: np.ndarray) -> None:
        simulation, before = self.env.simulation, self.motion.vel
        simulation.receive(action[None], fresh=self._steps % SUBSTEPS == 0)
        simulation.fly(1)
        simulation.settle()
        self._steps += 1
        if self._steps % SUBSTEPS == 0:
            verdict = simulation.assessment
            self.crashed |= bool(verdict.crash[0])
            self.solved |= bool(verdict.success[0])
        view = simulation.view
        pos, quat, twist = view.qpos[0, :3].copy(), view.qpos[0, 3:7].copy(), view.qvel[0, :6].copy()
        felt = (twist[:3] - before) / PHYSICS_DT_S + [0.0, 0.0, GRAVITY]
        self.motion = Motion(pos, twist[:3], quat, twist[3:], matrix(quat).T @ felt)

    def _at_rest(self) -> Motion:
        view = self.env.simulation.view
        pos, quat = view.qpos[0, :3].copy(), view.qpos[0, 3:7].copy()
        return Motion(pos, np.zeros(3), quat, np.zeros(3), matrix(quat).T @ [0.0, 0.0, GRAVITY])
