"""A dataset stays of one kind unless somebody wants it mixed; files are written whole, or told."""

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aerial_il.cli.main import main
from aerial_il.collection.collect import collect
from aerial_il.core.errors import InvalidValueError, SimulationDivergedError, StorageError
from aerial_il.data.dataset import altered_files, open_dataset
from aerial_il.data.folder import DatasetFolder
from aerial_il.data.recording import recorder
from aerial_il.data.recording.reader import read_episode
from aerial_il.data.recording.writer import is_being_written
from tests.collection.test_collect import digests
from tests.data.crane import CraneBatch, CraneExpert, StepResult
from tests.patience import HANG_S

pytestmark = pytest.mark.usefixtures("no_commit")
SEEDS = range(24)
WORLDS = 8
SLOW_CHILD = """
import os, sys, time
from aerial_il.collection.collect import collect
from tests.data.crane import CraneBatch, CraneExpert
sync = os.fsync
os.fsync = lambda handle: (time.sleep(0.05), sync(handle))
collect(CraneBatch(8), CraneExpert(), range(24), sys.argv[1], progress=False)
"""


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> DatasetFolder:
    out = tmp_path_factory.mktemp("reference")
    return collect(CraneBatch(WORLDS), CraneExpert(), SEEDS, out, progress=False).folder


def in_writer_thread() -> bool:
    return threading.current_thread().name.startswith("writer")


def test_the_flight_goes_on_while_a_file_waits_for_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    env, sync, flown = CraneBatch(3), os.fsync, []

    def slow(handle: int) -> None:
        before, last = env.stepped, time.monotonic() + HANG_S
        while in_writer_thread() and max(flown, default=0) < 5 > env.stepped - before and time.monotonic() < last:
            time.sleep(0.001)
        flown.append(env.stepped - before if in_writer_thread() else 0)
        sync(handle)

    monkeypatch.setattr(os, "fsync", slow)
    collect(env, CraneExpert(), range(4), tmp_path, progress=False)
    assert max(flown) >= 5


def test_few_blocks_make_the_flight_wait_but_change_nothing(
    reference: DatasetFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorder, "BLOCK_BYTES", 1)
    assert len(recorder.Recorder(CraneBatch().spec, 2, 5)._blocks) == 6
    collect(CraneBatch(5), CraneExpert(), SEEDS, tmp_path, progress=False)
    assert digests(DatasetFolder(tmp_path)) == digests(reference)


def test_the_index_has_the_digests_of_the_files(reference: DatasetFolder) -> None:
    assert altered_files(reference.path) == []
    assert sum(len(reference.read_index()[kind]) for kind in ("demos", "failures")) == len(SEEDS)


@pytest.mark.slow
def test_a_kill_with_a_full_queue_costs_each_world_one_episode(reference: DatasetFolder, tmp_path: Path) -> None:
    """The cheat would be to fly on before the last file is safe: more unfinished files than worlds."""
    folder, finished = DatasetFolder(tmp_path / "out"), 0
    while finished < len(SEEDS) // 2:
        child = subprocess.Popen([sys.executable, "-c", SLOW_CHILD, str(folder.path)])
        while len(digests(folder)) <= finished and child.poll() is None:
            assert len(folder.parts()) <= WORLDS
            time.sleep(0.002)
        child.send_signal(signal.SIGKILL)
        child.wait()
        assert len(folder.parts()) <= WORLDS
        found = digests(folder)
        assert found.items() <= digests(reference).items()
        assert len(found) > finished
        finished = len(found)
        for name in found:
            read_episode(folder.path / name)
    collect(CraneBatch(3), CraneExpert(), SEEDS, folder.path, progress=False)
    assert digests(folder) == digests(reference)
    assert not folder.parts()


