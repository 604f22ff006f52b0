"""The watched world is shown as it is, and flies as it would alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import rerun as rr

import aerial_il
from aerial_il.presentation.rerun.live import WatchedBatch
from aerial_il.presentation.rerun.program import run
from tests.presentation.rerun.conftest import Shown

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
