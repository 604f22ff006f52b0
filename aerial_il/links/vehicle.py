"""A robot for scripts: connect, arm, take off, go somewhere, move the arm, land; the same over every link.

Each call sends set points until it is done, and returns. In between, the robot hovers by itself.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from aerial_il.core import registry
from aerial_il.core.composition import build
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import ActionSpec
from aerial_il.links.link import LINKED_LEVELS, Link, LinkError, Mode, Order, Reading, RefusedError
from aerial_il.teleop.session.clock import Metronome

WITHIN_M, WITHIN_RAD = 0.05, 0.05  # where somewhere has been reached
TIMEOUT_S = 20.0
LOST_S = 5.0  # without news
BEYOND = 0.03  # m or rad by which what is measured may lie beyond a bound


@dataclass(frozen=True)
class State:
    """What a robot shows of itself.

    Attributes:
        time_s: by its own clock. mode: see :class:`~aerial_il.links.link.Mode`. armed: whether its rotors may turn.
        position: (3,) of the base, world, m. heading: rad. velocity: (3,) world, m/s.
        joints: (J,) rad. opening: of the gripper, 0 closed, 1 open; NaN without one.
        tool: (3,) position of the tool, world, m. tool_rot6d: (6,) its orientation, world from tool.
        obs: all that it shows, by name.
    """

    time_s: float
    mode: Mode
    armed: bool
    position: np.ndarray
    heading: float
    velocity: np.ndarray
    joints: np.ndarray
    opening: float
    tool: np.ndarray
    tool_rot6d: np.ndarray
    obs: dict[str, np.ndarray]

    @staticmethod
    def of(reading: Reading) -> State:
        """Return what a reading shows; NaN for what it does not."""
        obs = dict(reading.obs)
        turned = obs.get("base_rot6d", np.array([1.0, 0.0]))
        unknown = np.full(3, np.nan)
        return State(
            time_s=reading.stamp_s,
            mode=reading.mode,
            armed=reading.armed,
            position=obs.get("base_pos", unknown),
            heading=float(np.arctan2(turned[1], turned[0])),
            velocity=obs.get("base_vel", unknown),
            joints=obs.get("joint_pos", np.zeros(0)),
            opening=float(obs["gripper"][0]) if "gripper" in obs else np.nan,
            tool=obs.get("ee_pos", unknown),
            tool_rot6d=obs.get("ee_rot6d", np.full(6, np.nan)),
            obs=obs,
        )


class Vehicle:
    """A robot that a script flies.

    Args:
        link: to the robot; closed by :meth:`close`, or at the end of a ``with`` block.

    Calls raise :class:`InvalidValueError` for wrong numbers, :class:`RefusedError` where the robot refuses, and
    :class:`LinkError` where it crashes, is gone, or is not done in ``timeout_s`` of its time.

    Example:
        >>> with aerial_il.vehicle(robot="ua_quad_arm4") as vehicle:
        ...     vehicle.arm()
        ...     vehicle.take_off(0.5)
        ...     vehicle.go_to([0.5, 0.0, 1.5], heading=0.3)
        ...     vehicle.move_arm([0.0, 0.5, 0.5, 0.0])
        ...     vehicle.land()
    """

    def __init__(self, link: Link) -> None:
        self.link = link
        self._speed: float = getattr(link, "speed", 1.0)
        self._metronome = None if link.lockstep else Metronome(link.spec.control_dt_s / self._speed)
        self._specs, self._grip = _specs_of(link.spec.robot), 1.0
        self._base: np.ndarray | None = None  # (4,) position and heading that were asked for last

    def __enter__(self) -> Vehicle:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def state(self) -> State:
        """What the robot shows now.

        Raises:
            LinkError: nothing has arrived.
        """
        if (reading := self.link.read()) is None:
            raise LinkError("The robot has shown nothing yet.")
        return State.of(reading)

    def reset(self, seed: int = 0) -> None:
        """Put a simulated robot, and its scene, to the start of the episode of ``seed``."""
        self.link.order(Order.RESET, seed=seed)
        self._grip, self._base = 1.0, None

    def arm(self) -> None:
        """Let the rotors turn."""
        self.link.order(Order.ARM)

    def disarm(self) -> None:
        """Stop the rotors of a robot that stands."""
        self.link.order(Order.DISARM)

    def take_off(self, height_m: float = 0.3) -> None:
        """Rise by ``height_m`` from where it stands, and hover there."""
        self.link.order(Order.TAKE_OFF, height_m=height_m)
        self._wait(lambda state: state.mode in (Mode.HOLDING, Mode.FLYING), "take off")
        self._base = None

    def go_to(
        self, position: Sequence[float], heading: float | None = None, *, within_m: float = WITHIN_M,
        timeout_s: float = TIMEOUT_S,
    ) -> None:  # fmt: skip
        """Fly the base to ``position`` (3,) (world, m), turned to ``heading`` (rad; None: as it is)."""
        turned = [] if heading is None else _numbers("heading", [heading], 1)
        wanted = np.array([*_numbers("position", position, 3), *(self._now()[3:] if heading is None else turned)])

        def there(state: State) -> bool:
            turned = abs((state.heading - wanted[3] + np.pi) % (2 * np.pi) - np.pi)
            return bool(np.linalg.norm(state.position - wanted[:3]) < within_m and turned < WITHIN_RAD)

        self._base = wanted
        self._follow("base_joint", self._posture(), there, f"reach {_short(position)}", timeout_s)

    def follow(self, path: Iterable[Sequence[float]], *, within_m: float = 0.15) -> None:
        """Fly the base through points (3,) or (4,) with headings, each as soon as the last is within ``within_m``."""
        for point in path:
            self.go_to(point[:3], point[3] if len(point) > 3 else None, within_m=within_m)

    def fly(self, velocity: Sequence[float], *, yaw_rate: float = 0.0, seconds: float) -> None:
        """Fly at ``velocity`` (3,) (world, m/s) and ``yaw_rate`` (rad/s) for some seconds of the robot's time."""
        joints = np.zeros(self.state.joints.size)
        aim = *_numbers("velocity", velocity, 3), *_numbers("yaw_rate", [yaw_rate], 1)
        action = np.array([*aim, *joints, *self._gripper()])
        end = self.state.time_s + _numbers("seconds", [seconds], 1)[0]
        self._follow("velocity", action, lambda state: state.time_s >= end, "fly on", seconds + TIMEOUT_S)
        self._base = None

    def move_arm(self, joints: Sequence[float], *, timeout_s: float = TIMEOUT_S) -> None:
        """Move the arm's joints (J,) to these angles, rad, the base where it is."""
        wanted = _numbers("joints", joints, self.state.joints.size)
        self._base = self._now()

        def there(state: State) -> bool:
            return bool(np.abs(state.joints - wanted).max(initial=0.0) < WITHIN_RAD)

        self._follow("base_joint", self._posture(wanted), there, f"move the arm to {_short(joints)}", timeout_s)

    def grip(self, opening: float, *, seconds: float = 0.6) -> None:
        """Open (1) or close (0) the gripper, and give it some seconds of the robot's time."""
        if not 0.0 <= opening <= 1.0:
            raise InvalidValueError(f"opening is {opening}; it must lie in [0, 1], 0 closed and 1 open.")
        self._grip = float(opening)
        self.hover(seconds)

    def tool_to(
        self, position: Sequence[float], rot6d: Sequence[float] | None = None, *, within_m: float = 0.02,
        timeout_s: float = TIMEOUT_S,
    ) -> None:  # fmt: skip
        """Bring the tool to ``position`` (3,) (world, m) with base and arm together; ``rot6d`` (6,) None: as it is."""
        turned = self.state.tool_rot6d if rot6d is None else _numbers("rot6d", rot6d, 6)
        action = np.array([*_numbers("position", position, 3), *turned, *self._gripper()])

        def there(state: State) -> bool:
            return bool(np.linalg.norm(state.tool - action[:3]) < within_m)

        self._follow("ee_pose", action, there, f"bring the tool to {_short(position)}", timeout_s)
        self._base = None

    def hover(self, seconds: float) -> None:
        """Stay where it is for some seconds of the robot's time."""
        end = self.state.time_s + _numbers("seconds", [seconds], 1)[0]
        self._base = self._now()
        here = self._posture()
        self._follow("base_joint", here, lambda state: state.time_s >= end, "hover", seconds + TIMEOUT_S)

    def land(self) -> None:
        """Land where it took off, and stand there, disarmed."""
        self.link.order(Order.LAND)
        self._wait(lambda state: state.mode is Mode.STANDING, "land")

    def close(self) -> None:
        """Give up the link; a robot in the air hovers."""
        self.link.close()

    def _now(self) -> np.ndarray:
        """(4,) position and heading that were asked for last, or those that it has."""
        state = self.state
        return np.array([*state.position, state.heading]) if self._base is None else self._base

    def _gripper(self) -> list[float]:
        return [self._grip] if self.link.spec.action.labels[-1] == "gripper" else []

    def _posture(self, joints: np.ndarray | None = None) -> np.ndarray:
        base = [] if np.isnan(self.state.position).any() else self._now()
        return np.array([*base, *(self.state.joints if joints is None else joints), *self._gripper()])

    def _follow(
        self, level: str, action: np.ndarray, done: Callable[[State], bool], what: str, timeout_s: float
    ) -> None:
        if self.state.mode is Mode.STANDING:
            raise RefusedError("It stands: arm() and take_off() first.")
        spec = self._specs.get(level)
        if spec and action.shape == (spec.size,) and not np.allclose(within := spec.clip(action), action, atol=BEYOND):
            k = int(np.argmax(np.abs(within - action)))
            ends = f"[{spec.low[k]:.3g}, {spec.high[k]:.3g}]"
            raise RefusedError(f"To {what}, {spec.labels[k]} would be {action[k]:.3g}; it must lie in {ends}.")
        self._wait(done, what, lambda: self.link.send(level, action), timeout_s)

    def _wait(
        self, done: Callable[[State], bool], what: str, send: Callable[[], None] = lambda: None,
        timeout_s: float = TIMEOUT_S,
    ) -> None:  # fmt: skip
        """Send, and let ticks pass until it is done."""
        end, heard, last = self.state.time_s + _numbers("timeout_s", [timeout_s], 1)[0], time.perf_counter(), -np.inf
        while not done(state := self.state):
            if state.mode is Mode.CRASHED:
                raise LinkError(f"The robot crashed; it was to {what}.")
            if state.time_s != last:
                heard, last = time.perf_counter(), state.time_s
            if self._metronome is not None and time.perf_counter() - heard > LOST_S:
                raise LinkError(f"The robot is lost: no news of it for {LOST_S:g} s. It was to {what}.")
            if state.time_s > end:
                raise LinkError(f"The robot did not {what} within {timeout_s:g} s: {_where(state)}.")
            send()
            self._tick()

    def _tick(self) -> None:
        if self._metronome is None:
            self.link.step()
        else:
            self._metronome.wait()


