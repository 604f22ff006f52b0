"""Every registered algorithm, found by itself: it learns, resumes after a kill, and refuses what it must.

The settings below make trainings small by the family of an algorithm; one of no family is trained by its defaults, with
those of the values that it knows.
"""

from __future__ import annotations

import os
import signal
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import aerial_il
from aerial_il import algorithms
from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.cpl import CPL
from aerial_il.algorithms.on_policy.settings import Rollout
from aerial_il.algorithms.online.algorithm import Algorithm as Flying
from aerial_il.collection.collect import collect
from aerial_il.core.checkpoint import ARRAYS
from aerial_il.core.contracts import Algorithm
from aerial_il.core.errors import AerialError, InvalidValueError, TrainingDivergedError
from aerial_il.data.episode import Episode
from aerial_il.policies.categorical import Categorical
from aerial_il.policies.parts.network import PolicySettings
from aerial_il.policies.squashed_gaussian import SquashedGaussian
from tests.algorithms.drift import SPEC, Drift, Guide, demonstrations, mean_reward
from tests.algorithms.made import made, names
from tests.algorithms.point_mass import StepResult

SEEING = ("perception",)  # learns from images, which are not drawn here: tests/algorithms/test_perception.py
NAMES = tuple(name for name in algorithms.names() if name not in SEEING)
each = pytest.mark.parametrize("name", NAMES)
POLICY = SquashedGaussian(hidden=(32, 32))
CHOICES = Categorical(hidden=(32, 32), choices="bounds")
FIRST = 24  # steps that are few, and yet more than a warm-up or a rollout
LEAST = 0.1  # share of the demonstrator's mean reward that a training adds to what its first steps have reached

CLONES = BC(
    steps=200,
    batch_size=64,
    lr=3e-3,
    warmup_steps=10,
    ema=0.9,
    validation=0.0,
    validate_every=0,
    cadence=replace(BC.cadence, checkpoint_every=60),
)
ALONE = {"bc_pretrain_steps": 0, "bc_weight": 0.0, "action_noise": False, "lr_floor": 1.0}
ALONE |= {"cloning": replace(CLONES, steps=1)}  # no clone does the work
NETWORKS = {"critic_hidden": (32, 32), "reward_hidden": (32,), "gamma": 0.9, "gradient_penalty": 1.0}
ONLINE: dict[str, Any] = {**NETWORKS, **ALONE, "steps": 1_200, "warmup": 200, "batch_size": 64, "lr": 3e-3}
OFF_POLICY = {**ONLINE, "utd_ratio": 0.5, "tau": 0.05, "actor_every": 1, "reward_lr": 2e-3, "reward_updates": 1.0}
OFF_POLICY |= {"exploration": 0.5, "target_every": 1, "offline_steps": 200}
ON_POLICY = {**ONLINE, "warmup": 0, "rollout": 512, "epochs": 8, "batch_size": 128}
ON_POLICY |= {"step_size": 0.1, "critic_lr": 3e-3, "noise": 0.5, "kl": 0.0, "trial": 8}
SOON = ("airl", "bc_ppo", "npg", "ppo", "residual")  # learn it in half of the steps
WHOLE = {"a2c": {"epochs": 1, "batch_size": None}}  # one step by the whole of a rollout
ON_POLICY |= {"reward_batch": 256, "reward_lr": 3e-3, "reward_updates": 32, "buffer_size": 2048}


IMPOSSIBLE = {"steps": 0, "gamma": 1.0, "threads": 0, "ema": 1.0, "minutes": 0.0, "critics.hidden": ()}
IMPOSSIBLE |= {"critic_hidden": (), "reward.dropout": 1.0, "reward.form": "x"}


class Broke(Drift):
    """Pays a reward that is not a number, from the fifth step of an episode on."""

    def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> StepResult:
        result = super().step(actions, mask)
        return replace(result, reward=np.where(self.steps >= 5, np.nan, result.reward))


class Blind(Drift):
    """Shows a position that is not a number, from the fifth step of an episode on."""

    def _observe(self) -> dict[str, np.ndarray]:
        shown = super()._observe()
        shown["position"][self.steps >= 5] = np.nan
        return shown


