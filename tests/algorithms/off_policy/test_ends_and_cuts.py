"""Ends and cuts of episodes, of learners that see demonstrations: what is kept, row by row, and its value."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from aerial_il import algorithms
from aerial_il.algorithms.online.collector import Collector, Transition
from aerial_il.algorithms.online.interface import encode
from aerial_il.algorithms.online.replay_buffer import Batch, ReplayBuffer, split
from aerial_il.algorithms.online.smoothness import NO_SMOOTHNESS
from aerial_il.algorithms.run.folder import read_metrics
from aerial_il.core.contracts import StepResult
from aerial_il.data.episode import Episode
from tests.algorithms import small
from tests.algorithms.drift import Drift, demonstrations
from tests.algorithms.made import names

DEMONSTRATED = [n for n in algorithms.names() if "demonstrations" in names(cls := algorithms.get(n)) and cls.rewarded]
BRIEF: dict[str, Any] = {"steps": 400, "utd_ratio": 0.02, "offline_steps": 4, "bc_pretrain_steps": 4, "critics": 2}
BRIEF |= {"alpha": 1e-6, "entropy": -20.0}
each = pytest.mark.parametrize("name", DEMONSTRATED)
with_and_without = pytest.mark.parametrize("absorbing", [True, False])


def train(name: str, run: Path, env: Any, demos: list[Episode], **changes: Any) -> Any:
    return small.train(small.short(name, **{**BRIEF, **changes}), run, env, demos)


class Memory:
    """What a training flew, step by step, and the rows that it kept: of each step, and of demonstrations before."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.steps: list[Transition] = []
        self.shown: list[np.ndarray] = []
        self.flown: list[np.ndarray] = []
        step, add = Collector.step, ReplayBuffer.add

        def stepped(collector: Collector, actions: np.ndarray) -> Transition:
            self.steps.append(step(collector, actions))
            return self.steps[-1]

        def added(buffer: ReplayBuffer, rows: np.ndarray) -> None:
            (self.flown if self.steps else self.shown).append(rows)
            add(buffer, rows)

        monkeypatch.setattr(Collector, "step", stepped)
        monkeypatch.setattr(ReplayBuffer, "add", added)


def apart(rows: np.ndarray) -> Batch:
    """Take rows of one action element apart, with whatever observations carry."""
    width = (rows.shape[1] - 3) // 2
    return split(torch.from_numpy(rows), (width, 1, width, 1, 1))


@each
@with_and_without
def test_flights_go_on_beyond_a_cut_but_not_beyond_an_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, absorbing: bool
) -> None:
    """Row by row beside the steps: a crash leads nowhere, success to a state that leads to itself, or nowhere; a cut,
    as any other step, to what was seen last, never to the next episode."""
    memory = Memory(monkeypatch)
    env, demos = Drift(8, ends_at_success=True), demonstrations(6, ends_at_success=True)
    policy = train(name, tmp_path, env, demos, absorbing=absorbing)
    for step, rows in zip(memory.steps, memory.flown, strict=True):
        kept, over = apart(rows), torch.from_numpy(step.terminal)
        absorbed = over & torch.from_numpy(step.success) & absorbing
        flown, after = (Batch(*(column[part] for column in kept)) for part in (slice(0, 8), slice(8, None)))
        assert torch.equal(flown.next_obs[:, :2], torch.from_numpy(encode(policy.interface, step.next_frames)))
        assert torch.equal(flown.next_obs[:, -1] == 1.0, absorbed)
        assert torch.equal(flown.continues, (~over | absorbed).float())
        for seen in (after.obs, after.next_obs):
            assert torch.equal(seen, flown.next_obs[absorbed])
        assert torch.equal(after.rewards, flown.rewards[absorbed])
        assert (after.actions == 0.0).all()
        assert (after.continues == 1.0).all()
    ends = [(s.terminal & ~s.success, s.terminal & s.success, s.truncated) for s in memory.steps]
    assert (np.array(ends).sum((0, 2)) > 2).all(), "crashes, successes and cuts"
    for step, following in zip(memory.steps, memory.steps[1:], strict=False):
        goes_on = (following.frames == step.next_frames).all(axis=1)
        np.testing.assert_array_equal(goes_on, ~(step.terminal | step.truncated), "new episodes begin elsewhere")


@each
def test_what_the_last_step_cost_is_not_subtracted_for_ever(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Neither after flights nor after demonstrations: an absorbing state is paid what success is."""
    memory, env = Memory(monkeypatch), Drift(8, ends_at_success=True)
    rough = {"reward": "sparse", "smoothness": replace(NO_SMOOTHNESS, rate_penalty=0.3)}
    train(name, tmp_path, env, demonstrations(6, ends_at_success=True), **rough)
    for rows in (memory.shown[-1], np.concatenate(memory.flown)):
        kept = apart(rows)
        after = kept.obs[:, -1] == 1.0
        led = (kept.next_obs[:, -1] == 1.0) & ~after
        assert (kept.rewards[led] < 1.0).any(), "some come there with a rough action"
        assert after.sum() == led.sum()
        assert (kept.rewards[after] == 1.0).all()


@each
@with_and_without
@pytest.mark.parametrize("how", ["cut", "success", "crash"])
def test_demonstrations_go_on_beyond_a_cut_but_not_an_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, absorbing: bool, how: str
) -> None:
    memory, demos = Memory(monkeypatch), demonstrations(6, ends_at_success=how != "cut")
    if how == "crash":
        demos = [replace(d, success=False, terminated=np.arange(len(d)) == len(d) - 1) for d in demos]
    env = Drift(8, ends_at_success=how != "cut")
    train(name, tmp_path, env, demos, absorbing=absorbing, failures=True, steps=16, warmup=8)
    last = np.cumsum([len(demo) for demo in demos]) - 1
    kept, count = apart(memory.shown[-1]), last[-1] + 1
    over, absorbed = how != "cut", how == "success" and absorbing
    assert len(kept.obs) == count + 6 * absorbed
    np.testing.assert_array_equal(np.flatnonzero(kept.continues == 0.0), last if over and not absorbed else [])
    np.testing.assert_array_equal(np.flatnonzero(kept.next_obs[:count, -1]), last if absorbed else [])
    for seen in (kept.obs, kept.next_obs):
        np.testing.assert_array_equal(seen[count:], kept.next_obs[last[: 6 * absorbed]])


class Paid(Drift):
    """Pays 1 for a step, and ends with it: by a cut, by success, or by a crash."""

    def __init__(self, how: str) -> None:
        super().__init__(8, ends_at_success=True)
        self._how = how

    def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> StepResult:
        result, all_ = super().step(0.0 * actions, mask), np.ones(self.num_envs, bool)
        how = {name: all_ & (self._how == name) for name in ("cut", "success", "crash")}
        info = {**result.info, "success": how["success"]}
        return replace(result, reward=1.0 * all_, terminated=how["crash"], truncated=how["cut"], info=info)


@each
def test_critics_value_what_follows_a_cut_but_not_a_crash(tmp_path: Path, name: str) -> None:
    """One step of 1 is worth 1, steps without end 10 at gamma 0.9; random flights stand in for the demonstrations."""
    values = {}
    for how in ("cut", "success", "crash"):
        settings = {"control": "random_actions", "steps": 240, "utd_ratio": 0.5, "lr": 1e-2}
        train(name, tmp_path / how, Paid(how), demonstrations(4), **settings)
        values[how] = read_metrics(tmp_path / how)[-1]["critic/value"]
    assert values["crash"] == pytest.approx(1.0, abs=0.25)
    assert min(values["cut"], values["success"]) > 2.0
