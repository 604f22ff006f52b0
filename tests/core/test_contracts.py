"""Specifications are compared as users read it, and the contracts are kept by all that is registered."""

from dataclasses import replace

import numpy as np
import pytest

import aerial_il
from aerial_il import experts
from aerial_il.core.contracts import (
    NO_PHASE,
    BatchEnv,
    Expert,
    LabellingPolicy,
    PhasedPolicy,
    Policy,
    PrivilegedPolicy,
    SharedControlPolicy,
    intervention_of,
    label_of,
    phase_names_of,
    phase_of,
)
from aerial_il.core.env_wrapper import BatchEnvWrapper
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import EnvSpec, Field, ObservationSpec, camera_name, image_name
from aerial_il.evaluation.baselines import Hover

MEMBERS = sorted(name for name in dir(BatchEnv) if not name.startswith("_"))
FIRST_CELLS = {task: robot for robot, task in reversed(aerial_il.list_cells())}


class Bare:
    """What anybody may hand in: nothing but ``act`` and ``reset``."""

    def act(self, obs: object) -> np.ndarray:
        return np.zeros((2, 3))

    def reset(self, mask: object = None) -> None: ...


def test_a_bare_policy_is_one_and_has_the_defaults() -> None:
    bare = Bare()
    assert isinstance(bare, Policy)
    for more in (PrivilegedPolicy, PhasedPolicy, LabellingPolicy, SharedControlPolicy):
        assert not isinstance(bare, more)
    assert phase_names_of(bare) == ()
    np.testing.assert_array_equal(phase_of(bare, 2), [NO_PHASE, NO_PHASE])
    assert not intervention_of(bare, 2).any()
    fallback = np.full((2, 3), np.nan)
    assert label_of(bare, fallback) is fallback


def test_what_a_policy_says_is_used() -> None:
    class Telling(Bare):
        phase_names = ("go",)
        phase = np.array([0, 0])
        expert_action = np.ones((2, 3))
        is_intervention = np.array([True, False])

    telling = Telling()
    assert phase_names_of(telling) == ("go",)
    assert phase_of(telling, 2) is telling.phase
    np.testing.assert_array_equal(label_of(telling, np.zeros((2, 3))), telling.expert_action)
    assert intervention_of(telling, 2) is telling.is_intervention


@pytest.mark.parametrize("task", experts.names())
def test_every_expert_keeps_the_contract_before_it_is_attached(task: str) -> None:
    """A collection writes the names of the phases down before the expert knows its worlds."""
    expert = aerial_il.expert(FIRST_CELLS[task], task)
    assert isinstance(expert, Expert)
    assert len(phase_names_of(expert)) >= 1


def test_batches_have_every_member() -> None:
    ours = aerial_il.load_batch("ua_quad_arm4", "reach", num_envs=2, num_threads=1)
    theirs = aerial_il.load_gymnasium("Pendulum-v1", num_envs=2)
    for env in (ours, theirs, BatchEnvWrapper(ours), BatchEnvWrapper(theirs)):
        missing = [name for name in MEMBERS if not hasattr(env, name)]
        assert not missing
    assert ours.engine
    assert theirs.engine is None
    assert theirs.drawn(3) == {}
    with pytest.raises(InvalidValueError, match="camera=scene: this environment has no cameras"):
        theirs.render()
    for policy in (aerial_il.expert("ua_quad_arm4", "reach"), Hover()):
        with pytest.raises(InvalidValueError, match="gymnasium:Pendulum-v1"):
            policy.attach(theirs)
    ours.close()
    theirs.close()


def test_a_wrapper_passes_everything_on() -> None:
    env = aerial_il.load_batch("ua_quad_arm4", "reach", num_envs=2, num_threads=1)
    wrapped = BatchEnvWrapper(env)
    np.testing.assert_array_equal(wrapped.reset(3)["ee_pos"], env.observe()["ee_pos"])
    actions, state = np.zeros((2, env.spec.action.size)), wrapped.get_state()
    result = wrapped.step(actions)
    wrapped.set_state(state)
    np.testing.assert_array_equal(env.step(actions).reward, result.reward)
    assert wrapped.drawn(7) == env.drawn(7)
    for name in ("num_envs", "spec", "ends_at_success", "engine", "model", "model_xml"):
        assert getattr(wrapped, name) is getattr(env, name)
    for name in ("seeds", "ctrl", "sim_time"):
        np.testing.assert_array_equal(getattr(wrapped, name), getattr(env, name))
    env.close()


def spec_of(robot: str, task: str) -> EnvSpec:
    env = aerial_il.load_batch(robot, task, num_envs=1, num_threads=1)
    env.close()
    return env.spec


def test_robot_and_task_come_first_missing_fields_once() -> None:
    mine, theirs = spec_of("fa_hexa_arm4", "pick_place"), spec_of("big_four_z1", "insert_peg")
    differing = mine.differences(theirs)
    assert differing[:2] == ["robot: 'fa_hexa_arm4' != 'big_four_z1'", "task: 'pick_place' != 'insert_peg'"]
    about = [difference for difference in differing if difference.startswith("observation.fields.cube_pos.")]
    assert about == ["observation.fields.cube_pos.shape: [3] != None"]
    assert "observation.fields.joint_pos.shape: [4] != [6]" in differing


def test_a_field_that_both_have_is_compared_in_full() -> None:
    spec = spec_of("fa_hexa_arm4", "reach")
    first, *rest = spec.observation.fields
    other = replace(spec, observation=ObservationSpec((replace(first, unit="km", dtype="float32"), *rest)))
    assert spec.differences(other) == [
        f"observation.fields.{first.name}.dtype: 'float64' != 'float32'",
        f"observation.fields.{first.name}.unit: {first.unit!r} != 'km'",
    ]
    assert spec.differences(spec) == []


def test_a_field_says_by_itself_whether_it_is_a_colour_image() -> None:
    colour, depth = Field("front", (4, 5, 3), "image", "uint8"), Field("a_rgb", (4, 5), "image", "float32")
    numbers = Field("b_rgb", (4, 5, 3), "proprio", "uint8")
    assert [field.is_colour for field in (colour, depth, numbers)] == [True, False, False]
    assert camera_name(image_name("wrist")) == "wrist"
