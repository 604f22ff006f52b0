"""Where the things of a scene are: bodies that an episode places anew, or that can be moved, the robot's excepted."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import mujoco
import numpy as np

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import Field
from aerial_il.generation.transit import Boxes, boxes
from aerial_il.suite.physics.physics_batch import SIGNATURE

Kind = Literal["placed", "free", "hinge", "slide"]
KINDS: Mapping[int, Kind] = {
    int(mujoco.mjtJoint.mjJNT_FREE): "free",
    int(mujoco.mjtJoint.mjJNT_HINGE): "hinge",
    int(mujoco.mjtJoint.mjJNT_SLIDE): "slide",
}
TOOL, BASE = "tool", "imu"  # sites of every robot


@dataclass(frozen=True)
class Thing:
    """A body that is placed anew in each episode, or moved.

    Attributes:
        name: of the body. body, joint: indices in the model; -1 for one that is placed and has no joint.
        kind: how it can move. size_m: diameter of a ball about it that holds its geometry.
        sites: names of the sites on it.
    """

    name: str
    body: int
    joint: int
    kind: Kind
    size_m: float
    sites: tuple[str, ...]

    @property
    def is_jointed(self) -> bool:
        """Whether it moves along one joint, like a door or a button."""
        return self.kind in ("hinge", "slide")


@dataclass(frozen=True, eq=False)
class Poses:
    """Where B things are at K instants.

    Attributes:
        pos: (K, B, 3) m, world. mat: (K, B, 3, 3) world from thing. joint: (K, B) rad or m, 0 without a joint.
        axis, anchor: (K, B, 3) of the joint, world. tool_pos: (K, 3). tool_mat: (K, 3, 3).
    """

    pos: np.ndarray
    mat: np.ndarray
    joint: np.ndarray
    axis: np.ndarray
    anchor: np.ndarray
    tool_pos: np.ndarray
    tool_mat: np.ndarray

    def __len__(self) -> int:
        return len(self.pos)


class Scene:
    """The things of a scene, and where they are in given states.

    Args:
        model: compiled scene of the suite.

    Attributes:
        things: in the order of their bodies.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model, self._data = model, mujoco.MjData(model)
        self._tool = model.site(TOOL).id
        self.things = tuple(_things(model))
        self._bodies = np.array([thing.body for thing in self.things], int)
        self._joints = np.array([thing.joint for thing in self.things], int)

    def at(self, states: np.ndarray) -> Poses:
        """Return where everything is in full states (K, S), as ``env.get_state()`` returns them."""
        found = [self._pose(state) for state in states]
        return Poses(*(np.stack(values) for values in zip(*found, strict=True)))

    def boxes(self) -> Boxes:
        """Return what is solid in the last state that was looked at."""
        return boxes(self.model, self._data)

    @property
    def state_size(self) -> int:
        """Numbers of a full state, S."""
        return mujoco.mj_stateSize(self.model, SIGNATURE)

    def roots(self, *things: str) -> set[int]:
        """Return the topmost bodies of ``things``, by name, and of the robot."""
        bodies = [thing.body for thing in self.things if thing.name in things]
        return {_robot(self.model), *(int(self.model.body_rootid[body]) for body in bodies)}

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the things."""
        return tuple(thing.name for thing in self.things)

    def _pose(self, state: np.ndarray) -> tuple[np.ndarray, ...]:
        data, joints = self._data, self._joints
        mujoco.mj_setState(self.model, data, state, SIGNATURE)
        mujoco.mj_kinematics(self.model, data)
        has = joints >= 0
        positions = np.where(has, data.qpos[self.model.jnt_qposadr[joints]], 0.0)
        return (
            data.xpos[self._bodies].copy(),
            data.xmat[self._bodies].reshape(-1, 3, 3).copy(),
            positions,
            np.where(has[:, None], data.xaxis[joints], 0.0),
            np.where(has[:, None], data.xanchor[joints], 0.0),
            data.site_xpos[self._tool].copy(),
            data.site_xmat[self._tool].reshape(3, 3).copy(),
        )


@dataclass(frozen=True)
class Turning:
    """How a path turns with the thing that it is relative to.

    Attributes:
        how: ``not`` at all, where nothing says how the thing is turned; with its ``heading``; or in ``full``.
        fold: turns about its axis after which a thing looks the same, in a whole one.
    """

    how: Literal["not", "heading", "full"]
    fold: int = 1


def turning_of(thing: Thing, fields: Iterable[Field]) -> Turning:
    """Return how paths turn with ``thing``, by what a task shows of it.

    A thing on a joint is turned in full: along with what it is fixed to. Else the task's field ``NAME_...`` of the
    thing, or of a site on it, decides: six numbers of a rotation, or, without a unit, cosine and sine of its heading,
    whose labels say of how many times the heading (``cos4``: a cube is the same after a quarter turn). What no field
    tells of is turned so that nobody could see it, and the path is moved alone.
    """
    if thing.is_jointed:
        return Turning("full")
    owners = (thing.name, *thing.sites)
    about = [field for field in fields if any(field.name.startswith(f"{owner}_") for owner in owners)]
    if any(field.name.endswith("_rot6d") for field in about):
        return Turning("full")
    for labels in (field.labels for field in about if field.shape == (2,) and not field.unit):
        folds = re.match(r"cos(\d*)", labels[0]) if labels else None
        return Turning("heading", int(folds[1] or 1) if folds else 1)
    return Turning("not")


def _robot(model: mujoco.MjModel) -> int:
    """Return the topmost body of the robot."""
    return int(model.body_rootid[model.site_bodyid[model.site(BASE).id]])


def _things(model: mujoco.MjModel) -> Iterable[Thing]:
    robot = _robot(model)
    for body in range(1, model.nbody):
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        placed = model.body_mocapid[body] >= 0
        if model.body_rootid[body] == robot or not (placed or count == 1):
            continue
        geoms = [k for k in range(model.ngeom) if model.geom_bodyid[k] == body]
        reach = max((model.geom_rbound[k] + np.linalg.norm(model.geom_pos[k]) for k in geoms), default=0.0)
        sites = tuple(model.site(k).name for k in range(model.nsite) if model.site_bodyid[k] == body)
        if not placed and int(model.jnt_type[first]) not in KINDS:
            raise InvalidValueError(
                f"{model.body(body).name} hangs on a ball joint: nothing is generated there. Take two hinges."
            )
        kind = "placed" if placed else KINDS[int(model.jnt_type[first])]
        yield Thing(model.body(body).name, body, -1 if placed else first, kind, 2.0 * float(reach), sites)