def test_a_disk_that_fills_up_costs_nothing_finished(
    reference: DatasetFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sync, synced = os.fsync, []

    def fill_up(handle: int) -> None:
        if in_writer_thread():
            synced.append(handle)
            if len(synced) > 5:
                raise OSError(28, "No space left on device")
        sync(handle)

    monkeypatch.setattr(os, "fsync", fill_up)
    with pytest.raises(StorageError, match=r"No space left on device.*run the same command again"):
        collect(CraneBatch(WORLDS), CraneExpert(), SEEDS, tmp_path, progress=False)
    folder = DatasetFolder(tmp_path)
    assert len(digests(folder)) == 5
    assert digests(folder).items() <= digests(reference).items()
    assert len(list(open_dataset(tmp_path, failures=True))) == 5
    assert not any(is_being_written(part) for part in folder.parts()), "files are closed"
    assert len(folder.read_index()["demos"]) + len(folder.read_index()["failures"]) == 5
    monkeypatch.undo()
    collect(CraneBatch(WORLDS), CraneExpert(), SEEDS, tmp_path, progress=False)
    assert digests(folder) == digests(reference)


@pytest.mark.parametrize("step", [3, 70])
def test_a_value_that_cannot_be_recorded_names_seed_and_step(tmp_path: Path, step: int) -> None:
    class Broken(CraneBatch):
        def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> StepResult:
            result = super().step(actions, mask)
            result.reward[(self.seeds == 2) & (self.steps == step + 1)] = np.nan
            return result

    never = CraneExpert()
    never.act = lambda obs: np.tile([0.9, 1.9], (len(obs["ee_pos"]), 1))
    never.expert_action = np.tile([0.9, 1.9], (4, 1))
    with pytest.raises(SimulationDivergedError, match=rf"reward.* at step {step} of the episode with seed 2"):
        collect(Broken(4), never, range(4), tmp_path, progress=False)


def test_an_interrupt_keeps_what_has_landed(reference: DatasetFolder, tmp_path: Path) -> None:
    class Interrupted(CraneExpert):
        def act(self, obs: dict[str, np.ndarray]) -> np.ndarray:
            if len(DatasetFolder(tmp_path).files()) >= 3:
                raise KeyboardInterrupt
            return super().act(obs)

    with pytest.raises(KeyboardInterrupt):
        collect(CraneBatch(WORLDS), Interrupted(), SEEDS, tmp_path, progress=False)
    folder = DatasetFolder(tmp_path)
    listed = {uid for kind in ("demos", "failures") for uid in folder.read_index()[kind]}
    assert listed == {Path(name).stem for name in digests(folder)}
    assert digests(folder).items() <= digests(reference).items()


QUIET = "progress=false"
REACH = ["collect", "robot=quad", "task=hover", "episodes=2", "seed=3", QUIET]


def fly(out: Path, seeds: Any, **changed: Any) -> Any:
    told = {"policy_name": "expert", "settings": {"noise": 0.0}, "progress": False}
    return collect(CraneBatch(2), CraneExpert(), seeds, out, **(told | changed))


def test_other_seeds_of_the_same_kind_are_added(tmp_path: Path) -> None:
    fly(tmp_path, range(2))
    assert len(fly(tmp_path, range(1, 4)).skipped) == 1
    assert len(list(tmp_path.rglob("*.mcap"))) == 4


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"settings": {"noise": 0.3}}, "other settings: settings.noise 0.0 != 0.3 (existing"),
        (
            {"settings": {"noise": 0.0, "note": 99 * "a"}},
            f"settings: settings.note None != {60 * 'a'}... (99 characters) (",
        ),
        ({"policy_name": "a"}, "expert != a"),
    ],
)
def test_another_kind_is_refused_by_name_unless_it_is_wanted(
    tmp_path: Path, changed: dict[str, Any], named: str
) -> None:
    fly(tmp_path, range(2))
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(InvalidValueError, match="mix=true") as caught:
        fly(tmp_path, range(2, 4), **changed)
    assert named in str(caught.value)
    assert sorted(tmp_path.rglob("*")) == before
    fly(tmp_path, range(2), mix=True, **changed)
    fly(tmp_path, range(5, 6), **changed)  # both kinds are at home now
    fly(tmp_path, range(6, 7))


def test_another_engine_is_another_kind(tmp_path: Path) -> None:
    class Newer(CraneBatch):
        engine = "2"

    fly(tmp_path, range(2))
    with pytest.raises(InvalidValueError, match=r"engine 1 != 2"):
        collect(Newer(2), CraneExpert(), [7], tmp_path, settings={"noise": 0.0}, progress=False)


@pytest.fixture(scope="module")
def calm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("calm") / "demos"
    assert main([*REACH, f"out={out}"]) == 0
    return out


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["tier=gusts"], "tier calm != gusts"),
        (["expert.noise=0.2"], "settings.noise 0.3 != 0.2"),
        (["controller=pid"], "controller geometric_observer != pid"),
        (["action=velocity"], "another environment"),
        (["robot=fa_hexa_arm4", "task=reach"], "another environment"),
        (["robot=fa_hexa_arm4", "task=reach", "mix=true"], "another environment"),
    ],
)
def test_the_command_refuses_to_mix(
    calm: Path, words: list[str], named: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = sorted(calm.rglob("*"))
    assert main([*REACH, *words, f"out={calm}"]) == 2
    assert named in capsys.readouterr().err
    assert sorted(calm.rglob("*.mcap")) == sorted(file for file in before if file.suffix == ".mcap")


def test_info_counts_what_was_mixed(calm: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mixed = shutil.copytree(calm, tmp_path / "mixed")
    assert main(["info", str(mixed)]) == 0
    assert "Warning" not in capsys.readouterr().out
    assert main([*REACH, "tier=gusts", "expert.noise=0.1", "seed=4", "mix=true", f"out={mixed}"]) == 0
    capsys.readouterr()
    assert main(["info", str(mixed), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    kinds = {(kind["tier"], kind["settings"]): kind["episodes"] for kind in result["made_by"]}
    assert kinds == {("calm", "noise=0.3"): 2, ("gusts", "noise=0.1"): 2}
    assert result["repeated_seeds"] == [4]
    assert main(["info", str(mixed)]) == 0
    said = capsys.readouterr().out
    assert "1 seeds were flown more than once" in said
    assert "calm, gusts" in said
