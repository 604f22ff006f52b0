"""Objects that fall: nothing passes through a table, and one out of reach for good ends the episode."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import gymnasium
import mujoco
import numpy as np
import pytest

import aerial_il
from aerial_il.collection.collect import collect
from aerial_il.core.specs import EnvSpec
from aerial_il.data.dataset import open_dataset
from aerial_il.evaluation.rollouts import evaluate
from aerial_il.presentation.films.video import end_of
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.props import CUBE_HALF_M, TABLE_HEIGHT_M
from aerial_il.suite.props.peg import PEG_RADIUS_M
from tests.contract.registered import batch, hold_actions
from tests.suite.drops import drop, loose_objects, places_of, props_of

ROBOT = "fa_hexa_arm4"
LOOSE = (("pick_place", "cube", CUBE_HALF_M), ("insert_peg", "peg", PEG_RADIUS_M))
each_loose = pytest.mark.parametrize(("task", "name", "radius"), LOOSE)


def put(worlds: BatchEnvironment, name: str, pos: tuple[float, float, float], world: int = 0) -> None:
    """Lay an object down in one world."""
    view = worlds.simulation.view
    pose, speed = view.free_joint(name)
    view.qpos[world, pose] = [*pos, np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0]
    view.qvel[world, speed] = 0.0
    worlds.set_state(worlds.get_state())


@each_loose
def test_what_falls_off_the_table_ends_the_episode(task: str, name: str, radius: float) -> None:
    worlds = batch(ROBOT, task)
    worlds.reset(0)
    put(worlds, name, (0.0, 0.9, 0.6), world=1)
    put(worlds, name, (0.1, 0.0, TABLE_HEIGHT_M + radius), world=2)
    stay, first = hold_actions(worlds), None
    for step in range(40):
        result = worlds.step(stay)
        if result.info["dropped"].any():
            first = first or step
            assert result.info["dropped"].tolist() == result.terminated.tolist() == [False, True, False]
    assert first is not None, "it fell for a third of a second, and was lost on the way"
    assert not result.info["success"].any()
    assert not result.info["crash"].any()


@each_loose
def test_what_was_lost_stays_lost(task: str, name: str, radius: float) -> None:
    worlds = batch(ROBOT, task)
    worlds.reset(0)
    put(worlds, name, (0.0, 0.9, radius))
    put(worlds, name, (0.2, 0.2, radius), world=1)  # under the table
    stay = hold_actions(worlds)
    assert worlds.step(stay).info["dropped"].tolist() == [True, True, False]
    put(worlds, name, (0.1, 0.0, TABLE_HEIGHT_M + radius))
    assert worlds.step(stay).info["dropped"][0]
    worlds.reset(0)
    assert not worlds.step(stay).info["dropped"].any()


def test_an_arm_that_cannot_fly_loses_what_lies_too_far_off() -> None:
    worlds = batch("z1", "pick_place")
    worlds.reset(0)
    put(worlds, "cube", (0.38, 0.48, TABLE_HEIGHT_M + CUBE_HALF_M))
    put(worlds, "cube", (0.2, 0.2, TABLE_HEIGHT_M + CUBE_HALF_M), world=1)
    stay = hold_actions(worlds)
    for _ in range(10):
        result = worlds.step(stay)
    far = worlds.simulation.view.site_pos("cube") - worlds.simulation.view.base_pos
    reach = worlds.simulation.robot.longest_reach
    assert result.info["dropped"].tolist() == (np.linalg.norm(far, axis=1) > reach).tolist() == [True, False, False]


class Thrower:
    """Flies as the expert does, and throws the object of one seed away."""

    def __init__(self, task: str, name: str, seed: int) -> None:
        self.expert, self.name, self.seed = aerial_il.expert(ROBOT, task), name, seed

    @property
    def spec(self) -> EnvSpec:
        return self.env.spec

    def attach(self, env: BatchEnvironment) -> None:
        self.env = env
        self.expert.attach(env)

    def reset(self, mask: np.ndarray | None = None) -> None:
        self.expert.reset(mask)

    def act(self, obs: dict[str, np.ndarray]) -> np.ndarray:
        simulation = self.env.simulation
        for world in np.flatnonzero((simulation.seeds == self.seed) & (simulation.steps == 5)):
            pose, _ = simulation.view.free_joint(self.name)
            simulation.view.qpos[world, pose] = [0.0, 0.9, 0.3, 1.0, 0.0, 0.0, 0.0]
        return self.expert.act(obs)


@each_loose
def test_evaluation_and_recording_give_the_reason(task: str, name: str, radius: float, tmp_path: Path) -> None:
    env = batch(ROBOT, task)
    result = evaluate(env, Thrower(task, name, 11), [10, 11, 12], policy_name="thrower", progress=False)
    assert [episode.end for episode in result.episodes] == ["success", "dropped", "success"]
    assert result.metrics["dropped"]["count"] == result.metrics["ends"]["dropped"] == 1
    assert result.metrics["crash"]["count"] == 0
    collect(env, Thrower(task, name, 11), [10, 11, 12], tmp_path, policy_name="thrower", progress=False)
    failed = list(open_dataset(tmp_path, failures=True))
    assert [(episode.seed, end_of(episode)) for episode in failed if not episode.success] == [(11, "dropped")]


def test_gymnasium_says_so_with_the_same_keys_from_the_start_on() -> None:
    with gymnasium.make(f"aerial_il/pick_place-{ROBOT}-v0") as env:
        _, first = env.reset(seed=0)
        view = env.unwrapped.aerial.simulation.view
        _, _, terminated, _, info = env.step(env.action_space.sample())
        assert info.keys() == first.keys()
        assert not terminated
        pose, _ = view.free_joint("cube")
        view.qpos[0, pose] = [0.0, 0.9, 0.1, 1.0, 0.0, 0.0, 0.0]
        _, _, terminated, _, info = env.step(env.action_space.sample())
        assert (terminated, info["dropped"], info["crash"]) == (True, True, False)


ALIKE = (
    "peg_green",
    "peg_blue",
    "cube_yellow",
    "cube_purple",
    "ripe_b",
    "unripe_a",
    "unripe_b",
)  # in shape and mass to one that is dropped
each_object = pytest.mark.parametrize(("task", "joint"), [each for each in loose_objects() if each[1] not in ALIKE])
FEW, MANY = 40, 1000


def faults(task: str, joint: str, model: mujoco.MjModel, drops: int) -> Counter[str]:
    """How often each fault occurred, and how often none did."""
    places = places_of(task)
    return Counter(name for seed in range(drops) for name in drop(model, joint, places, seed).faults or ("none",))


@each_object
@pytest.mark.parametrize("drops", [FEW, pytest.param(MANY, marks=pytest.mark.slow)])
def test_what_is_dropped_comes_to_rest_on_top(task: str, joint: str, drops: int) -> None:
    assert faults(task, joint, props_of(task, joint).compile(), drops) == {"none": drops}


def test_loose_objects_are_listed() -> None:
    assert {("pick_place", "cube"), ("insert_peg", "peg")} <= set(loose_objects())


def test_a_soft_thin_table_lets_things_through() -> None:
    """The check can fail: a peg without balls for noses, over boards as soft as MuJoCo makes them by itself."""
    spec = props_of("insert_peg", "peg")
    for geom in spec.geoms:
        geom.solref, geom.solimp, geom.solmix = [0.02, 1.0], [0.9, 0.95, 0.001, 0.5, 2.0], 1.0
    top = spec.geom("table")
    top.pos[2], top.size[2] = top.pos[2] + top.size[2] - 0.015, 0.015
    for name in ("peg_nose", "peg_tail"):
        spec.delete(spec.geom(name))
    assert faults("insert_peg", "peg", spec.compile(), FEW)["passed through"] > 0.1 * FEW


def test_springs_without_damping_give_no_rest() -> None:
    """The check can fail: without friction or damping in the contact, an object bounces on and on."""
    spec = props_of("pick_place", "cube")
    for geom in spec.geoms:
        geom.solref, geom.solmix = [-2e4, 0.0], 1.0
    found = faults("pick_place", "cube", spec.compile(), FEW)
    assert found["not at rest"] + found["gained energy"] + found["bounced higher than it fell from"] > 0.1 * FEW
