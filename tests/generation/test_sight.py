"""What the camera beside the tool sees is computed as it is rendered."""

from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from aerial_il.data.episode import Episode
from aerial_il.generation.cuts import Cut
from aerial_il.generation.sight import in_view
from aerial_il.generation.source import read_source
from aerial_il.suite.physics.physics_batch import SIGNATURE


@pytest.mark.render
def test_a_thing_is_in_view_where_its_pixels_are(flight: Callable[[str], Episode]) -> None:
    episode = flight("pick_place")
    source, model = read_source(episode), mujoco.MjModel.from_xml_string(episode.model_xml)
    model.cam_fovy[:] = 60.0  # so that it leaves the picture
    data, bowl = mujoco.MjData(model), model.body("bowl").id
    computed, rendered = list[bool](), list[bool]()
    with mujoco.Renderer(model, 96, 128) as renderer:
        renderer.enable_segmentation_rendering()
        for step in range(0, len(episode), 5):
            mujoco.mj_setState(model, data, episode.states[step], SIGNATURE)
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, "wrist")
            ids = renderer.render()[..., 0]
            rendered.append(bool(np.isin(model.geom_bodyid[np.maximum(ids, 0)], bowl)[ids >= 0].any()))
            at_step = replace(source, cuts=(Cut("bowl", step, step + 1),))
            computed.append(in_view(model, "wrist", 128 / 96, [at_step])["bowl"] == 1.0)
    assert {True, False} == set(rendered)
    assert all(seen for shown, seen in zip(computed, rendered, strict=True) if shown), (
        "the middle of a part is a part of it"
    )
    assert sum(rendered) - sum(computed) <= 3, "little more than the middles of its parts"
