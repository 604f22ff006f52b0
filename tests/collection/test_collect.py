"""Collecting is bit for bit repeatable and complete; the whole path on real robots: flown, recorded, replayed."""

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import aerial_il
from aerial_il.collection.collect import collect
from aerial_il.core.errors import InvalidValueError, SimulationDivergedError, StorageError
from aerial_il.data.dataset import open_dataset
from aerial_il.data.folder import DatasetFolder
from aerial_il.data.recording.reader import read_episode
from aerial_il.data.recovery import recover
from aerial_il.data.replay import replay
from aerial_il.suite.scenario import horizon_of
from tests.data.crane import CraneBatch, CraneExpert

pytestmark = pytest.mark.usefixtures("no_commit")
SEEDS = range(10)
CHILD = """
import sys
from aerial_il.collection.collect import collect
from tests.data.crane import CraneBatch, CraneExpert
collect(CraneBatch(int(sys.argv[2])), CraneExpert(), range(int(sys.argv[3])), sys.argv[1], progress=False)
"""


def digests(folder: DatasetFolder) -> dict[str, str]:
    """Return the SHA-256 of every finished episode."""
    files = [*folder.files("demos"), *folder.files("failures")]
    return {f"{f.parent.name}/{f.name}": hashlib.sha256(f.read_bytes()).hexdigest() for f in files}


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> DatasetFolder:
    return collect(CraneBatch(1), CraneExpert(), SEEDS, tmp_path_factory.mktemp("one"), progress=False).folder


def start_child(out: Path, num_envs: int, seeds: int) -> subprocess.Popen:
    return subprocess.Popen([sys.executable, "-c", CHILD, str(out), str(num_envs), str(seeds)], env=os.environ)


@pytest.mark.parametrize("num_envs", [3, 16])
def test_files_do_not_depend_on_the_number_of_worlds(reference: DatasetFolder, tmp_path: Path, num_envs: int) -> None:
    result = collect(CraneBatch(num_envs), CraneExpert(), SEEDS, tmp_path, progress=False)
    assert digests(result.folder) == digests(reference)
    assert len(result.demos) + len(result.failures) == len(SEEDS)


def test_outcomes_are_sorted_and_labelled(reference: DatasetFolder) -> None:
    demos, failures = reference.files("demos"), reference.files("failures")
    assert demos
    assert failures
    assert all(read_episode(file).success for file in demos)
    assert not any(read_episode(file).success for file in failures)
    assert len(open_dataset(reference.path)) == len(demos)
    assert len(open_dataset(reference.path, failures=True)) == len(SEEDS)
    index = reference.read_index()
    assert index["robot"] == "crane"
    assert index["demos"] == {f.stem: hashlib.sha256(f.read_bytes()).hexdigest() for f in demos}
    line = json.loads((reference.path / "recordings.jsonl").read_text())
    assert (line["demos"], line["failures"]) == (len(demos), len(failures))


def test_a_crash_is_a_failure_that_ends_the_flight(tmp_path: Path) -> None:
    result = collect(CraneBatch(4), CraneExpert(dive=True), SEEDS, tmp_path, progress=False)
    crashed = [e for e in open_dataset(tmp_path, failures=True) if e.terminated[-1]]
    assert crashed
    assert {e.seed for e in crashed} <= set(result.failures)


def test_the_same_call_again_flies_nothing(reference: DatasetFolder) -> None:
    before, env = digests(reference), CraneBatch(4)
    result = collect(env, CraneExpert(), SEEDS, reference.path, progress=False)
    assert sorted(result.skipped) == list(SEEDS)
    assert env.stepped == 0
    assert digests(reference) == before


def test_other_settings_are_other_episodes(tmp_path: Path) -> None:
    collect(CraneBatch(2), CraneExpert(), range(2), tmp_path, progress=False)
    noisy = CraneExpert(noise=0.02)
    result = collect(CraneBatch(2), noisy, range(2), tmp_path, settings={"noise": 0.02}, mix=True, progress=False)
    assert not result.skipped
    episodes = {e.provenance["settings"].get("noise"): e for e in open_dataset(tmp_path, failures=True) if e.seed == 0}
    assert np.array_equal(episodes[None].actions, episodes[None].expert_actions)
    assert np.abs(episodes[0.02].actions - episodes[0.02].expert_actions).max() > 0.01


