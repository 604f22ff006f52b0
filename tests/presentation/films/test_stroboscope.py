"""Trails and arrows are where the flight was and what acted on it, and a still shows several moments of it."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from aerial_il.core.errors import InvalidValueError
from aerial_il.presentation.films.scene_renderer import SceneRenderer
from aerial_il.presentation.films.stroboscope import write_stroboscope
from aerial_il.presentation.films.traces import M_PER_N, Traces, traces_of
from aerial_il.presentation.studio.marks import Arrow, Trail
from tests.presentation.conftest import Flown


@pytest.fixture(scope="module")
def traces(flown: Flown) -> Traces:
    return traces_of(flown.episode, SceneRenderer(flown.episode.model_xml))


def test_the_tool_s_trail_is_where_the_flight_observed_it(traces: Traces, flown: Flown) -> None:
    seen = flown.episode.obs["ee_pos"]
    np.testing.assert_allclose(traces.tool[: len(seen)], seen, atol=1e-6)
    assert not traces.wind.any()


def test_forces_become_arrows_and_calm_air_none(traces: Traces) -> None:
    force = np.tile([0.0, 0.0, 4.0], (len(traces.tool), 1))
    pressed = Traces(traces.tool, traces.base, traces.wind, force, traces.tool, traces.dt)
    arrows = [mark for mark in pressed.marks(30) if isinstance(mark, Arrow)]
    assert [arrow.vector.tolist() for arrow in arrows] == [[0.0, 0.0, 4.0 * M_PER_N]]
    blown = Traces(traces.tool, traces.base, force, np.zeros_like(force), traces.tool, traces.dt)
    assert len([mark for mark in blown.marks(30) if isinstance(mark, Arrow)]) == 1
    trails = [mark for mark in traces.marks(30, since_s=10 * traces.dt) if isinstance(mark, Trail)]
    assert [len(trail.points) for trail in trails] == [11, 11]


@pytest.mark.render
def test_a_still_is_a_picture_of_the_size_asked_for(flown: Flown, tmp_path: Path) -> None:
    with Image.open(write_stroboscope(tmp_path / "flight.png", flown.episode, size=(54, 96))) as picture:
        assert picture.size == (96, 54)
        assert np.asarray(picture).std() > 10
    with pytest.raises(InvalidValueError, match=r"e\.g\. size=\[1080,1920\]"):
        write_stroboscope(tmp_path / "big.png", flown.episode, size=(54, 99999))
