"""A pose to aim at is one that can be seen: no two of its headings look the same, not even where it points down."""

from __future__ import annotations

import math
from contextlib import closing
from itertools import pairwise

import mujoco
import numpy as np
import pytest

from aerial_il.core.rotations import mat_from_quat
from aerial_il.suite.props.marker import add_marker


@pytest.mark.render
@pytest.mark.parametrize("pitch", [0.5, 0.5 * math.pi])
def test_each_heading_of_a_marked_pose_looks_different(pitch: float):
    spec = mujoco.MjSpec()
    add_marker(spec, tolerance=0.02, arrow=0.12, bar=0.1)
    spec.worldbody.add_camera(name="above", pos=[0.0, 0.0, 0.4], quat=[1, 0, 0, 0])
    spec.worldbody.add_light(pos=[0.0, 0.0, 2.0])
    model = spec.compile()
    data, pictures = mujoco.MjData(model), []
    with closing(mujoco.Renderer(model, 64, 64)) as renderer:
        renderer.enable_segmentation_rendering()
        for yaw in (-0.4, 0.0, 0.4):
            about_z = np.array([math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw)])
            mujoco.mju_mulQuat(
                data.mocap_quat[0], about_z, np.array([math.cos(0.5 * pitch), 0, math.sin(0.5 * pitch), 0])
            )
            points = np.reshape(mat_from_quat(tuple(data.mocap_quat[0])), (3, 3))[:, 0]
            assert points[2] == pytest.approx(-math.sin(pitch))
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, "above")
            pictures.append(renderer.render()[..., 0] >= 0)
    for one, other in pairwise(pictures):
        assert (one != other).sum() > 0.2 * one.sum()
