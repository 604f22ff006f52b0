"""Minibatches are what their definition says, and data that cannot be learned from is refused by name."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from aerial_il.algorithms.supervised.training_set import (
    Shuffle,
    TrainingSet,
    cut_windows,
    digest_of,
    fit_interface,
    read_demos,
    split,
)
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.data.episode import Episode
from aerial_il.policies.mlp import MLP
from tests.algorithms.point_mass import demonstrations, with_action_level


@pytest.fixture(scope="module")
def demos() -> list[Episode]:
    return demonstrations(4)


@pytest.mark.parametrize("anchor", ["ee_pos", None])
def test_minibatches_hold_the_history_behind_and_the_chunk_ahead(demos: list[Episode], anchor: str | None) -> None:
    config = MLP(history=3, chunk=7, anchor=anchor)
    layout, kept = read_demos(demos, config)
    windows = cut_windows(kept, layout, config)
    interface = fit_interface(layout, windows, config)
    obs, actions, valid = (np.asarray(t) for t in TrainingSet(windows, interface).gather(np.arange(len(windows))))
    index = 0
    for episode in demos:
        seen, steps = layout.relate(layout.flatten(episode.obs)), len(episode)
        for t in range(steps):
            history = seen[np.maximum(np.arange(t - 2, t + 1), 0)]
            np.testing.assert_allclose(obs[index], interface.obs.normalise(history), atol=1e-5)
            chunk = episode.expert_actions[np.minimum(np.arange(t, t + 7), steps - 1)].copy()
            if anchor:
                chunk[:, :3] -= episode.obs["ee_pos"][t]
            np.testing.assert_allclose(actions[index], interface.action.normalise(chunk), atol=1e-4)
            np.testing.assert_array_equal(valid[index], np.arange(t, t + 7) < steps)
            index += 1
    assert index == len(windows)


@pytest.mark.parametrize("to_the_end", [True, False])
def test_the_end_of_an_episode_is_held_and_the_end_of_a_correction_is_not(
    demos: list[Episode], to_the_end: bool
) -> None:
    """Where nobody was asked nothing is known, of the steps beyond the end neither if that was so at the end."""
    flown, config = demos[0], MLP(chunk=7)
    asked = np.ones(len(flown), bool)
    asked[10:20], asked[-3:] = False, to_the_end
    episode = replace(flown, expert_actions=np.where(asked[:, None], flown.expert_actions, np.nan))
    layout, kept = read_demos([episode], config)
    windows = cut_windows(kept, layout, config)
    _, _, valid = TrainingSet(windows, fit_interface(layout, windows, config), hold=True).gather(
        np.arange(len(windows))
    )
    known = np.append(asked, [to_the_end] * 6)
    for row, start in zip(np.asarray(valid), np.flatnonzero(asked), strict=True):
        np.testing.assert_array_equal(row > 0, known[start : start + 7])


def test_what_is_learned_is_what_is_flown(demos: list[Episode]) -> None:
    """Decoding the encoded label gives back the demonstrated action."""
    config = MLP(chunk=7)
    layout, kept = read_demos(demos, config)
    windows = cut_windows(kept, layout, config)
    batch = windows[np.arange(50)]
    interface = fit_interface(layout, windows, config)
    encoded = interface.encode_actions(batch.actions, batch.obs)
    np.testing.assert_allclose(interface.decode_actions(encoded, batch.obs), batch.actions, atol=1e-5)


def test_anchored_actions_are_normalised_as_offsets(demos: list[Episode]) -> None:
    """Offsets are far smaller than the places they lead to."""
    config = MLP(chunk=1)
    layout, kept = read_demos(demos, config)
    windows = cut_windows(kept, layout, config)
    scaler = fit_interface(layout, windows, config).action
    places = np.concatenate([d.expert_actions[:, :3] for d in demos])
    seen = np.concatenate([d.obs["ee_pos"][:-1] for d in demos])
    np.testing.assert_allclose(scaler.scale[:3], (places - seen).std(0), rtol=1e-4)
    assert (scaler.scale[:3] < 0.5 * places.std(0)).all()


def test_the_digest_depends_on_every_value(demos: list[Episode]) -> None:
    config = MLP(chunk=7)
    layout, kept = read_demos(demos, config)
    before = digest_of(cut_windows(kept, layout, config))
    assert digest_of(cut_windows(kept, layout, config)) == before
    changed = demos[2].expert_actions.copy()
    changed[5, 1] += 1e-3
    assert digest_of(cut_windows([*kept[:2], replace(kept[2], expert_actions=changed)], layout, config)) != before


def test_each_epoch_visits_every_window_once_in_a_new_order() -> None:
    order = Shuffle(103, 10, seed=1)
    visits = np.concatenate([order[step] for step in range(103)])  # ten epochs, whose borders fall within minibatches
    epochs = visits.reshape(10, 103)
    np.testing.assert_array_equal(np.sort(epochs, axis=1), np.tile(np.arange(103), (10, 1)))
    assert len({tuple(epoch) for epoch in epochs}) == 10
    np.testing.assert_array_equal(Shuffle(103, 10, seed=1)[57], order[57])
    assert not np.array_equal(Shuffle(103, 10, seed=2)[57], order[57])
    assert len(Shuffle(3, 10, seed=0)[0]) == 10


@pytest.mark.parametrize(("count", "fraction", "held"), [(10, 0.0, 0), (10, 0.05, 1), (100, 0.05, 5), (1, 0.5, 0)])
def test_validation_takes_whole_demonstrations(count: int, fraction: float, held: int) -> None:
    everything: Any = list(range(count))
    kept, out = split(everything, fraction, seed=0)
    assert len(out) == held
    assert sorted(kept + out) == everything


def test_failures_are_left_out_and_labels_preferred(demos: list[Episode]) -> None:
    unlabelled = replace(demos[1], expert_actions=np.full_like(demos[1].actions, np.nan))
    config = MLP(chunk=1)
    layout, kept = read_demos([replace(demos[0], success=False), unlabelled, demos[2]], config)
    assert [d.uid for d in kept] == ["demo-1", "demo-2"]
    actions = cut_windows(kept, layout, config)[np.array([3, len(demos[1]) + 3])].actions[:, 0]
    np.testing.assert_allclose(actions[0], demos[1].executed_actions[3], atol=1e-6)
    np.testing.assert_allclose(actions[1], demos[2].expert_actions[3], atol=1e-6)


def test_an_episode_shorter_than_the_chunk_is_padded(demos: list[Episode]) -> None:
    steps, longest = len(demos[0]), demos[0].spec.max_steps
    assert steps < longest
    layout, kept = read_demos(demos[:2], config := MLP(chunk=longest))
    batch = cut_windows(kept, layout, config)[np.array([0, steps - 1])]
    assert (~batch.is_pad).sum(1).tolist() == [steps, 1]
    assert (batch.actions[0, steps:] == batch.actions[0, steps - 1]).all()
    with pytest.raises(InvalidValueError, match=f"chunk={longest + 1} must not be longer than an episode"):
        cut_windows(kept, layout, MLP(chunk=longest + 1))


def test_what_cannot_be_learned_from_is_refused(demos: list[Episode]) -> None:
    with pytest.raises(InvalidValueError, match="no successful demonstration"):
        read_demos([], MLP())
    with pytest.raises(InvalidValueError, match="no successful demonstration"):
        read_demos([replace(demos[0], success=False)], MLP())
    with pytest.raises(UnknownNameError, match="cube_pos"):
        read_demos(demos, MLP(obs_names=("ee_pos", "cube_position")))
    with pytest.raises(InvalidValueError, match=r"demo-1 comes from another environment: action\.level"):
        read_demos([demos[0], with_action_level(demos[1], "velocity")], MLP())
    nan = {**demos[1].obs, "goal_pos": np.where(np.arange(len(demos[1]) + 1)[:, None] == 9, np.nan, 0.0)}
    with pytest.raises(InvalidValueError, match="demo-1: observation goal_pos is not finite at step 9"):
        read_demos([demos[0], replace(demos[1], obs=nan)], MLP())
    broken = np.full_like(demos[0].actions, np.nan)
    with pytest.raises(InvalidValueError, match="demo-0: the action is not finite at step 0"):
        read_demos([replace(demos[0], executed_actions=broken, expert_actions=broken)], MLP())
