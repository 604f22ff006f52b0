"""Policies of chunks: history, plan and memory of every world follow their definition, whatever is reset when."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aerial_il.algorithms.bc import BC
from aerial_il.core import checkpoint
from aerial_il.core.contracts import attach
from aerial_il.core.errors import CheckpointError, InvalidValueError, NonFiniteActionError, UnknownNameError
from aerial_il.core.specs import EnvSpec, Field, ObservationSpec
from aerial_il.policies import load_policy
from aerial_il.policies.diffusion import Diffusion
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.chunking import ActionPlan, ObservationHistory
from aerial_il.policies.parts.layout import Layout
from aerial_il.policies.parts.network import PolicySettings
from tests.algorithms.drift import Drift, demonstrations
from tests.algorithms.point_mass import SPEC, PointMassBatch
from tests.policies.test_registry import fresh_policy


def with_fields(spec: EnvSpec, *fields: Field) -> EnvSpec:
    return replace(spec, observation=ObservationSpec(fields))


def test_anchor_makes_positions_relative_and_actions_absolute() -> None:
    """Moving everything by one vector moves the commanded positions by it, as the end effector's column is blind."""
    policy, env = fresh_policy("mlp"), PointMassBatch(3)
    layout, obs = policy.interface.layout, env.reset(0)
    related = layout.relate(layout.flatten(obs))
    np.testing.assert_allclose(related[:, 9:12], obs["cube_pos"] - obs["ee_pos"])
    np.testing.assert_allclose(related[:, :3], obs["ee_pos"])
    policy.network.get_submodule("layers.1.0").weight.data[:, [0, 1, 2, 15, 16, 17]] = 0  # two frames of ee_pos
    before = policy.predict(np.repeat(layout.flatten(obs)[:, None], 2, 1))
    shift = np.array([0.1, -0.2, 0.05])
    moved = {k: v + shift if k.endswith("_pos") else v for k, v in obs.items()}
    after = policy.predict(np.repeat(layout.flatten(moved)[:, None], 2, 1))
    np.testing.assert_allclose(after[..., :3] - before[..., :3], np.broadcast_to(shift, (3, 5, 3)), atol=1e-5)
    np.testing.assert_allclose(after[..., 3:], before[..., 3:], atol=1e-5)


def test_without_an_anchor_positions_stay_in_the_world() -> None:
    obs = PointMassBatch(2).reset(0)
    layout = Layout(SPEC, SPEC.observation.state_names)
    frames = layout.relate(layout.flatten(obs))
    np.testing.assert_array_equal(frames, SPEC.observation.flatten(obs, layout.names))


def test_blindness_leaves_out_fields_unless_they_are_asked_for() -> None:
    assert "gripper" not in Layout.of(SPEC, MLP()).names
    assert Layout.of(SPEC, MLP(masked_fields=())).names == SPEC.observation.state_names
    assert Layout.of(SPEC, MLP(obs_names=("ee_pos", "gripper"))).names == ("ee_pos", "gripper")


def test_unknown_fields_anchors_and_images_are_refused() -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'cube_pos'"):
        Layout(SPEC, ("ee_pos", "cube_position"))
    with pytest.raises(UnknownNameError, match="anchor=null"):
        Layout(SPEC, ("ee_pos",), anchor="base_pos")
    with pytest.raises(InvalidValueError, match="is an image"):
        Layout(SPEC, ("scene_rgb",))


def test_a_missing_observation_is_named() -> None:
    obs = PointMassBatch(2).reset(0)
    del obs["goal_pos"]
    with pytest.raises(UnknownNameError, match="goal_pos"):
        fresh_policy("mlp").act(obs)


def test_another_number_of_worlds_needs_a_reset() -> None:
    policy = fresh_policy("mlp")
    policy.act(PointMassBatch(3).reset(0))
    with pytest.raises(InvalidValueError, match="3 worlds and was shown 2"):
        policy.act(PointMassBatch(2).reset(0))
    policy.reset()
    assert policy.act(PointMassBatch(2).reset(0)).shape == (2, 10)


