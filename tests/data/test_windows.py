"""Windows hold the right rows and pad at the ends; waypoints are found where hands flew."""

from dataclasses import replace

import numpy as np
import pytest

import aerial_il
from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.supervised.training_set import cut_windows, digest_of
from aerial_il.collection.collect import collect
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.data import waypoints
from aerial_il.data.dataset import open_dataset
from aerial_il.data.episode import Episode
from aerial_il.data.folder import DatasetFolder
from aerial_il.data.statistics import Statistics, statistics
from aerial_il.data.waypoints import GRIP_MARGIN_S, HOLD_S
from aerial_il.data.windows import Windows
from aerial_il.policies.mlp import MLP
from aerial_il.teleop.driver.operator import DriverOperator
from tests.teleop.hands import world

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


DT, AHEAD = 0.02, replace(BC.waypoints, lookahead_s=2.0)
MARGIN, HOLD = round(GRIP_MARGIN_S / DT), round(HOLD_S / DT)
SAME = ("actions", "executed_actions", "is_intervention", "rewards", "ctrl", "phase", "terminated", "truncated")


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Episode:
    """A cube picked and placed by the model of a person, through sticks and assist."""
    out, env = tmp_path_factory.mktemp("by_hand"), world(task="pick_place")
    DriverOperator(seed=1).record(env, None, out, seeds=range(5000, 5001), tags={})
    env.close()
    return open_dataset(out, failures=True)[0]


@pytest.fixture(scope="module")
def scripted(tmp_path_factory: pytest.TempPathFactory) -> Episode:
    env = world(task="pick_place")
    pilot = aerial_il.expert("fa_hexa_arm4", "pick_place")
    result = collect(env, pilot, range(5000, 5001), tmp_path_factory.mktemp("scripted"), progress=False).folder
    env.close()
    return open_dataset(result.path)[0]


def kept(flight: Episode, relabelled: Episode) -> np.ndarray:
    """Return the steps of ``flight`` (k,) that are left."""
    return np.searchsorted(flight.sim_time, relabelled.sim_time[:-1])


def grips(flight: Episode) -> np.ndarray:
    """Return the steps in which the gripper is commanded to move."""
    return np.flatnonzero(np.abs(np.diff(flight.labels[:, -1], prepend=flight.labels[0, -1])) > 1e-3)


def looks_beyond_a_grip(flight: Episode, relabelled: Episode) -> bool:
    """Whether a step before the first move of the gripper is led to a pose that was reached only after it began."""
    first = grips(flight)[0]
    before = relabelled.labels[kept(flight, relabelled) < first - MARGIN, :3]
    reached = flight.obs["ee_pos"][: first - MARGIN + 1]
    return not all((pose == reached).all(1).any() for pose in before)


def test_no_ops_are_left_out_but_for_grips_and_the_end(flight: Episode) -> None:
    result = AHEAD.apply(flight)
    left = kept(flight, result)
    assert HOLD < len(result) < len(flight)
    assert left[-HOLD:].tolist() == list(range(len(flight) - HOLD, len(flight)))
    around = {step + k for step in grips(flight) for k in range(-MARGIN, MARGIN + 1)}
    assert {step for step in around if 0 <= step < len(flight)} <= set(left.tolist())
    rest = [step for step in left if step not in around and step < len(flight) - HOLD]
    change = np.abs(flight.labels[rest] - flight.labels[np.maximum(np.array(rest) - 1, 0)])
    assert (change.max(1) > 1e-4).all(), "what is left elsewhere commands something"


def test_labels_are_poses_that_the_flight_reached_later(flight: Episode) -> None:
    result = AHEAD.apply(flight)
    left = kept(flight, result)
    for step, label in zip(left, result.labels, strict=True):
        (reached,) = np.flatnonzero((flight.obs["ee_pos"] == label[:3]).all(1))[:1]
        assert reached > step
        np.testing.assert_array_equal(flight.obs["ee_rot6d"][reached].ravel(), label[3:9])
    np.testing.assert_array_equal(result.labels[-1, :3], flight.obs["ee_pos"][-1])


