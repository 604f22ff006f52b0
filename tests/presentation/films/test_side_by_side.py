"""Flights side by side become one animation that passes in real time and ends in what became of them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from aerial_il.core.errors import InvalidValueError
from aerial_il.data.episode import Episode
from aerial_il.presentation.films.overlay import COLOURS, strip_height
from aerial_il.presentation.films.side_by_side import GAP, HOLD_S, Look, write_side_by_side
from tests.presentation.conftest import Flown

SMALL = Look(height=64, width=96, fps=5.0, abreast=2)
SHORT = 50


def cut(episode: Episode, steps: int) -> Episode:
    """Return the first steps of a flight, which did not succeed yet."""
    return replace(episode, actions=episode.actions[:steps], states=episode.states[: steps + 1], success=False)


@pytest.mark.render
def test_rounds_follow_each_other_in_real_time(flown: Flown, tmp_path: Path) -> None:
    flights = [cut(flown.episode, SHORT), cut(flown.episode, 30), cut(flown.episode, 30), cut(flown.episode, 20)]
    path = write_side_by_side(tmp_path / "film.webp", flights, SMALL)
    with Image.open(path) as film:
        assert film.size == (2 * SMALL.width + GAP, SMALL.height + strip_height(SMALL.width))
        durations = []
        for k in range(film.n_frames):
            film.seek(k)
            film.load()
            durations.append(film.info["duration"])
    assert durations.count(round(1000 * HOLD_S)) == 2
    assert sum(durations) == pytest.approx(1000 * (1.0 + 0.6 + 2 * HOLD_S), abs=200)


@pytest.mark.render
def test_the_last_picture_tells_how_each_flight_ended(flown: Flown, tmp_path: Path) -> None:
    path = write_side_by_side(tmp_path / "film.webp", [flown.episode, cut(flown.episode, SHORT)], SMALL)
    with Image.open(path) as film:
        film.seek(film.n_frames - 1)
        strip = np.asarray(film.convert("RGB"))[SMALL.height + 1].astype(int)
    for left, end in ((0, "success"), (SMALL.width + GAP, "timeout")):
        assert np.abs(strip[left + 4 : left + SMALL.width - 4] - COLOURS[end]).mean() < 40


@pytest.mark.parametrize(
    ("change", "said"),
    [({"height": 8}, "height is 8"), ({"fps": 0.0}, "fps is 0"), ({"quality": 101}, "quality is 101"),
     ({"abreast": 0}, "abreast is 0")],
)  # fmt: skip
def test_an_impossible_look_is_refused(change: dict, said: str) -> None:
    with pytest.raises(InvalidValueError, match=said):
        Look(**change)


def test_half_a_round_and_another_format_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match=r"must end in \.webp"):
        write_side_by_side(tmp_path / "film.gif", [])
    with pytest.raises(InvalidValueError, match="0 flights do not fill a round of 3"):
        write_side_by_side(tmp_path / "film.webp", [])
