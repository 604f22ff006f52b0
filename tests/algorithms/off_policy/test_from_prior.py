"""Actor-critics that start from a clone: it flies first, critics learn its value, and other weights are refused."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.off_policy.problems import explored
from aerial_il.algorithms.online.interface import decode
from aerial_il.algorithms.run.folder import read_metrics
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import ActionSpec
from aerial_il.policies import load_policy
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.layout import Interface, Layout
from aerial_il.policies.parts.network import PolicySettings
from aerial_il.policies.parts.normaliser import Normaliser
from aerial_il.policies.parts.switches import Switches
from aerial_il.policies.squashed_gaussian import SquashedGaussian
from tests.algorithms import point_mass, small
from tests.algorithms.drift import SPEC, Drift, demonstrations, mean_reward
from tests.algorithms.small import POLICY

NAMES = ["ddpg", "sac", "td3"]
each = pytest.mark.parametrize("name", NAMES)
BRIEF: dict[str, Any] = {"steps": 320, "warmup": 160, "log_every": 160}


def cloned(run: Path, policy: PolicySettings = POLICY) -> Path:
    cloning = BC(steps=400, batch_size=64, lr=3e-3, warmup_steps=10, ema=0.9, validation=0.0)
    cloning.train(demonstrations(40), policy, run=run, progress=False)
    return run


@pytest.fixture(scope="module")
def prior(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return cloned(tmp_path_factory.mktemp("prior") / "run")


@pytest.fixture(scope="module")
def chunked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    policy = MLP(hidden=(16,), chunk=3, anchor=None, masked_fields=())
    return cloned(tmp_path_factory.mktemp("chunked") / "run", policy)


@pytest.fixture(scope="module")
def narrow(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return cloned(tmp_path_factory.mktemp("narrow") / "run", SquashedGaussian(hidden=(8,)))


def train(name: str, run: Path, *, evaluate: Any = None, **changes: Any) -> Any:
    return small.train(small.short(name, **{**BRIEF, **changes}), run, Drift(8), evaluate=evaluate)


@each
def test_in_the_warm_up_the_prior_flies_and_critics_learn(tmp_path: Path, name: str, prior: Path) -> None:
    obs, taken = Drift(20).reset(0), {}

    def evaluate(policy: Any, step: int) -> dict[str, float]:
        taken[step] = policy.act(obs)
        return {}

    watched = {"evaluate": evaluate, "evaluate_every": 160}
    started, random = train(name, tmp_path / "started", prior=str(prior), **watched), train(name, tmp_path / "random")
    np.testing.assert_array_equal(taken[160], load_policy(prior).act(obs))
    assert not np.array_equal(taken[320], taken[160]), "the actor learns when the warm-up is over"
    rows = (read_metrics(tmp_path / run) for run in ("started", "random"))
    first, aimless = (next(row for row in result if "episode/return" in row) for result in rows)
    assert first["episode/return"] > aimless["episode/return"] + 1.0
    assert "critic/loss" in first
    assert "actor/loss" not in first
    assert "critic/loss" not in aimless
    assert random.config == started.config


@each
def test_it_goes_on_from_its_prior(tmp_path: Path, name: str, prior: Path) -> None:
    """In as many steps as bring a new actor nowhere near."""
    entropy = {"alpha": 0.01} if name == "sac" else {}
    started = train(name, tmp_path / "started", prior=str(prior), lr=1e-3, **entropy)
    fresh = train(name, tmp_path / "fresh", lr=1e-3, **entropy)
    assert mean_reward(started) > mean_reward(fresh) + 0.05
    obs = Drift(9).reset(0)
    assert not np.array_equal(started.fresh().act(obs), load_policy(prior).act(obs)), "it learned"


@each
def test_weights_of_another_class_or_size_are_refused(
    tmp_path: Path, name: str, prior: Path, chunked: Path, narrow: Path
) -> None:
    with pytest.raises(InvalidValueError, match=r"cannot start with.*chunk: 3 there, 1 here.*algorithm=ibrl"):
        train(name, tmp_path / "run", prior=str(chunked))
    with pytest.raises(InvalidValueError, match=r"hidden: \[?\(?8.*there.*16"):
        train(name, tmp_path / "run", prior=str(narrow))
    with pytest.raises(InvalidValueError, match="obs_norm=false"):
        train(name, tmp_path / "run", prior=str(prior), obs_norm=True)
    assert not (tmp_path / "run").exists()


def test_another_prior_in_the_same_place_is_another_run(tmp_path: Path, prior: Path) -> None:
    train("td3", tmp_path / "run", prior=str(prior), checkpoint_every=80)
    with pytest.raises(InvalidValueError, match="holds another run"):
        train("td3", tmp_path / "run", checkpoint_every=80)


def test_switches_are_kept_and_what_never_varied_is_held() -> None:
    """Three actions: one that varied, a gripper that only opens and closes, and one that stayed at 0.3."""
    rng = np.random.default_rng(0)
    shown = np.stack([rng.normal(size=99), rng.choice([0.2, 1.0], 99), np.full(99, 0.3)], 1).astype(np.float32)
    action = ActionSpec("velocity", tuple("xyz"), ("m/s",) * 3, (-5.0,) * 3, (5.0,) * 3)
    layout = Layout(replace(SPEC, action=action), ("position",))
    obs = Normaliser.none(layout.size)
    own = Interface(layout, obs, Normaliser.fit(shown), 10.0, Switches.fit(shown))
    drawn = rng.uniform(-1, 1, (50, 3)).astype(np.float32)
    flown = decode(explored(own), drawn, np.zeros((50, layout.size)))
    assert np.ptp(flown[:, 0]) > 1.0
    assert set(flown[:, 1].round(5)) == {0.2, 1.0}, "never between them"
    np.testing.assert_allclose(flown[:, 2], 0.3, rtol=1e-6)


def test_what_filled_one_unit_is_not_taken_for_what_never_varied() -> None:
    layout = Layout(SPEC, ("position",))
    filled = Normaliser.fit(np.linspace(-1.0, 1.0, 9)[:, None], "minmax")
    interface = Interface(layout, Normaliser.none(layout.size), filled, 10.0, Switches.none(1))
    assert filled.scale == 1.0
    assert np.isnan(explored(interface).switches.low).all()


def test_an_offset_that_never_varied_is_held() -> None:
    """At a place of the world it could not be held: the commanded height is as high as the tool, wherever that is."""
    layout = Layout(point_mass.SPEC, ("ee_pos", "cube_pos"), anchor="ee_pos")
    rng = np.random.default_rng(0)
    shown = np.concatenate([rng.normal(size=(99, 2)), np.zeros((99, 1)), rng.normal(size=(99, 7))], axis=1)
    scaler = Normaliser.fit(shown, "minmax")
    interface = Interface(layout, Normaliser.none(layout.size), scaler, 10.0, Switches.fit(shown))
    frames = rng.uniform(-0.4, 0.4, (50, layout.size))
    flown = decode(explored(interface), rng.uniform(-1, 1, (50, 10)).astype(np.float32), frames)
    np.testing.assert_allclose(flown[:, 2], frames[:, 2], atol=2e-3)
    assert np.ptp(flown[:, 0] - frames[:, 0]) > 1.0


@each
def test_a_prior_with_an_anchor_is_gone_on_from(tmp_path: Path, name: str) -> None:
    """Its actions have no bounds in the environment, but they have those that it was trained with."""
    policy = SquashedGaussian(hidden=(16,), anchor="ee_pos")
    cloning = BC(steps=40, batch_size=64, warmup_steps=5, ema=0.9, validation=0.0)
    cloning.train(point_mass.demonstrations(4), policy, run=tmp_path / "prior", progress=False)
    settings = small.short(name, **BRIEF, prior=str(tmp_path / "prior"), reward_patience=0)
    env = point_mass.PointMassBatch(8)
    started = settings.train(None, policy, env=env, run=tmp_path / "run", seed=1, progress=False)
    assert "actor/loss" in read_metrics(tmp_path / "run")[-1]
    again, obs = load_policy(tmp_path / "run"), env.reset(0)
    flown = again.act(obs)
    np.testing.assert_array_equal(flown, started.act(obs))
    np.testing.assert_allclose(flown[:, 3:9], np.tile(point_mass.ROT6D, (8, 1)), atol=1e-6)
