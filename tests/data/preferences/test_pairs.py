"""Pairs of segments are drawn alike from all episodes that are long enough."""

from collections import Counter

import pytest

from aerial_il.core.errors import InvalidValueError
from aerial_il.data.preferences.pairs import Preference, Segment, draw_pairs, flip

LENGTHS = {"short": 3, "long": 1_000, "brief": 6, "fair": 10}


def test_segments_lie_within_two_episodes() -> None:
    pairs = draw_pairs(LENGTHS, 200, length=5, seed=0)
    assert len({*pairs, *((right, left) for left, right in pairs)}) == 400, "each once, either way round"
    for left, right in pairs:
        assert left.uid != right.uid
        for segment in (left, right):
            assert 0 <= segment.first <= LENGTHS[segment.uid] - segment.length
            assert segment.uid != "short"


def test_long_episodes_come_no_oftener() -> None:
    pairs = draw_pairs({"a": 1_000, "b": 20, "c": 20, "d": 20}, 300, length=5, seed=0)
    counts = Counter(segment.uid for pair in pairs for segment in pair)
    assert max(counts.values()) < 1.5 * min(counts.values())


def test_more_pairs_begin_with_the_same() -> None:
    assert draw_pairs(LENGTHS, 50, length=5, seed=1)[:20] == draw_pairs(LENGTHS, 20, length=5, seed=1)
    assert draw_pairs(LENGTHS, 20, length=5, seed=2) != draw_pairs(LENGTHS, 20, length=5, seed=1)


def test_too_few_are_refused() -> None:
    with pytest.raises(InvalidValueError, match=r"1 of 4 episodes have the 11 steps of a segment.*longest has 1000"):
        draw_pairs(LENGTHS, 5, length=11, seed=0)
    with pytest.raises(InvalidValueError, match="There are 4 pairs of segments of 5 steps; 5 were asked for"):
        draw_pairs({"a": 6, "b": 6}, 5, length=5, seed=0)


def test_impossible_preferences_are_refused() -> None:
    left, right = Segment("a", 0, 5), Segment("b", 0, 5)
    with pytest.raises(InvalidValueError, match=r"preferred is 'both'. Valid: left, right, equal"):
        Preference(left, right, "both", "hand")  # type: ignore[arg-type]
    with pytest.raises(InvalidValueError, match="by is 'me'"):
        Preference(left, right, "left", "me")  # type: ignore[arg-type]
    with pytest.raises(InvalidValueError, match="no steps"):
        Preference(left, Segment("b", 0, 0), "left", "hand")


def test_the_opposite_of_equal_is_equal() -> None:
    assert [flip("left"), flip("right"), flip("equal")] == ["right", "left", "equal"]
