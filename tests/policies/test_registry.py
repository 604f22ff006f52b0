"""Every policy file obeys the same contract; a new one is found and tested without an edit here."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from subprocess import run

import numpy as np
import pytest
import torch
import yaml

from aerial_il import policies
from aerial_il.algorithms.bc import BC
from aerial_il.core.errors import CheckpointError, InvalidValueError, UnknownNameError
from aerial_il.policies import load_policy
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.layout import Interface, Layout
from aerial_il.policies.parts.normaliser import Normaliser
from aerial_il.policies.parts.switches import Switches
from tests.algorithms.point_mass import SPEC, PointMassBatch

SIZES = {"history": 2, "chunk": 5}
NAMES = [  # importing lerobot takes seconds, and so does training its networks
    pytest.param(name, marks=pytest.mark.slow) if name.startswith("lerobot_") else name for name in policies.names()
]


def fresh_policy(name: str, **settings: object) -> ChunkPolicy:
    config = policies.get(name)(**{**SIZES, **settings})
    layout = Layout.of(SPEC, config)
    data = np.random.default_rng(0)
    scalers = (Normaliser.fit(data.normal(size=(99, size))) for size in (layout.size, SPEC.action.size))
    interface = Interface(layout, *scalers, config.obs_clip, Switches.none(layout.spec.action.size))
    torch.manual_seed(0)
    return ChunkPolicy(config, interface, config.build(layout.size, SPEC.action.size), {"step": 3})


@pytest.mark.parametrize("name", NAMES)
def test_networks_map_histories_to_chunks_and_mask_their_loss(name: str) -> None:
    policy = fresh_policy(name)
    network = policy.network
    obs, actions = torch.randn(4, 2, policy.interface.layout.size), torch.randn(4, 5, 10)
    assert network(obs).shape == (4, 5, 10)
    valid = torch.ones(4, 5)
    valid[:, 3:] = 0

    def loss_of(valid: torch.Tensor) -> torch.Tensor:
        torch.manual_seed(0)
        return network.loss(obs, actions, valid)[0]

    loss = loss_of(valid)
    actions[:, 3:] += 100
    assert loss.ndim == 0
    assert torch.equal(loss, loss_of(valid))
    assert not torch.equal(loss, loss_of(torch.ones(4, 5)))


@pytest.mark.parametrize("name", NAMES)
def test_a_saved_policy_flies_alone_and_alike(name: str, tmp_path: Path) -> None:
    policy = fresh_policy(name)
    again = load_policy(policy.save(tmp_path / "policy"))
    assert (again.config, again.spec, again.origin) == (policy.config, policy.spec, {"step": 3})
    env = PointMassBatch(3)
    obs = env.reset(0)
    for _ in range(4):
        action = policy.act(obs)
        np.testing.assert_array_equal(again.act(obs), action)
        assert action.shape == (3, 10)
        assert action.dtype == np.float64
        assert (action >= SPEC.action.low).all()
        assert (action <= SPEC.action.high).all()
        obs = env.step(action).obs


@pytest.mark.parametrize("name", NAMES)
def test_settings_survive_yaml(name: str) -> None:
    config = policies.get(name)(**SIZES)
    assert policies.get(name)(**yaml.safe_load(yaml.safe_dump(config.to_dict()))) == config
    assert config.name == name


@pytest.mark.parametrize("settings", [{"history": 0}, {"chunk": 0}, {"execute": 6}, {"obs_clip": 0}])
@pytest.mark.parametrize("name", NAMES)
def test_impossible_settings_are_refused(name: str, settings: dict[str, int]) -> None:
    with pytest.raises(InvalidValueError, match=next(iter(settings))):
        policies.get(name)(**{**SIZES, **settings})


def test_a_single_name_or_width_stands_for_a_list_of_it() -> None:
    """A command line writes ``policy.masked_fields=target_*``, which must not be read letter by letter."""
    config = MLP(masked_fields="target_*", hidden=256, images=["wrist_rgb"])  # type: ignore[arg-type]
    assert (config.masked_fields, config.hidden, config.images) == (("target_*",), (256,), ("wrist_rgb",))
    assert replace(BC.selection, operators="expert").operators == ("expert",)  # type: ignore[arg-type]


def test_names_come_without_importing_torch() -> None:
    code = "import sys; from aerial_il import policies; policies.names(); print('torch' in sys.modules)"
    assert run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == "False"


def test_unknown_policies_and_paths_say_what_there_is(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'mlp'"):
        policies.get("mpl")
    with pytest.raises(CheckpointError, match="does not exist"):
        load_policy(tmp_path / "nowhere")
    with pytest.raises(CheckpointError, match="neither a policy nor a run"):
        load_policy(tmp_path)
