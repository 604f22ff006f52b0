"""What a camera beside the tool sees of what the tool deals with."""

from collections.abc import Sequence

import mujoco
import numpy as np

from aerial_il.generation.moves import cuts_of
from aerial_il.generation.source import Source
from aerial_il.generation.things import TOOL


def in_view(model: mujoco.MjModel, camera: str, aspect: float, sources: Sequence[Source]) -> dict[str, float]:
    """Return for each thing in which share of the steps about it the middle of a part of it is in view.

    What hides it does not count. It is the same in the sources and in what is made of them, as a path moves with its
    thing.

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
            parts = model.geom_pos[model.geom_bodyid == model.body(cut.thing).id]
            points = poses.pos[steps, k, None] + np.einsum("kij,gj->kgi", poses.mat[steps, k], parts)
            from_tool = np.einsum("kji,kgj->kgi", poses.tool_mat[steps], points - poses.tool_pos[steps, None])
            right, up, back = np.moveaxis((from_tool - place) @ turn, 2, 0)
            seen = (back < 0.0) & (np.abs(up) < -back * half) & (np.abs(right) < -back * half * aspect)
            found.setdefault(cut.thing, []).extend(seen.any(axis=1))
    return {name: float(np.mean(seen)) for name, seen in found.items()}