def test_an_expert_labels_what_a_policy_flies(tmp_path: Path) -> None:
    class Still:
        def reset(self, mask: np.ndarray | None = None) -> None: ...

        def act(self, obs: dict[str, np.ndarray]) -> np.ndarray:
            return np.tile([0.0, 1.0], (len(obs["ee_pos"]), 1))

    env = CraneBatch(2, max_steps=30)
    collect(env, Still(), range(2), tmp_path, policy_name="still", expert=CraneExpert(), progress=False)
    for episode in open_dataset(tmp_path, failures=True):
        assert (episode.actions == [0.0, 1.0]).all()
        np.testing.assert_array_equal(episode.expert_actions[:, 0], episode.obs["goal_pos"][:-1, 0])
        assert (episode.phase == -1).all()


def test_another_environment_is_refused(reference: DatasetFolder) -> None:
    with pytest.raises(InvalidValueError, match=r"max_steps: 120 != 7.*out=PATH"):
        collect(CraneBatch(2, max_steps=7), CraneExpert(), SEEDS, reference.path, progress=False)


@pytest.mark.parametrize("seeds", [[], [1, 1], [-1]])
def test_seeds_are_checked(tmp_path: Path, seeds: list[int]) -> None:
    with pytest.raises(InvalidValueError, match="Seeds must be distinct"):
        collect(CraneBatch(2), CraneExpert(), seeds, tmp_path, progress=False)


def test_killed_at_any_moment_it_continues(reference: DatasetFolder, tmp_path: Path) -> None:
    """SIGKILL a real process again and again; what was finished stays readable, and in the end all files are equal.

    One that gets through before it is killed, as on a busy machine, is followed by another in a folder of its own.
    """
    rng, kills, attempts = np.random.default_rng(1), 0, 0
    folder, finished = DatasetFolder(tmp_path / "0"), dict[str, str]()
    while kills < 3:
        attempts += 1
        assert attempts < 100
        child = start_child(folder.path, 3, len(SEEDS))
        while len(digests(folder)) <= len(finished) and child.poll() is None:
            time.sleep(0.002)
        time.sleep(rng.uniform(0, 0.05))
        child.send_signal(signal.SIGKILL)
        killed = child.wait() == -signal.SIGKILL
        kills += killed
        present = digests(folder)
        assert finished.items() <= present.items()
        finished = present
        for name in finished:
            read_episode(folder.path / name)
        if not killed:
            folder, finished = DatasetFolder(tmp_path / str(attempts)), {}
    assert start_child(folder.path, 2, len(SEEDS)).wait() == 0
    assert digests(folder) == digests(reference)
    assert not folder.parts()
    assert recover(folder.path) == []


def test_several_processes_share_a_folder(reference: DatasetFolder, tmp_path: Path) -> None:
    children = [start_child(tmp_path, 2, len(SEEDS)) for _ in range(2)]
    assert [child.wait() for child in children] == [0, 0]
    folder = DatasetFolder(tmp_path)
    collect(CraneBatch(2), CraneExpert(), SEEDS, tmp_path, progress=False)
    assert digests(folder) == digests(reference)


def test_a_full_disk_is_an_error_and_costs_nothing_finished(reference: DatasetFolder, tmp_path: Path) -> None:
    collect(CraneBatch(2), CraneExpert(), range(4), tmp_path, progress=False)
    before = digests(DatasetFolder(tmp_path))
    name = next(f.stem for f in reference.files() if "-000004-" in f.name or "-000005-" in f.name)
    (tmp_path / "demos" / f"{name}.mcap.part").symlink_to("/dev/full")
    with pytest.raises(StorageError, match=r"No space left on device.*run the same command again"):
        collect(CraneBatch(2), CraneExpert(), SEEDS, tmp_path, progress=False)
    (tmp_path / "demos" / f"{name}.mcap.part").unlink()
    after = digests(DatasetFolder(tmp_path))
    assert before.items() <= after.items()
    assert len(list(open_dataset(tmp_path, failures=True))) == len(after)
    collect(CraneBatch(2), CraneExpert(), SEEDS, tmp_path, progress=False)
    assert digests(DatasetFolder(tmp_path)) == digests(reference)


