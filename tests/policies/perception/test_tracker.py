"""Estimates over time: what rests stays, what is carried goes along, and one wrong look does little."""

from __future__ import annotations

import numpy as np
import pytest

from aerial_il.policies.perception.relations import Rate
from aerial_il.policies.perception.targets import Target
from aerial_il.policies.perception.tracker import Measurement, Tracker

CUBE = Target("cube", "place", 3, 1, np.zeros(3), np.full(3, 0.3), np.zeros(3), ("cube",))
TRAVEL = Target("travel", "number", 1, 1, np.zeros(1), np.full(1, 0.01), np.full(1, 1e-8), ("travel",))
HEADING = Target("heading", "heading", 2, 4, np.zeros(2), np.ones(2), np.full(2, 1e-6), ("heading",))
ALL = (CUBE, TRAVEL, HEADING)
SURE = np.tile(1e-4 * np.eye(3), (2, 1, 1))  # 1 cm
BOTH = np.ones(2, bool)
STILL = np.tile(np.eye(3), (2, 1, 1))


def started(targets=ALL) -> Tracker:
    tracker = Tracker(targets, 0.9)
    tracker.begin(BOTH)
    return tracker


def following_a_ball() -> Tracker:
    """A place whose rate is wanted, too, in m/s at 50 control steps a second."""
    ball = Target("ball", "place", 3, 1, np.zeros(3), np.full(3, 0.3), np.zeros(3), ("ball",))
    tracker = Tracker([ball], 0.9, [Rate("ball_vel", "ball", 50.0, 0.01, 1e-6)])
    tracker.begin(BOTH)
    return tracker


def look(tracker: Tracker, place: np.ndarray, spread: np.ndarray = SURE) -> None:
    tracker.fade(BOTH)
    tracker.tell("cube", BOTH, Measurement(place, spread))


def test_a_resting_object_is_known_better_with_every_look():
    tracker, rng, place = started(), np.random.default_rng(0), np.array([[0.2, 0.1, 0.5], [-0.3, 0.0, 0.5]])
    before = tracker.deviations()["cube"]
    for _ in range(40):
        look(tracker, place + 0.01 * rng.standard_normal((2, 3)))
    assert (np.linalg.norm(tracker.estimates()["cube"] - place, axis=1) < 0.008).all()
    assert (tracker.deviations()["cube"] < 0.2 * before).all()


def test_a_carried_object_goes_along_when_it_is_no_longer_seen():
    tracker, tool = started(), np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0]])
    for step in range(60):
        moved = tool + np.array([0.01, 0.0, 0.0])
        tracker.move(STILL, tool, moved)
        tool = moved
        if step < 40:  # seen in the gripper of the first world, and left behind in the second
            look(tracker, np.stack([tool[0] - [0.0, 0.0, 0.02], [0.0, 0.0, 0.98]]))
    carried, left = tracker.estimates()["cube"]
    np.testing.assert_allclose(carried, tool[0] - [0.0, 0.0, 0.02], atol=0.01)
    np.testing.assert_allclose(left, [0.0, 0.0, 0.98], atol=0.01)


def test_one_wrong_look_does_little():
    tracker, place = started(), np.array([[0.2, 0.1, 0.5], [0.2, 0.1, 0.5]])
    for _ in range(30):
        look(tracker, place)
    look(tracker, place + np.array([0.5, 0.0, 0.0]))
    assert (np.linalg.norm(tracker.estimates()["cube"] - place, axis=1) < 0.02).all()


def test_what_is_not_where_it_should_be_is_forgotten():
    tracker, place = started(), np.array([[0.3, 0.1, 0.5], [0.3, 0.1, 0.5]])
    for _ in range(30):
        look(tracker, place)
    sure = tracker.deviations()["cube"]
    for _ in range(30):
        tracker.fade(BOTH)
        tracker.doubt("cube", np.array([True, False]))
    gone, still = tracker.estimates()["cube"]
    assert np.linalg.norm(gone) < 0.01, "ordinarily it is in the middle"
    np.testing.assert_allclose(still, place[1], atol=0.01)
    assert tracker.deviations()["cube"][0] > 20 * sure[0]


def test_of_two_cameras_the_surer_counts_more():
    tracker = started()
    for _ in range(20):
        tracker.fade(BOTH)
        tracker.tell("cube", BOTH, Measurement(np.zeros((2, 3)), 1e-4 * SURE))
        tracker.tell("cube", BOTH, Measurement(np.full((2, 3), 0.02), 10 * SURE))
    assert (np.abs(tracker.estimates()["cube"]) < 2e-3).all()


def test_a_heading_stays_one_and_a_number_follows():
    tracker = started()
    for _ in range(40):
        tracker.move(STILL, np.zeros((2, 3)), np.zeros((2, 3)))
        tracker.fade(BOTH)
        tracker.tell("heading", BOTH, Measurement(np.tile([0.6, 0.8], (2, 1)), np.full((2, 2), 0.01)))
        tracker.tell("travel", BOTH, Measurement(np.full((2, 1), 0.004), np.full((2, 1), 1e-6)))
    found = tracker.estimates()
    np.testing.assert_allclose(np.linalg.norm(found["heading"], axis=1), 1.0)
    np.testing.assert_allclose(found["heading"], [[0.6, 0.8]] * 2, atol=0.01)
    np.testing.assert_allclose(found["travel"], 0.004, atol=2e-4)


