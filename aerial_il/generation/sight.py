"""What a camera beside the tool sees of what the tool deals with."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from aerial_il.generation.moves import cuts_of
from aerial_il.generation.source import Source
from aerial_il.generation.things import TOOL


def in_view(model: mujoco.MjModel, camera: str, aspect: float, sources: Sequence[Source]) -> dict[str, float]:
    """Return for each thing in which share of the steps about it its middle is in view, whatever hides it.

    It is the same in flights of the sources and in those that are made of them, as a path moves with its thing.

    Args:
        model: of a scene with the robot that flies. camera: one on the body of its tool. aspect: width over height.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
    tool, eye = data.site(TOOL), data.cam(camera)
    mat, place = tool.xmat.reshape(3, 3), tool.xmat.reshape(3, 3).T @ (eye.xpos - tool.xpos)
    turn, half = mat.T @ eye.xmat.reshape(3, 3), np.tan(0.5 * np.radians(model.camera(camera).fovy[0]))
    found = dict[str, list[bool]]()
    for source in sources:
        poses = source.poses
        for cut in cuts_of(source):
            k, steps = source.names.index(cut.thing), slice(cut.first, cut.last)
            from_tool = np.einsum("kji,kj->ki", poses.tool_mat[steps], poses.pos[steps, k] - poses.tool_pos[steps])
            right, up, back = ((from_tool - place) @ turn).T
            seen = (back < 0.0) & (np.abs(up) < -back * half) & (np.abs(right) < -back * half * aspect)
            found.setdefault(cut.thing, []).extend(seen)
    return {name: float(np.mean(seen)) for name, seen in found.items()}
