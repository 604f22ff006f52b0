"""From frames of a device to actions: the whole chain of mapping, shaping, modes, assist and targets, tick by tick.

What it commands follows from the frames and from what the vehicle shows, never from a clock: the log of a flight,
given again, is the same flight to the last bit.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from aerial_il.control.vehicle import Vehicle
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.specs import EnvSpec
from aerial_il.teleop.input.frame import DeviceFrame
from aerial_il.teleop.input.mapping import JOINTS, Bindings, Intent
from aerial_il.teleop.piloting.assist import DeadMan, eased, tilt_of
from aerial_il.teleop.piloting.command import GRIP_RATE, Command, check_level, command_of, modes_of
from aerial_il.teleop.piloting.follow import Follower, together
from aerial_il.teleop.piloting.shaping import Shaper
from aerial_il.teleop.piloting.targets import Obs, heading, targets_for

JOINT_LEVELS = ("base_joint", "velocity")
PILOT = 2  # raised by who changes what a frame does: speeds, ramps, the dead man; logs of before are refused by name


def check_leader(level: str, bindings: Bindings) -> None:
    """Refuse a leader arm where joints are not commanded.

    Raises:
        InvalidValueError: names the levels where they are.
    """
    if level not in JOINT_LEVELS and any(joint in bindings.axes for joint in JOINTS):
        raise InvalidValueError(
            f"A leader arm commands joints, which action={level} has none of. Take action=base_joint or "
            "action=velocity, or leave the arm out of devices=[...]."
        )


class ManualPilot:
    """A person's hands on one vehicle: turns frames of a device into actions.

    Args:
        spec: the environment. vehicle: what flies in it. bindings: what the frames' bits mean.
        mode: what sticks mean at first; None for the level's default.

    Raises:
        UnknownNameError: an action level or mode that cannot be flown.
    """

    def __init__(self, spec: EnvSpec, vehicle: Vehicle, bindings: Bindings, mode: str | None = None) -> None:
        check_level(spec.action.level)
        check_leader(spec.action.level, bindings)
        self.modes = modes_of(spec.action.level, vehicle)
        if mode is not None and mode not in self.modes:
            raise UnknownNameError("mode", mode, self.modes)
        self.mode = mode or self.modes[0]
        self.bindings, self._spec = bindings, spec
        self._grips = spec.action.labels[-1:] == ("gripper",)
        self._targets = targets_for(spec.action.level, vehicle)
        self._shaper, self._dead_man, self._follower = Shaper(), DeadMan(), Follower()
        self.command, self.opening, self.dead, self.precise = Command(), 1.0, True, False

    def engage(self, obs: Obs, action: np.ndarray | None = None) -> None:
        """Take over at what the vehicle does now, without a jerk.

        Args:
            obs: what the vehicle shows. action: (Da,) commanded last; the gripper goes on by it, for fingers that
                hold something stand wider than is commanded.
        """
        self._shaper.stop()
        self._follower.let_go()
        self._targets.seat(obs)
        self.command = Command()
        self.opening = float(obs["gripper"][0]) if "gripper" in obs else 1.0
        if action is not None and self._grips:
            self.opening = float(action[-1])

    def watch(self, frame: DeviceFrame) -> Intent:
        """Note who is there and what the sticks mean; return what they want."""
        intent = self.bindings.intent(frame)
        self.dead, self.precise = self._dead_man.step(frame.seq), "precision" in intent.held
        if "mode" in intent.pressed:
            self.mode = self.modes[(self.modes.index(self.mode) + 1) % len(self.modes)]
            self._shaper.stop()
        return intent

    def act(self, frame: DeviceFrame, obs: Obs) -> np.ndarray:
        """Return the action (Da,) of the coming tick.

        Args:
            frame: what the device shows. obs: what the vehicle shows, ``name -> (D,)``.
        """
        return self.fly(self.watch(frame), obs)

    def fly(self, intent: Intent, obs: Obs) -> np.ndarray:
        """Return the action (Da,) that ``intent``, which :meth:`watch` returned for this tick, asks for."""
        dt = self._spec.control_dt_s
        if self.dead:
            self._shaper.stop()
            self._follower.let_go()
            self.command = Command()
        else:
            self.command = self._wanted(intent, obs, dt)
            if "base_rot6d" in obs:
                self.command = eased(self.command, tilt_of(obs["base_rot6d"]))
        action = self._targets.step(self.command, obs, dt)
        if self._grips:
            closing = self.command.grip if intent.opening is None or self.dead else self._closing(intent.opening, dt)
            self.opening = min(1.0, max(0.0, self.opening - dt * closing))
            action = np.append(action, self.opening)
        return self.clip(action)

    def clip(self, action: np.ndarray) -> np.ndarray:
        """Return an action (Da,) within its bounds."""
        return self._spec.action.clip(action)

    def _wanted(self, intent: Intent, obs: Obs, dt: float) -> Command:
        """Return what sticks and keys, a clutched phone and a leader arm ask for together."""
        command = command_of(self._shaper.step(intent), self.mode, precise=self.precise)
        if intent.joints:
            command = replace(command, led=tuple(sorted(intent.joints.items())))
        if intent.pose is None or self.mode.startswith("joints"):
            self._follower.let_go()
            return command
        followed = self._follower.step(intent.pose, heading(obs), dt, closed_now="clutch" in intent.pressed)
        return together(command, followed if self.mode != "base" else replace(followed, turn=(0.0, 0.0)))

    def _closing(self, opening: float, dt: float) -> float:
        """Return the rate that brings the gripper to ``opening``, in openings per second."""
        return min(GRIP_RATE, max(-GRIP_RATE, (self.opening - opening) / dt))

    def settings(self) -> dict[str, Any]:
        """Return what a log must be flown with again, as plain values."""
        return {"pilot": PILOT, "mode": self.mode, "bindings": self.bindings.to_dict()}
