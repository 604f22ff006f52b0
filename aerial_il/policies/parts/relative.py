"""Poses of the end effector as it sees them itself: ``inv(pose now) * pose``, orientations as rot6d.

Source: C. Chi et al., "Universal Manipulation Interface", 2024, section IV-C (relative end-effector trajectories).
"""

import numpy as np

POSE = 9  # position (3) and rot6d (6), at the front of an ``ee_pose`` action


def into_tool(poses_world: np.ndarray, tool_world: np.ndarray) -> np.ndarray:
    """Return poses (..., 9) in the frame of the tool, whose own pose in the world is ``tool_world`` (..., 9)."""
    rot_tool_from_world = np.swapaxes(rotations(tool_world[..., 3:]), -1, -2)
    return turned(rot_tool_from_world, poses_world - _origin(tool_world))


def into_world(poses_tool: np.ndarray, tool_world: np.ndarray) -> np.ndarray:
    """Undo :func:`into_tool`."""
    poses_world = turned(rotations(tool_world[..., 3:]), poses_tool)
    poses_world[..., :3] += tool_world[..., :3]
    return poses_world


def rotations(rot6d: np.ndarray) -> np.ndarray:
    """Return rotation matrices (..., 3, 3) of rot6d vectors (..., 6), by Gram-Schmidt (Zhou et al. 2019)."""
    x, y = rot6d[..., :3], rot6d[..., 3:]
    x = x / np.linalg.norm(x, axis=-1, keepdims=True)
    y = y - (x * y).sum(-1, keepdims=True) * x
    y = y / np.linalg.norm(y, axis=-1, keepdims=True)
    return np.stack([x, y, np.cross(x, y)], axis=-1)


def turned(rotation: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Apply ``rotation`` (..., 3, 3) to each three numbers of ``vectors`` (..., 3 k)."""
    rows = np.matmul(vectors.reshape((*vectors.shape[:-1], -1, 3)), np.swapaxes(rotation, -1, -2))
    return rows.reshape((*rows.shape[:-2], -1))


def _origin(poses: np.ndarray) -> np.ndarray:
    """What is subtracted from a pose (..., 9) seen from ``poses``: the columns of a rotation have no origin."""
    origin = np.zeros_like(poses)
    origin[..., :3] = poses[..., :3]
    return origin