def test_every_move_of_the_gripper_is_kept_and_decided_at_once(flight: Episode) -> None:
    result, commanded = AHEAD.apply(flight), flight.labels[:, -1]
    label = result.labels[:, -1]
    assert set(grips(flight)) <= set(kept(flight, result).tolist())
    starts = [step for step in grips(flight) if step - 1 not in grips(flight)]
    assert len(starts) >= 2, "what follows is about a flight that grasps and lets go"
    for step in starts:
        at = int(np.flatnonzero(kept(flight, result) == step)[0])
        ends = next(t for t in range(step, len(flight)) if t + 1 not in grips(flight))
        assert label[at - 1] == commanded[step - 1], "not a step earlier than the person"
        assert label[at] == pytest.approx(commanded[min(ends + MARGIN, len(flight) - 1)])
    assert label[-1] == commanded[-1]


def test_nothing_else_changes(flight: Episode) -> None:
    result = AHEAD.apply(flight)
    left = kept(flight, result)
    for name in SAME:
        np.testing.assert_array_equal(getattr(result, name), getattr(flight, name)[left])
    seen = np.append(left, len(flight))
    for name, values in flight.obs.items():
        np.testing.assert_array_equal(result.obs[name], values[seen])
    np.testing.assert_array_equal(result.states, flight.states[seen])
    assert (result.uid, result.success, result.provenance) == (flight.uid, flight.success, flight.provenance)


def test_a_grasp_is_looked_ahead_to_and_never_beyond(flight: Episode, monkeypatch: pytest.MonkeyPatch) -> None:
    assert not looks_beyond_a_grip(flight, replace(BC.waypoints, lookahead_s=30.0).apply(flight))
    monkeypatch.setattr(waypoints, "_near", lambda grips, margin: np.zeros(len(grips), bool))
    assert looks_beyond_a_grip(flight, replace(BC.waypoints, lookahead_s=30.0).apply(flight)), (
        "the check finds who does"
    )


def test_only_what_the_person_took_over_is_relabelled(flight: Episode) -> None:
    labels = np.full_like(flight.actions, np.nan)
    labels[40:90] = flight.actions[40:90]
    shared = replace(flight, expert_actions=labels, provenance={"policy": "learner with human:ada"})
    result = replace(BC.waypoints, lookahead_s=30.0).apply(shared)
    left = kept(shared, result)
    assert set(range(40)) | set(range(90, len(flight))) <= set(left.tolist()), "what the policy flew is all there"
    assert left[result.asked].tolist() == [step for step in left if 40 <= step < 90]
    np.testing.assert_array_equal(result.labels[result.asked][0, :3], flight.obs["ee_pos"][90])
    np.testing.assert_array_equal(result.labels[~result.asked], result.executed_actions[~result.asked])


def test_what_leads_to_where_the_person_let_go_is_left_out(flight: Episode) -> None:
    held, nearest = np.zeros(len(flight), bool), round(0.5 * AHEAD.lookahead_s / DT)
    held[: grips(flight)[0] - MARGIN - 20] = True
    labels = np.where(held[:, None], flight.actions, np.nan)
    result = AHEAD.apply(replace(flight, expert_actions=labels, is_intervention=held))
    by_hand = int(held[kept(flight, result)].sum())
    assert by_hand > nearest
    assert result.asked.tolist()[: by_hand - nearest + 1] == [True] * (by_hand - nearest + 1)
    assert not result.asked[by_hand - nearest + 1 :].any(), "those just before the controls were handed back"
    whole = AHEAD.apply(replace(flight, expert_actions=flight.actions, is_intervention=np.ones(len(flight), bool)))
    assert whole.asked.all(), "the end of a flight is a goal"


