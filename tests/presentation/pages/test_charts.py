"""Charts are well-formed, put data where it belongs, and escape what they are told."""

from xml.etree import ElementTree

import pytest

from aerial_il.evaluation.curves import LearningPoint
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.presentation.pages.charts import (
    BOTTOM,
    HEIGHT,
    NARROW,
    RIGHT,
    TOP,
    Figure,
    Plot,
    histogram,
)
from aerial_il.presentation.pages.figures import learning_curve, paths


def parse(figure: Figure) -> ElementTree.Element:
    return ElementTree.fromstring(str(figure.svg))


def test_a_point_lands_where_the_axes_say() -> None:
    plot = Plot(x=(0, 10), y=(0, 1), x_label="s", y_label="m", alt="a point")
    plot.dot(10, 1, "good")
    circle = ElementTree.fromstring(str(plot.svg())).find(".//circle")
    assert circle is not None
    assert (float(circle.attrib["cx"]), float(circle.attrib["cy"])) == (NARROW - RIGHT, TOP)


def test_bars_of_a_histogram_hold_every_value() -> None:
    groups = {"success": [1.0, 1.1, 2.0, 5.0], "failure": [1.0, 9.0]}
    figure = histogram("Time", groups, x_label="s", kinds={"success": "good", "failure": "bad"})
    per_episode = (HEIGHT - BOTTOM - TOP) / 3  # the tallest bin holds 1.0, 1.0 and 1.1
    heights = dict.fromkeys(("good", "bad"), 0.0)
    for bar in parse(figure).iter("rect"):
        heights[bar.attrib["class"]] += float(bar.attrib["height"])
    assert heights["good"] == pytest.approx(4 * per_episode, abs=0.5)
    assert heights["bad"] == pytest.approx(2 * per_episode, abs=0.5)


def test_text_from_outside_is_escaped() -> None:
    plot = Plot(x=(0, 1), y=(0, 1), x_label="<b>&", y_label='"', alt='"><script>')
    plot.dot(0, 0, "good", title="</title><script>")
    assert "<script>" not in plot.svg()
    ElementTree.fromstring(str(plot.svg()))


def test_paths_mark_successes_and_failures(diver: EvaluationResult) -> None:
    top = parse(paths(diver)[0])
    won = diver.success["count"]
    assert len(list(top.iter("circle"))) == won
    assert len([p for p in top.iter("path") if p.attrib["class"] == "end bad"]) == len(diver.episodes) - won


def test_learning_curve_shows_each_point_with_its_interval(diver: EvaluationResult, expert: EvaluationResult) -> None:
    drawing = parse(learning_curve([LearningPoint(100, expert), LearningPoint(10, diver)]))
    assert len([p for p in drawing.iter("path") if p.attrib["class"] == "whisker"]) == 2
    left, right = (float(c.attrib["cy"]) for c in drawing.iter("circle"))
    assert left > right  # the expert at 100 stands higher than the diver at 10
