"""What a robot can follow: a chunk is changed, while it is denoised, towards poses that its tool will reach.

The tool is modelled as a point and a frame that follow commanded poses as a robot's controller would in free air:

    acceleration = p (reference - position) + d (reference's velocity - velocity),   limited, and so is the velocity;
    turn = 4/s of what is missing, limited

with gains and limits of the flight controller, fitted to the robot (slow rotors slow all of them down), and less
acceleration where it has to tilt first. Commands here run ahead of the tool, so that no robot is where they are. The
cost of a chunk is therefore the squared distance between what this robot reaches and what the robot that demonstrated
would, at eight moments of it; its gradient by the commanded poses is limited at each. Where both models are alike, as
of vehicles with quick rotors that need not tilt, there is nothing to lead to.

The model stands in place of the source's predictive controller. It knows neither the arm's posture nor contact,
payload, wind or latency. What the source moves is the noisy chunk; here it is what is told of the clean one.

Source: H. Gupta et al., "UMI-on-Air: Embodiment-Aware Guidance for Embodiment-Agnostic Visuomotor Policies", 2025 (cost
over 8 poses, limits of 0.05 and 0.005, scale 1.5 times the share of the signal's variance).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from aerial_il.control.reference import TURN_APPROACH
from aerial_il.control.vehicle import Gains
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.tensors import tensor
from aerial_il.policies.parts.layout import TOOL, Interface, to_offsets
from aerial_il.policies.parts.relative import POSE, rotations
from aerial_il.robots.robot import Robot

MOMENTS = 8
MOST_M, MOST_ROT6D = 0.05, 0.005  # of the gradient at one moment
UNDER_SHARE = 0.5  # of the acceleration, where a vehicle has to tilt before it moves sideways: a guess
VELOCITY = "base_vel"


@dataclass(frozen=True)
class Follower:
    """How the tool of one robot follows commanded poses; SI units, numbers or (B, 1) of B robots."""

    stiffness: Any
    damping: Any
    acceleration: Any
    speed: Any
    turn: Any

    @staticmethod
    def of(robot: Robot) -> Follower:
        """Return the model of a robot.

        Raises:
            InvalidValueError: it has no arm to hold a tool, or does not fly.
        """
        if robot.fixed or not robot.num_joints:
            lacking = "stands fixed" if robot.fixed else "has no arm, and so no tool of its own"
            raise InvalidValueError(f"execution.guidance needs a robot that flies with a tool; {robot.name} {lacking}.")
        gains = Gains().fitted(robot.vehicle)
        share = UNDER_SHARE if robot.actuation == "under" else 1.0
        return Follower(
            gains.position, gains.velocity, share * gains.reference_acceleration, gains.reference_speed,
            gains.reference_turn,
        )  # fmt: skip

    def beside(self, other: Follower, count: int) -> Follower:
        """Return ``count`` robots like this one, and as many like the other."""
        pairs = torch.tensor([astuple(self), astuple(other)]).repeat_interleave(count, 0)
        return Follower(*pairs.split(1, -1))

    def reached(self, commanded: Tensor, start: Tensor, velocity: Tensor, interval_s: float) -> Tensor:
        """Return the poses (B, K, 9) that the tool has at the end of each interval, of those that are commanded.

        Args:
            commanded: (B, K, 9), each for one interval. start: (B, 9), velocity: (B, 3) of the tool now.
        """
        pos, turned, reached = start[:, :3], start[:, 3:], []
        rates = torch.diff(commanded[..., :3], dim=1, append=commanded[:, -1:, :3]) / interval_s
        for target, rate in zip(commanded.unbind(1), rates.unbind(1), strict=True):
            pull = self.stiffness * (target[:, :3] - pos) + self.damping * (rate - velocity)
            velocity = _limited(velocity + interval_s * _limited(pull, self.acceleration), self.speed)
            pos = pos + interval_s * velocity
            turned = turned + interval_s * _limited(TURN_APPROACH * (target[:, 3:] - turned), self.turn)
            reached.append(torch.cat([pos, turned], -1))
        return torch.stack(reached, 1)


def steering(
    followers: tuple[Follower, Follower],
    interface: Interface,
    history: np.ndarray,
    velocity_world: np.ndarray,
    guidance: float,
) -> Callable[[Tensor], Tensor]:
    """Return what normalised chunks (B, C), denoised after ``history``, are changed by.

    Args:
        followers: of the robot, and of the one that demonstrated. interface: of the policy.
        history: (B, To, Do) that it sees. velocity_world: (B, 3) of the robot's base. guidance: how strongly.
    """
    layout, scale = interface.layout, tensor(interface.action.scale)
    centre, dt = tensor(interface.action.centre), layout.spec.control_dt_s
    tool = layout.tool_of(history[:, -1])
    stay = np.zeros((len(tool), 1, layout.spec.action.size))
    stay[:, 0, :POSE] = tool
    start = tensor(to_offsets(layout, stay, history)[:, 0, :POSE].astype(np.float32))
    velocity = np.asarray(velocity_world)
    if layout.relative:
        velocity = np.einsum("nji,nj->ni", rotations(tool[:, 3:]), velocity)
    moving, both = tensor(velocity.astype(np.float32)), followers[0].beside(followers[1], len(tool))

    def steer(chunks: Tensor) -> Tensor:
        actions = chunks.unflatten(-1, (-1, len(scale))) * scale + centre
        steps = actions.shape[1]
        moments = torch.linspace(0, steps - 1, min(MOMENTS, steps)).round().long()
        interval_s = dt * max(1.0, (steps - 1) / max(1, len(moments) - 1))
        with torch.enable_grad():
            commanded = actions[:, moments, :POSE].detach().requires_grad_()
            poses, begin, speed = (torch.cat([each, each]) for each in (commanded, start, moving))
            reached, meant = both.reached(poses, begin, speed, interval_s).chunk(2)
            (grad,) = torch.autograd.grad((reached - meant).square().sum(), commanded)
        grad = torch.cat([_limited(grad[..., :3], MOST_M), _limited(grad[..., 3:], MOST_ROT6D)], -1)
        spread = functional.interpolate(grad.mT, size=steps, mode="linear", align_corners=True).mT
        change = torch.zeros_like(actions)
        change[..., :POSE] = -guidance * spread / scale[:POSE]
        return change.flatten(1)

    return steer


def check_steerable(interface: Interface, shown: tuple[str, ...]) -> None:
    """Refuse a policy, or an environment that shows ``shown``, of which the model knows too little.

    Raises:
        InvalidValueError: names what is missing.
    """
    level, names = interface.layout.spec.action.level, interface.layout.names
    if level != "ee_pose":
        raise InvalidValueError(f"execution.guidance needs a policy that commands ee_pose; this one commands {level}.")
    if missing := [*({*TOOL} - {*names}), *({VELOCITY} - {*shown})]:
        raise InvalidValueError(f"execution.guidance needs {', '.join(sorted(missing))}, which is not observed here.")


def _limited(vectors: Tensor, most: float) -> Tensor:
    """Return ``vectors`` (..., k) no longer than ``most``."""
    length = (vectors.square().sum(-1, keepdim=True) + 1e-12).sqrt()
    return vectors * (most / length).clamp(max=1.0)
