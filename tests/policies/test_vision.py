"""Policies see: every class of them, the right part of the right frame, and only through its own cameras."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from aerial_il import policies
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.specs import EnvSpec, Field, ObservationSpec
from aerial_il.policies import load_policy
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.execution import Execution
from aerial_il.policies.parts.layout import Interface, Layout
from aerial_il.policies.parts.network import Seen
from aerial_il.policies.parts.normaliser import Normaliser
from aerial_il.policies.parts.switches import Switches
from aerial_il.policies.parts.vision import FAR_M, build_network, middle_part, part_at, random_corner
from tests.algorithms.point_mass import SPEC
from tests.policies.test_registry import NAMES

SIDE = 20


def seeing(spec: EnvSpec, *names: str, side: int = SIDE) -> EnvSpec:
    """Return ``spec`` with cameras of these names, and no others."""
    fields = tuple(f for f in spec.observation.fields if f.group != "image")
    cameras = tuple(Field(name, (side, side, 3), "image", dtype="uint8") for name in names)
    return replace(spec, observation=ObservationSpec(fields + cameras))


SEEN = seeing(SPEC, "wrist_rgb", "base_rgb")
EYES = {"history": 2, "chunk": 5, "images": ("wrist_rgb", "base_rgb"), "image_features": 8, "obs_names": ("ee_pos",)}


def fresh_policy(name: str = "mlp", spec: EnvSpec = SEEN, **settings: object) -> ChunkPolicy:
    config = policies.get(name)(**{**EYES, **settings})
    layout = Layout.of(spec, config)
    data = np.random.default_rng(0)
    scalers = (Normaliser.fit(data.normal(size=(99, size))) for size in (layout.size, SEEN.action.size))
    interface = Interface(layout, *scalers, config.obs_clip, Switches.none(SEEN.action.size))
    torch.manual_seed(0)
    return ChunkPolicy(config, interface, build_network(config, layout))


def look(n: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
    states = {f.name: rng.normal(size=(n, *f.shape)) for f in SEEN.observation.fields if f.group != "image"}
    images = {f.name: rng.integers(0, 256, (n, *f.shape), np.uint8) for f in SEEN.observation.of_group("image")}
    return states | images


@pytest.mark.parametrize("name", NAMES)
def test_every_policy_sees_and_flies_alike_after_saving(name: str, tmp_path: Path) -> None:
    policy = fresh_policy(name)
    again, rng = load_policy(policy.save(tmp_path / "policy")), np.random.default_rng(1)
    first = look(32, rng)  # of a few choices, another picture changes some
    action = policy.act(first)
    np.testing.assert_array_equal(again.act(first), action)
    assert action.shape == (32, 10)
    policy.reset()
    other = policy.act({**first, "base_rgb": 255 - first["base_rgb"]})
    assert not np.array_equal(action, other), "what a camera shows must matter"


@pytest.mark.parametrize("name", ["diffusion", "flow"])
def test_who_denoises_can_be_led_though_it_sees(name: str) -> None:
    plain, obs = fresh_policy(name, chunk=12, execute=4, ensemble=None), look(3, np.random.default_rng(1))
    led = plain.executing(Execution(chunks="realtime", delay_ms=40))
    first, second = ([each.act(obs) for _ in range(14)] for each in (plain, led))
    assert np.isfinite(second).all()
    assert not np.array_equal(first, second)


def test_worlds_see_their_own_history() -> None:
    rng = np.random.default_rng(0)
    together, alone = fresh_policy(execute=2), fresh_policy(execute=2)
    for t in range(6):
        obs = look(3, rng)
        together.reset(np.array([False, t == 3, t % 5 == 2]))
        actions = together.act(obs)
        np.testing.assert_allclose(alone.act({k: v[:1] for k, v in obs.items()})[0], actions[0], atol=1e-5)


def test_eyes_learn_and_see_random_parts_in_training_only() -> None:
    policy, rng = fresh_policy(), np.random.default_rng(0)
    network = policy.network.requires_grad_(True)
    images = {n: torch.from_numpy(rng.integers(0, 256, (4, 2, SIDE, SIDE, 3), np.uint8)) for n in EYES["images"]}
    obs = Seen(torch.randn(4, 2, 3), images)
    assert torch.equal(network(obs), network(obs))
    network.train()
    assert not torch.equal(network(obs), network(obs))
    loss, _ = network.loss(obs, torch.randn(4, 5, 10), torch.ones(4, 5))
    loss.backward()
    assert all(p.grad is not None and p.grad.abs().sum() > 0 for p in network.parameters())


def test_random_parts_lie_at_one_place_per_window() -> None:
    rows, columns = torch.meshgrid(torch.arange(12.0), torch.arange(16.0), indexing="ij")
    images = torch.stack([rows, columns, rows * 0], dim=-1).expand(64, 2, 12, 16, 3)
    torch.manual_seed(0)
    parts = part_at(images, random_corner(images, 8, 10), 8, 10)
    assert parts.shape == (64, 2, 8, 10, 3)
    corner = parts[:, :, :1, :1]
    assert torch.equal(parts - corner, (images[:, :, :8, :10] - images[:, :, :1, :1]))
    assert torch.equal(corner[:, 0], corner[:, 1])
    assert corner[:, 0, 0, 0, 0].unique().tolist() == [0, 1, 2, 3, 4]
    assert corner[:, 0, 0, 0, 1].unique().tolist() == [0, 1, 2, 3, 4, 5, 6]
    assert middle_part(images, 8, 10)[0, 0, 0, 0].tolist() == [2, 3, 0]


def test_a_resnet_from_random_weights_sees_too_and_is_saved_whole(tmp_path: Path) -> None:
    policy, seen = fresh_policy(encoder="resnet18"), look(1, np.random.default_rng(0))
    again = load_policy(policy.save(tmp_path / "policy"))
    np.testing.assert_array_equal(again.act(seen), policy.act(seen))


def test_fields_are_hidden_by_pattern_down_to_images_alone() -> None:
    assert Layout.of(SEEN, MLP(masked_fields=("*_pos",), anchor=None)).names == ("ee_rot6d", "gripper")
    policy = fresh_policy(obs_names=(), masked_fields=("*",), anchor=None)
    assert policy.interface.layout.names == ()
    assert policy.act(look(2, np.random.default_rng(0))).shape == (2, 10)
    with pytest.raises(InvalidValueError, match="neither a state field nor an image"):
        Layout.of(SEEN, MLP(masked_fields=("*",), anchor=None))


def test_other_cameras_and_sizes_are_refused_and_both_are_named() -> None:
    policy = fresh_policy()
    policy.check(replace(SEEN, tier="gusts"))
    with pytest.raises(InvalidValueError, match="base_rgb 20 x 20; the environment shows no images"):
        policy.check(seeing(SPEC))
    with pytest.raises(InvalidValueError, match=r"shows wrist_rgb 20 x 20\. Load it with"):
        policy.check(seeing(SPEC, "wrist_rgb"))
    with pytest.raises(InvalidValueError, match="shows wrist_rgb 32 x 32, base_rgb 32 x 32"):
        policy.check(seeing(SPEC, "wrist_rgb", "base_rgb", side=32))
    obs = look(1, np.random.default_rng(0))
    with pytest.raises(InvalidValueError, match="'base_rgb' is 8 x 20; the policy was trained with wrist_rgb 20 x 20"):
        policy.act({**obs, "base_rgb": obs["base_rgb"][:, :8]})
    del obs["base_rgb"]
    with pytest.raises(UnknownNameError, match="Unknown image 'base_rgb'"):
        policy.act(obs)


def test_depth_is_seen_in_metres_up_to_a_limit(tmp_path: Path) -> None:
    depth = Field("wrist_depth", (SIDE, SIDE), "image", dtype="float32")
    spec = replace(SEEN, observation=ObservationSpec((*SEEN.observation.fields, depth)))
    policy = fresh_policy(spec=spec, images=("wrist_rgb", "wrist_depth"))
    obs, metres = look(2, np.random.default_rng(0)), np.random.default_rng(1).uniform(0.1, 1.9, (2, SIDE, SIDE))

    def acted(values: np.ndarray, flown: ChunkPolicy = policy) -> np.ndarray:
        flown.reset()
        return flown.act({**obs, "wrist_depth": values.astype(np.float32)})

    near, beyond = acted(metres), metres.copy()
    assert (near != acted(0.9 * metres)).any()
    beyond[:, 0] = FAR_M
    at_limit = acted(beyond)
    beyond[:, 0] = 40.0
    np.testing.assert_array_equal(acted(beyond), at_limit)
    np.testing.assert_array_equal(acted(metres, load_policy(policy.save(tmp_path / "policy"))), near)
    with pytest.raises(InvalidValueError, match="wrist_depth 20 x 20; the environment shows"):
        policy.check(SEEN)


def test_images_without_colour_or_not_recorded_are_refused() -> None:
    with pytest.raises(UnknownNameError, match=r"Unknown colour or depth image 'wrist_depth'.*Record it"):
        Layout.of(SEEN, MLP(images=("wrist_depth",)))
    with pytest.raises(InvalidValueError, match=r"is an image\. Name it in policy.images"):
        Layout.of(SEEN, MLP(obs_names=("ee_pos", "wrist_rgb")))
    with pytest.raises(InvalidValueError, match="10 x 10 after crop"):
        fresh_policy(crop=0.5)
    with pytest.raises(InvalidValueError, match=r"Unknown encoder 'vit'\. Valid: cnn, resnet18"):
        MLP(encoder="vit")  # pyright: ignore[reportArgumentType]
