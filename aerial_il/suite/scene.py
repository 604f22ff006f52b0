"""Assemble one scene: physics settings, arena, robot, the task's props, contact sensors."""

from __future__ import annotations

import mujoco
import numpy as np

from aerial_il.robots.parts.camera import look_along
from aerial_il.robots.parts.collision import WORLD
from aerial_il.robots.robot import Robot
from aerial_il.suite.physics.contact_sensors import add_contact_sensor
from aerial_il.suite.physics.episode_state import USERDATA_SIZE
from aerial_il.suite.props.contact import HARD
from aerial_il.suite.tasks.task import Task
from aerial_il.suite.timing import PHYSICS_DT_S

# From the accelerations of the step before, the solver's line search takes 11 evaluations a step; from rest it takes 5.
DISABLED = int(mujoco.mjtDisableBit.mjDSBL_WARMSTART | mujoco.mjtDisableBit.mjDSBL_ISLAND)
ARENA_BYTES = 1 << 21  # ten times what a scene was seen to need; MuJoCo ends the process where it does not suffice
GROUND_M = [50.0, 50.0, 10.0]  # half sizes and grid as drawn; endless, a picture takes four times as long
EXTENT_M = 1.3  # of what is looked at: sets the nearest and farthest that cameras see, at 0.01 and 50 times as much
SCENE_SPAN_M, SCENE_RETREAT = 1.1, 0.4  # widest robot that fits the picture, and share of the way back per m beyond
SCENE_AWAY = np.array([1.55, -1.75, 1.40 - 0.9])  # m, from what it looks at to the camera


def build_xml(robot: Robot, task: Task, memory: int = USERDATA_SIZE) -> str:
    """Return the scene as stand-alone MJCF, the one text from which every environment compiles its model.

    Args:
        memory: numbers that an episode remembers beyond the physics.
    """
    spec = mujoco.MjSpec()
    spec.modelname = f"{robot.name}-{task.name}"
    spec.compiler.degree = False
    spec.nuserdata = memory
    spec.memory = ARENA_BYTES
    set_physics(spec)
    _set_visuals(spec)
    _add_arena(spec)
    _add_scene_camera(spec, robot, task)
    robot.add_to(spec)
    _unplug_rotors(spec, robot)
    task.add_props(spec, robot)
    _add_contact_sensors(spec, robot)
    spec.compile()
    return spec.to_xml()


def set_physics(spec: mujoco.MjSpec) -> None:
    """Integrator, solver and contact model of every scene."""
    option = spec.option
    option.timestep = PHYSICS_DT_S
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = 10.0
    option.iterations, option.ls_iterations = 50, 50
    option.disableflags |= DISABLED


def _set_visuals(spec: mujoco.MjSpec) -> None:
    visual = spec.visual
    visual.quality.offsamples = 0
    visual.quality.shadowsize = 0
    visual.global_.offwidth, visual.global_.offheight = 1280, 960
    visual.headlight.ambient = [0.45, 0.45, 0.45]
    visual.headlight.diffuse = [0.25, 0.25, 0.25]
    visual.headlight.specular = [0.0, 0.0, 0.0]
    visual.map.znear = 0.01
    spec.stat.extent = EXTENT_M


def _add_arena(spec: mujoco.MjSpec) -> None:
    """Ground plane at z = 0, sky and one light."""
    spec.add_texture(
        name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.80, 0.87, 0.94], rgb2=[0.95, 0.97, 0.99], width=64, height=64,
    )  # fmt: skip
    spec.add_texture(
        name="grid", type=mujoco.mjtTexture.mjTEXTURE_2D, builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=[0.80, 0.82, 0.84], rgb2=[0.86, 0.87, 0.89], width=128, height=128,
    )  # fmt: skip
    material = spec.add_material(name="grid", texrepeat=[4, 4], texuniform=True, reflectance=0.0)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "grid"
    plane = mujoco.mjtGeom.mjGEOM_PLANE
    spec.worldbody.add_geom(name="ground", type=plane, size=GROUND_M, material="grid", **WORLD, **HARD)
    sun = spec.worldbody.add_light(name="sun", pos=[1, -2, 4], dir=[-0.3, 0.5, -1], castshadow=False)
    sun.type, sun.diffuse, sun.specular = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, [0.45] * 3, [0.1] * 3


def _add_scene_camera(spec: mujoco.MjSpec, robot: Robot, task: Task) -> None:
    """The fixed camera ``scene``, which looks where the task says; stepped back and raised for a wide robot."""
    excess = max(0.0, robot.base.span - SCENE_SPAN_M)
    away = task.scene_distance * SCENE_AWAY * (1.0 + SCENE_RETREAT * excess)
    centre = np.array([0.0, 0.0, task.scene_height_m + 0.15 * excess])
    spec.worldbody.add_camera(name="scene", pos=centre + away, quat=look_along(-away), fovy=42)


def _unplug_rotors(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Take the rotors' actuators out: the flight loop pushes the base itself, for less than MuJoCo's transmissions."""
    for i in range(robot.num_rotors):
        spec.delete(spec.actuator(f"rotor_{i}"))


def _add_contact_sensors(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Count contacts of the base (hub and rotor discs) and of every link: only the gripper may touch something."""
    add_contact_sensor(spec, "contact_base", body="base")
    for i in range(robot.num_joints):
        add_contact_sensor(spec, f"contact_link_{i}", body=f"link_{i}")