def test_what_a_script_flew_is_learned_from_as_recorded(scripted: Episode, flight: Episode) -> None:
    assert AHEAD.apply(scripted) is scripted
    assert BC.waypoints.apply(flight) is flight
    assert len(replace(BC.waypoints, lookahead_s=2.0, flown_by="anyone").apply(scripted)) < len(scripted)

    def digest(cloning: BC, *episodes: Episode) -> str:
        demos = cloning.divide([replace(e, success=True) for e in episodes], MLP(), seed=0)
        return digest_of(cut_windows(demos.kept, demos.layout, MLP()))

    plain, ahead = BC(validation=0.0), BC(validation=0.0, waypoints=AHEAD)
    assert digest(ahead, scripted) == digest(plain, scripted)
    assert digest(ahead, scripted, flight) != digest(plain, scripted, flight)


@pytest.mark.parametrize("closes", [72, 80, 84])
def test_what_a_policy_does_with_the_gripper_is_no_label_of_the_person(flight: Episode, closes: int) -> None:
    """Somebody closes the gripper and hands back, and the policy opens it again: what was shown is to close it."""
    steps = np.arange(len(flight))
    held = (steps >= 50) & (steps < 90)
    actions = flight.actions.copy()
    actions[:, -1] = np.where(steps < closes, 0.0, 1.0)
    actions[90:, -1] = np.maximum(0.0, 1.0 - 0.1 * (steps[90:] - 90))
    labels = np.where(held[:, None], actions, np.nan)
    shared = replace(
        flight, actions=actions, executed_actions=actions, expert_actions=labels, is_intervention=held,
        provenance={"policy": "learner with human:ada"},
    )  # fmt: skip
    result = replace(AHEAD, lookahead_s=0.1).apply(shared)
    learned, left = result.labels[result.asked, -1], kept(shared, result)[result.asked]
    assert (left >= closes).any()
    np.testing.assert_array_equal(learned, left >= closes)


def test_what_an_expert_said_beside_a_learner_is_kept(scripted: Episode) -> None:
    anyone = replace(BC.waypoints, lookahead_s=2.0, flown_by="anyone")
    learners = replace(scripted, provenance={"policy": "dagger", "settings": {"algorithm": "dagger", "round": 2}})
    assert anyone.apply(learners) is learners
    assert anyone.apply(scripted) is not scripted


def test_no_flight_is_labelled_by_another(flight: Episode) -> None:
    elsewhere = replace(flight, obs={**flight.obs, "ee_pos": flight.obs["ee_pos"] + 10.0}, uid="elsewhere")
    cloning = BC(validation=0.0, waypoints=replace(BC.waypoints, lookahead_s=60.0))
    near, far = cloning.divide([replace(e, success=True) for e in (flight, elsewhere)], MLP(), seed=0).kept
    assert near.labels[:, :3].max() < 5.0 < far.labels[:, :3].min()


def test_what_cannot_be_relabelled_is_refused(flight: Episode) -> None:
    spec = replace(flight.spec, action=replace(flight.spec.action, level="velocity"))
    with pytest.raises(InvalidValueError, match=r"velocity; only ee_pose .* dataset.by_hand=false"):
        AHEAD.apply(replace(flight, spec=spec))
    with pytest.raises(InvalidValueError, match="lookahead_s is -1"):
        replace(BC.waypoints, lookahead_s=-1.0)
    with pytest.raises(InvalidValueError, match="Unknown flown_by 'nobody'"):
        replace(BC.waypoints, flown_by="nobody")  # type: ignore[arg-type]


def test_recordings_say_who_flew(flight: Episode, scripted: Episode) -> None:
    assert waypoints.flown_by_hand(flight.provenance)
    assert waypoints.flown_by_hand({"policy": "runs/pick with human:ada"})
    assert not waypoints.flown_by_hand(scripted.provenance)
    assert not waypoints.flown_by_hand({})