def test_worlds_do_not_depend_on_each_other_and_memory_is_all():
    rng = np.random.default_rng(3)
    looks = [(rng.standard_normal((2, 3)) * 0.1, rng.random(2) < 0.7) for _ in range(12)]

    def flown(rows: slice, kept: Tracker | None = None, some=looks) -> Tracker:
        count = len(BOTH[rows])
        tracker = kept or Tracker(ALL, 0.9)
        if kept is None:
            tracker.begin(np.ones(count, bool))
        for place, seen in some:
            tracker.move(STILL[rows], np.zeros((count, 3)), np.full((count, 3), 0.01))
            tracker.fade(np.ones(count, bool))
            tracker.tell("cube", seen[rows], Measurement(place[rows], SURE[rows]))
        return tracker

    both, first = flown(slice(0, 2)), flown(slice(0, 1))
    np.testing.assert_array_equal(both.estimates()["cube"][:1], first.estimates()["cube"])
    half, again = flown(slice(0, 2), some=looks[:6]), Tracker(ALL, 0.9)
    again.recall(half.memory())
    np.testing.assert_array_equal(flown(slice(0, 2), again, looks[6:]).estimates()["cube"], both.estimates()["cube"])
    again.begin(np.array([True, False]))
    np.testing.assert_array_equal(again.estimates()["cube"][0], np.zeros(3))
    np.testing.assert_array_equal(again.estimates()["cube"][1], both.estimates()["cube"][1])


def test_a_rate_is_told_by_how_its_field_changes():
    """A door that swings, told by noisy looks at every other step: its rate is none of the looks' differences."""
    angle = Target("angle", "number", 1, 1, np.zeros(1), np.full(1, 0.4), np.full(1, 3e-5), ("angle",))
    rate = Rate("rate", "angle", 50.0, 0.08, 3.2e-4)
    tracker, rng, missed = Tracker([angle], 0.9, [rate]), np.random.default_rng(1), []
    tracker.begin(BOTH)
    for step in range(300):
        truth, turning = 0.4 * np.sin(0.02 * step), 0.4 * np.cos(0.02 * step)
        tracker.move(STILL, np.zeros((2, 3)), np.zeros((2, 3)))
        if step % 2 == 0:
            tracker.fade(BOTH)
            tracker.tell("angle", BOTH, Measurement(truth + 0.01 * rng.standard_normal((2, 1)), np.full((2, 1), 1e-4)))
        if step > 30:
            missed.append(tracker.estimates()["rate"] - turning)
    assert np.sqrt(np.mean(np.square(missed))) < 0.06, "differences of looks miss by .35, silence by .28"
    assert tracker.deviations()["angle"].max() < 0.01
    kept = tracker.memory()
    tracker.begin(BOTH)
    assert not tracker.estimates()["rate"].any()
    tracker.recall(kept)
    assert tracker.estimates()["rate"].any()


def test_a_place_that_moves_by_itself_is_followed_when_it_is_out_of_sight():
    tracker = following_a_ball()
    for step in range(80):
        tracker.move(STILL, np.zeros((2, 3)), np.zeros((2, 3)))
        if step < 60:
            tracker.fade(BOTH)
            tracker.tell("ball", BOTH, Measurement(np.full((2, 3), 0.002 * step), SURE))
    np.testing.assert_allclose(tracker.estimates()["ball"], 0.002 * 79, atol=0.01)
    np.testing.assert_allclose(tracker.estimates()["ball_vel"], 0.1, atol=0.02)


@pytest.mark.parametrize("late", [0, 5])
def test_a_late_image_of_what_moves_tells_where_it_was(late: int):
    """A ball at .1 m/s, shown five steps late: a look taken for one of now would leave it a centimetre behind."""
    tracker = following_a_ball()
    for step in range(late, 80):
        tracker.move(STILL, np.zeros((2, 3)), np.zeros((2, 3)))
        tracker.fade(BOTH)
        tracker.tell(
            "ball", BOTH, Measurement(np.full((2, 3), 0.002 * (step - late)), 1e-2 * SURE, age=np.full(2, late))
        )
    np.testing.assert_allclose(tracker.estimates()["ball"], 0.002 * 79, atol=0.001)
    np.testing.assert_allclose(tracker.estimates()["ball_vel"], 0.1, atol=0.01)


def test_what_is_looked_at_for_long_is_still_known():
    """Forgetting magnifies with every look what rounding leaves of asymmetry; after four hundred it would be all."""
    tracker = following_a_ball()
    for step in range(3000):
        tracker.move(STILL, np.zeros((2, 3)), np.zeros((2, 3)))
        tracker.fade(BOTH)
        tracker.tell("ball", BOTH, Measurement(np.full((2, 3), 0.3 * np.sin(0.02 * step)), 0.01 * SURE))
        if step > 100:
            assert (tracker.deviations()["ball"] < 0.002).all()
    np.testing.assert_allclose(tracker.estimates()["ball"], 0.3 * np.sin(0.02 * 2999), atol=0.003)


def test_where_it_is_undecided_what_an_object_does_its_place_is_unsure():
    """The two hypotheses are each sure of a place, and these are 30 cm apart."""
    tracker, tool = started(), np.zeros((2, 3))
    for _ in range(20):
        look(tracker, tool)
    tracker.move(STILL, tool, tool + np.array([0.3, 0.0, 0.0]))
    (cube,) = tracker.estimates()["cube"][:1]
    assert 0.02 < cube[0] < 0.28, "a check that it has decided would tell nothing"
    assert tracker.deviations()["cube"][0] > 0.02
