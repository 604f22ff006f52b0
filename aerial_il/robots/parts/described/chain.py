"""The serial chain in a tree of bodies: which joints turn, and what moves with each of them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

import mujoco

from aerial_il.control.vehicle import MAX_JOINTS
from aerial_il.robots.parts.described.error import ModelFileError
from aerial_il.robots.parts.described.model import Model

FREE, HINGE = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_HINGE)
LOOPS = (int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD))


@dataclass(frozen=True, eq=False)
class Chain:
    """A serial chain of J joints.

    Attributes:
        base, tool: bodies at its ends. joints: (J,) numbers of its joints, base to tool. names: theirs.
        groups: J + 1 lists of bodies: those that stay with the base, then those that move with each joint.
    """

    base: int
    tool: int
    joints: tuple[int, ...]
    names: tuple[str, ...]
    groups: tuple[tuple[int, ...], ...]


def find_chain(
    model: Model, *, base: str | None, tool: str | None, locked: Mapping[str, float], drop: Collection[str]
) -> Chain:
    """Return the chain from ``base`` to ``tool``; see :func:`aerial_il.robots.parts.described.arm.read_arm`."""
    _check_names(model, locked)
    root = model.only_root("robots or parts", "base") if base is None else model.body(base, "base")
    dropped = {body for name in drop for body in model.below(model.body(name, "drop"))}
    kept = [body for body in model.below(root) if body not in dropped]
    end = _tool(model, tool, kept)
    path = _path(model, root, end)
    joints = [joint for body in path for joint in _turning(model, body, locked)]
    _check_chain(model, joints)
    names = tuple(model.compiled.joint(joint).name for joint in joints)
    group, moved = {root: 0}, {body: _turning_or_sliding(model, body, locked) for body in kept[1:]}
    if stray := {body: own for body, own in moved.items() if set(own) - set(joints)}:
        raise model.error(_stray(model, stray, end))
    for body, own in moved.items():
        group[body] = joints.index(own[0]) + 1 if own else group[model.parent(body)]
    groups = tuple(tuple(body for body in kept if group[body] == k) for k in range(len(joints) + 1))
    return Chain(root, end, tuple(joints), names, groups)


def _check_names(model: Model, locked: Mapping[str, float]) -> None:
    known = {model.compiled.joint(joint).name for joint in range(model.compiled.njnt)}
    for name in locked:
        if name not in known:
            raise model.error(f"locked names {name!r}, which is no joint. Joints: {_list(known)}.")


def _tool(model: Model, tool: str | None, kept: list[int]) -> int:
    if tool is not None:
        found = model.body(tool, "tool")
        if found not in kept:
            base = model.name(kept[0])
            raise model.error(f"the tool {tool!r} does not hang from {base!r}, or is dropped.")
        return found
    ends = [body for body in kept if not set(model.children(body)) & set(kept)]
    if len(ends) != 1:
        found = _list(model.name(body) for body in ends)
        raise ModelFileError(
            model.source, f"it has {len(ends)} ends: {found}. Name the one that carries the gripper with tool=...."
        )
    return ends[0]


def _path(model: Model, root: int, end: int) -> list[int]:
    """Bodies from the one after ``root`` to ``end``."""
    path = [end]
    while path[-1] != root:
        path.append(model.parent(path[-1]))
    return path[-2::-1]


def _turning_or_sliding(model: Model, body: int, locked: Mapping[str, float]) -> list[int]:
    """The joints of a body that are not locked; one that is free is not the arm's."""
    free = {joint for joint in model.joints_of(body) if int(model.compiled.jnt_type[joint]) == FREE}
    return [j for j in model.joints_of(body) if j not in free and model.compiled.joint(j).name not in locked]


def _turning(model: Model, body: int, locked: Mapping[str, float]) -> list[int]:
    """The joint of a body of the chain, unless it is locked."""
    found = [joint for joint in model.joints_of(body) if model.compiled.joint(joint).name not in locked]
    link = model.name(body)
    if len(found) > 1:
        names = _list(model.compiled.joint(joint).name for joint in found)
        problem = f"body {link!r} has {len(found)} joints: {names}. A link is moved by one"
        raise ModelFileError(model.source, f"{problem}; give each its own body, or lock the others: locked={{...}}.")
    for joint in found:
        name, kind = model.compiled.joint(joint).name, int(model.compiled.jnt_type[joint])
        if not name:
            raise model.error(f"the joint of body {link!r} has no name; give it one.")
        if kind != HINGE:
            word = mujoco.mjtJoint(kind).name.removeprefix("mjJNT_").lower()
            problem = f"joint {name!r} between base and tool is of type {word}, and only joints that turn are flown"
            raise model.error(f"{problem}. Lock it where it stands: locked={{{name!r}: 0.0}}.")
        if coupled := model.joints[name].coupled:
            problem = f"joint {name!r} between base and tool is not free: {coupled}"
            raise model.error(f"{problem}. Lock it (locked={{{name!r}: 0.0}}) or take it out.")
    return found


def _check_chain(model: Model, joints: list[int]) -> None:
    if not 1 <= len(joints) <= MAX_JOINTS:
        problem = f"between base and tool {len(joints)} joints turn, and the controller flies 1 to {MAX_JOINTS}"
        raise model.error(f"{problem}. Choose base and tool, or lock joints: locked={{...}}.")
    if any(int(kind) in LOOPS for kind in model.compiled.eq_type):
        raise model.error("a <connect> or <weld> closes a loop, and an arm here is a chain without.")


def _stray(model: Model, stray: Mapping[int, Sequence[int]], end: int) -> str:
    names = [model.compiled.joint(joint).name for joints in stray.values() for joint in joints]
    links = [model.name(body) for body in stray]
    locked = ", ".join(f"{name!r}: 0.0" for name in names)
    return (
        f"joints that move links beside the chain that ends at {model.name(end)!r}: {', '.join(names)}. Weld them "
        f"(locked={{{locked}}}), leave their links away (drop={links}), or end the chain there (tool=...)."
    )


def _list(names: Iterable[str]) -> str:
    return ", ".join(sorted(names)) or "none"
