"""Actions in the end effector's own frame: undone exactly, scaled by their own statistics, the same wherever it is."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from aerial_il.algorithms.supervised.training_set import cut_windows, fit_interface, read_demos
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.rotations import mat_from_rot6d, rot6d_from_mat
from aerial_il.core.specs import EnvSpec
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.layout import Layout, to_offsets
from aerial_il.policies.parts.relative import into_tool, into_world, rotations
from aerial_il.suite.scenario import Scenario
from tests.algorithms.point_mass import SPEC, PointMassBatch, demonstrations, with_action_level
from tests.policies.test_registry import fresh_policy


def some_poses(seed: int, shape: tuple[int, ...]) -> np.ndarray:
    rng = np.random.default_rng(seed)
    mats = Rotation.random(int(np.prod(shape)), rng=rng).as_matrix().reshape(*shape, 3, 3)
    return np.concatenate([rng.normal(size=(*shape, 3)), rot6d_from_mat(mats)], axis=-1)


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 10_000))
def test_it_is_the_inverse_pose_times_the_pose(seed: int) -> None:
    poses, tool = some_poses(seed, (3, 4)), some_poses(seed + 1, (3, 1))
    seen = into_tool(poses, tool)
    rot_world_from_tool, rot_world_from_pose = mat_from_rot6d(tool[..., 3:]), mat_from_rot6d(poses[..., 3:])
    back = np.swapaxes(rot_world_from_tool, -1, -2)
    np.testing.assert_allclose(seen[..., :3], (back @ (poses - tool)[..., :3, None])[..., 0], atol=1e-12)
    np.testing.assert_allclose(mat_from_rot6d(seen[..., 3:]), back @ rot_world_from_pose, atol=1e-12)
    np.testing.assert_allclose(into_world(seen, tool), poses, atol=1e-12)


def test_rotations_are_made_right_angled() -> None:
    skew = np.random.default_rng(0).normal(size=(9, 6))
    np.testing.assert_allclose(rotations(skew), mat_from_rot6d(skew), atol=1e-12)


def test_the_pose_itself_is_nothing() -> None:
    tool = some_poses(0, (5,))
    np.testing.assert_allclose(into_tool(tool, tool), np.tile([0, 0, 0, 1, 0, 0, 0, 1, 0], (5, 1)), atol=1e-12)


def test_relative_chunks_are_decoded_as_they_were_demonstrated() -> None:
    config = MLP(chunk=7, relative=True, history=2)
    layout, demos = read_demos(demonstrations(4), config)
    windows = cut_windows(demos, layout, config)
    interface = fit_interface(layout, windows, config)
    obs, actions, is_pad = windows[np.arange(len(windows))]
    encoded = interface.encode_actions(actions, obs)
    np.testing.assert_allclose(interface.decode_actions(encoded, obs), actions, atol=1e-5)
    relative = to_offsets(layout, actions, obs)[~is_pad]
    np.testing.assert_allclose(interface.action.centre, relative.mean(0), atol=1e-4)
    np.testing.assert_allclose(interface.action.scale[:3], relative.std(0)[:3], rtol=1e-3)
    np.testing.assert_allclose(encoded[~is_pad].std(0)[:3], 1, atol=1e-2)


def test_a_turned_and_moved_world_turns_and_moves_the_commands() -> None:
    """The network blind, only the frame of the answer is left: the same relative chunk at another pose."""
    policy = fresh_policy("mlp", relative=True)
    for parameter in policy.network.parameters():
        parameter.data[:] = 0
    torch.nn.init.normal_(list(policy.network.parameters())[-1])
    layout, obs = policy.interface.layout, PointMassBatch(3).reset(0)
    poses = some_poses(3, (3,))
    moved = {**obs, "ee_pos": poses[:, :3], "ee_rot6d": poses[:, 3:]}
    chunks = [policy.predict(np.repeat(layout.flatten(o)[:, None], 2, 1))[..., :9] for o in (obs, moved)]
    tools = [np.concatenate([o["ee_pos"], o["ee_rot6d"]], -1)[:, None] for o in (obs, moved)]
    np.testing.assert_allclose(into_tool(chunks[0], tools[0]), into_tool(chunks[1], tools[1]), atol=1e-5)
    assert not np.allclose(chunks[0], chunks[1], atol=0.1)


def test_what_has_no_pose_is_refused() -> None:
    (demo,) = demonstrations(1)
    with pytest.raises(InvalidValueError, match="needs ee_pose actions; these are velocity"):
        read_demos([with_action_level(demo, "velocity")], MLP(relative=True))
    with pytest.raises(UnknownNameError, match=r"'ee_rot6d'.*see policy.obs_names"):
        Layout.of(SPEC, MLP(relative=True, obs_names=("ee_pos", "cube_pos")))
    assert Layout.of(replace(SPEC, tier="gusts"), MLP(relative=True)).anchored == 0


def turned_and_moved(spec: EnvSpec, layout: Layout) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return five made-up observations of press_button, and the same in a world that was turned and moved."""
    rng = np.random.default_rng(0)
    obs = {name: rng.normal(size=(5, *spec.observation[name].shape)) for name in layout.names}
    poses, turn, shift = some_poses(1, (5,)), Rotation.random(rng=rng).as_matrix(), rng.normal(size=3)
    obs |= {"ee_pos": poses[:, :3], "ee_rot6d": poses[:, 3:]}
    moved = dict(obs)
    for name in ("base_vel", "tip_to_button", "ee_rot6d", "base_rot6d", "button_rot6d"):
        if name in moved:
            moved[name] = (obs[name].reshape(5, -1, 3) @ turn.T).reshape(5, -1)
    for name in ("base_pos", "button_pos", "ee_pos"):
        if name in moved:
            moved[name] = obs[name] @ turn.T + shift
    return obs, moved


