"""Letters can be read on every background of every page, light and dark: WCAG AA, by computation."""

import re

import pytest

from aerial_il.teleop.page import PAGE

SCHEMES = ("light", "dark")
LETTERS = ("ink", "muted", "good", "bad", "amber", "accent")
BACKGROUNDS = ("background", "card", "raised")
ENOUGH, ENOUGH_FOR_EDGES = 4.5, 3.0
BESIDES = [  # letters on areas that are the same in both schemes
    ("#ffffff", "#c9281d"), ("#ffffff", "#2757a4"), ("#ffffff", "#0b7364"), ("#16100a", "#f28b3c"),
    ("#16100a", "#84b1ee"), ("#16100a", "#ef8a3a"), ("#ffffff", "#8a5b00"), ("#ffffff", "#1f63d6"),
    ("#ffffff", "#a4470a"),
]  # fmt: skip


def colours() -> dict[str, tuple[str, str]]:
    """Return the colours of the theme by name: light and dark."""
    text = (PAGE / "theme.css").read_text(encoding="utf-8")
    return {name: (a, b) for name, a, b in re.findall(r"--(\w[\w-]*): light-dark\((#\w+), (#\w+)\)", text)}


def luminance(colour: str) -> float:
    """Return the relative luminance of #rrggbb; WCAG 2.2."""
    parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: str, other: str) -> float:
    """Return the contrast ratio of two colours, from 1 to 21."""
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_the_measure_is_that_of_the_standard() -> None:
    assert contrast("#000000", "#ffffff") == pytest.approx(21.0)
    assert contrast("#777777", "#ffffff") == pytest.approx(4.48, abs=0.01), "a grey that is known to fail"


@pytest.mark.parametrize("scheme", range(2), ids=SCHEMES)
@pytest.mark.parametrize("background", BACKGROUNDS)
def test_letters_can_be_read(background: str, scheme: int) -> None:
    result = colours()
    for letters in LETTERS:
        assert contrast(result[letters][scheme], result[background][scheme]) >= ENOUGH, letters
    assert contrast(result["edge"][scheme], result["card"][scheme]) >= ENOUGH_FOR_EDGES


@pytest.mark.parametrize(("letters", "area"), BESIDES)
def test_letters_on_coloured_areas_can_be_read(letters: str, area: str) -> None:
    css = (PAGE / "style.css").read_text(encoding="utf-8") + (PAGE / "theme.css").read_text(encoding="utf-8")
    assert area in css, "this area is no longer there"
    assert contrast(letters, area) >= ENOUGH