def connect(link: str = "simulated", **settings: Any) -> Vehicle:
    """Return a vehicle over a link.

    Args:
        link: its name. settings: of the link; with ``simulated`` also those of :class:`SimulatedRobot`: ``robot``,
            ``task`` (``hover`` without an arm, else ``reach``), ``tier``, ``latency``, ``seed`` of the scene.

    Raises:
        LinkError: no robot answers. UnknownNameError, InvalidValueError: a setting is unknown or wrong.
    """
    kind = registry.get("link", link)
    if link == "mavlink" and "robot" not in settings:
        raise InvalidValueError("link=mavlink: say whose autopilot sends here, robot=NAME; see aerial-il list.")
    if link != "simulated":
        return Vehicle(build(kind, settings).connect(_nobody))
    names = ("robot", "task", "tier", "latency", "seed", "controller")
    own = {name: settings.pop(name) for name in names if name in settings}
    return Vehicle(build(kind, settings).connect(lambda: _robot(**own)))


def land(link: Link) -> None:
    """Land a robot that flies, and wait until it stands."""
    vehicle = Vehicle(link)
    if vehicle.state.mode not in (Mode.STANDING, Mode.CRASHED):
        vehicle.land()


def _robot(robot: str = "ua_quad_arm4", task: str | None = None, seed: int = 0, **settings: Any) -> Any:
    from aerial_il import robots
    from aerial_il.links.robot import SimulatedRobot

    made = SimulatedRobot(robot, task or ("reach" if robots.get(robot).num_joints else "hover"), **settings)
    made.reset(seed)
    return made