def test_nan_is_told_with_its_field_and_worlds() -> None:
    policy, obs = fresh_policy("mlp"), PointMassBatch(4).reset(0)
    obs["cube_pos"][2, 1] = np.inf
    with pytest.raises(NonFiniteActionError, match="observation cube_pos in world 2") as caught:
        policy.act(obs)
    assert caught.value.worlds == (2,)
    broken = fresh_policy("mlp")
    next(broken.network.parameters()).data[:] = np.nan
    with pytest.raises(NonFiniteActionError, match="network output in world 0, 1"):
        broken.act(PointMassBatch(2).reset(0))


def test_actions_are_limited_to_their_bounds() -> None:
    policy, obs = fresh_policy("mlp"), PointMassBatch(4).reset(0)
    for parameter in policy.network.parameters():
        parameter.data *= 50
    action = policy.act(obs)
    assert ((action == SPEC.action.low) | (action == SPEC.action.high)).any()
    np.testing.assert_array_equal(action, SPEC.action.clip(action))


def test_it_flies_across_tiers_and_added_cameras_only() -> None:
    policy = fresh_policy("mlp")
    fields = SPEC.observation.fields
    camera = Field("wrist_rgb", (8, 8, 3), "image", dtype="uint8")
    policy.check(replace(with_fields(SPEC, *fields, camera), tier="gusts", max_steps=7))
    with pytest.raises(InvalidValueError, match="robot: 'point' != 'cloud'"):
        policy.check(replace(SPEC, robot="cloud"))
    with pytest.raises(InvalidValueError, match="control_dt_s"):
        policy.check(replace(SPEC, control_dt_s=0.1))
    with pytest.raises(InvalidValueError, match=r"action\.level: 'ee_pose' != 'velocity'"):
        policy.check(replace(SPEC, action=replace(SPEC.action, level="velocity")))
    with pytest.raises(InvalidValueError, match="goal_pos"):
        policy.check(with_fields(SPEC, *(f for f in fields if f.name != "goal_pos")))
    env = PointMassBatch(1)
    env.spec = replace(SPEC, task="drop")
    with pytest.raises(InvalidValueError, match="task"):
        attach(policy, env)


def test_a_setting_that_was_not_saved_is_not_made_up(tmp_path: Path) -> None:
    saved = fresh_policy("diffusion").to_checkpoint()
    known = {name: value for name, value in saved.config["settings"].items() if name != "predict"}
    folder = checkpoint.save(tmp_path / "policy", replace(saved, config={**saved.config, "settings": known}))
    with pytest.raises(CheckpointError, match="does not say predict; train it again"):
        load_policy(folder)


def test_a_policy_of_another_make_is_refused(tmp_path: Path) -> None:
    saved = fresh_policy("mlp").to_checkpoint()
    settings = saved.config["settings"]
    for change, why in (
        ({"policy": "gpt"}, "Unknown policy 'gpt'"),
        ({"settings": {**settings, "width": 3}}, "unexpected keyword argument 'width'"),
        ({"spec": {}}, "Not an environment specification"),
        ({"settings": {**settings, "hidden": [7]}}, "layers.2.weight"),
    ):
        folder = checkpoint.save(tmp_path / "policy", replace(saved, config={**saved.config, **change}))
        with pytest.raises(CheckpointError, match="no policy that this release can rebuild") as refused:
            load_policy(folder)
        assert why in str(refused.value)


N, TA, DA, STEPS = 5, 6, 3, 40


def some_resets(rng: np.random.Generator) -> np.ndarray:
    """(STEPS, N) bool: at which steps a world starts anew; all of them at step 0."""
    resets = rng.random((STEPS, N)) < 0.08
    resets[0] = True
    return resets


@pytest.mark.parametrize("length", [1, 2, 4])
def test_history_repeats_the_first_observation_of_an_episode(length: int) -> None:
    rng = np.random.default_rng(length)
    resets, frames = some_resets(rng), rng.normal(size=(STEPS, N, 7))
    history = ObservationHistory(length)
    for t in range(STEPS):
        history.reset(resets[t])
        seen = history.push(frames[t])
        for i in range(N):
            start = np.flatnonzero(resets[: t + 1, i])[-1]
            wanted = frames[np.maximum(np.arange(t - length + 1, t + 1), start), i]
            np.testing.assert_array_equal(seen[i], wanted)


