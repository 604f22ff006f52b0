"""What `place_orange` and `place_green` share: one scene, one observation, and two instructions.

Nothing that is seen tells the two tasks apart: which cube is meant is a matter of what the robot is told.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import mujoco
import numpy as np

from aerial_il.control.dynamics import put
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import planar_norm, sub
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.physics.contact_sensors import add_contact_sensor, add_touch_sensor
from aerial_il.suite.physics.view import View
from aerial_il.suite.physics.world import Names, site_pos, tool_pos, touching
from aerial_il.suite.props import CUBE_HALF_M, TABLE_HEIGHT_M, add_bowl, add_cube, add_table
from aerial_il.suite.props.place import places_apart
from aerial_il.suite.tasks import pick_place
from aerial_il.suite.tasks.fields import direction, seen
from aerial_il.suite.tasks.pick_place import (
    AREA_HIGH,
    AREA_LOW,
    BOWL,
    IN_BOWL_M,
    START_HIGH,
    START_LOW,
    PickPlace,
    heading_of,
    workable,
)
from aerial_il.suite.tasks.task import TaskKernels, hover_start

COLOURS = {"orange": (0.95, 0.45, 0.12, 1.0), "green": (0.25, 0.62, 0.28, 1.0)}
APART_M = 0.17
OTHER = 2  # site; the cube that is meant is the first
STACKED_M = 0.10  # over the bowl's underside; a cube on a cube in the bowl is 0.07
ROBOT_ON_OTHER = 3  # contact


def names_of(cube: str, other: str) -> Names:
    """Return what a task reads whose cube is ``cube``: its own first, as `pick_place` numbers them."""
    return Names(
        sites=(f"{cube}_cube", "bowl", f"{other}_cube"),
        joints=(f"{cube}_cube", f"{other}_cube"),
        contacts=(f"grip_left_{cube}", f"grip_right_{cube}", f"robot_on_{cube}", f"robot_on_{other}"),
    )


class TwoCubes(PickPlace):
    """One of two cubes, which one the instruction says, is put into the bowl."""

    def add_props(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        add_table(spec)
        add_bowl(spec)
        for colour, rgba in COLOURS.items():
            add_cube(spec, f"{colour}_cube", rgba)
            for side in ("left", "right"):
                add_contact_sensor(spec, f"grip_{side}_{colour}", geoms=(f"pad_{side}", f"{colour}_cube"))
            add_touch_sensor(spec, f"robot_on_{colour}", f"{colour}_cube")

    def start(self, view: View, world: int, rng: np.random.Generator) -> None:
        hover_start(view, world, rng.uniform(START_LOW, START_HIGH), rng.uniform(-0.3, 0.3))
        reach = partial(workable, view.robot)
        while not all(map(reach, places := places_apart(rng, AREA_LOW, AREA_HIGH, 3, apart=APART_M))):
            pass
        *cubes, bowl = places
        for colour, cube in zip(COLOURS, cubes, strict=True):
            yaw = rng.uniform(-np.pi, np.pi)
            pose, _ = view.free_joint(f"{colour}_cube")
            lying = TABLE_HEIGHT_M + CUBE_HALF_M
            view.qpos[world, pose] = [*cube, lying, np.cos(0.5 * yaw), 0.0, 0.0, np.sin(0.5 * yaw)]
        view.mocap_pos[world, view.mocap_id("bowl")] = [*bowl, TABLE_HEIGHT_M]

    def fields(self) -> tuple[Field, ...]:
        return (*(field for colour in COLOURS for field in _fields_of(colour)), seen("bowl_pos", "middle of the bowl"))


def _fields_of(colour: str) -> tuple[Field, ...]:
    return (
        seen(f"{colour}_pos", f"centre of the {colour} cube"),
        direction(f"{colour}_heading", "of four times its yaw, the same for all four faces", labels=("cos4", "sin4")),
        seen(f"tool_to_{colour}", f"from the tool to the {colour} cube"),
        seen(f"{colour}_to_bowl", f"from the {colour} cube to the bowl"),
    )


@kernel
def observe_both(world, found, orange, green):
    """Write the fields, with the sites of both cubes by their numbers."""
    for k in range(2):
        site = orange if k == 0 else green
        cube, start = site_pos(world, site), 11 * k
        put(found, start, cube)
        found[start + 3], found[start + 4] = heading_of(world, site)
        put(found, start + 5, sub(cube, tool_pos(world)))
        put(found, start + 8, sub(site_pos(world, BOWL), cube))
    put(found, 22, site_pos(world, BOWL))


@kernel
def solved(world):
    """Whether the cube that is meant lies in the bowl, and the other does not."""
    return pick_place.solved(world) and not other_in_bowl(world)


@kernel
def lost(world):
    """Whether the wrong cube was let go of in the bowl, or the right one is out of reach."""
    return pick_place.lost(world) or (other_in_bowl(world) and not touching(world, ROBOT_ON_OTHER))


@kernel
def other_in_bowl(world):
    """Whether the other cube lies in the bowl, or on what lies there."""
    offset = sub(site_pos(world, OTHER), site_pos(world, BOWL))
    return planar_norm(offset) <= IN_BOWL_M and 0.0 <= offset[2] <= STACKED_M


def kernels_with(observe: Callable[..., Any]) -> TaskKernels:
    """Return the kernels of a task of the family: what is not of two cubes is that of `pick_place`."""
    return TaskKernels(
        observe=observe,
        solved=solved,
        progress=pick_place.progress,
        reward=pick_place.reward,
        lost=lost,
    )
