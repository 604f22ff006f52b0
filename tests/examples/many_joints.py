"""The hexarotor with each link of its arm in two halves: eight joints, the most that an arm may have."""

from dataclasses import replace

from aerial_il import robots
from aerial_il.robots.parts.arm import Arm

WHOLE = robots.get("fa_hexa_arm4")
HALVES = [
    replace(link, tip=tuple(0.5 * side for side in link.tip), mass=0.5 * link.mass)
    for link in WHOLE.arm.links
    for _ in range(2)
]
ROBOT = replace(
    WHOLE,
    name="many_joints",
    arm=Arm(tuple(HALVES), mount=WHOLE.arm.mount),
    rest_forward=tuple(angle for whole in WHOLE.rest_forward for angle in (0.5 * whole, 0.5 * whole)),
    rest_down=tuple(angle for whole in WHOLE.rest_down for angle in (0.5 * whole, 0.5 * whole)),
)