def test_a_turned_and_moved_world_looks_the_same() -> None:
    spec = Scenario("fa_hexa_arm4", "press_button").spec
    layout = Layout.of(spec, MLP(relative=True))
    obs, moved = turned_and_moved(spec, layout)
    seen, seen_moved = (layout.relate(layout.flatten(o)) for o in (obs, moved))
    own = np.concatenate([np.full(spec.observation[name].size, name.startswith("ee_")) for name in layout.names])
    np.testing.assert_allclose(seen[:, ~own], seen_moved[:, ~own], atol=1e-9)
    world = Layout.of(spec, MLP())
    assert not np.allclose(*(world.relate(world.flatten(o)) for o in (obs, moved)), atol=0.1)


def test_without_its_own_pose_a_turned_world_looks_the_same() -> None:
    spec = Scenario("fa_hexa_arm4", "press_button").spec
    blind = Layout.of(spec, MLP(relative=True, masked_fields=("base_*", "joint_*", "gripper", "ee_*")))
    assert blind.unseen == ("ee_pos", "ee_rot6d")
    assert not any(name.startswith(("base_", "joint_")) for name in blind.names)
    obs, moved = turned_and_moved(spec, blind)
    seen, seen_moved = (blind.relate(blind.flatten(o)) for o in (obs, moved))
    np.testing.assert_allclose(seen, seen_moved, atol=1e-9)
    assert len(np.unique(seen.round(6), axis=0)) == 5, "it is not blind to the button"


def test_the_anchor_can_be_hidden() -> None:
    spec = Scenario("fa_hexa_arm4", "press_button").spec
    layout = Layout.of(spec, MLP(masked_fields=("ee_pos",)))
    assert layout.unseen == ("ee_pos",)
    obs, _ = turned_and_moved(spec, layout)
    shifted = {
        name: value + 1.0 if name.endswith("_pos") and name != "joint_pos" else value for name, value in obs.items()
    }
    np.testing.assert_allclose(*(layout.relate(layout.flatten(o)) for o in (obs, shifted)), atol=1e-12)
