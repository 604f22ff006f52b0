"""Recordings replay bit for bit from any step; what a kill or damage leaves is salvaged."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aerial_il.core.errors import DemoError
from aerial_il.core.files import sha256_of
from aerial_il.data.dataset import altered_files, open_dataset
from aerial_il.data.folder import DatasetFolder
from aerial_il.data.recording.reader import read_episode
from aerial_il.data.recording.recorder import Recorder
from aerial_il.data.recording.writer import EpisodeWriter
from aerial_il.data.recovery import recover, recover_episode
from aerial_il.data.replay import replay
from tests.data.crane import CraneBatch, CraneExpert


def record_part(path: Path, steps: int) -> None:
    """Record some steps of a flight and abandon it, as a kill would."""
    env, expert = CraneBatch(), CraneExpert()
    expert.attach(env)
    recorder, obs = Recorder(env.spec, 2), env.reset(0)
    origin = {"seed": 0, "policy": "expert"}
    recorder.begin(0, EpisodeWriter(path, recorder.layout, uid="cut", provenance=origin, model_xml=env.model_xml))
    for _ in range(steps):
        recorder.observe(obs, state=env.get_state(), sim_time=env.sim_time)
        action = expert.act(obs)
        result = env.step(action)
        obs, no = result.obs, np.zeros(1, bool)
        recorder.act(
            action=action, executed_action=action, expert_action=action, ctrl=env.ctrl, reward=result.reward,
            terminated=result.terminated, truncated=result.truncated, is_intervention=no, phase=expert.phase,
        )  # fmt: skip
    recorder.close()


@pytest.mark.parametrize("share", np.linspace(0.2, 0.999, 12))
def test_truncated_episodes_are_salvaged(folder: DatasetFolder, tmp_path: Path, share: float) -> None:
    source = folder.files("failures")[0]
    whole, raw = read_episode(source), source.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(raw[: int(share * len(raw))])
    if share < 0.45:  # its first 64 steps, or what precedes them, are cut
        with pytest.raises(DemoError, match=r"fewer than two complete steps|lacks the attachment"):
            recover_episode(cut, tmp_path / "saved.mcap")
        return
    saved = recover_episode(cut, tmp_path / "saved.mcap")
    episode = read_episode(saved.path)
    steps = len(episode)
    assert steps == saved.steps
    np.testing.assert_array_equal(episode.states, whole.states[: steps + 1])
    np.testing.assert_array_equal(episode.actions, whole.actions[:steps])
    assert episode.uid == whole.uid
    assert "the original is truncated" in episode.provenance["note"]
    if steps < len(whole):
        assert episode.truncated[-1]
        assert not episode.success
    else:
        assert episode.success == whole.success
    assert replay(CraneBatch(), episode) == steps


def test_folder_recovery_keeps_sets_aside_and_salvages(folder: DatasetFolder, tmp_path: Path) -> None:
    copy = DatasetFolder(shutil.copytree(folder.path, tmp_path / "copy"))
    record_part(copy.file("cut"), 100)
    victim = copy.files()[1]
    raw = bytearray(victim.read_bytes())
    raw[len(raw) // 2] ^= 1
    victim.write_bytes(raw)
    assert altered_files(copy.path) == [victim]
    assert [uid for uid, error in open_dataset(copy.path).problems() if error] == [victim.stem]

    found = {item.source.name: item for item in recover(copy.path)}

    assert found["cut.mcap.part"].steps == 63
    assert read_episode(copy.path / "salvaged" / "cut.mcap").provenance["note"].startswith("salvaged")
    assert str(victim) in (copy.path / "quarantine" / f"{victim.name}.txt").read_text()
    assert not copy.parts()
    dataset = open_dataset(copy.path)
    assert len(dataset) == len(folder.files()) - 1
    assert not any(error for _, error in dataset.problems())
    assert recover(copy.path) == []


def test_a_damaged_file_of_a_folder_stands_for_the_folder(folder: DatasetFolder, tmp_path: Path) -> None:
    """What is left of it is no demonstration beside the others."""
    copy = DatasetFolder(shutil.copytree(folder.path, tmp_path / "copy"))
    victim = copy.files()[0]
    raw = bytearray(victim.read_bytes())
    raw[len(raw) // 2] ^= 1
    victim.write_bytes(raw)
    (found,) = recover(victim)
    assert found.path.parent.name in ("salvaged", "quarantine")
    assert not victim.exists()
    assert len(copy.files()) == len(folder.files()) - 1
    assert not altered_files(copy.path)


def test_a_file_that_was_flown_anew_is_no_altered_one(folder: DatasetFolder, tmp_path: Path) -> None:
    copy = DatasetFolder(shutil.copytree(folder.path, tmp_path / "copy"))
    victim = copy.files()[0]
    recover_episode(victim, tmp_path / victim.name)  # another file of the same flight
    shutil.copy(tmp_path / victim.name, victim)
    assert altered_files(copy.path) == [victim]
    copy.write_index(copy.spec(), {victim.stem: sha256_of(victim)})
    assert not altered_files(copy.path), "what has just been written counts"
    shutil.copy(folder.file(victim.stem, victim.parent.name), victim)
    recover(copy.path)
    assert not altered_files(copy.path), "the index is written anew"


def test_flights_of_two_folders_with_one_name_are_both_learned_from(folder: DatasetFolder, tmp_path: Path) -> None:
    copies = [DatasetFolder(shutil.copytree(folder.path, tmp_path / name)) for name in ("monday", "tuesday")]
    assert len(open_dataset(tmp_path)) == len(open_dataset(copies[0].path)), "equal files are one flight"
    other = copies[1].files("demos")[0]
    recover_episode(other, tmp_path / other.name)
    shutil.copy(tmp_path / other.name, other)
    (tmp_path / other.name).unlink()
    copies[1].write_index(copies[1].spec(), {other.stem: sha256_of(other)})
    both = open_dataset(tmp_path)
    assert {other.stem, f"tuesday-{other.stem}"} <= {*both.uids}
    assert both[f"tuesday-{other.stem}"].uid == f"tuesday-{other.stem}"


def test_what_is_being_written_is_left_alone(tmp_path: Path) -> None:
    layout = Recorder(CraneBatch().spec, 2).layout
    writer = EpisodeWriter(tmp_path / "demos" / "a.mcap", layout, uid="a", provenance={"seed": 0}, model_xml="")
    assert recover(tmp_path) == []
    assert writer.part.exists()
    writer.discard()
    assert not writer.part.exists()


def test_a_lost_file_and_a_broken_index_are_noticed(folder: DatasetFolder, tmp_path: Path) -> None:
    copy = DatasetFolder(shutil.copytree(folder.path, tmp_path / "copy"))
    lost = copy.files()[0]
    lost.unlink()
    with pytest.raises(DemoError, match=f"{lost.name}.*missing"):
        open_dataset(copy.path)
    (copy.path / "dataset.yaml").write_text("spec: {robot: [")
    with pytest.raises(DemoError, match=r"dataset\.yaml.*cannot be read"):
        open_dataset(copy.path)
    recover(copy.path)
    assert len(open_dataset(copy.path)) == len(folder.files()) - 1


def test_trash_can_be_undone(folder: DatasetFolder, tmp_path: Path) -> None:
    copy = DatasetFolder(shutil.copytree(folder.path, tmp_path / "copy"))
    uid = copy.files()[0].stem
    copy.trash(uid)
    assert copy.find(uid) is None
    assert copy.restore(uid) == copy.find(uid)
    with pytest.raises(DemoError, match="has no episode 'nobody'"):
        copy.trash("nobody")


def test_replays_from_every_step(demo: Path) -> None:
    episode = read_episode(demo)
    count = len(episode)
    assert replay(CraneBatch(4), episode, starts=range(count)) == count * (count + 1) // 2


def test_names_the_first_divergence(demo: Path) -> None:
    episode = read_episode(demo)
    states = episode.states.copy()
    states[7, 2] += 1e-15
    with pytest.raises(DemoError, match=r"topic /step, step 7, field state\[2\]"):
        replay(CraneBatch(), replace(episode, states=states))
    actions = episode.executed_actions.copy()
    actions[5] += 1e-3
    with pytest.raises(DemoError, match="step 5, field reward"):
        replay(CraneBatch(), replace(episode, executed_actions=actions))
    rewards = np.where(np.arange(len(episode)) == 2, 0.5, episode.rewards)
    with pytest.raises(DemoError, match=r"an outcome differs.*step 2, field reward"):
        replay(CraneBatch(), replace(episode, rewards=rewards))


def test_refuses_what_cannot_be_compared(demo: Path) -> None:
    episode, env = read_episode(demo), CraneBatch()
    with pytest.raises(DemoError, match="another environment: max_steps"):
        replay(CraneBatch(max_steps=5), episode)
    with pytest.raises(DemoError, match="another scene"):
        replay(env, replace(episode, model_xml="<mujoco/>"))
    with pytest.raises(DemoError, match="another MuJoCo"):
        replay(env, replace(episode, provenance={"mujoco": "2.0.0"}))
    with pytest.raises(DemoError, match="cannot resume there"):
        replay(env, episode, starts=[len(episode)])
