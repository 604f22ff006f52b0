"""Poses of all frames of a scene in every recorded state, each relative to its parent frame in ROS 2."""

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from aerial_il.presentation.rerun.motion import Motion
from aerial_il.presentation.rerun.ros2.bag import Frame
from aerial_il.presentation.rerun.ros2.kinematics import FIXED, WORLD, Joint, Pose, Tree, body_name

TOOL = "tool"
AHEAD = Pose(np.zeros(3), Rotation.from_quat([1.0, 0.0, 0.0, 0.0]))  # MuJoCo's look along -z


@dataclass(frozen=True, eq=False)
class Track:
    """A frame on its way.

    Attributes:
        parent, name: of frames. pose: one for each of N states, or one alone of a frame that stays.
    """

    parent: str
    name: str
    pose: Pose

    @property
    def moves(self) -> bool:
        """There is a pose for each state."""
        return self.pose.pos.ndim == 2

    def at(self, state: int = 0) -> Frame:
        """Return where it is in a state."""
        chosen = state if self.moves else ...
        return Frame(self.parent, self.name, self.pose.pos[chosen], self.pose.xyzw[chosen])


def tracks_of(motion: Motion, tree: Tree, qpos: np.ndarray) -> list[Track]:
    """Return all frames: links in their parents, all other bodies in ``world``, and the tool and cameras.

    Args:
        motion: the scene in N states. tree: its robot. qpos: (N, nq) of MuJoCo.
    """
    links = [_link(motion, tree, joint, qpos) for joint in tree.joints]
    held = {joint.child for joint in tree.joints}
    names = [body_name(motion.model, body) for body in range(motion.model.nbody)]
    others = [
        Track(WORLD, name, body_pose(motion, body)) for body, name in enumerate(names) if body and name not in held
    ]
    return [*others, *links, *_tool(motion.model), *(eye(motion, camera) for camera in range(motion.model.ncam))]


def body_pose(motion: Motion, body: int) -> Pose:
    """Return the pose of a body in the world: one for each state, or one alone if it cannot move."""
    states = slice(None) if motion.moving[body] else 0
    return Pose.of(motion.body_pos[states, body], motion.body_quat[states, body])


def _link(motion: Motion, tree: Tree, joint: Joint, qpos: np.ndarray) -> Track:
    """Return a link in its parent: where its joint puts it, or, where a joint is no number, where MuJoCo does."""
    model = motion.model
    if joint.index is not None:
        return Track(joint.parent, joint.child, joint.at(qpos[:, model.jnt_qposadr[joint.index]]))
    if joint.kind == FIXED:
        return Track(joint.parent, joint.child, joint.origin)
    mine = body_pose(motion, tree.bodies[joint.child])
    held = joint.parent != WORLD
    return Track(
        joint.parent, joint.child, mine.seen_from(body_pose(motion, tree.bodies[joint.parent])) if held else mine
    )


def _tool(model: mujoco.MjModel) -> Iterator[Track]:
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, TOOL)
    if site >= 0:
        parent = body_name(model, int(model.site_bodyid[site]))
        yield Track(parent, TOOL, Pose.of(model.site_pos[site], model.site_quat[site]))


def eye(motion: Motion, camera: int) -> Track:
    """Return a camera's frame, x right, y down, z ahead: in its body, or in the world where it follows another."""
    model, name = motion.model, optical(motion.model.camera(camera).name)
    if model.cam_mode[camera] == mujoco.mjtCamLight.mjCAMLIGHT_FIXED:
        parent = body_name(model, int(model.cam_bodyid[camera]))
        return Track(parent, name, Pose.of(model.cam_pos[camera], model.cam_quat[camera]).then(AHEAD))
    pose = Pose(motion.camera_pos[:, camera], Rotation.from_matrix(motion.camera_mat[:, camera]))
    return Track(WORLD, name, pose.then(AHEAD))


def optical(camera: str) -> str:
    """Return the name of a camera's frame, as ROS calls those that look along z."""
    return f"{camera}_optical"