def test_a_policy_that_gives_nan_stops_with_step_and_seed(tmp_path: Path) -> None:
    class Poisoned(CraneExpert):
        def act(self, obs: dict[str, np.ndarray]) -> np.ndarray:
            actions = super().act(obs)
            actions[self.env.steps == 9] = np.nan
            return actions

    with pytest.raises(SimulationDivergedError, match="at step 9 of the episode with seed 20"):
        collect(CraneBatch(1), Poisoned(), [20, 21], tmp_path, progress=False)
    assert DatasetFolder(tmp_path).parts()


@pytest.mark.parametrize(("robot", "task"), [("ua_quad_arm4", "pick_place"), ("fa_hexa_arm4", "reach")])
def test_a_flight_in_gusts_is_recorded_and_replays(tmp_path: Path, robot: str, task: str) -> None:
    digests = []
    for num_envs in (1, 3):
        env = aerial_il.load_batch(robot, task, tier="gusts", num_envs=num_envs)
        expert = aerial_il.expert(robot, task)
        folder = collect(env, expert, range(2), tmp_path / str(num_envs), progress=False).folder
        digests.append([hashlib.sha256(f.read_bytes()).digest() for f in folder.files() + folder.files("failures")])
    assert digests[0] == digests[1]
    episode = open_dataset(folder.path, failures=True)[0]
    assert episode.spec == env.spec
    starts = np.linspace(0, len(episode) - 1, 3).astype(int).tolist()
    assert replay(env, episode, starts=starts) == sum(len(episode) - start for start in starts)


def test_with_a_horizon_flights_go_on_through_success(tmp_path: Path) -> None:
    env = aerial_il.load_batch("fa_hexa_arm4", "reach", num_envs=2, horizon=220)
    folder = collect(env, aerial_il.expert("fa_hexa_arm4", "reach"), range(2), tmp_path, progress=False).folder
    flights = list(open_dataset(folder.path))
    assert [len(flight) for flight in flights] == [220, 220]
    assert all(flight.success and flight.truncated[-1] and not flight.terminated.any() for flight in flights)
    assert horizon_of(flights[0].spec) == 220
    assert horizon_of(aerial_il.load_batch("fa_hexa_arm4", "reach", num_envs=1).spec) is None


def test_a_horizon_that_is_no_shorter_than_the_time_limit_is_refused() -> None:
    """One that is as long would be forgotten: of its recordings nothing says whether success was to end them."""
    for horizon in (1001, 1000, 0, 10.5, True):
        says = rf"horizon is {horizon}; it must be an integer, in \[1, 999\]. reach has a time limit of 1000 steps"
        with pytest.raises(InvalidValueError, match=says):
            aerial_il.load_batch("fa_hexa_arm4", "reach", horizon=horizon)


@pytest.mark.render
def test_pictures_stay_with_their_steps_when_other_worlds_land(tmp_path: Path) -> None:
    """Worlds that land at different steps: each file is the one that a world alone writes."""
    found = []
    for num_envs in (1, 3):
        env = aerial_il.load_batch("quad", "hover", num_envs=num_envs, cameras=("scene",), image_size=(24, 32))
        folder = collect(
            env, aerial_il.expert("quad", "hover"), range(4), tmp_path / str(num_envs), progress=False
        ).folder
        found.append({file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in folder.files()})
    assert found[0] == found[1]
    flights = list(open_dataset(folder.path))
    assert len({len(flight) for flight in flights}) > 1, "they land at different steps"
