"""What of a path a robot cannot fly, as far as it can be told before it flies."""

import numpy as np

from aerial_il.core.specs import ActionSpec
from aerial_il.generation.plan import Path
from aerial_il.robots.figures import stance
from aerial_il.robots.poise import poised
from aerial_il.robots.robot import Robot

LOOKED_AT = 5  # instants of a path
MISSED_RAD = 0.35  # more than what arms give up to keep the tool in its place
ROTOR_MARGIN = 0.15  # of a rotor's range, to both its ends, at rest


def beyond(robot: Robot, commands: ActionSpec, path: Path) -> str | None:
    """Say why ``robot`` cannot fly ``path``, or None if nothing speaks against it.

    Looked at: the space that commands may name, the reach of a fixed arm, how far the arm of a flying robot can turn
    the tool, the height of its base, and what its rotors have left to hold the arm like that.
    """
    low, high = commands.low[:3], commands.high[:3]
    if ((path.pos < low) | (path.pos > high)).any():
        return "leave the space that commands may name, " + " by ".join(
            f"{a:g} to {b:g} m" for a, b in zip(low, high, strict=True)
        )
    looked_at = np.unique(np.linspace(0, len(path) - 1, LOOKED_AT).astype(int))
    if robot.fixed:
        reached = all(robot.reachable(path.there[k], path.faced[k]) for k in looked_at)
        return None if reached else "are out of its arm's reach"
    return next((why for k in looked_at if (why := _flying(robot, path, k))), None)


def _flying(robot: Robot, path: Path, k: int) -> str | None:
    joints, base, missed = poised(robot, path.faced[k])
    if missed > MISSED_RAD:
        return "ask its arm to turn the tool farther than it can"
    if path.there[k, 2] + base[2] < robot.base.hub_size[2]:
        return "would bring its base down to the ground"
    low, high = robot.vehicle.rotor_min, robot.vehicle.rotor_max
    thrust, room = stance(robot, "", joints).thrust, ROTOR_MARGIN * (high - low)
    if ((thrust < low + room) | (thrust > high - room)).any():
        return "leave its rotors no margin to hold the arm like that"
    return None
