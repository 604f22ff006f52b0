"""Windows hold the right rows, pad at the ends, and are gathered fast."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.data.dataset import open_dataset
from aerial_il.data.folder import DatasetFolder
from aerial_il.data.statistics import Statistics, statistics
from aerial_il.data.windows import Windows

NAMES = ("ee_pos", "goal_pos")


@pytest.mark.parametrize(("history", "chunk"), [(1, 1), (3, 8), (2, 500)])
def test_windows_against_a_plain_loop(folder: DatasetFolder, history: int, chunk: int) -> None:
    episodes = list(open_dataset(folder.path, failures=True))
    windows = Windows(episodes, NAMES, history=history, chunk=chunk, successes_only=False, dtype=np.float64)
    assert len(windows) == sum(map(len, episodes))
    batch, row = windows[np.arange(len(windows))], 0
    for episode in episodes:
        obs = np.concatenate([episode.obs[n] for n in NAMES], axis=1)
        for t in range(len(episode)):
            past = [max(t - k, 0) for k in reversed(range(history))]
            ahead = [min(t + k, len(episode) - 1) for k in range(chunk)]
            np.testing.assert_array_equal(batch.obs[row], obs[past])
            np.testing.assert_array_equal(batch.actions[row], episode.actions[ahead])
            np.testing.assert_array_equal(batch.is_pad[row], t + np.arange(chunk) >= len(episode))
            row += 1


def test_failures_are_left_out_and_batches_cover_an_epoch(folder: DatasetFolder) -> None:
    episodes = list(open_dataset(folder.path, failures=True))
    windows = Windows(episodes, NAMES)
    assert len(windows) == sum(len(e) for e in episodes if e.success)
    seen = np.concatenate([b.obs[:, 0] for b in windows.batches(7, np.random.default_rng(0))])
    assert len(seen) == len(windows) // 7 * 7
    everything = windows[np.arange(len(windows))].obs[:, 0]
    assert {tuple(row) for row in seen} <= {tuple(row) for row in everything}


def test_only_what_somebody_labelled_is_learned(folder: DatasetFolder) -> None:
    """No window begins at a step that nobody labelled, and within one such steps are padding."""
    one, other = list(open_dataset(folder.path))[:2]
    labels = np.full_like(one.actions, np.nan)
    labels[5:9] = labels[12] = 0.25
    partly, unasked = (
        replace(one, expert_actions=labels),
        replace(other, expert_actions=np.full_like(other.actions, np.nan)),
    )
    windows = Windows([partly, unasked], NAMES, chunk=3, target="expert_actions", dtype=np.float64)
    assert windows.lengths.tolist() == [5, len(other)]
    batch = windows[np.arange(5)]
    obs = np.concatenate([one.obs[n] for n in NAMES], axis=1)
    np.testing.assert_array_equal(batch.obs[:, 0], obs[[5, 6, 7, 8, 12]])
    assert batch.is_pad.tolist() == [[False] * 3, [False] * 3, [False, False, True], *[[False, True, True]] * 2]
    assert (batch.actions[~batch.is_pad] == 0.25).all()
    np.testing.assert_array_equal(windows[np.array([5])].actions[0, 0], other.executed_actions[0])


def test_bad_requests_are_refused(folder: DatasetFolder) -> None:
    episodes = list(open_dataset(folder.path))
    with pytest.raises(UnknownNameError, match="Did you mean 'ee_pos'"):
        Windows(episodes, ["ee_poz"])
    with pytest.raises(InvalidValueError, match="chunk=0"):
        Windows(episodes, NAMES, chunk=0)
    with pytest.raises(InvalidValueError, match="No episode"):
        Windows([], NAMES)


def test_a_batch_of_windows_is_its_windows_one_by_one(folder: DatasetFolder) -> None:
    windows = Windows(open_dataset(folder.path), NAMES, history=2, chunk=16)
    index = np.random.default_rng(0).integers(len(windows), size=64)
    together, alone = windows[index], [windows[np.array([k])] for k in index]
    for name in ("obs", "actions", "is_pad"):
        np.testing.assert_array_equal(getattr(together, name), np.concatenate([getattr(one, name) for one in alone]))


def test_statistics_are_those_of_the_data(folder: DatasetFolder) -> None:
    episodes = list(open_dataset(folder.path))
    result = statistics(episodes)
    ee_pos = np.concatenate([e.obs["ee_pos"][:-1] for e in episodes])
    np.testing.assert_allclose(result["ee_pos"].mean, ee_pos.mean(0))
    np.testing.assert_allclose(result["ee_pos"].q99, np.quantile(ee_pos, 0.99, axis=0))
    assert result["action"].count == sum(map(len, episodes))
    with pytest.raises(InvalidValueError, match="finite"):
        Statistics.of(np.array([[np.nan]]))
