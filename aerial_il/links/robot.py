"""A robot of the suite as one meets it over a link: it takes set points at any level, and orders, one tick at a time.

It stands in a cradle where its episode begins, because an arm leaves no room for landing gear: disarmed, it does not
move. It is released by taking off, and held again when it has come back to within 3 cm, slowly, or rests on the ground
beside.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np

from aerial_il.control import controller_state as layout
from aerial_il.control.actions import ActionLevel, levels_of
from aerial_il.core.contracts import StepResult
from aerial_il.core.latency import NO_LATENCY, Latency
from aerial_il.core.specs import EnvSpec
from aerial_il.links.link import LINKED_LEVELS, QUIET_S, Mode, Order, Reading, RefusedError, require_linked
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.episode.hold_action import hold_action
from aerial_il.suite.episode.simulation import STATE_OFFSET
from aerial_il.suite.scenario import Scenario

START_S = 10.0  # of its clock, which only ever goes on
TAKE_OFF_M = 0.3  # above the cradle, where no height is asked for
HIGHEST_M = 2.0  # that may be asked for
ARRIVED_M, IN_CRADLE_M, SLOW_M_S = 0.05, 0.03, 0.1
RESTED_TICKS = 50  # within ARRIVED_M: its skids touch the ground before it is there, so it lies there
ABOVE_M = 0.25  # over the cradle, from where it is lowered into it
BASE = ActionLevel.BASE_JOINT.label


class SimulatedRobot:
    """One robot in its world.

    Args:
        robot, task: registry names; the task sets the scene, and judges. tier: disturbances. level: of the actions in
            its specification, and of the first set point. controller: flight law. cameras: images that it shows.
        latency: how late it shows and takes things, whole control steps. quiet_s: see :data:`QUIET_S`.

    Attributes:
        mode, armed: see :class:`Mode`. late: ticks by which it shows and takes things late.
        solved: whether the task was, since the episode began.

    Raises:
        UnknownNameError, CellError: see :func:`aerial_il.load`. InvalidValueError: the level cannot be commanded over
            a link.
    """

    def __init__(
        self,
        robot: str,
        task: str,
        *,
        tier: str = "calm",
        level: str = "ee_pose",
        controller: str = "geometric_observer",
        cameras: Sequence[str] = (),
        image_size: tuple[int, int] = (240, 320),
        latency: Latency = NO_LATENCY,
        quiet_s: float = QUIET_S,
    ) -> None:
        scenario = Scenario(robot, task, tier, level, cameras, image_size, controller)
        require_linked(level)
        own = [each.label for each in levels_of(scenario.robot.vehicle) if each.label in LINKED_LEVELS]
        self._envs = {each: BatchEnvironment(replace(scenario, action=each), 1, 1) for each in own}
        self._first, self.late = level, latency.steps(scenario.spec.control_dt_s)
        self._quiet = max(1, round(quiet_s / scenario.spec.control_dt_s))
        self.time_s = START_S
        self.reset(0)

    @property
    def spec(self) -> EnvSpec:
        """Of its readings, and of actions at the level that it was made for."""
        return self._envs[self._first].spec

    @property
    def levels(self) -> tuple[str, ...]:
        """Levels of the set points that it takes."""
        return tuple(self._envs)

    @property
    def env(self) -> BatchEnvironment:
        """The world (of one) that it flies in, at the level that it is flown at now."""
        return self._envs[self._level]

    def spec_at(self, level: str) -> EnvSpec:
        """Return the specification with the actions of a level.

        Raises:
            RefusedError: it does not take set points at that level.
        """
        if level not in self._envs:
            raise RefusedError(f"{self.spec.robot} takes no set points at {level!r}. Valid: {', '.join(self.levels)}.")
        return self._envs[level].spec

    def reset(self, seed: int) -> None:
        """Stand in the cradle at the start of the episode of ``seed``."""
        self._level, self.mode, self.armed = self._first, Mode.STANDING, False
        env = self.env
        obs = env.reset(int(seed))
        view = env.simulation.view
        self._cradle = view.base_pos[0].copy(), _yaw(env), view.joint_pos[0].copy()
        self._opening, self._target = 1.0, np.zeros(0)
        seen, done = self.late
        self._seen = deque([obs] * (seen + 1), maxlen=seen + 1)
        self._sent: deque[tuple[str, np.ndarray] | None] = deque([None] * done)
        self._newest: tuple[str, np.ndarray] | None = None
        self._setpoint: tuple[str, np.ndarray] | None = None
        self._heard = self.ticks = self._rested = 0
        self._result: StepResult | None = None
        self.solved = self._held = False

    def command(self, level: str, action: np.ndarray) -> None:
        """Take note of a set point (Da,) at a level; it counts from the next tick on, or later by the latency.

        Raises:
            RefusedError: wrong level or size, or not finite.
        """
        action, spec = np.asarray(action, float), self.spec_at(level)
        if action.shape != (spec.action.size,):
            labels = ", ".join(spec.action.labels)
            raise RefusedError(f"{level} takes {spec.action.size} numbers ({labels}), got {action.shape}.")
        if not np.isfinite(action).all():
            label = spec.action.labels[int(np.argmin(np.isfinite(action)))]
            raise RefusedError(f"{label} of the set point is not finite. The robot goes on as it did.")
        self._newest = level, action.copy()

    def order(self, order: Order | str, **numbers: float) -> None:
        """Obey an order, see :class:`Order`.

        Raises:
            RefusedError: it cannot be obeyed now; says why.
        """
        order = Order(order)
        if order is Order.RESET:
            return self.reset(int(numbers.get("seed", 0)))
        if self.mode is Mode.CRASHED:
            raise RefusedError("It has crashed: reset it.")
        match order:
            case Order.ARM:
                self.armed = True
            case Order.TAKE_OFF:
                self._take_off(float(numbers.get("height_m", TAKE_OFF_M)))
            case Order.HOVER:
                self._require_air(order)
                self._hold()
                self._held = True
            case Order.FOLLOW:
                self._held = False
            case Order.LAND:
                self._require_air(order)
                self.mode, self._target = Mode.LANDING, np.zeros(0)
            case Order.DISARM:
                if self.mode is not Mode.STANDING:
                    raise RefusedError("It is in the air: land first.")
                self.armed = False
        return None

    def tick(self) -> None:
        """Let 20 ms pass."""
        self.time_s += self.spec.control_dt_s
        self.ticks += 1
        self._sent.append(self._newest)
        self._newest = None
        if (arrived := self._sent.popleft()) is not None:
            self._setpoint, self._heard = arrived, self.ticks
        if self.mode not in (Mode.STANDING, Mode.CRASHED):
            self._fly(*self._wanted())
        self._seen.append(self.env.observe() if self._result is None else self._result.obs)

    def reading(self) -> Reading:
        """Return what it shows now, late by its latency."""
        obs = {name: values[0] for name, values in self._seen[0].items()}
        measured_s = self.time_s - self.late[0] * self.spec.control_dt_s
        return Reading(obs, measured_s, self.mode, self.armed, self._told())

    def close(self) -> None:
        """Free what it holds."""
        for env in self._envs.values():
            env.close()

    def _told(self) -> dict[str, object]:
        info = {} if self._result is None else self._result.info
        return {
            **{name: value[0] for name, value in info.items()},
            "success": self.solved,
            "reward": 0.0 if self._result is None else float(self._result.reward[0]),
            "state": self.env.get_state()[0],
            "ctrl": self.env.ctrl[0],
            "seed": int(self.env.seeds[0]),
        }

    def _take_off(self, height_m: float) -> None:
        if self.mode is not Mode.STANDING:
            raise RefusedError("It is in the air already.")
        if not self.armed:
            raise RefusedError("It is not armed.")
        if not 0.0 <= height_m <= (0.0 if self.env.scenario.robot.fixed else HIGHEST_M):
            raise RefusedError(f"height_m is {height_m:g}; it must lie in [0, {HIGHEST_M:g}], 0 for a fixed base.")
        target, mode = self._stay(), Mode.TAKING_OFF
        if height_m == 0.0:
            target, mode = hold_action(self.env.scenario, self.env.simulation.view, 0), Mode.FLYING
        elif height_m > (room := self._envs[BASE].spec.action.high[2] - target[2]):
            raise RefusedError(f"height_m is {height_m:g}; its set points end {room:.2f} m above where it stands.")
        else:
            target[2] += height_m
        self._setpoint, self._heard, self._held = None, self.ticks, False
        self.mode, self._target = mode, target

    def _require_air(self, order: Order) -> None:
        if self.mode is Mode.STANDING:
            raise RefusedError(f"{order} is for a robot in the air: it stands.")

    def _hold(self) -> None:
        """Hover here, with arm and gripper as they are."""
        self.mode, self._target, self._setpoint = Mode.HOLDING, self._stay(), None

    def _stay(self) -> np.ndarray:
        """Return the action at ``base_joint`` that keeps base, arm and gripper where they are."""
        view = self.env.simulation.view
        base = [] if self.env.scenario.robot.fixed else [*view.base_pos[0], _yaw(self.env)]
        grip = [self._opening] if self.env.scenario.robot.has_gripper else []
        return self._envs[BASE].spec.action.clip(np.array([*base, *view.joint_pos[0], *grip]))

    def _wanted(self) -> tuple[str, np.ndarray]:
        """Return level and action of the coming tick."""
        quiet = self.ticks - self._heard > self._quiet
        follows = self.mode in (Mode.FLYING, Mode.HOLDING) and not self._held
        if follows and self._setpoint is not None and not quiet:
            self.mode = Mode.FLYING
            return self._setpoint
        if self.mode is Mode.FLYING and (quiet or (self._setpoint is None and self._level != self._first)):
            self._hold()
        if self.mode is Mode.FLYING:  # released, and not yet commanded
            return self._first, self._target
        if self.mode is Mode.LANDING:
            self._target = self._towards_cradle()
        return BASE, self._target

    def _towards_cradle(self) -> np.ndarray:
        """Return the action that leads back into the cradle: over it first, then down."""
        pos, yaw, joints = self._cradle
        target = self._stay()
        if self.env.scenario.robot.fixed:
            return target
        aside = np.linalg.norm(self.env.simulation.view.base_pos[0][:2] - pos[:2])
        target[:4] = [*pos, yaw]
        target[4 : 4 + joints.size] = joints
        if aside > ARRIVED_M:
            target[2] = max(pos[2] + ABOVE_M, self.env.simulation.view.base_pos[0][2] if aside > ABOVE_M else 0.0)
        return self._envs[BASE].spec.action.clip(target)

    def _fly(self, level: str, action: np.ndarray) -> None:
        self._change(level)
        if self.env.scenario.robot.has_gripper:
            self._opening = float(np.clip(action[-1], 0.0, 1.0))
        self._result = result = self.env.step(action[None])
        self.solved |= bool(result.info["success"][0])
        view = self.env.simulation.view
        if result.info["crash"][0]:
            self.mode, self.armed = Mode.CRASHED, False
        elif self.mode is Mode.TAKING_OFF and np.linalg.norm(view.base_pos[0] - self._target[:3]) < ARRIVED_M:
            self.mode = Mode.HOLDING
        elif self.mode is Mode.LANDING:
            aside = np.linalg.norm(view.base_pos[0] - self._cradle[0])
            slow = np.linalg.norm(view.base_vel[0]) < SLOW_M_S
            self._rested = self._rested + 1 if slow and aside < ARRIVED_M else 0
            if self.env.scenario.robot.fixed or (slow and aside < IN_CRADLE_M) or self._rested > RESTED_TICKS:
                self.mode, self.armed = Mode.STANDING, False

    def _change(self, level: str) -> None:
        """Go on at another level, the references of the tool where the tool is."""
        if level == self._level:
            return
        state, view = self.env.get_state(), self.env.simulation.view
        first = mujoco.mj_stateSize(self.env.model, STATE_OFFSET)
        own = state[0, first : first + layout.CONTROLLER_STATE_SIZE]
        if own[layout.READY]:
            for where in (layout.TOOL_POS, layout.TARGET_POS):
                own[where : where + 3] = view.tool_pos[0]
            for where in (layout.TOOL_ROT, layout.TARGET_ROT):
                own[where : where + 9] = view.tool_mat[0]
            for where in (layout.TOOL_VEL, layout.TOOL_OMEGA, layout.TARGET_VEL, layout.TOOL_ACC):
                own[where : where + 3] = 0.0
        self._level = level
        self.env.set_state(state)


def _yaw(env: BatchEnvironment) -> float:
    base = env.simulation.view.base_mat[0]
    return float(np.arctan2(base[3], base[0]))
