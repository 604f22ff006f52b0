"""Every study is found by its folder, flies the shipped defaults, and refuses what it cannot be asked for."""

from dataclasses import fields, is_dataclass
from typing import Any

import pytest
import yaml

from aerial_il.algorithms.bc import BC
from aerial_il.core import registry
from aerial_il.core.composition import build, plain
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.policies.mlp import MLP
from aerial_il.workflows.collect import Expert
from aerial_il.workflows.train import Train
from experiments.common.report import settings_of
from experiments.controllers.study import Controllers
from experiments.dagger.study import Dagger
from experiments.imitation.study import DEFAULT, Imitation
from experiments.learning_curve.study import LearningCurve

STUDIES = registry.names("study")


@pytest.mark.parametrize("name", STUDIES)
def test_a_study_is_what_its_folder_says(name: str) -> None:
    study = registry.get("study", name)
    assert study.name == name
    assert study.question.endswith("?")
    assert is_dataclass(study)
    assert fields(study)
    assert study() == study(), "settings are values"


@pytest.mark.parametrize("name", STUDIES)
def test_settings_come_back_as_they_were_printed(name: str) -> None:
    usual: Any = registry.get("study", name)()
    again = build(type(usual), yaml.safe_load(yaml.safe_dump(plain(usual))), base=usual)
    assert settings_of(again) == settings_of(usual)


def test_an_unknown_study_is_answered_with_the_nearest() -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'tracking'"):
        registry.get("study", "traking")


def test_training_without_a_word_is_the_training_of_the_studies() -> None:
    usual: Any = {field.name: field.default for field in fields(Train)}
    assert (usual["policy"], usual["algorithm"]) == (DEFAULT, "bc")
    study, curve, asking = Imitation(), LearningCurve(), Dagger()
    assert study.policies[DEFAULT] == curve.policy == asking.policy == MLP()
    assert study.algorithms[DEFAULT] == curve.algorithm == asking.cloning == BC()


@pytest.mark.parametrize("study", ["imitation", "learning_curve", "dagger", "from_prior", "pixels", "lerobot"])
def test_the_expert_demonstrates_as_collect_has_it(study: str) -> None:
    assert registry.get("study", study)().noise == Expert().noise


def test_the_study_of_controllers_flies_every_law() -> None:
    assert set(Controllers().controllers) == set(registry.names("controller"))


ITERATED = "expert_iteration"
CASES: list[tuple[str, dict[str, Any], str]] = [
    ("adroit", {"clean": ({"demos": 15, "asks": 1},)}, "it names demos and any of bc"),
    ("beyond_teacher", {"suited": {"insert_peg": {"exploration": {"nose": 0.07}}}}, "Did you mean 'exploration.noise'"),
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
    ("from_prior", {"suited": {"hover": {"dapg": {"exploration": {"nose": 0.1}}}}}, "Did you mean 'exploration.noise'"),
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
    ("imitation", {"first_episode": 9_999}, "from 20000"),
    ("imitation", {"episodes": 0}, "start at 1"),
    ("imitation", {"draws": ()}, "at least one"),
    ("imitation", {"flown_in": ("storm",)}, "storm"),
    ("learning_curve", {"sizes": ()}, "start at 1"),
    ("pixels", {"cameras": ()}, "name at least one"),
    ("pixels", {"flown_in": ()}, "name at least one"),
    ("pixels", {"tasks": ("no_such",)}, "no_such"),
    ("imitation", {"robots": ("nobody",)}, "nobody"),
    ("pixels", {"changes": ("blind",)}, "images blanked"),
    ("pixels", {"arms": ("end to end",), "changes": ("10 Hz",)}, "only policies with eyes"),
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
