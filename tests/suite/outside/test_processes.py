"""Environments from outside in processes of their own; recorded and flown by a policy that finds its way home."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import dm_env
import numpy as np
import pytest
from dm_env import specs

import aerial_il
from aerial_il.cli.main import main
from aerial_il.collection.collect import collect
from aerial_il.core.contracts import Observation
from aerial_il.core.errors import InvalidValueError, SimulationDivergedError
from aerial_il.suite import outside
from aerial_il.suite.outside.processes import SharedBatch, processes_for
from tests.patience import HANG_S


class Counting(dm_env.Environment):
    """Shows seed and steps so far; an action above 0.5 spoils the next observation, one below -0.5 is an error."""

    def __init__(self, seed: int) -> None:
        self._seed, self._steps = seed, 0

    def reset(self) -> dm_env.TimeStep:
        return dm_env.restart(np.array([self._seed, 0.0]))

    def step(self, action: np.ndarray) -> dm_env.TimeStep:
        if action[0] < -0.5:
            raise ZeroDivisionError("as it was asked to")
        self._steps += 1
        shown = np.nan if action[0] > 0.5 else self._steps
        return dm_env.transition(1.0, np.array([self._seed, shown]))

    def action_spec(self) -> specs.BoundedArray:
        return specs.BoundedArray((1,), float, -1.0, 1.0)

    def observation_spec(self) -> specs.Array:
        return specs.Array((2,), float)


def hopper(n: int, processes: int = 1) -> Any:
    return aerial_il.load_gymnasium("Hopper-v5", num_envs=n, processes=processes, max_steps=30)


def swinging(n: int, processes: int = 1) -> Any:
    return outside.load_dm_control("cartpole-balance", num_envs=n, processes=processes, max_steps=20)


@pytest.fixture(scope="module")
def counting() -> Iterator[Any]:
    env = aerial_il.load_dm_env(Counting, num_envs=3, processes=2, max_steps=9)
    yield env
    env.close()


def story(env: Any) -> list[Any]:
    """Return all that an environment says while it is asked everything."""
    rng, n = np.random.default_rng(0), env.num_envs
    some, answers = np.arange(n) % 2 == 0, [env.reset(7), env.spec, env.rule, env.model, env.model_xml]
    for mask in (None, some, None, ~some):
        actions = rng.uniform(env.spec.action.low, env.spec.action.high, (n, env.spec.action.size))
        step = env.step(actions, mask)
        answers += [step.obs, step.reward, step.terminated, step.truncated, step.info]
    answers += [state := env.get_state(), env.ctrl, env.sim_time, env.seeds.copy(), env.reset(np.arange(n) + 40, some)]
    return [*answers, env.seeds, env.set_state(state, ~some), env.set_state(state), env.observe()]


@pytest.mark.parametrize("make", [hopper, swinging])
def test_several_processes_answer_as_one(make: Any) -> None:
    one, shared = make(5), make(5, processes=2)
    assert isinstance(shared, SharedBatch)
    for a, b in zip(story(one), story(shared), strict=True):
        np.testing.assert_equal(b, a)
    shared.close()


def test_what_is_not_finite_elsewhere_names_seed_and_step(counting: Any) -> None:
    counting.reset(11)
    counting.step(np.zeros((3, 1)))
    with pytest.raises(SimulationDivergedError, match="step 2 of the episode with seed 13") as caught:
        counting.step(np.array([[0.0], [0.0], [1.0]]))
    assert (caught.value.seed, caught.value.step) == (13, 2)


def test_an_environments_own_error_brings_its_traceback(counting: Any) -> None:
    counting.reset(0)
    with pytest.raises(RuntimeError, match="ZeroDivisionError: as it was asked to"):
        counting.step(np.array([[0.0], [0.0], [-1.0]]))
    assert counting.reset(5)["observation"][:, 0].tolist() == [5, 6, 7], "the processes live on"


def test_a_late_answer_is_not_taken_for_the_next(counting: Any) -> None:
    counting.reset(0)
    counting._others[0].ask("sim_time", ())  # whoever asked was interrupted
    assert counting.observe()["observation"][:, 0].tolist() == [0, 1, 2]


def test_a_process_that_is_lost_is_named_and_none_is_left_behind() -> None:
    before = set(multiprocessing.active_children())
    env: Any = aerial_il.load_dm_env(Counting, num_envs=3, processes=3, max_steps=9)
    env.reset(0)
    first, second = set(multiprocessing.active_children()) - before
    first.kill()
    first.join()
    with pytest.raises(InvalidValueError, match=r"process that flies worlds has ended.*processes=1"):
        env.step(np.zeros((3, 1)))
    env.close()
    assert not second.is_alive()


@pytest.mark.parametrize("processes", [0, 4])
def test_more_processes_than_worlds_are_refused(processes: int) -> None:
    with pytest.raises(InvalidValueError, match=rf"from 1 to num_envs=3, got {processes}"):
        aerial_il.load_dm_env(Counting, num_envs=3, processes=processes, max_steps=9)


def test_what_cannot_be_pickled_is_refused_before_anything_flies() -> None:
    with pytest.raises(InvalidValueError, match="pickled"):
        aerial_il.load_dm_env(lambda seed: Counting(seed), num_envs=2, processes=2, max_steps=9)


@pytest.mark.parametrize(("threads", "worlds", "processes"), [(4, 64, 4), (4, 20, 2), (4, 7, 1), (1, 64, 1)])
def test_few_worlds_share_one_process(threads: int, worlds: int, processes: int) -> None:
    assert processes_for(threads, worlds) == processes
    assert processes_for(0, 8) == 1


SCRIPT = """
import multiprocessing
import signal
import numpy as np
import aerial_il

