"""A page speaks of what is on it."""

from __future__ import annotations

from experiments.common.notes import About, demonstrator, listed, notes_on

NOTES = (
    ("Always.", About(("ppo", "sac"), "Slow: {}, {times} times."), About(("dqn",), "Never of {}.")),
    (About(("dqn",), "Nor this."),),
)


def test_what_is_not_on_the_page_is_not_spoken_of() -> None:
    assert list(notes_on({"sac", "bc"}, NOTES, times=3)) == ["Always. Slow: sac, 3 times."]
    assert list(notes_on({"sac", "ppo"}, NOTES, times=3)) == ["Always. Slow: ppo and sac, 3 times."], "in their order"
    assert list(notes_on(set(), NOTES, times=3)) == ["Always."]
    assert list(notes_on({"dqn"}, NOTES, times=3)) == ["Always. Never of dqn.", "Nor this."]


def test_names_are_listed_as_in_a_sentence() -> None:
    assert [listed(names) for names in ([], ["a"], ["a", "b"], ["a", "b", "c"])] == ["", "a", "a and b", "a, b and c"]


def test_noise_of_a_demonstrator_is_told() -> None:
    assert demonstrator("quad", 0.0) == "quad, demonstrated by its scripted expert without noise"
    assert "with a noise of 0.3" in demonstrator("quad", 0.3)
