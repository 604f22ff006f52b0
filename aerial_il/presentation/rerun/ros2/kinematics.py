"""The robot of a compiled scene as a tree of links and joints, as URDF has it: a joint moves the frame of its child."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from aerial_il.presentation.rerun.motion import robot_bodies

WORLD = "world"
SLIDE, HINGE = int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE)
SCALAR = (SLIDE, HINGE)
FIXED, REVOLUTE, CONTINUOUS, PRISMATIC, FLOATING = "fixed", "revolute", "continuous", "prismatic", "floating"


@dataclass(frozen=True, eq=False)
class Pose:
    """A frame in another one, or N of them.

    Attributes:
        pos: (..., 3) m. rot: of as many, parent from child.
    """

    pos: np.ndarray
    rot: Rotation

    @staticmethod
    def of(pos: np.ndarray, quat_wxyz: np.ndarray) -> Pose:
        """Return a pose of MuJoCo's position and quaternion."""
        return Pose(np.asarray(pos, float), Rotation.from_quat(quat_wxyz, scalar_first=True))

    @property
    def xyzw(self) -> np.ndarray:
        """(..., 4) quaternions in ROS's order."""
        return self.rot.as_quat()

    def then(self, inner: Pose) -> Pose:
        """Return the pose of a frame that ``inner`` gives in this one."""
        return Pose(self.pos + self.rot.apply(inner.pos), self.rot * inner.rot)

    def seen_from(self, outer: Pose) -> Pose:
        """Return this pose in the frame ``outer``, where both are given in one frame."""
        back = outer.rot.inv()
        return Pose(back.apply(self.pos - outer.pos), back * self.rot)


def shifted(pos: np.ndarray) -> Pose:
    """Return a frame that is moved and not turned."""
    return Pose(np.asarray(pos, float), Rotation.identity())


@dataclass(frozen=True, eq=False)
class Joint:
    """What holds one link to another.

    Attributes:
        name, kind: as URDF has them. parent, child: names of links.
        origin: the child's frame in the parent's where the joint is at zero.
        axis: (3,) in the child's frame.
        index: of MuJoCo's joint, None where nothing moves.
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: Pose
    axis: np.ndarray
    index: int | None = None

    def at(self, values: np.ndarray) -> Pose:
        """Return the child's frame in the parent's where the joint is at ``values`` (N,), rad or m."""
        along = np.multiply.outer(values, self.axis)
        if self.kind == PRISMATIC:
            return Pose(
                self.origin.pos + self.origin.rot.apply(along), self.origin.rot * Rotation.from_rotvec(0 * along)
            )
        return Pose(np.broadcast_to(self.origin.pos, along.shape), self.origin.rot * Rotation.from_rotvec(along))


@dataclass(frozen=True, eq=False)
class Tree:
    """The robot's links and joints.

    Attributes:
        root: the link that nothing holds: the only body that flies or stands freely, else ``world``.
        bodies: link -> body, of the links that are one. joints: parents before children.
    """

    root: str
    bodies: dict[str, int]
    joints: tuple[Joint, ...]

    @property
    def links(self) -> tuple[str, ...]:
        """All links, parents before children."""
        return (self.root, *(joint.child for joint in self.joints))

    @property
    def moving(self) -> tuple[Joint, ...]:
        """Joints with a value of their own."""
        return tuple(joint for joint in self.joints if joint.index is not None)


def tree_of(model: mujoco.MjModel) -> Tree:
    """Return the robot of a scene."""
    robot = robot_bodies(model)
    mine = [int(body) for body in np.flatnonzero(robot)]
    tops = [body for body in mine if not robot[model.body_parentid[body]]]
    alone = len(tops) == 1 and not _scalar_joints(model, tops[0])
    root = body_name(model, tops[0]) if alone else WORLD
    bodies = {body_name(model, body): body for body in mine}
    held = [joint for body in mine if not (alone and body == tops[0]) for joint in _joints(model, body, robot)]
    return Tree(root, bodies, tuple(held))


def body_name(model: mujoco.MjModel, body: int) -> str:
    """Return the name of a body's frame."""
    return WORLD if body == 0 else model.body(body).name or f"body_{body}"


def joint_name(model: mujoco.MjModel, joint: int) -> str:
    """Return the name of a joint."""
    return model.joint(joint).name or f"joint_{joint}"


def _scalar_joints(model: mujoco.MjModel, body: int) -> list[int]:
    first = model.body_jntadr[body]
    return [j for j in range(first, first + model.body_jntnum[body]) if model.jnt_type[j] in SCALAR]


def _joints(model: mujoco.MjModel, body: int, robot: np.ndarray) -> Iterator[Joint]:
    """Yield what leads from a body's parent to the body: MuJoCo moves it by one joint after the other, each in place.

    A joint whose anchor is the body's origin, alone, makes one link; any other brings links of its own.
    """
    name, above = body_name(model, body), int(model.body_parentid[body])
    parent = body_name(model, above) if robot[above] else WORLD
    pose, joints = Pose.of(model.body_pos[body], model.body_quat[body]), _scalar_joints(model, body)
    if model.body_jntnum[body] != len(joints):  # a free or ball joint
        yield Joint(f"{name}_{FLOATING}", FLOATING, parent, name, pose, np.zeros(3))
        return
    for joint in joints:
        anchor, axis = model.jnt_pos[joint], model.jnt_axis[joint]
        last = joint == joints[-1] and not anchor.any()
        child = name if last else f"{name}_{joint_name(model, joint)}"
        moved = Joint(joint_name(model, joint), _kind(model, joint), parent, child, shifted(anchor), axis, joint)
        zero = moved.at(-model.qpos0[model.jnt_qposadr[joint]])
        yield Joint(moved.name, moved.kind, parent, child, pose.then(zero), axis, joint)
        parent, pose = child, shifted(-anchor)
    if parent != name:
        yield Joint(f"{name}_{FIXED}", FIXED, parent, name, pose, np.zeros(3))


def _kind(model: mujoco.MjModel, joint: int) -> str:
    if model.jnt_type[joint] == SLIDE:
        return PRISMATIC
    return REVOLUTE if model.jnt_limited[joint] else CONTINUOUS
