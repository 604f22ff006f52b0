"""A film lasts as long as it was asked to, and divides the time so that long flights get what short ones leave."""

from pathlib import Path

import numpy as np
import pytest

import aerial_il
from aerial_il.core.errors import InvalidValueError
from aerial_il.presentation.films import reel
from aerial_il.workflows.film import REEL
from tests.presentation.conftest import Flown
from tests.presentation.films.test_side_by_side import cut

SMALL = reel.ReelLook(height=64, width=96, fps=5.0, seconds=6.0, exposures=1, title="A film")


@pytest.mark.parametrize(
    ("lengths", "total", "expected"),
    [
        ([2.0, 20.0, 4.0], 12.0, [2.0, 6.0, 4.0]),
        ([20.0, 20.0], 12.0, [6.0, 6.0]),
        ([2.0, 4.0], 9.0, [3.0, 6.0]),
        ([2.0, 4.0], 60.0, [4.0, 8.0]),
    ],
)
def test_the_time_is_shared(lengths: list[float], total: float, expected: list[float]) -> None:
    assert reel.shares(lengths, total) == pytest.approx(expected)


@pytest.mark.render
def test_a_film_of_short_flights_lasts_as_long_as_asked(flown: Flown, tmp_path: Path) -> None:
    import av

    flights = [cut(flown.episode, 60), cut(flown.episode, 40)]  # 2 s together, 3 s of film beside the title
    path = reel.write_reel(tmp_path / "film.mp4", flights, SMALL)
    with av.open(str(path)) as film:
        pictures = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
    assert len(pictures) == pytest.approx(SMALL.seconds * SMALL.fps, abs=2)
    assert np.ptp([picture.mean() for picture in pictures]) > 5.0  # title, fades and flights differ


def test_a_film_too_short_for_its_flights_is_refused(flown: Flown, tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match="seconds=4 is too short for 2 flights"):
        reel.write_reel(tmp_path / "f.mp4", [flown.episode] * 2, reel.ReelLook(seconds=4.0, title="A film"))


def test_the_film_of_the_project_shows_flights_that_there_are() -> None:
    cells = {tuple(flight.split("/")[:2]) for flight in REEL}
    assert len(cells) == len(REEL)
    assert cells <= set(aerial_il.list_cells())