if __name__ == "__main__":
    heard = []
    signal.signal(signal.SIGTERM, lambda *_: heard.append("SIGTERM"))
    env = aerial_il.load_gymnasium("Pendulum-v1", num_envs=2, processes=2)
    env.reset(0)
    print(multiprocessing.active_children()[0].pid, flush=True)
    while not heard:
        env.step(np.zeros((2, 1)))
    env.step(np.zeros((2, 1)))
    print("went on and ended", flush=True)
"""


@pytest.fixture
def flying(tmp_path: Path) -> Iterator[tuple[subprocess.Popen[str], int]]:
    """A script in a process group of its own, and the process that it has started."""
    (tmp_path / "script.py").write_text(SCRIPT)
    words = [sys.executable, str(tmp_path / "script.py")]
    script = subprocess.Popen(words, stdout=subprocess.PIPE, text=True, start_new_session=True)
    assert script.stdout is not None
    yield script, int(script.stdout.readline())
    script.kill()
    script.wait()


def ended(pid: int) -> bool:
    """Wait until a process is gone, or has ended and nobody has asked how."""
    for _ in range(int(HANG_S / 0.05)):
        status = Path(f"/proc/{pid}/stat")
        if not status.exists() or status.read_text().rpartition(")")[2].split()[0] == "Z":
            return True
        time.sleep(0.05)
    return False


def test_a_signal_to_the_whole_group_is_answered_by_who_asks(flying: tuple[subprocess.Popen[str], int]) -> None:
    script, other = flying
    os.killpg(script.pid, signal.SIGTERM)
    said, _ = script.communicate(timeout=HANG_S)
    assert (said, script.returncode) == ("went on and ended\n", 0)
    assert ended(other), "without a word to close it"


def test_a_process_does_not_outlive_who_asks(flying: tuple[subprocess.Popen[str], int]) -> None:
    script, other = flying
    script.kill()
    assert ended(other)


def test_a_script_without_its_guard_is_answers(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text("import aerial_il\naerial_il.load_gymnasium('Pendulum-v1', num_envs=2, processes=2)\n")
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=HANG_S, check=False)
    assert "InvalidValueError: A process that flies worlds has ended" in done.stderr


QUIET = "progress=false"


class Balancer:
    """Pushes the cart the way that the pole falls."""

    def reset(self, mask: np.ndarray | None = None) -> None:
        pass

    def act(self, obs: Observation) -> np.ndarray:
        right = obs["observation"] @ np.array([0.1, 0.3, 3.0, 1.0]) > 0
        return np.stack([~right, right], axis=1).astype(float)


def test_record_train_and_judge(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    monkeypatch.chdir(tmp_path)
    env = aerial_il.load_gymnasium("CartPole-v1", num_envs=3, max_steps=100)
    made = collect(env, Balancer(), range(6), tmp_path / "demos", policy_name="balancer", progress=False)
    assert len(made.demos) == 6
    dataset = aerial_il.open_dataset(str(tmp_path / "demos"))
    assert dataset.spec == env.spec
    assert all(len(episode) == 100 and episode.total_reward == 100 for episode in dataset)
    small = ["policy.hidden=[32,32]", "policy.chunk=1", "policy.ensemble=null", "algorithm.steps=150"]
    assert main(["train", "dataset=demos", "run=run", *small, QUIET]) == 0
    assert main(["evaluate", "policy=run", "out=judged", "episodes=6", "num_envs=4", "videos=0", QUIET]) == 0
    judged = json.loads((tmp_path / "judged" / "evaluation.json").read_text())
    assert judged["provenance"]["command"].startswith("aerial-il evaluate policy=run env=gymnasium:CartPole-v1 ")
    assert judged["return"]["mean"] > 75, "pushing at random earns about 20"
    assert "Return " in capsys.readouterr().out


def test_a_policy_records_where_it_is_told_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    where = ["env=gymnasium:Pendulum-v1", "max_steps=10", "success=return:-1000", QUIET]
    assert main(["collect", *where, "policy=random", "episodes=3", "out=flown"]) == 0
    assert [len(episode) for episode in aerial_il.open_dataset("flown")] == [10, 10, 10]
    assert main(["collect", *where, "episodes=3", "out=flown"]) == 2


def test_the_same_files_whatever_the_number_of_worlds(tmp_path: Path) -> None:
    for n in (1, 3):
        env = aerial_il.load_gymnasium("CartPole-v1", num_envs=n, max_steps=30)
        collect(env, Balancer(), range(4), tmp_path / str(n), policy_name="balancer", progress=False)
    one, three = ({f.name: f.read_bytes() for f in (tmp_path / n).rglob("*.mcap")} for n in ("1", "3"))
    assert one == three
    assert len(one) == 4