@pytest.mark.parametrize("execute", [1, 2, 6])
@pytest.mark.parametrize("coefficient", [0.01, 0.5, -0.3, None])
def test_a_plan_is_the_weighted_mean_of_chunks_for_the_step(execute: int, coefficient: float | None) -> None:
    rng = np.random.default_rng(execute)
    resets, chunks = some_resets(rng), rng.normal(size=(STEPS, N, TA, DA)).astype(np.float32)
    plan = ActionPlan(TA, execute, coefficient)
    planned: list[list[int]] = [[] for _ in range(N)]  # steps at which each world planned, in this episode
    for t in range(STEPS):
        plan.reset(resets[t])
        due = plan.due(N)
        plan.add(chunks[t, due], due)
        actions = plan.pop()
        for i in range(N):
            planned[i] = [] if resets[t, i] else planned[i]
            assert due[i] == (not planned[i] or t - planned[i][-1] >= execute)
            planned[i] += [t] if due[i] else []
            reaching = [s for s in planned[i] if t - s < TA]
            proposals = np.array([chunks[s, i, t - s] for s in reaching], np.float64)
            weights = np.exp(-(coefficient or 0.0) * np.arange(len(reaching)))
            weights = np.eye(len(reaching))[-1] if coefficient is None else weights / weights.sum()
            np.testing.assert_allclose(actions[i], weights @ proposals, atol=1e-5)


def test_a_world_forgets_completely_when_reset() -> None:
    """Its first action is bit-equal to the chunk's, so results do not depend on who flew in the world before."""
    rng = np.random.default_rng(0)
    plan, mask = ActionPlan(TA), np.array([True, False])
    for _ in range(7):
        plan.add(rng.normal(scale=1e3, size=(2, TA, DA)).astype(np.float32), np.ones(2, bool))
        plan.pop()
    plan.reset(mask)
    chunk = rng.normal(size=(2, TA, DA)).astype(np.float32)
    plan.add(chunk, np.ones(2, bool))
    np.testing.assert_array_equal(plan.pop()[0], chunk[0, 0])


@pytest.mark.parametrize("execute", [0, TA + 1])
def test_execute_must_fit_into_the_chunk(execute: int) -> None:
    with pytest.raises(InvalidValueError, match=r"\[1, 6\]"):
        ActionPlan(TA, execute)


CHUNKS = {"chunk": 4, "anchor": None, "masked_fields": ()}
CASES: dict[str, PolicySettings] = {
    "averaged": MLP(hidden=(8,), history=2, execute=1, ensemble=0.1, **CHUNKS),
    "one after the other": MLP(hidden=(8,), execute=3, ensemble=None, **CHUNKS),
    "with chance": Diffusion(**CHUNKS),
}


@pytest.mark.parametrize("case", CASES)
def test_a_policy_goes_on_in_the_middle_of_its_plans(tmp_path: Path, case: str) -> None:
    short = BC(steps=3, batch_size=8, warmup_steps=1, validation=0.0, validate_every=0)
    short.train(demonstrations(4), CASES[case], run=tmp_path, progress=False)
    policy, other = load_policy(tmp_path), load_policy(tmp_path).fresh()
    env = Drift(3)
    obs = env.reset(0)
    for step in range(5):
        if step == 2:
            policy.reset(np.array([False, True, False]))  # plans of different ages
        obs = env.step(policy.act(obs)).obs
    memory = policy.memory()
    other.recall(memory)
    forgetful, first = policy.fresh(), policy.act(obs)
    assert not np.array_equal(forgetful.act(obs), first), "what is remembered decides"
    np.testing.assert_array_equal(other.act(obs), first)
    policy.recall(memory)
    np.testing.assert_array_equal(policy.act(obs), first)
    for _ in range(4):
        obs = env.step(policy.act(obs)).obs
        other.act(obs)
    policy.recall(memory)
    assert set(memory) == set(policy.memory())


LEAN = """
import sys
for name in ("torch", "mujoco", "dm_control", "numba", "scipy", "yaml"):
    sys.modules[name] = None
import aerial_il.policies.parts.flying
"""


def test_what_flies_chunks_needs_neither_torch_nor_mujoco() -> None:
    """So that an exported policy flies where they are not installed."""
    done = subprocess.run([sys.executable, "-c", LEAN], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
