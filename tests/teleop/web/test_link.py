"""Pictures become smaller on a narrow link at once, and larger again only after a while."""

from __future__ import annotations

from aerial_il.teleop.web.film import THRIFT
from aerial_il.teleop.web.link import Link


def shown(link: Link, now: list[float], count: int, took: float) -> list[int]:
    """Show pictures that take so long; return the thrift after each."""
    found = []
    for number in range(count):
        link.send(number)
        now[0] += took
        link.arrive(number)
        found.append(link.thrift)
    return found


def test_a_narrow_link_gets_the_smallest_pictures_within_two_seconds() -> None:
    now = [0.0]
    assert shown(Link(lambda: now[0]), now, 4, 0.45)[-1] == len(THRIFT) - 1
    assert now[0] < 2.0


def test_a_wide_link_keeps_the_best_and_gets_it_back() -> None:
    now = [0.0]
    link = Link(lambda: now[0])
    assert set(shown(link, now, 200, 0.03)) == {0}
    shown(link, now, 10, 0.5)
    assert link.thrift == len(THRIFT) - 1
    assert shown(link, now, 10, 0.03)[-1] == len(THRIFT) - 1, "not at once"
    assert shown(link, now, 700, 0.03)[-1] == 0


def test_what_was_never_sent_means_nothing() -> None:
    link = Link(lambda: 0.0)
    link.arrive(7)
    assert link.thrift == 0
