"""What no study can be asked for is refused when it is built, by the name of the setting or of the nearest choice."""

from __future__ import annotations

from typing import Any

import pytest

from aerial_il.core import registry
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.policies.mlp import MLP

ITERATED = "expert_iteration"
CASES: list[tuple[str, dict[str, Any], str]] = [
    ("adroit", {"clean": ({"demos": 15, "asks": 1},)}, "it names demos and any of bc"),
    ("beyond_teacher", {"suited": {"insert_peg": {"exploration": {"nose": 0.07}}}}, "Did you mean 'noise'"),
    ("controllers", {"seeds": 0}, "seeds >= 1"),
    ("dagger", {"arms": ("magic",)}, "magic"),
    ("dagger", {"demos": 0}, "start at 1"),
    ("flight_control", {"entropy": {"fly": 0.1}}, r"entropy names \['fly'\]; valid: hover"),
    ("flight_control", {"laws": ("mpc",)}, r"laws names \['mpc'\]; valid: pid, lqr"),
    ("from_prior", {"starts": {}}, "starts"),
    ("from_prior", {"starts": {"reach": (0,)}}, "starts"),
    ("from_prior", {"draws": ()}, "at least one"),
    ("from_prior", {"many": 0}, "start at 1"),
    ("from_prior", {"fewer": {"dapg": 0}}, "fewer"),
    ("from_prior", {"arms": ("sac",)}, "filtered_bc"),
    ("from_prior", {"only_from": {"dapgg": ("reach_4",)}}, "dapgg"),
    ("from_prior", {"only_from": {"dapg": ("reech_4",)}}, "reech"),
    ("from_prior", {"begun_by": {"insert_peg": "bc_ppo"}}, r"begun_by.*expert_iteration, filtered_bc"),
    ("from_prior", {"starts": {"pick_plaice": (10,)}}, "Did you mean 'pick_place'"),
    ("from_prior", {"begun_by": {"pick_plaice": ITERATED}}, "Did you mean 'pick_place'"),
    ("from_prior", {"practised_in": {"pick_plaice": "calm"}}, "Did you mean 'pick_place'"),
    ("from_prior", {"suited": {"pick_plaice": {}}}, "Did you mean 'pick_place'"),
    ("from_prior", {"suited": {"hover": {"dapg": {"exploration": {"nose": 0.1}}}}}, "Did you mean 'noise'"),
    ("from_prior", {"suited": {"hover": {"dagp": {}}}}, "Did you mean 'dapg'"),
    ("from_prior", {"first_episode": 5_900}, "demonstrations use others"),
    ("gail", {"methods": ("bc",)}, "no method of this study"),
    ("gail", {"apart": {"reach": {"sead": 2}}}, r"apart.reach names \['sead'\]; valid: steps, seeds, controls"),
    ("gail", {"seeds": 0}, "start at 1"),
    ("human_data", {"fewer": {"transformer": 1}}, "transformer"),
    ("human_data", {"as_recorded": ("lstm",)}, "lstm"),
    ("human_data", {"fewer": {"act": 0}}, r"fewer\.act is 0; it starts at 1"),
    ("imitation", {"tasks": ("hover",)}, "task"),
    ("imitation", {"methods": ("diffusion_act",)}, "method"),
    ("imitation", {"algorithms": {}}, "differ"),
    ("imitation", {"first_episode": 9_999}, "from 10000"),
    ("imitation", {"episodes": 0}, "start at 1"),
    ("imitation", {"draws": ()}, "at least one"),
    ("imitation", {"flown_in": ("storm",)}, "storm"),
    ("learning_curve", {"sizes": ()}, "start at 1"),
    ("pixels", {"policy": MLP()}, "sees no images"),
    ("policies", {"calls": 0}, "calls is 0"),
    ("policies", {"policies": ("mpl",)}, "Did you mean 'mlp'"),
    ("recording", {"num_envs": 0}, "got 0, "),
    ("rl_speed", {"algorithms": ("bc",)}, "flies while it learns"),
    ("rl_speed", {"repetitions": 0}, "start at 1"),
    ("sb3", {"cells": ("ppo_cartpol",)}, "Did you mean 'ppo_cartpole'"),
    ("sb3", {"steps_share": 0.0}, "steps_share"),
    ("teleop", {"keys": 0}, "keys"),
    ("teleop", {"duration_s": 0.0}, "duration_s"),
    ("teleop", {"silences": 0}, "silences"),
    ("teleop", {"kills": -1}, "kills"),
    ("tracking", {"seeds": 0}, "seeds >= 1"),
    ("wind", {"tiers": ("calm",)}, "No wind in calm"),
    ("wind", {"duration_s": 1.0}, "163.84"),
    ("z1_reach", {"algorithms": ("ppo",)}, r"algorithms names \['ppo'\]; valid: sac, td3, ddpg"),
]


@pytest.mark.parametrize(
    ("study", "wrong", "said"), CASES, ids=[f"{name}-{next(iter(wrong))}" for name, wrong, _ in CASES]
)
def test_impossible_settings_are_refused(study: str, wrong: dict[str, Any], said: str) -> None:
    with pytest.raises((InvalidValueError, UnknownNameError), match=said):
        registry.get("study", study)(**wrong)