def _specs_of(robot: str) -> dict[str, ActionSpec]:
    """Return the bounds of a robot's set points, by level; none of one that is not registered."""
    from aerial_il import robots
    from aerial_il.control.actions import ActionLevel, action_spec

    if robot not in robots.names():
        return {}
    vehicle = robots.get(robot).vehicle
    return {level: action_spec(ActionLevel.parse(level), vehicle) for level in LINKED_LEVELS}


def _nobody() -> Any:
    raise AssertionError("a link to a robot that is there makes none")


def _numbers(name: str, values: Sequence[float], size: int) -> np.ndarray:
    """Return finite numbers (size,).

    Raises:
        InvalidValueError: they are not.
    """
    try:
        numbers = np.asarray(values, float)
    except (TypeError, ValueError):
        numbers = np.zeros(0)
    if numbers.shape != (size,) or not np.isfinite(numbers).all():
        raise InvalidValueError(f"{name} is {values!r}; it takes {size} finite number{'s' * (size != 1)}.")
    return numbers


def _short(values: Sequence[float]) -> list[float]:
    return [round(float(value), 3) for value in values]


def _where(state: State) -> str:
    return f"base at {np.round(state.position, 2).tolist()}, tool at {np.round(state.tool, 2).tolist()}, {state.mode}"
