"""Take off: rise from the ground to a point and stand still there, heading as asked."""

from __future__ import annotations

import mujoco
import numpy as np

from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import closeness
from aerial_il.robots.robot import Robot
from aerial_il.suite.physics.view import View
from aerial_il.suite.props.place import place
from aerial_il.suite.props.skids import add_skids, standing
from aerial_il.suite.tasks import hover
from aerial_il.suite.tasks.task import TaskKernels, hover_start

SIDEWAYS_M = 0.3  # at most, from the start to below the target
RISE_M = 0.5  # at which half of what coming nearer earns is left


class TakeOff(hover.Hover):
    """From its skids, rotors at rest, to within 5 cm of a point and 3° of the trimmed attitude for 1 s.

    The point is 0.8 to 1.0 m above the ground and at most 0.3 m away. The trimmed attitude is that of ``hover``. A hub
    or a rotor that strikes the ground is a crash; skids may touch it again.
    """

    name = "take_off"
    instruction = "Take off, hover at the marked point and face along the arrow."
    wordings = (
        "Take off and hover at the marked point.",
        "Fly up and hover, facing along the arrow.",
        "起飞，在标记点悬停，机头沿箭头方向。",
        "起飞并悬停。",
    )
    held_out = ("Take off, then hover at the mark.", "请起飞。")
    scene_height_m = 0.5

    def own_infeasibility(self, robot: Robot) -> str | None:
        return "its arm is where the landing gear would be" if robot.num_joints else None

    def add_props(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        super().add_props(spec, robot)
        add_skids(spec)

    def start(self, view: View, world: int, rng: np.random.Generator) -> None:
        target, heading = rng.uniform(hover.TARGET_LOW, hover.TARGET_HIGH), rng.uniform(*hover.HEADING_RANGE_RAD)
        place(view, world, "target", target, yaw=heading)
        aside = target[:2] + rng.uniform(-SIDEWAYS_M, SIDEWAYS_M, 2) / np.sqrt(2.0)
        hover_start(view, world, standing(aside), rng.uniform(*hover.HEADING_RANGE_RAD))
        view.thrust[world] = view.rotor_command[world] = 0.0


@kernel
def reward(world):
    return 0.3 * closeness(hover.distance(world), RISE_M) + 0.7 * hover.reward(world)


TASK = TakeOff(TaskKernels(observe=hover.observe, solved=hover.solved, progress=hover.progress, reward=reward))
