"""Pictures for people hold what they are of, whatever its size."""

import numpy as np
import pytest

from aerial_il.presentation.films.scene_renderer import SceneRenderer, obstacle, robot_geoms
from aerial_il.presentation.studio.studio import QUICK
from tests.presentation.conftest import Flown

pytestmark = pytest.mark.render
HEIGHT, WIDTH = 90, 120


def test_what_renders_has_no_obstacle() -> None:
    assert obstacle() == ""


def test_a_framed_robot_fills_the_picture_and_touches_no_edge(flown: Flown) -> None:
    with SceneRenderer(flown.episode.model_xml) as scene:
        view = scene.frame(flown.episode.states, WIDTH / HEIGHT)
        assert view.distance > 0.5
        shown = scene.studio.model.geom_rgba
        colours, robot = shown.copy(), robot_geoms(scene.studio.model)
        for state in flown.episode.states[::20]:
            with_robot = scene.draw(state, view, HEIGHT, WIDTH, exposures=QUICK).astype(int)
            shown[robot, 3] = 0.0
            without = scene.draw(state, view, HEIGHT, WIDTH, exposures=QUICK)
            shown[:] = colours
            seen = (with_robot - without > 8).any(axis=2) | (with_robot.min(axis=2) < 60)  # a shadow is grey
            assert seen.sum() > 100
            assert not seen[[0, -1]].any()
            assert not seen[:, [0, -1]].any()


def test_a_portrait_shows_the_robot_alone(flown: Flown) -> None:
    with SceneRenderer(flown.episode.model_xml) as scene:
        scene.hide_props()
        model = scene.studio.model
        shown, robot = model.geom_rgba[:, 3] > 0, robot_geoms(model)
        names = {model.geom(i).name for i in np.flatnonzero(shown & ~robot)}
        assert names == {"ground"}
        assert (shown & robot).sum() > 10


def test_the_scene_s_own_cameras_are_offered(flown: Flown) -> None:
    with SceneRenderer(flown.episode.model_xml) as scene:
        assert {"scene", "wrist"} <= set(scene.cameras)
        assert scene.draw(flown.episode.states[0], "wrist", HEIGHT, WIDTH).shape == (HEIGHT, WIDTH, 3)
