"""What every policy file owes: it builds at any size, learns, survives saving, and treats each world by itself."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch.nn.functional import one_hot

from aerial_il import policies
from aerial_il.core.errors import InvalidValueError
from aerial_il.policies import load_policy
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.network import PolicySettings
from tests.algorithms.point_mass import SPEC
from tests.policies.test_registry import NAMES, fresh_policy

SMALL: dict[str, Any] = {  # sizes under which seconds suffice, for whichever policy has a setting of that name
    "hidden": (48,), "units": 32, "width": 48, "heads": 3, "feedforward": 64, "dropout": 0.0, "latent": 4,
    "dim_model": 48, "n_heads": 3, "dim_feedforward": 64, "down_dims": (32, 64),
}  # fmt: skip
DRAWING: dict[str, Any] = {"sample_latent": True, "kl_weight": 0.02, "head": "gmm"}  # ways to have several answers
BAD: dict[str, Any] = {
    "hidden": (), "dropout": 1.0, "min_std": 0.0, "modes": 0, "units": 0, "layers": 0, "width": 0, "heads": 0,
    "blocks": 0, "latent": 0, "feedforward": 0, "encoder_layers": 0, "decoder_layers": 0, "kl_weight": -1.0,
    "noise_steps": 0, "denoise_steps": 0, "euler_steps": 0, "clip": 0.0, "loss": "l3", "cell": "rnn", "head": "none",
    "sampler": "euler", "predict": "score",
}  # fmt: skip


def config(name: str, **settings: Any) -> PolicySettings:
    """A small configuration of the policy ``name``; settings that it does not have are left out."""
    kind = policies.get(name)
    return kind(**{k: v for k, v in (SMALL | settings).items() if k in kind.__dataclass_fields__})


def policy(name: str, **settings: Any) -> ChunkPolicy:
    known = policies.get(name).__dataclass_fields__
    return fresh_policy(name, **{k: v for k, v in (SMALL | settings).items() if k in known})


def observations(rng: np.random.Generator, n: int) -> dict[str, np.ndarray]:
    return {f.name: rng.normal(size=(n, *f.shape)) for f in SPEC.observation.fields}


def fit(network: Any, batches: Any, steps: int, lr: float = 3e-3) -> list[float]:
    """Train ``network`` on ``batches(step) -> obs, actions, valid``; return the losses."""
    optimizer, losses = torch.optim.Adam(network.train().parameters(), lr=lr), []
    for step in range(steps):
        loss, _ = network.loss(*batches(step))
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
    network.eval()
    return losses


@pytest.mark.parametrize("sizes", [(1, 1, 1, 1), (3, 7, 5, 3)])
@pytest.mark.parametrize("name", NAMES)
def test_it_builds_at_odd_sizes(name: str, sizes: tuple[int, int, int, int]) -> None:
    history, chunk, seen, done = sizes
    network = config(name, history=history, chunk=chunk).build(seen, done).eval()
    obs, actions = torch.randn(4, history, seen), torch.randn(4, chunk, done)
    assert network(obs).shape == (4, chunk, done)
    loss, logged = network.loss(obs, actions, torch.ones(4, chunk))
    loss.backward()
    assert torch.isfinite(loss)
    assert all(value.ndim == 0 and not value.requires_grad for value in logged.values())
    if network.noise_size:
        assert network(obs, torch.randn(4, network.noise_size)).shape == (4, chunk, done)


@pytest.mark.parametrize("name", NAMES)
def test_its_loss_falls_and_its_actions_come_near(name: str) -> None:
    """On a smooth map from observation to chunk, far below the error of always answering with the mean.

    One that chooses among a few actions is shown the best of them.
    """
    torch.manual_seed(0)
    map_ = torch.randn(3, 4 * 2) / 2
    seen = torch.randn(400, 1, 3)
    wanted = torch.tanh(seen[:, 0] @ map_).reshape(400, 4, 2)
    if name == "categorical":
        wanted = 2.0 * one_hot(wanted.argmax(-1), 2) - 1.0
    network = config(name, history=1, chunk=4, kl_weight=0.1).build(3, 2)
    every = torch.ones(64, 4)
    losses = fit(network, lambda step: (seen[(i := torch.randint(400, (64,)))], wanted[i], every), 250)
    assert np.isfinite(losses).all()
    assert np.mean(losses[-25:]) < np.mean(losses[:10]) - 0.1
    with torch.no_grad():
        error = (network(seen) - wanted).abs().mean()
    assert error < 0.5 * (wanted - wanted.mean(0)).abs().mean()


@pytest.mark.parametrize("redraw", [False, True])
@pytest.mark.parametrize("name", NAMES)
def test_a_world_is_flown_as_if_it_were_alone(name: str, redraw: bool) -> None:
    """Also when others are reset at other times; noise included, for policies that draw."""
    settings = {**DRAWING, "execute": 2, "redraw": redraw, "sampler": "ddpm" if redraw else "ddim"}
    together, alone = policy(name, **settings), policy(name, **settings)
    rng = np.random.default_rng(0)
    for t in range(9):
        obs = observations(rng, 5)
        again = t == 6
        together.reset(np.array([again, t == 3, False, t % 5 == 2, t == 1]))
        alone.reset(np.array([again]))
        actions = together.act(obs)
        np.testing.assert_allclose(alone.act({k: v[:1] for k, v in obs.items()})[0], actions[0], atol=1e-5)


@pytest.mark.parametrize("name", NAMES)
def test_the_place_in_the_batch_does_not_matter(name: str) -> None:
    obs = observations(np.random.default_rng(1), 6)
    order = np.array([4, 2, 0, 5, 1, 3])
    actions = policy(name, **DRAWING).act(obs)
    shuffled = policy(name, **DRAWING).act({k: v[order] for k, v in obs.items()})
    np.testing.assert_allclose(shuffled, actions[order], atol=1e-5)


@pytest.mark.parametrize("name", NAMES)
def test_the_same_episode_is_flown_the_same_again(name: str, tmp_path: Path) -> None:
    """After a reset of all worlds, of this one, and from disk, bit for bit."""
    flown = policy(name, **DRAWING)
    frames = [observations(np.random.default_rng(t), 3) for t in range(4)]

    def fly(policy: ChunkPolicy) -> np.ndarray:
        return np.stack([policy.act(frame) for frame in frames])

    first = fly(flown)
    flown.reset()
    np.testing.assert_array_equal(fly(flown), first)
    flown.reset(np.ones(3, bool))
    np.testing.assert_array_equal(fly(flown), first)
    np.testing.assert_array_equal(fly(load_policy(flown.save(tmp_path / "policy"))), first)


@pytest.mark.parametrize("name", NAMES)
def test_acting_leaves_the_shared_generator_alone(name: str) -> None:
    flown = policy(name, **DRAWING)
    before = torch.get_rng_state()
    flown.act(observations(np.random.default_rng(0), 2))
    assert torch.equal(torch.get_rng_state(), before)


@pytest.mark.parametrize("name", NAMES)
def test_each_setting_refuses_what_it_cannot_be(name: str) -> None:
    """The message names the setting, the value and what is allowed."""
    kind = policies.get(name)
    for setting, value in BAD.items():
        if setting in kind.__dataclass_fields__:
            with pytest.raises(InvalidValueError, match=rf"{setting}.*({value!r}|\(\)).*(must|Valid)"):
                kind(**{setting: value})


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow) if n == "act" else n for n in NAMES])
def test_two_ways_are_told_apart_where_the_policy_can(name: str) -> None:
    """Half of the demonstrations go one way and half the other, whatever is seen: the mean is no way at all."""
    if name == "lerobot_act":
        pytest.skip("its style, which is zero in flight, may stand for either way or for none")
    torch.manual_seed(1)
    settings = DRAWING | {"loss": "l2", "chunk": 3, "history": 1}
    network = config(name, **settings).build(2, 2)
    ways = torch.stack([torch.ones(3, 2), -torch.ones(3, 2)]) * 0.8

    def batches(step: int) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        return torch.randn(128, 1, 2), ways[torch.randint(2, (128,))], torch.ones(128, 3)

    fit(network, batches, 500)
    obs = torch.randn(300, 1, 2)
    with torch.no_grad():
        flown = network(obs, torch.randn(300, network.noise_size)) if network.noise_size else network(obs)
    near = (flown[:, None] - ways).abs().amax((-1, -2)) < 0.35
    if network.noise_size:
        assert near.any(1).float().mean() > 0.9, "every chunk is one of the two ways"
        assert (near.float().mean(0) > 0.2).all(), "both of them are flown"
    else:
        assert near.float().mean() < 0.1, "a policy without chance flies between them"
