"""A flight is cut where it deals with things, and a segment moves with its thing."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aerial_il.core.errors import InvalidValueError
from aerial_il.data.episode import Episode
from aerial_il.generation.plan import moved
from aerial_il.generation.segments import Segment, cut
from aerial_il.generation.source import Source, read_source, read_sources
from aerial_il.generation.things import Poses

Flights = Callable[[str], Episode]
TASKS = {
    "pick_place": (["cube", "bowl"], ["heading", "not"]),
    "insert_peg": (["peg", "hole"], ["not", "not"]),
    "open_door": (["door"], ["full"]),
    "press_button": (["button_cap"], ["full"]),
    "inspect_contact": (["plate"], ["full"]),
}


def at(poses: Poses, step: int) -> Poses:
    """Return where everything is at one step."""
    return Poses(*(value[step : step + 1] for value in vars(poses).values()))


def index(source: Source, segment: Segment) -> int:
    return [thing.name for thing in source.things].index(segment.name)


@pytest.mark.parametrize("task", TASKS)
def test_a_flight_is_cut_where_it_deals_with_things(flight: Flights, task: str) -> None:
    segments = cut(read_source(flight(task)))
    assert ([each.name for each in segments], [each.turning.how for each in segments]) == TASKS[task]
    assert all(len(each) > 10 for each in segments)
    assert (segments[0].held is None) == (len(segments) == 1)
    assert [each.carried for each in segments[1:]] == [segments[0].name] * (len(segments) - 1)


@pytest.mark.parametrize("task", TASKS)
def test_where_nothing_has_moved_the_path_is_that_of_the_source(flight: Flights, task: str) -> None:
    source = read_source(flight(task))
    for segment in cut(source):
        k = index(source, segment)
        path = moved(segment, source.things[k], k, at(source.poses, 0))
        np.testing.assert_allclose(path.pos, segment.pos, atol=2e-3)
        np.testing.assert_allclose(path.there, segment.tool_pos, atol=2e-3)
        np.testing.assert_allclose(path.mat, segment.mat, atol=5e-3)


def test_a_path_moves_and_turns_with_its_thing(flight: Flights) -> None:
    source = read_source(flight("pick_place"))
    cube, bowl = cut(source)
    k, here, aside = index(source, cube), at(source.poses, 0), np.array([0.3, -0.2, 0.1])
    for angle, turned in ((0.0, 0.0), (20.0, 20.0), (90.0, 0.0), (-110.0, -20.0)):
        turn = Rotation.from_euler("z", angle, degrees=True).as_matrix()
        there = replace(here, pos=here.pos + aside, mat=turn @ here.mat)
        path = moved(cube, source.things[k], k, there)
        expected = Rotation.from_euler("z", turned, degrees=True).as_matrix()
        relative = (cube.pos - cube.thing_pos) @ expected.T
        np.testing.assert_allclose(path.pos, here.pos[0, k] + aside + relative, atol=2e-3)
        np.testing.assert_allclose(path.mat, expected @ cube.mat, atol=1e-2)
        np.testing.assert_allclose(path.gripper, cube.gripper)
    k = index(source, bowl)
    path = moved(bowl, source.things[k], k, replace(here, mat=turn @ here.mat))
    np.testing.assert_allclose(path.pos, bowl.pos, atol=2e-3)  # how a bowl is turned shows nowhere


def test_a_thing_on_a_joint_is_led_to_where_the_source_led_it(flight: Flights) -> None:
    source = read_source(flight("push_slider"))
    (segment,) = cut(source)
    k, start = index(source, segment), at(source.poses, 0)
    ahead = 0.5 * (segment.joint[-1] - start.joint[0, k])  # half of the way is done
    halfway = replace(start, joint=start.joint + ahead, pos=start.pos + ahead * start.axis)
    path = moved(segment, source.things[k], k, halfway)
    assert np.linalg.norm(path.pos[0] - segment.pos[0]) == pytest.approx(abs(ahead), rel=0.1)
    np.testing.assert_allclose(path.pos[-1], segment.pos[-1], atol=5e-3)


def test_what_cannot_be_generated_from_is_refused(flight: Flights) -> None:
    episode = flight("pick_place")
    for changed, said in (
        (replace(episode, success=False), "is no success"),
        (replace(episode, states=episode.states[:, :-1]), "recorded by another engine"),
        (replace(episode, spec=replace(episode.spec, controller="none")), "not of the suite"),
    ):
        with pytest.raises(InvalidValueError, match=said):
            read_source(changed)
    with pytest.raises(InvalidValueError, match="no successful flight"):
        read_sources([replace(episode, success=False)])
    with pytest.raises(InvalidValueError, match="several tasks: open_door, pick_place"):
        read_sources([episode, flight("open_door")])
