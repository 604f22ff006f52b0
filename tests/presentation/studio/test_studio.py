"""The studio changes how a state looks to people, and nothing of what happens; its solids are closed."""

from collections import Counter

import mujoco
import numpy as np
import pytest

import aerial_il
from aerial_il.presentation.films.scene_renderer import SceneRenderer
from aerial_il.presentation.studio.propellers import SHUTTER_S, propellers, turn
from aerial_il.presentation.studio.solids import Solid, block, disc, propeller, tube
from aerial_il.presentation.studio.stage import staged
from aerial_il.presentation.studio.studio import MOVING, QUICK, STILL, Studio
from aerial_il.suite import tasks
from aerial_il.suite.physics.physics_batch import STATE
from aerial_il.suite.physics.rotors import thrusts_of
from aerial_il.suite.scenario import Scenario
from tests.presentation.conftest import Flown

HEIGHT, WIDTH = 48, 64
ROBOTS = sorted({robot for robot, _ in tasks.cells()})
CELLS = [*((robot, next(t for r, t in tasks.cells() if r == robot)) for robot in ROBOTS),
         *((next(r for r, t in tasks.cells() if t == task), task) for task in tasks.names())]  # fmt: skip


@pytest.mark.parametrize(("robot", "task"), CELLS)
def test_a_state_of_the_scene_is_one_of_its_stage(robot: str, task: str) -> None:
    scene = Scenario(robot, task)
    plain = scene.compile()
    stage = staged(plain, scene.xml)
    states = []
    for model in (plain, stage):
        data = mujoco.MjData(model)
        state = np.random.default_rng(0).normal(size=mujoco.mj_stateSize(plain, STATE))
        mujoco.mj_setState(model, data, state, STATE)
        mujoco.mj_kinematics(model, data)
        states.append(np.concatenate([data.xpos.ravel(), data.xquat.ravel(), data.site_xpos.ravel()]))
    np.testing.assert_array_equal(*states)
    assert stage.ngeom > plain.ngeom
    added = np.array([stage.geom(i).name.startswith("studio") for i in range(stage.ngeom)])
    assert not stage.geom_contype[added].any()
    np.testing.assert_array_equal(stage.body_mass, plain.body_mass)


@pytest.mark.render
def test_pictures_leave_flight_and_observations_alone() -> None:
    def fly(*, filmed: bool) -> list[np.ndarray]:
        env = aerial_il.load_batch("ua_quad_arm4", "reach", num_envs=1, num_threads=1, cameras=("wrist", "scene"),
                                   image_size=(HEIGHT, WIDTH))  # fmt: skip
        result, scene = [*env.reset(5).values()], SceneRenderer(env.model_xml) if filmed else None
        for _ in range(5):
            obs = env.step(np.zeros((1, env.spec.action.size))).obs
            if scene is not None:
                state = env.get_state()[0]
                scene.draw(state, scene.frame([state], WIDTH / HEIGHT), HEIGHT, WIDTH, exposures=QUICK)
            result += [*obs.values(), env.get_state()]
        if scene is not None:
            scene.close()
        env.close()
        return result

    for alone, watched in zip(fly(filmed=False), fly(filmed=True), strict=True):
        np.testing.assert_array_equal(alone, watched)


@pytest.mark.render
def test_shadows_are_softer_the_more_exposures(flown: Flown) -> None:
    with SceneRenderer(flown.episode.model_xml) as scene:
        state = flown.episode.states[-1]
        view = scene.frame([state], WIDTH / HEIGHT)
        shades = {}
        for exposures in (QUICK, MOVING, STILL):
            picture = scene.draw(state, view, HEIGHT, WIDTH, exposures=exposures).astype(int)
            floor = (np.ptp(picture, axis=2) < 14) & (picture.mean(axis=2) > 60)
            shades[exposures] = picture.mean(axis=2)[floor]
        lit = np.median(shades[QUICK])
        assert (shades[QUICK] < 0.8 * lit).sum() > 10
        between = {n: ((shade < 0.92 * lit) & (shade > 0.72 * lit)).sum() for n, shade in shades.items()}
        assert between[STILL] > between[QUICK]


