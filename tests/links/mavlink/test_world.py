"""The world behind the simulator: the suite's own physics, whoever commands the rotors at its rate."""

import numpy as np

from aerial_il.links.mavlink.channels import CHANNELS
from aerial_il.links.mavlink.world import CradledWorld
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.scenario import Scenario
from aerial_il.suite.timing import PHYSICS_DT_S, SUBSTEPS

ROBOT = "ua_quad_arm4"


def full(world: CradledWorld, share: float = 1.0) -> np.ndarray:
    vehicle = world.env.scenario.robot.vehicle
    return world.channels.controls(share * vehicle.rotor_max, vehicle.rest_down, 1.0)


def test_steps_at_the_physics_rate_are_those_of_a_control_step() -> None:
    coarse, fine = (BatchEnvironment(Scenario(ROBOT, "reach", "gusts", "rotor"), 1, 1) for _ in range(2))
    for env in (coarse, fine):
        env.reset(5)
    vehicle = coarse.scenario.robot.vehicle
    action = np.array([*(0.5 * vehicle.rotor_max), *vehicle.rest_down, 1.0])[None]
    for _ in range(10):
        coarse.step(action)
        for k in range(SUBSTEPS):
            fine.simulation.receive(action, fresh=k == 0)
            fine.simulation.fly(1)
    np.testing.assert_array_equal(coarse.get_state(), fine.get_state())


def test_it_stands_until_rotors_carry_it() -> None:
    world = CradledWorld(ROBOT, "reach", "gusts")
    start = world.motion
    for _ in range(100):
        world.step(full(world, 0.2), armed=True)
        world.step(full(world), armed=False)
    assert world.held
    np.testing.assert_array_equal(world.motion.pos, start.pos)
    for _ in range(100):
        world.step(full(world), armed=True)
    assert not world.held
    assert world.motion.pos[2] > start.pos[2] + 0.3


def test_specific_forces_add_up_to_the_motion() -> None:
    world = CradledWorld(ROBOT, "reach")
    for _ in range(60):
        before = world.motion
        world.step(full(world, 0.6), armed=True)
        after = world.motion
        np.testing.assert_allclose(after.pos, before.pos + PHYSICS_DT_S * after.vel, atol=1e-9)
    assert after.specific_force[2] > 9.81


def test_far_from_the_cradle_nothing_catches_it() -> None:
    world = CradledWorld(ROBOT, "reach")
    for _ in range(80):
        world.step(full(world), armed=True)
    for _ in range(400):
        world.step(np.zeros(CHANNELS), armed=False)
    assert not world.held
    assert world.crashed