@pytest.fixture(autouse=True)
def _one_thread() -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def known(cls: type[Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return those of the values that are settings of ``cls``."""
    names = {field.name for field in fields(cls)}
    return {name: value for name, value in values.items() if name in names}


def small(name: str) -> Any:
    """Return settings that learn in seconds."""
    cls = algorithms.get(name)
    if issubclass(cls, Flying):
        if not isinstance(getattr(cls, "rollout", None), Rollout):
            shown = {"steps": 600} if cls.demonstrated else {}  # half as many suffice
            return made(cls, OFF_POLICY | shown)
        steps = (10_240 if cls.rewarded else 6_144) // (2 if name in SOON else 1)  # a learned reward says more a step
        paid = {"reward": "environment"} if cls.rewarded else {}
        return made(cls, ON_POLICY | WHOLE.get(name, {}) | paid | {"steps": steps})
    if cls is BC:
        return CLONES
    if issubclass(cls, CPL):
        return cls(cloning=CLONES, pairs=200, length=6, looked_at=3, steps=60, batch_size=16, lr=1e-3, ema=0.9)
    return cls(**known(cls, {"rounds": 2, "episodes": 4, "training": CLONES, "between_steps": 60}))


def short(name: str, steps: int) -> Any:
    """Return :func:`small` settings of ``steps`` steps, evaluated and saved on the way."""
    settings = small(name)
    changes: dict[str, Any] = {"steps": steps, "rollout": 16, "evaluate_every": steps // 4, "warmup": 8}
    changes |= {
        "offline_steps": 12,
        "epochs": 1,
        "trial": 2,
        "reward_updates": 1,
        "reward_batch": 8,
        "batch_size": 8,
        "log_every": 10,
        "buffer_size": 4096,  # the usual million takes 0.4 GB of a real cell's transitions, and some algorithms stay
    }
    changes |= WHOLE.get(name, {})
    if isinstance(settings, CPL):
        changes["cloning"] = replace(CLONES, steps=steps, batch_size=8)
    if "training" in {field.name for field in fields(settings)}:
        training = replace(CLONES, steps=steps, batch_size=8)
        changes = {"rounds": 2, "episodes": 2, "training": training, "between_steps": steps, "evaluate_every": 1}
    return made(type(settings), changes, settings)


def train(settings: Algorithm, run: Path, env: Any = None, demos: list[Episode] | None = None, **options: Any) -> Any:
    """Train with what the algorithm asks for."""
    handed = {"env": env or Drift(8), "expert": Guide(), "collect": collect}
    demos = (demos or demonstrations(10)) if settings.demonstrated else None
    options = {"seed": 3, "progress": False, **{need: handed[need] for need in settings.needs}, **options}
    return settings.train(demos, policy_of(settings), run=run, **options)


def policy_of(settings: Algorithm) -> PolicySettings:
    """Return a small policy of a kind that the algorithm trains."""
    return POLICY if isinstance(POLICY, getattr(settings, "trains", type(POLICY))) else CHOICES


@each
def test_it_fulfils_the_contract(name: str) -> None:
    settings = algorithms.get(name)()
    assert isinstance(settings, Algorithm)
    assert settings.name == name
    assert settings.worlds >= 1
    assert set(settings.needs) <= {"env", "expert", "collect"}


@each
def test_it_learns_more_than_its_start(tmp_path: Path, name: str) -> None:
    """On unseen seeds, with its own machinery alone; what never learns gains nothing, see the test below."""
    started = train(short(name, FIRST), tmp_path / "start")
    learned = train(small(name), tmp_path / "learned")
    assert gain(started, learned) > LEAST


def gain(started: Any, learned: Any) -> float:
    return (mean_reward(learned) - mean_reward(started)) / mean_reward(Guide())


def test_what_does_not_learn_gains_nothing(tmp_path: Path) -> None:
    started = train(short("sac", FIRST), tmp_path / "start")
    idle = train(replace(small("sac"), lr=1e-12), tmp_path / "idle")
    assert gain(started, idle) < LEAST


@each
def test_killed_in_the_middle_it_ends_with_the_same_bytes(tmp_path: Path, name: str) -> None:
    """Killed by the system, in its second evaluation: nothing can tidy up."""
    settings = short(name, 48)
    train(settings, tmp_path / "whole", evaluate=weight)

    def killed(calls: list[int] = []) -> Callable[[Any, int], dict[str, float]]:  # noqa: B006 - one list per process
        def evaluate(policy: Any, step: int) -> dict[str, float]:
            calls.append(step)
            if len(calls) == 2:
                os.kill(os.getpid(), signal.SIGKILL)
            return weight(policy, step)

        return evaluate

    assert killed_in_a_fork(lambda: train(settings, tmp_path / "run", evaluate=killed()))
    assert not (tmp_path / "run" / "policy").exists(), "killed before its end"
    assert list((tmp_path / "run").iterdir()), "killed after its beginning"
    train(settings, tmp_path / "run", evaluate=weight)
    whole, run = ((tmp_path / one / "policy" / ARRAYS).read_bytes() for one in ("whole", "run"))
    assert run == whole
    other = train(settings, tmp_path / "other", seed=4)
    assert (tmp_path / "other" / "policy" / ARRAYS).read_bytes() != whole, "another seed gives other bytes"
    assert other.config == policy_of(settings)


def weight(policy: Any, step: int) -> dict[str, float]:
    """Stand in for rollouts: a number that depends on the weights."""
    return {"success": float(next(policy.network.parameters()).detach().sum())}


def killed_in_a_fork(work: Callable[[], object]) -> bool:
    """Do some work in a process of its own; return whether it was killed."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of forking beside threads, of which the work uses none
        child = os.fork()
    if child == 0:
        try:
            work()
        finally:
            os._exit(1)
    _, status = os.waitpid(child, 0)
    return os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGKILL


@each
def test_impossible_settings_are_refused(name: str) -> None:
    """Every number that is not negative by default must not be, in groups neither, and none may be no number at all."""
    cls = algorithms.get(name)
    values = {key: value for key, value in values_of(cls()) if key in names(cls)}  # those of a choice depend on it
    numbers = {key: value for key, value in values.items() if type(value) in (int, float) and value >= 0}
    assert len(numbers) > 3
    wrong = [(number, value) for number in numbers for value in (-1, float("nan"))]
    for key, value in (*wrong, *((key, value) for key, value in IMPOSSIBLE.items() if key in names(cls))):
        with pytest.raises(InvalidValueError, match=key.rpartition(".")[2]):
            made(cls, {key: value})


def values_of(settings: Any, at: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the dotted name and the value of each setting, in groups too."""
    for field in fields(settings):
        value = getattr(settings, field.name)
        yield from values_of(value, f"{at}{field.name}.") if is_dataclass(value) else [(f"{at}{field.name}", value)]


@each
def test_what_is_no_number_is_refused(tmp_path: Path, name: str) -> None:
    settings = short(name, 96)
    if settings.demonstrated:
        demo, *others = demonstrations(4)
        actions = demo.executed_actions.copy()
        actions[3] = np.nan
        with pytest.raises(InvalidValueError, match="demo-0: the action is not finite at step 3"):
            train(settings, tmp_path / "data", demos=[replace(demo, executed_actions=actions), *others])
    if settings.rewarded:
        with pytest.raises(TrainingDivergedError):
            train(settings, tmp_path / "reward", env=Broke(8))
    if "env" in settings.needs:
        with pytest.raises(AerialError, match=r"(?i)non-finite"):
            train(settings, tmp_path / "blind", env=Blind(8))


@each
def test_the_run_of_another_environment_is_refused(tmp_path: Path, name: str) -> None:
    settings, elsewhere = short(name, FIRST), replace(SPEC, robot="crane")
    train(settings, tmp_path / "run")
    env, moved = Drift(8), [replace(demo, spec=elsewhere, obs=shifted(demo.obs)) for demo in demonstrations(10)]
    env.spec = elsewhere
    with pytest.raises(InvalidValueError, match="holds another run"):
        train(settings, tmp_path / "run", env=env, demos=moved)
    if "env" in settings.needs and settings.demonstrated:
        with pytest.raises(InvalidValueError, match=r"another environment|the environment is"):
            train(settings, tmp_path / "mixed", env=env)


def shifted(obs: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {name: values + 0.01 for name, values in obs.items()}


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Any, Any, list[Episode]]]:
    """One real cell: its worlds, its expert, and two demonstrations."""
    env = aerial_il.load_batch("ua_quad_arm4", "reach", num_envs=2, num_threads=1)
    expert, folder = aerial_il.expert("ua_quad_arm4", "reach"), tmp_path_factory.mktemp("cell") / "demos"
    collect(env, expert, range(2), folder, progress=False)
    yield env, expert, list(aerial_il.open_dataset(folder))
    env.close()


@each
def test_it_trains_on_a_real_cell(tmp_path: Path, name: str, cell: tuple[Any, Any, list[Episode]]) -> None:
    env, expert, demos = cell
    settings = short(name, FIRST)
    if "expert" in settings.needs:
        settings = replace(settings, **known(type(settings), {"rounds": 1, "episodes": 1}))
    options = {"expert": expert} if "expert" in settings.needs else {}
    policy = train(settings, tmp_path / "run", env=env, demos=demos, **options)
    obs = env.reset(np.array([5000, 5001]))
    policy.reset()
    actions = policy.act(obs)
    assert actions.shape == (2, env.spec.action.size)
    assert np.isfinite(actions).all()
    assert any(path.suffix == ".safetensors" for path in (tmp_path / "run" / "policy").iterdir())
