"""What rerun shows: curves and lanes of a flight, two flights on one timeline, and a flight as it happens."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rerun as rr

import aerial_il
from aerial_il.core.specs import ActionSpec
from aerial_il.data.episode import Episode
from aerial_il.evaluation.predictions import Prediction
from aerial_il.presentation.rerun.comparison import align, common, phase_starts
from aerial_il.presentation.rerun.flight import Flight
from aerial_il.presentation.rerun.live import WatchedBatch
from aerial_il.presentation.rerun.program import run
from aerial_il.presentation.rerun.signals import groups_of, phase_names
from tests.presentation.rerun.conftest import Shown


def test_actions_rewards_and_observations_are_the_recorded_ones(shown: Shown, episodes: list[Episode]) -> None:
    episode = episodes[0]
    for entity, values in {
        "action/ee_xyz/commanded": episode.actions[:, :3],
        "action/ee_xyz/executed": episode.executed_actions[:, :3],
        "action/gripper/executed": episode.executed_actions[:, 9:],
        "reward": episode.rewards[:, None],
        "observation/joint_pos": episode.obs["joint_pos"],
    }.items():
        result = shown.numbers(f"/signals/{entity}", "Scalars:scalars").reshape(values.shape)
        assert np.array_equal(result, values), entity


def test_both_timelines_are_the_recordings(shown: Shown, episodes: list[Episode]) -> None:
    episode = episodes[0]
    assert np.array_equal(shown.numbers("/scene/robot/base", "step"), np.arange(len(episode) + 1))
    nanoseconds = shown.column("/scene/robot/base", "sim_time").combine_chunks().cast("int64").to_numpy()
    assert nanoseconds * 1e-9 == pytest.approx(episode.sim_time, abs=1e-9)


def test_phases_are_logged_when_they_change(shown: Shown, episodes: list[Episode]) -> None:
    phases = phase_names(episodes[0])
    assert phases is not None
    steps, names = shown.numbers("/states/0_phase", "step"), shown.numbers("/states/0_phase", "StateChange:state")
    assert len(steps) < 12
    spread = [names[np.searchsorted(steps, k, side="right") - 1] for k in range(len(episodes[0]))]
    assert spread == phases.tolist()
    assert shown.numbers("/states/9_outcome", "StateChange:state").tolist() == ["flying", "success"]


def test_flags_stand_after_the_step_that_earned_them(episodes: list[Episode], write: Callable[..., Shown]) -> None:
    episode, flags = episodes[0], np.zeros((len(episodes[0]), 5))
    flags[30:, 1] = 1.0
    shown = write({"": Flight.of(episode, flags)})
    assert shown.numbers("/states/2_grasped", "step").tolist() == [0, 31]
    assert shown.numbers("/states/1_at_cube", "step").tolist() == [0]


def test_a_failure_is_no_success(episodes: list[Episode], write: Callable[..., Shown]) -> None:
    shown = write({"": Flight.of(replace(episodes[0], success=False))})
    assert shown.numbers("/states/9_outcome", "StateChange:state").tolist() == ["flying", "no success"]


def test_chunks_are_drawn_where_they_begin(episodes: list[Episode], write: Callable[..., Shown]) -> None:
    episode, starts = episodes[0], np.arange(0, len(episodes[0]), 10)
    action, times = episode.spec.action, episode.sim_time[:-1]
    predicted = Prediction("p", action.labels, action.units, times, episode.actions, episode.actions + 0.01, starts)
    shown = write({"": Flight.of(episode, prediction=predicted)})
    assert shown.numbers("/scene/predicted", "step").tolist() == starts.tolist()
    first = np.asarray(shown.column("/scene/predicted", "LineStrips3D:strips")[0].as_py())
    assert first.reshape(-1, 3) == pytest.approx(episode.actions[:10, :3] + 0.01, abs=1e-6)
    assert "/signals/action/ee_xyz/predicted" in shown.entities


def test_actions_are_grouped_by_what_they_mean() -> None:
    def names(*labels: str) -> dict[str, tuple[int, ...]]:
        n = len(labels)
        spec = ActionSpec("level", labels, ("",) * n, np.zeros(n), np.ones(n))
        return {group.name: group.columns for group in groups_of(spec)}

    assert names("ee_x", "ee_y", "ee_z", "ee_rot6d_0", "ee_rot6d_1", "gripper") == {
        "ee_xyz": (0, 1, 2), "ee_rot6d": (3, 4), "gripper": (5,),
    }  # fmt: skip
    assert names("0", "1") == {"action": (0, 1)}
    assert names("x") == {"x": (0,)}


def test_phases_fall_together(episodes: list[Episode]) -> None:
    first, second = (Flight.of(episode) for episode in episodes)
    result = align(first, second)
    assert result.by == "phases"
    assert len(result.milestones) >= 5
    ours, theirs = phase_starts(first), phase_starts(second)
    assert any(abs(ours[name] - theirs[name]) > 0.05 for name in result.milestones)  # they need aligning
    assert result.first.aligned == pytest.approx(episodes[0].sim_time)
    for name in result.milestones:
        step = int(np.searchsorted(episodes[1].sim_time, theirs[name]))
        assert result.second.aligned is not None
        assert result.second.aligned[step] == pytest.approx(ours[name])
    assert (np.diff(result.second.aligned) > 0).all()
    assert result.second.aligned[-1] == pytest.approx(episodes[0].sim_time[-1])


def test_without_phases_sub_tasks_or_the_ends_align(episodes: list[Episode]) -> None:
    def blind(episode: Episode, at: int | None) -> Flight:
        flags = None if at is None else np.repeat(np.arange(len(episode))[:, None] >= at, 5, axis=1).astype(float)
        return Flight.of(replace(episode, phase=np.full(len(episode), -1)), flags)

    result = align(blind(episodes[0], 40), blind(episodes[1], 90))
    assert result.by == "sub-tasks"
    assert np.interp(episodes[1].sim_time[91], result.second.sim_time, result.second.aligned) == pytest.approx(
        episodes[0].sim_time[41]
    )
    assert align(blind(episodes[0], None), Flight.of(episodes[1])).by == "start and end"


def test_what_was_done_in_another_order_is_left_out() -> None:
    assert common({"a": 0.0, "b": 1.0, "c": 2.0, "d": 3.0}, {"a": 0.0, "c": 1.0, "b": 2.0, "d": 3.0}) == ["a", "b", "d"]
    assert common({"a": 1.0}, {"b": 1.0}) == []


def test_both_flights_are_in_one_recording(episodes: list[Episode], write: Callable[..., Shown]) -> None:
    flights = [Flight.of(episode) for episode in episodes]
    result = align(*flights)
    shown = write({"one/": flights[0], "two/": flights[1]}, clocks={"one/": result.first, "two/": result.second})
    for root, flight in zip(("one", "two"), flights, strict=True):
        assert flight.motion is not None
        told = shown.numbers(f"/{root}/scene/robot/base", "Transform3D:translation").reshape(-1, 3)
        base = flight.motion.model.body("base").id
        assert told == pytest.approx(flight.motion.body_pos[:, base], abs=1e-5)
        assert len(shown.column(f"/{root}/scene/robot/base", "aligned")) == len(flight.episode) + 1


STEPS = 12


def test_what_flies_is_shown_and_flies_the_same(tmp_path: Path) -> None:
    plain = aerial_il.load_batch("ua_quad_arm4", "reach", num_envs=2, tier="gusts", seed=4, num_threads=1)
    stream = rr.RecordingStream("live", recording_id="live")
    stream.save(tmp_path / "live.rrd")
    watched = WatchedBatch(plain, 1, stream)
    paths = []
    for env in (plain, watched):
        expert, path = aerial_il.expert("ua_quad_arm4", "reach"), []
        expert.attach(env)
        obs = env.reset(4)
        expert.reset()
        for _ in range(STEPS):
            obs = env.step(expert.act(obs)).obs
            path.append(env.get_state())
        paths.append(np.array(path))
        base = env.data(0).body("base").xpos.copy()
    assert np.array_equal(*paths)
    watched.step(np.zeros((2, watched.spec.action.size)), np.array([False, True]))  # the first world stands still
    for env in (plain, watched):
        env.close()
    stream.flush()
    stream.disconnect()
    shown = Shown(tmp_path / "live.rrd")
    told = shown.numbers("/scene/robot/base", "Transform3D:translation").reshape(-1, 3)
    assert len(told) == STEPS
    assert told[np.argmax(shown.numbers("/scene/robot/base", "step"))] == pytest.approx(base, abs=1e-5)
    assert "without error" in run("rrd", "verify", str(shown.path))


@pytest.mark.slow
def test_collecting_with_rerun_records_the_same_flights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from aerial_il.cli.main import main
    from aerial_il.data.dataset import open_dataset

    monkeypatch.chdir(tmp_path)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    for out, rerun in (("plain", "false"), ("watched", "true")):
        words = ["robot=ua_quad_arm4", "task=reach", "episodes=1", "progress=false", "threads=1", f"rerun={rerun}"]
        assert main(["collect", *words, f"out={out}"]) == 0
    one, other = (open_dataset(name)[0] for name in ("plain", "watched"))
    assert np.array_equal(one.states, other.states)
    assert len(Shown(Path("runs/inspections/live.rrd")).numbers("/signals/reward", "Scalars:scalars")) == len(one)


def test_a_place_that_cannot_be_written_costs_no_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from aerial_il.cli.main import main
    from aerial_il.data.dataset import open_dataset

    monkeypatch.chdir(tmp_path)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    Path("runs").mkdir()
    Path("runs/inspections").touch()  # a file, where the folder would be made
    words = ["robot=quad", "task=hover", "episodes=1", "horizon=20", "progress=false", "threads=1", "rerun=true"]
    assert main(["collect", *words, "out=flown"]) == 0
    assert "what flew could not be written" in capsys.readouterr().err
    assert len(open_dataset("flown", failures=True)) == 1
