"""Poses of the end effector as it sees them itself: ``inv(pose now) * pose``, orientations as rot6d.

Source: C. Chi et al., "Universal Manipulation Interface", 2024, section IV-C (relative end-effector trajectories).
"""

from __future__ import annotations

import numpy as np

POSE = 9  # position (3) and rot6d (6), at the front of an ``ee_pose`` action


def into_tool(poses_world: np.ndarray, tool_world: np.ndarray) -> np.ndarray:
    """Return poses (..., 9) in the frame of the tool, whose own pose in the world is ``tool_world`` (..., 9)."""
    rot_tool_from_world = np.swapaxes(rotations(tool_world[..., 3:]), -1, -2)
    return _turned(rot_tool_from_world, _vectors(poses_world) - _origin(tool_world))


def into_world(poses_tool: np.ndarray, tool_world: np.ndarray) -> np.ndarray:
    """Undo :func:`into_tool`."""
    turned = _turned(rotations(tool_world[..., 3:]), _vectors(poses_tool))
    turned[..., :3] += tool_world[..., :3]
    return turned


def rotations(rot6d: np.ndarray) -> np.ndarray:
    """Return rotation matrices (..., 3, 3) of rot6d vectors (..., 6), by Gram-Schmidt (Zhou et al. 2019)."""
    x, y = rot6d[..., :3], rot6d[..., 3:]
    x = x / np.linalg.norm(x, axis=-1, keepdims=True)
    y = y - (x * y).sum(-1, keepdims=True) * x
    y = y / np.linalg.norm(y, axis=-1, keepdims=True)
    return np.stack([x, y, np.cross(x, y)], axis=-1)


def _vectors(poses: np.ndarray) -> np.ndarray:
    """(..., 9) as three vectors (..., 3, 3): position and the first two columns of the rotation."""
    return poses.reshape((*poses.shape[:-1], 3, 3))


def _origin(poses: np.ndarray) -> np.ndarray:
    """What is subtracted from each of the three vectors: directions have no origin."""
    origin = np.zeros_like(_vectors(poses))
    origin[..., 0, :] = poses[..., :3]
    return origin


def _turned(rotation: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Apply (..., 3, 3) to each of the three row vectors and flatten them to (..., 9)."""
    turned = np.matmul(vectors, np.swapaxes(rotation, -1, -2))
    return turned.reshape((*turned.shape[:-2], POSE))
