"""Scenes redrawn: recorded moments in which objects are moved aside, so that no two frames show the same scene.

A few hundred flights show as many scenes, however many frames they have, and a network learns scenes by heart. So
objects are moved about and turned where demonstrations differ in them, each frame anew, and the simulator says what is
then to be seen. They are turned to between how they stood at the start of two flights: from behind, a button that
always faces the robot teaches nothing. What always stands together, such as a button and its post, moves together.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import mujoco
import numpy as np

HELD_M = 0.07  # from the tool: what is nearer may be in the gripper, and stays there
REACHES_M = (0.02, 0.08, 0.25, 0.6)  # deviations of the displacement, one of them for each frame
VARIES_M, VARIES_RAD, APART_M = 1e-3, 1e-2, 5e-3
STATE = mujoco.mjtState.mjSTATE_INTEGRATION


@dataclass(frozen=True)
class Thing:
    """A free object, or a fixture (mocap); ``index``: of its first number in qpos, or of the fixture."""

    mocap: bool
    index: int


@dataclass(eq=False)
class Movable:
    """Something that stands elsewhere in each flight, with what stands beside it in all of them.

    Attributes:
        thing: what it is. axes: (3,) bool, along which it differs. turns: whether it differs in how it is turned.
        quats: (E, 4) how it was turned at the start of each flight.
        beside: what goes along, and where that is, (2,) m, in its own heading.
    """

    thing: Thing
    axes: np.ndarray
    turns: bool
    quats: np.ndarray
    beside: list[tuple[Movable, np.ndarray]] = field(default_factory=list)


class Redrawing:
    """Moves objects about in recorded states of one scene.

    Args:
        model: of the scene. starts: (E, S) first states of several flights, whose differences say what may move.
    """

    def __init__(self, model: mujoco.MjModel, starts: np.ndarray) -> None:
        self._model, self._data = model, mujoco.MjData(model)
        poses = [self._poses(state) for state in starts]
        every = {thing: np.array([each[thing] for each in poses]) for thing in poses[0]}
        moving = [_movable(thing, found) for thing, found in every.items()]
        moving = [each for each in moving if each.axes.any() or each.turns]
        self.movable = _gathered(sorted(moving, key=lambda each: not each.turns), every)

    def redrawn(self, states: np.ndarray, tools: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Return states (n, S) in which the objects are elsewhere, but for what is at the tools (n, 3) m."""
        return np.stack([self._moved(state, tool, rng) for state, tool in zip(states, tools, strict=True)])

    def _moved(self, state: np.ndarray, tool: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        mujoco.mj_setState(self._model, self._data, state, STATE)
        reach = REACHES_M[rng.integers(len(REACHES_M))]
        for each in self.movable:
            together, alone = self._standing(each)
            self._displace(together, reach, tool, rng)
            for other in alone:
                self._displace([other], reach, tool, rng)
        moved = np.empty_like(state)
        mujoco.mj_getState(self._model, self._data, moved, STATE)
        return moved

    def _standing(self, leader: Movable) -> tuple[list[Movable], list[Movable]]:
        """Return something with what still stands beside it, and what has been taken away."""
        pos, quat = self._pose(leader.thing)
        away = [np.linalg.norm(_offset(pos, quat, self._pose(other.thing)[0]) - at) for other, at in leader.beside]
        others = [other for other, _ in leader.beside]
        near = [other for other, distance in zip(others, away, strict=True) if distance < APART_M]
        return [leader, *near], [other for other in others if other not in near]

    def _displace(self, things: list[Movable], reach: float, tool: np.ndarray, rng: np.random.Generator) -> None:
        """Shift and turn some things as one, unless one of them may be in the gripper."""
        leader, poses = things[0], [self._pose(each.thing) for each in things]
        step, (full, heading) = reach * rng.standard_normal(3) * leader.axes, self._turns(leader, rng)
        free = (pos for each, (pos, _) in zip(things, poses, strict=True) if not each.thing.mocap)
        if any(np.linalg.norm(pos - tool) < HELD_M for pos in free):
            return
        centre = poses[0][0].copy()
        for number, (pos, quat) in enumerate(poses):
            arm = np.zeros(3)
            mujoco.mju_rotVecQuat(arm, pos - centre, heading)
            pos[:] = centre + arm + step
            mujoco.mju_mulQuat(quat, heading if number else full, quat.copy())

    def _turns(self, movable: Movable, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Return the turn (4,) of something, and of what stands beside it, about the vertical alone.

        A fixture is turned in full, what is free about the vertical: it lies as it lies.
        """
        turn = np.array([1.0, 0.0, 0.0, 0.0])
        if movable.turns:
            one, other = movable.quats[rng.integers(len(movable.quats), size=2)]
            between = one + rng.random() * (np.copysign(1.0, one @ other) * other - one)
            back = self._pose(movable.thing)[1] * (1.0, -1.0, -1.0, -1.0)
            mujoco.mju_mulQuat(turn, between / np.linalg.norm(between), back)
        heading = turn * (1.0, 0.0, 0.0, 1.0)
        heading /= np.linalg.norm(heading)
        return (turn if movable.thing.mocap else heading), heading

    def _poses(self, state: np.ndarray) -> dict[Thing, np.ndarray]:
        """Return the poses (7,) of all free objects but the robot, and of all fixtures."""
        mujoco.mj_setState(self._model, self._data, state, STATE)
        free = self._model.jnt_qposadr[self._model.jnt_type == mujoco.mjtJoint.mjJNT_FREE]
        things = [Thing(mocap=False, index=int(k)) for k in free if k > 0]
        things += [Thing(mocap=True, index=i) for i in range(self._model.nmocap)]
        return {thing: np.concatenate(self._pose(thing)) for thing in things}

    def _pose(self, thing: Thing) -> tuple[np.ndarray, np.ndarray]:
        """Return views of position (3,) and quaternion (4,)."""
        if thing.mocap:
            return self._data.mocap_pos[thing.index], self._data.mocap_quat[thing.index]
        return self._data.qpos[thing.index : thing.index + 3], self._data.qpos[thing.index + 3 : thing.index + 7]


def _movable(thing: Thing, poses: np.ndarray) -> Movable:
    turned = 2.0 * np.arccos(np.clip(np.abs(poses[:, 3:] @ poses[0, 3:]), 0.0, 1.0))
    return Movable(thing, poses[:, :3].std(0) > VARIES_M, bool(turned.max() > VARIES_RAD), poses[:, 3:])


def _gathered(moving: list[Movable], poses: dict[Thing, np.ndarray]) -> list[Movable]:
    """Return what moves by itself, each with what stood beside it in all flights (E, 7)."""
    leaders = list[Movable]()
    for each in moving:
        for leader in leaders:
            pairs = zip(poses[leader.thing], poses[each.thing], strict=True)
            offsets = np.array([_offset(one[:3], one[3:], other[:3]) for one, other in pairs])
            if len(offsets) > 1 and (offsets.std(0) < VARIES_M).all():
                leader.beside.append((each, offsets.mean(0)))
                break
        else:
            leaders.append(each)
    return leaders


def _offset(pos: np.ndarray, quat: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return where something else is, (2,) m horizontally, in the heading of a pose."""
    mat = np.zeros(9)
    mujoco.mju_quat2Mat(mat, quat)
    ahead = mat[[0, 3]] if np.hypot(mat[0], mat[3]) > np.hypot(mat[1], mat[4]) else mat[[4, 1]] * (1.0, -1.0)
    x, y = ahead / np.linalg.norm(ahead)
    return np.array([[x, y], [-y, x]]) @ (other - pos)[:2]
