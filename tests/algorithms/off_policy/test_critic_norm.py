"""Critics with standardised layers: bounded where nothing was tried, and honoured by every algorithm that has them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.numpy import load_file

from aerial_il import algorithms
from aerial_il.algorithms.sac import SAC
from aerial_il.core.checkpoint import ARRAYS
from aerial_il.policies.squashed_gaussian import SquashedGaussian
from tests.algorithms.drift import Drift, demonstrations
from tests.algorithms.made import made, names

SETTINGS = {n: algorithms.get(n) for n in algorithms.names()}
NAMES = [n for n, settings in SETTINGS.items() if "critics.layer_norm" in names(settings)]
SMALL: dict[str, Any] = {"steps": 96, "warmup": 32, "batch_size": 16, "critic_hidden": (8,), "checkpoint_every": 32}
SMALL |= {"bc_pretrain_steps": 5, "offline_steps": 8, "reward_hidden": (8,), "actor_every": 1, "utd_ratio": 0.2}


def critics_of(name: str, run: Path, **changes: Any) -> set[str]:
    """Train for a moment; return the names of all arrays that a checkpoint holds of critics' layers."""
    cls: Any = SETTINGS[name]
    settings = made(cls, {**SMALL, **changes})
    shown = settings.demonstrated
    settings.train(
        demonstrations(4, ends_at_success=True) if shown else None,
        SquashedGaussian(hidden=(8,)),
        env=Drift(8, ends_at_success=shown),
        run=run,
        seed=1,
        progress=False,
    )
    checkpoint = max((run / "checkpoints").iterdir())
    return {array for array in load_file(checkpoint / ARRAYS) if "gains" in array}


def test_algorithms_with_critics_of_actions_have_it() -> None:
    assert {"sac", "td3", "ddpg", "awac", "iql", "rlpd", "ibrl", "dac", "sqil"} <= set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_critics_are_standardised_only_where_that_is_asked(name: str, tmp_path: Path) -> None:
    assert critics_of(name, tmp_path / "on", critic_norm=True)
    assert not critics_of(name, tmp_path / "off", critic_norm=False)


def test_values_of_actions_that_were_never_tried_are_bounded() -> None:
    obs, far = torch.zeros(1, 3), torch.tensor([[1e4, -1e4]])
    torch.manual_seed(0)
    plain, normed = (replace(SAC.critics, layer_norm=norm).build((2, 2)) for norm in (False, True))
    assert plain(obs, far).abs().max() > 100.0
    assert normed(obs, far).abs().max() < 2.0
