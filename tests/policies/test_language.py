"""Instructions as numbers: wordings of one task lie nearer to each other than to those of other tasks."""

import numpy as np
import pytest

from aerial_il.core import language
from aerial_il.suite import tasks


def test_numbers_depend_on_the_words_alone() -> None:
    one = language.embedded("Press the RED button!")
    np.testing.assert_array_equal(one, language.embedded("press the red  button"))
    assert one.shape == (language.SIZE,)
    assert np.linalg.norm(one) == pytest.approx(1.0)
    assert not language.embedded("...").any()
    assert language.tokens("把 Cube-2 放进碗里") == ["cube", "2", "放", "进", "碗", "里"]


@pytest.mark.parametrize("task", tasks.names())
def test_wordings_that_are_held_out_are_recognised(task: str) -> None:
    """The nearest wording that is learned from is one of the same task, in both languages."""
    known = {text: name for name in tasks.names() for text in (tasks.get(name).instruction, *tasks.get(name).wordings)}
    own = tasks.get(task)
    assert len(own.wordings) >= 4
    assert len(own.held_out) >= 2
    assert not {*own.held_out} & {*known}
    for text in own.held_out:
        near, likeness = language.nearest(text, known)
        assert known[near] == task, (text, near)
        assert likeness >= language.ALIKE


@pytest.mark.parametrize("text", ["Fly to the moon.", "今天天气怎么样", "hello world", "the", ""])
def test_nonsense_is_like_nothing(text: str) -> None:
    known = [text for name in tasks.names() for text in (tasks.get(name).instruction, *tasks.get(name).wordings)]
    assert language.nearest(text, known)[1] < language.ALIKE


@pytest.mark.parametrize("task", tasks.names())
def test_what_forbids_something_is_not_understood_as_an_order(task: str) -> None:
    known = (tasks.get(task).instruction, *tasks.get(task).wordings)
    for text in (*known, *tasks.get(task).held_out):
        assert language.understood(text, known) in known, text
        for forbids in ("Do not", "Please don't", "不要", "请勿", "Never"):
            assert language.understood(f"{forbids} {text}", known) is None, forbids


def test_what_was_learned_may_forbid_something() -> None:
    known = ("Do not touch the red cube.", "Push the red cube.")
    assert language.understood("Do NOT touch the red cube!", known) == known[0]
    assert language.understood("Do not push the red cube.", known) is None


def test_order_of_words_counts() -> None:
    said = "Put the orange cube beside the blue bowl."
    other = "Put the blue cube beside the orange bowl."
    assert language.nearest(said, [other, said]) == (said, 1.0)
    assert language.nearest(said, [other])[1] < 1.0
