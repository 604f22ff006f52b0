"""A vehicle's nominal model as a MuJoCo model of its own, and random states of it."""

from dataclasses import dataclass

import mujoco
import numpy as np
import pytest

from aerial_il import robots
from aerial_il.control.dynamics import forward_kinematics
from aerial_il.control.scratch import FRAME_SIZE
from aerial_il.control.vehicle import GRAVITY, Vehicle

ROBOTS = [robots.get(name) for name in robots.names()]
VEHICLES = {robot.name: robot.vehicle for robot in ROBOTS if robot.num_joints and not robot.fixed}
each_vehicle = pytest.mark.parametrize("vehicle", VEHICLES.values(), ids=VEHICLES.keys())


def compile_nominal(vehicle: Vehicle, *, gravity: float = GRAVITY) -> mujoco.MjModel:
    """Base and links with exactly the masses of ``vehicle``; no armature, damping, contact or gripper."""
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.gravity = [0, 0, -gravity]
    body = spec.worldbody.add_body(
        name="base", mass=vehicle.base_mass, inertia=vehicle.base_inertia, explicitinertial=True
    )
    body.add_freejoint()
    for j in range(len(vehicle.link_mass)):
        body = body.add_body(
            name=f"link_{j}", pos=vehicle.link_offset[j], mass=vehicle.link_mass[j], ipos=vehicle.link_com[j],
            inertia=vehicle.link_inertia[j], explicitinertial=True,
        )  # fmt: skip
        body.add_joint(name=f"joint_{j}", axis=vehicle.link_axis[j])
    body.add_site(name="tool", pos=vehicle.tool_offset)
    return spec.compile()


@dataclass(frozen=True)
class State:
    """A state of a vehicle in MuJoCo's coordinates, and in the controller's."""

    data: mujoco.MjData
    pos: tuple[float, ...]
    rot: tuple[float, ...]
    vel: tuple[float, ...]
    omega: tuple[float, ...]
    joints: np.ndarray
    joint_vel: np.ndarray
    frames: np.ndarray


def random_state(model: mujoco.MjModel, vehicle: Vehicle, rng: np.random.Generator) -> State:
    """Any attitude, joints within their limits, speeds up to 2."""
    data, count = mujoco.MjData(model), len(vehicle.link_mass)
    data.qpos[:3] = rng.uniform(-1, 1, 3)
    data.qpos[3:7] = rng.standard_normal(4)
    data.qpos[3:7] /= np.linalg.norm(data.qpos[3:7])
    data.qpos[7 : 7 + count] = rng.uniform(vehicle.joint_low, vehicle.joint_high)
    data.qvel[:] = rng.uniform(-2, 2, model.nv)
    mujoco.mj_forward(model, data)
    rot = data.body("base").xmat.copy()
    omega = rot.reshape(3, 3) @ data.qvel[3:6]
    joints, frames = data.qpos[7 : 7 + count].copy(), np.empty((count + 1, FRAME_SIZE))
    pos, matrix = tuple(data.qpos[:3]), tuple(rot)
    forward_kinematics(vehicle.record, pos, matrix, joints, 0, frames)
    return State(data, pos, matrix, tuple(data.qvel[:3]), tuple(omega), joints, data.qvel[6 : 6 + count].copy(), frames)
