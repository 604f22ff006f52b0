"""Studies run as a whole in a tiny setting, and what they have measured is not measured again."""

import importlib.util
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.bc_ppo import BCPPO
from aerial_il.algorithms.cpl import CPL
from aerial_il.algorithms.dagger import DAgger
from aerial_il.algorithms.dapg import DAPG
from aerial_il.algorithms.ddpg import DDPG
from aerial_il.algorithms.expert_iteration import ExpertIteration
from aerial_il.algorithms.filtered_bc import FilteredBC
from aerial_il.algorithms.npg import NPG
from aerial_il.algorithms.perception import Perception
from aerial_il.algorithms.sac import SAC
from aerial_il.core import registry
from aerial_il.core.composition import build
from aerial_il.policies.mlp import MLP
from aerial_il.policies.squashed_gaussian import SquashedGaussian
from experiments.panda.study import REACH
from experiments.pixels.changes import CHANGES
from experiments.pixels.study import ARMS, HEADS
from experiments.umi.study import OF_THE_TOOL
from tests.experiments.test_adroit import DATA as ADROIT

CLONING, SMALL = BC(steps=10, batch_size=16), {"draws": (0,), "num_envs": 1}
ROUNDS: dict[str, Any] = {"rounds": 2, "episodes": 2, "between_steps": 5, "evaluate_every": 0}

OFF_POLICY = {"steps": 160, "warmup": 80, "replay": {"batch_size": 8}, "critics": {"hidden": (8,)}}
SETTINGS: dict[str, Callable[[], dict[str, Any]]] = {
    "adroit_rl": lambda: {
        "data": str(ADROIT),
        "policy": MLP(chunk=1, ensemble=None, hidden=(8,)),
        "dapg": build(DAPG, {"steps": 1_200, "warmup": 100, "rollout": {"steps": 800}, "exploration": {"execute": 1}}),
        "npg": build(NPG, {"rollout": {"steps": 800}}),
        "tasks": ("door",),
        "rewards": ("environment",),
        "episodes": 2,
        "worlds": 2,
    },
    "beyond_teacher": lambda: {
        "policy": MLP(hidden=(16,)),
        "cloning": CLONING,
        "practising": build(BCPPO, {"steps": 20_000, "rollout": {"steps": 8_000}, "reward_patience": 0}),
        "tasks": ("reach",),
        "demos": 2,
        "episodes": 2,
    },
    "cameras": lambda: {
        "robots": ("ua_quad_arm4",),
        "tasks": ("reach",),
        "fov": (60.0, 90.0),
        "episodes": 2,
        "threads": 1,
    },
    "links": lambda: {
        "policy": MLP(hidden=(8,)),
        "cloning": CLONING,
        "tasks": ("reach",),
        "links": ("evaluation", "in_process"),
        "latencies_ms": (0, 40),
        "demos": 2,
        "speed": 20.0,
        "episodes": 2,
    },
    "umi": lambda: {
        "policy": replace(OF_THE_TOOL, width=16),
        "cloning": CLONING,
        "tasks": ("reach",),
        "robots": ("ua_quad_arm4",),
        "latencies_ms": (0, 40),
        "demos": 2,
        "episodes": 2,
    },
    "preferences": lambda: {
        "policy": MLP(hidden=(16,)),
        "cloning": CLONING,
        "learning": CPL(cloning=CLONING, steps=5, pairs=10, length=8, batch_size=4),
        "filtering": FilteredBC(**ROUNDS, training=CLONING),
        "poor": CLONING,
        "poor_demos": 2,
        "tasks": ("reach",),
        "demos": 6,
        "episodes": 2,
    },
    "influence": lambda: {
        "policy": MLP(hidden=(16,)),
        "cloning": CLONING,
        "poor": CLONING,
        "poor_demos": 2,
        "tasks": ("reach",),
        "planted": (),
        "demos": 4,
        "arms": ("all",),
        "flights": 2,
        "episodes": 2,
    },
    "experts": lambda: {"robots": ("ua_quad_arm4",), "tasks": ("reach",), "tiers": ("calm",), "episodes": 1},
    "from_prior": lambda: {
        "policy": MLP(hidden=(16,)),
        "cloning": CLONING,
        "practising": {
            "expert_iteration": ExpertIteration(**ROUNDS, training=CLONING, attempts=2),
            "filtered_bc": FilteredBC(**ROUNDS, training=CLONING),
        },
        "starts": {"reach": (2,)},
        "many": 3,
        "episodes": 1,
    },
    "panda": lambda: {
        "policy": SquashedGaussian(hidden=(8,)),
        "reach": {"ddpg": build(DDPG, {**OFF_POLICY, "hindsight": {"goals": 4}})},
        "tasks": (REACH,),
        "seeds": 1,
        "episodes": 3,
    },
    "pixels": lambda: {
        "policy": MLP(hidden=(8,)),
        "perception": Perception(
            training=CLONING, steps=2, more_steps=2, batch_size=4, width=8, frames=4, redrawn=2, flown=2, episodes=1
        ),
        "heads": {arm: replace(head, image_features=4) for arm, head in HEADS.items()},
        "cloning": BC(steps=2, batch_size=4, validation=0.0),
        "asking": DAgger(rounds=1, episodes=1, between_steps=2, evaluate_every=0),
        "arms": ARMS,
        "changes": CHANGES,
        "tasks": ("press_button",),
        "flown_in": ("calm",),
        "demos": 2,
        "image_size": (24, 24),
        "episodes": 1,
    },
    "loader": lambda: {"demonstrations": 2, "seen": 1, "steps": 1, "repetitions": 1, "sizes": (2,)},
    "recording": lambda: {"robots": ("ua_quad_arm4",), "demonstrations": 2, "converted": 2, "repetitions": 1},
    "sb3": lambda: {"cells": ("ppo_cartpole",), "seeds": (0, 1), "episodes": 2, "steps_share": 0.02},
    "z1_reach": lambda: {
        "policy": SquashedGaussian(hidden=(8,)),
        "sac": build(SAC, OFF_POLICY),
        "algorithms": ("sac",),
        "actions": ("velocity",),
        "rewards": ("sparse",),
        "horizon": 20,
        "seeds": 1,
        "episodes": 2,
        "curve_episodes": 2,
    },
}
REMEASURED = {"loader", "recording"}  # of their few minutes nothing is kept
TIMED = {"Time of one world"}  # tables that are measured anew
NEEDS = {"panda": "panda_gym", "sb3": "stable_baselines3"}


@pytest.mark.slow
@pytest.mark.render
@pytest.mark.parametrize("name", SETTINGS)
def test_a_small_study_runs_and_is_not_done_again(name: str, tmp_path: Path) -> None:
    if (package := NEEDS.get(name)) and importlib.util.find_spec(package) is None:
        pytest.skip(f"{package} is not installed")
    if name == "adroit_rl" and not ADROIT.is_dir():
        pytest.skip(f"{ADROIT} is not there")
    study: Any = registry.get("study", name)
    settings = {**{key: value for key, value in SMALL.items() if hasattr(study(), key)}, **SETTINGS[name]()}
    report = study(**settings).run(tmp_path, progress=False)
    assert any(report.tables.values())
    json.dumps(report.to_dict(), allow_nan=False)
    if name not in REMEASURED:
        before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.json")}
        again = study(**settings).run(tmp_path, progress=False)
        assert {k: v for k, v in again.tables.items() if k not in TIMED} == {
            k: v for k, v in report.tables.items() if k not in TIMED
        }
        assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.json")} == before