def test_propellers_turn_with_the_root_of_their_thrust(flown: Flown) -> None:
    scene = mujoco.MjModel.from_xml_string(flown.episode.model_xml)
    studio = Studio(scene, flown.episode.model_xml)
    result, data = propellers(studio.model), studio.pose(flown.episode.states[50])
    assert len(result) == 4
    thrusts_of(data)[:2] = 8.0, 2.0
    fast, slow = (propeller.speed(data) for propeller in result[:2])
    assert fast == pytest.approx(2.0 * slow)
    still = data.geom_xmat.copy()
    seen = []
    for share in (0.0, 1.0):
        turn(data, result, still, share)
        seen.append(data.geom_xmat[result[0].geom].reshape(3, 3).copy())
    axis = data.site_xmat[result[0].site].reshape(3, 3)[:, 2]
    between = seen[1] @ seen[0].T
    angle = np.arccos(0.5 * (np.trace(between) - 1.0))
    assert angle == pytest.approx(fast * SHUTTER_S, rel=1e-6)
    np.testing.assert_allclose(between @ axis, axis, atol=1e-9)
    assert [p.sense for p in result] == [-1.0, 1.0, -1.0, 1.0]


SOLIDS = {
    "block": (block((0.1, 0.05, 0.02), 0.01), 8 * 0.1 * 0.05 * 0.02),
    "disc": (disc(0.1, 0.02, 0.002), np.pi * 0.1**2 * 0.04),
    "tube": (tube(0.3, (0.02, 0.02, 0.02)), np.pi * 0.02**2 * 0.3),
}


@pytest.mark.parametrize("name", SOLIDS)
def test_it_is_closed_and_about_as_large_as_said(name: str) -> None:
    solid, volume = SOLIDS[name]
    assert 0.85 * volume < volume_of(solid) < volume
    assert set(edges_of(solid).values()) == {0}


@pytest.mark.parametrize("name", [*SOLIDS, "propeller"])
def test_normals_are_unit_vectors_that_point_outwards(name: str) -> None:
    solid = propeller(0.12, 2, True) if name == "propeller" else SOLIDS[name][0]
    np.testing.assert_allclose(np.linalg.norm(solid.normals, axis=1), 1.0, atol=1e-6)
    a, b, c = (solid.points[solid.faces[:, k]] for k in range(3))
    outwards = np.cross(b - a, c - a)
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    along = np.einsum("fj,fj->f", outwards, solid.normals[solid.faces].mean(axis=1))
    assert (along > 0.0).mean() > 0.98


def test_a_propeller_is_as_wide_as_its_rotor() -> None:
    one, other = propeller(0.12, 2, True), propeller(0.12, 2, False)
    assert np.linalg.norm(one.points[:, :2], axis=1).max() == pytest.approx(0.12, rel=0.02)
    np.testing.assert_allclose(one.points.mean(axis=0), 0.0, atol=1e-3)
    tilt = [np.corrcoef(s.points[s.points[:, 0] > 0, 1], s.points[s.points[:, 0] > 0, 2])[0, 1] for s in (one, other)]
    assert tilt[0] * tilt[1] < 0.0


def volume_of(solid: Solid) -> float:
    a, b, c = (solid.points[solid.faces[:, k]] for k in range(3))
    return float(np.einsum("fj,fj->", a, np.cross(b, c)) / 6.0)


def edges_of(solid: Solid) -> Counter:
    """How often each edge, told by its ends' places, is gone along one way more than the other."""
    place = {tuple(p): i for i, p in enumerate(np.round(solid.points, 9))}
    number = [place[tuple(p)] for p in np.round(solid.points, 9)]
    count: Counter = Counter()
    for face in solid.faces:
        for k in range(3):
            a, b = number[face[k]], number[face[(k + 1) % 3]]
            if a != b:
                count[min(a, b), max(a, b)] += 1 if a < b else -1
    return count
