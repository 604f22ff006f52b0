"""Set points that arrive in parts: tool, base, arm and gripper, each as its newest message left it.

The newest sets the level: a pose of the tool ``ee_pose``, one of the base ``base_joint``, a velocity of the base
``velocity``; the arm's trajectory goes with the base's pose or velocity, and takes over from the tool. When the level
changes, and after a silence in which the robot hovers, what was sent before is forgotten: base and arm stay where they
are then, until a message says otherwise.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from aerial_il.core.rotations import wrap_angle
from aerial_il.core.specs import ActionSpec
from aerial_il.links.link import QUIET_S, RefusedError

TOOL, BASE, VELOCITY = "ee_pose", "base_joint", "velocity"


@dataclass(frozen=True)
class Track:
    """A way through points, straight between them.

    Attributes:
        times: (k,) s by the robot's clock, rising. points: (k, n).
    """

    times: np.ndarray
    points: np.ndarray

    def at(self, time_s: float) -> np.ndarray:
        """Return the point (n,) at a time: the first before, the last after it."""
        return np.array([np.interp(time_s, self.times, column) for column in self.points.T])

    def rate(self, time_s: float) -> np.ndarray:
        """Return how fast it moves (n,) at a time; at its ends and beyond, it rests."""
        i = int(np.searchsorted(self.times, time_s, side="right"))
        if not 0 < i < len(self.times):
            return np.zeros(self.points.shape[1])
        return (self.points[i] - self.points[i - 1]) / (self.times[i] - self.times[i - 1])


@dataclass(frozen=True)
class Now:
    """Where a robot is: ``time_s`` by its clock, ``base`` (4,) position and yaw, ``joints`` (J,)."""

    time_s: float
    base: np.ndarray
    joints: np.ndarray


class SetPoints:
    """What a robot is to do, from messages about its parts.

    Args:
        actions: level -> specification of its actions, of the levels that the robot takes.
    """

    def __init__(self, actions: Mapping[str, ActionSpec]) -> None:
        self._actions = actions
        labels = actions[BASE].labels
        self.joints = sum(label.startswith("joint_") for label in labels)
        self.has_base, self.has_gripper = "yaw" in labels, "gripper" in labels
        self.opening = 1.0
        self.forget()

    def forget(self) -> None:
        """Let the next message begin anew; the gripper stays as it is."""
        self._level = ""
        self._tool, self._velocity = np.zeros(9), np.zeros(4)
        self._base = self._arm = Track(np.zeros(1), np.zeros((1, 0)))
        self._fresh, self._heard_s = False, -np.inf

    def take_tool(self, pose: np.ndarray, now: Now) -> None:
        """Take position, m, and rotation of the tool (9,)."""
        _finite("the tool's pose", pose)
        self._enter(TOOL, now)
        self._tool = pose

    def take_base(self, times: np.ndarray, points: np.ndarray, now: Now) -> None:
        """Take positions, m, and yaws, rad, of the base (k, 4), each at a time (k,), s from now.

        Raises:
            RefusedError: the base is fixed, something is not finite, or the times do not rise.
        """
        self._require_base()
        track = _track("the base's way", times, points, now.base, now.time_s)
        yaws = np.unwrap(np.append(now.base[3], track.points[:, 3]))[1:]  # the short way round
        self._enter(BASE, now)
        self._base = Track(track.times, np.column_stack([track.points[:, :3], yaws]))

    def take_velocity(self, velocity: np.ndarray, now: Now) -> None:
        """Take velocity of the base in the world, m/s, and yaw rate, rad/s (4,)."""
        self._require_base()
        _finite("the base's velocity", velocity)
        self._enter(VELOCITY, now)
        self._velocity = velocity

    def take_arm(self, times: np.ndarray, points: np.ndarray, now: Now) -> None:
        """Take positions of the joints, rad (k, J), each at a time (k,), s from now."""
        if points.shape[1:] != (self.joints,) or not self.joints:
            raise RefusedError(f"the arm has {self.joints} joints, got {points.shape[1:]}.")
        track = _track("the arm's way", times, points, now.joints, now.time_s)
        self._enter(VELOCITY if self._known(now) == VELOCITY else BASE, now)
        self._arm = track

    def take_gripper(self, opening: float, now: Now) -> None:
        """Take an opening, 0 closed, 1 open."""
        if not self.has_gripper:
            raise RefusedError("it has no gripper.")
        _finite("the gripper's opening", np.array([opening]))
        self._enter(self._known(now) or BASE, now)
        self.opening = float(np.clip(opening, 0.0, 1.0))

    def take_action(self, action: np.ndarray) -> None:
        """Learn of a whole action, which leaves nothing of the parts but the gripper."""
        self.forget()
        if self.has_gripper:
            self.opening = float(np.clip(action[-1], 0.0, 1.0))

    def compose(self, time_s: float) -> tuple[str, np.ndarray] | None:
        """Return level and action (Da,) of a time; None where nothing is new and no trajectory under way."""
        if not (self._fresh or self._under_way(time_s)):
            return None
        self._fresh = False
        parts = {
            TOOL: lambda: (self._tool,),
            BASE: lambda: (_wrapped(self._base.at(time_s)), self._arm.at(time_s)),
            VELOCITY: lambda: (self._velocity, self._arm.rate(time_s)),
        }[self._level]()
        spec = self._actions[self._level]
        return self._level, spec.clip(np.concatenate([*parts, [self.opening] if self.has_gripper else []]))

    def _enter(self, level: str, now: Now) -> None:
        """Go to a level, from where the robot is."""
        if level != self._known(now):
            started = np.array([now.time_s])
            self._base, self._arm = Track(started, now.base[None]), Track(started, now.joints[None])
        self._level, self._fresh, self._heard_s = level, True, now.time_s

    def _known(self, now: Now) -> str:
        """Return the level of what has been sent lately; empty after a silence."""
        silent = now.time_s - self._heard_s > QUIET_S and not self._under_way(now.time_s)
        return "" if silent else self._level

    def _under_way(self, time_s: float) -> bool:
        """Whether a trajectory is: one along which a velocity would be kept up is none."""
        return self._level == BASE and time_s <= max(self._base.times[-1], self._arm.times[-1])

    def _require_base(self) -> None:
        if not self.has_base:
            raise RefusedError("its base is fixed.")


def _track(what: str, times: np.ndarray, points: np.ndarray, here: np.ndarray, time_s: float) -> Track:
    """Return the way from ``here`` at ``time_s`` through ``points``; a point that is due at once is jumped to."""
    times, points = np.asarray(times, float), np.asarray(points, float)
    _finite(what, np.append(times, points))
    if not len(times) or times[0] < 0.0 or (np.diff(times) <= 0.0).any():
        raise RefusedError(f"{what} needs points whose times rise from 0 or later on, got {times.tolist()} s.")
    if times[0] > 0.0:
        times, points = np.append(0.0, times), np.concatenate([here[None], points])
    return Track(time_s + times, points)


def _finite(what: str, values: np.ndarray) -> None:
    if not np.isfinite(values).all():
        raise RefusedError(f"{what} is not finite.")


def _wrapped(base: np.ndarray) -> np.ndarray:
    """Return a base's position and yaw (4,), or nothing of a fixed one (0,), the yaw in (-π, π]."""
    return base if not base.size else np.append(base[:3], wrap_angle(base[3]))
