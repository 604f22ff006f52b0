"""An arm out of a URDF or MJCF: the chain from its base to its tool, as the controller and the simulator take it."""

from __future__ import annotations

import logging
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from aerial_il.core.errors import InvalidValueError
from aerial_il.robots.parts.arm import Vector
from aerial_il.robots.parts.described.ahead import Axis, require_ahead
from aerial_il.robots.parts.described.chain import Chain, find_chain
from aerial_il.robots.parts.described.error import ModelFileError
from aerial_il.robots.parts.described.inertia import RigidBody, about, flaw, joined
from aerial_il.robots.parts.described.link import DescribedArm, DescribedLink
from aerial_il.robots.parts.described.model import Model, read_model
from aerial_il.robots.parts.described.placement import Placement, from_rpy
from aerial_il.robots.parts.described.shape import CONVEX, Shape

STIFFNESS_PER_TORQUE, DAMPING_S, ARMATURE_PER_TORQUE = 8.0, 0.05, 1.5e-3  # 1/rad, s, s²: as our own arms have them
ENDLESS = (-np.pi, np.pi)
SLENDER, THINNEST_M = 0.1, 0.006  # radius of the capsule of a link without shapes: share of its length, and least
WIDEST_GYRATION = 3.0  # radius of gyration over the arm's length, beyond which the units cannot be right

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Servo:
    """What drives a joint; None where the file says it, or else where it follows from the torque.

    Attributes:
        torque: limit, N m. speed: limit, rad/s.
        stiffness: N m/rad, else 8 times the torque. damping: N m s/rad, else 0.05 s times the stiffness.
        armature: reflected inertia of the rotor, kg m², else 0.0015 s² times the torque.
    """

    torque: float | None = None
    speed: float | None = None
    stiffness: float | None = None
    damping: float | None = None
    armature: float | None = None


@dataclass(frozen=True, eq=False)
class ReadArm:
    """What a file says of an arm.

    Attributes:
        arm: for ``Robot(arm=...)``.
        foot_kg, foot_inertia: mass, and moments (3,) about the origin of the vehicle's base, kg m², of what stays with
            the base: add them to the base's own.
        joints: names of the file's joints, in the order of the arm's.
        zero: (J,) values of the file's joints at which the arm's are zero, rad.
        notes: what was assumed or left out, a sentence each.
    """

    arm: DescribedArm
    foot_kg: float
    foot_inertia: Vector
    joints: tuple[str, ...]
    zero: tuple[float, ...]
    notes: tuple[str, ...]

    def posture(self, *values: float) -> tuple[float, ...]:
        """Return joint positions of the robot for values (J,) of the file's joints, rad."""
        if len(values) != len(self.joints):
            raise InvalidValueError(
                f"a posture has {len(self.joints)} values ({', '.join(self.joints)}), got {values}."
            )
        return tuple(value - zero for value, zero in zip(values, self.zero, strict=True))


def read_arm(
    path: str | Path,
    *,
    base: str | None = None,
    tool: str | None = None,
    approach: Axis | None = None,
    zero: tuple[float, ...] | None = None,
    mount: Vector = (0.0, 0.0, 0.0),
    mount_rpy: Vector = (0.0, 0.0, 0.0),
    servo: Servo = Servo(),
    servos: Mapping[str, Servo] | None = None,
    locked: Mapping[str, float] | None = None,
    drop: Collection[str] = (),
    meshes: str | Path | None = None,
) -> ReadArm:
    """Read an arm from a URDF or MJCF.

    Our arms count their joints from the posture in which every link's frame is that of the vehicle's base, so that the
    tool points ahead. A file counts them from where it likes: ``zero`` says where ours begin.

    Args:
        path: the file. meshes: folder that holds its meshes, the file's own if None; nothing outside is opened.
        base: link that is bolted to the vehicle, the file's first if None.
        tool: link, or site of an MJCF, at whose origin the gripper sits; the only end of the tree if None.
        approach: axis of that link that points out of the gripper, x if None.
        zero: (J,) values of the file's joints, rad, in which the tool points ahead; zeros if None.
        mount: where the base link's origin sits on the vehicle's base, m.
        mount_rpy: its roll, pitch and yaw there, rad: (π, 0, 0) hangs an upright arm below the vehicle.
        servo: of all joints, servos: of those named here; both go before what the file says.
        locked: joints that are welded at an angle (rad) or travel (m). drop: links left away, with what they carry.

    Raises:
        ModelFileError: the file is no such arm; names link or joint, value, limit and what to change.
    """
    model = read_model(path, meshes, frame=tool)
    chain = find_chain(model, base=base, tool=tool, locked=locked or {}, drop=drop)
    zeros = _checked_zero(model, chain, zero)
    data = model.data(dict(zip(chain.joints, zeros, strict=True)) | _locked(model, locked))
    place = Placement(model, data, chain.base, np.array(mount), from_rpy(mount_rpy))
    require_ahead(place, chain, approach or "x", zeros)
    _check_servos(model, chain, servos or {})
    reader = _Reader(model, chain, place, zeros, {**dict.fromkeys(chain.names, servo), **(servos or {})})
    if guessed := [name for name, said in (("tool", tool), ("approach", approach)) if said is None]:
        where = f"its gripper sits at {model.name(chain.tool)!r} and points along the {approach or 'x'} axis of that"
        reader.notes.append(
            f"{where}: taken for granted, {' and '.join(f'{name}=...' for name in guessed)} would say it."
        )
        log.warning("%s: %s", model.source, reader.notes[-1])
    return reader.read()


@dataclass(eq=False)
class _Reader:
    """Turns a chain, posed where our joints are zero, into links; gathers notes."""

    model: Model
    chain: Chain
    place: Placement
    zero: tuple[float, ...]
    servos: Mapping[str, Servo]
    notes: list[str] = field(default_factory=list)

    def read(self) -> ReadArm:
        data = self.place.data
        seats = [self.place.point(data.xanchor[joint]) for joint in self.chain.joints]
        seats.append(self.place.point(data.xpos[self.chain.tool]))
        length = sum(float(np.linalg.norm(b - a)) for a, b in pairwise(seats))
        links = tuple(self._link(j, seats[j], seats[j + 1], length) for j in range(len(self.chain.joints)))
        foot = self._foot()
        for clause in self.model.mesh_notes():
            self._note(clause)
        arm = DescribedArm(links, mount=_vector(seats[0]), foot=self._shapes(0, np.zeros(3)))
        spin = foot.tensor + foot.mass * about(foot.com) if foot else np.zeros((3, 3))
        mass = foot.mass if foot else 0.0
        return ReadArm(arm, mass, _vector(np.diag(spin)), self.chain.names, self.zero, tuple(self.notes))

    def _link(self, j: int, seat: np.ndarray, end: np.ndarray, reach: float) -> DescribedLink:
        name = self.chain.names[j]
        body = self._rigid(j + 1, reach)
        shapes = self._shapes(j + 1, seat)
        if not any(shape.collides for shape in shapes):
            self._note(
                f"link {self._title(j + 1)!r} collides with nothing in the file: it does as a capsule to the next joint"
            )
            shapes = ()
        servo = self._servo(name)
        t = body.tensor
        return DescribedLink(
            axis=_vector(self.place.direction(self.place.data.xaxis[self.chain.joints[j]])),
            tip=_vector(end - seat),
            radius=max(THINNEST_M, SLENDER * float(np.linalg.norm(end - seat))),
            mass=body.mass,
            limits=self._limits(name, self.zero[j]),
            speed=servo["speed"],
            torque=servo["torque"],
            stiffness=servo["stiffness"],
            damping=servo["damping"],
            armature=servo["armature"],
            centre=_vector(body.com - seat),
            tensor=tuple(_clean(np.array([t[0, 0], t[1, 1], t[2, 2], t[0, 1], t[0, 2], t[1, 2]]))),
            shapes=shapes,
        )

    def _title(self, group: int) -> str:
        return self.model.name(self.chain.groups[group][0])

    def _note(self, sentence: str) -> None:
        self.notes.append(f"{sentence}.")

    def _rigid(self, group: int, reach: float) -> RigidBody:
        """All that moves with one joint, as one body."""
        parts = self.place.massive(self.chain.groups[group])
        title = self._title(group)
        if not parts:
            raise ModelFileError(
                self.model.source, f"link {title!r} has no mass, and a joint moves it. Give its inertia."
            )
        whole = joined(parts)
        if problem := flaw(whole.mass, whole.tensor):
            raise self.model.error(f"no solid is like link {title!r}: {problem}.")
        gyration = float(np.sqrt(np.linalg.eigvalsh(whole.tensor)[-1] / whole.mass))
        if gyration > WIDEST_GYRATION * reach:
            problem = (
                f"the inertia of link {title!r} is that of its {whole.mass:.4g} kg at {gyration:.3g} m from its middle"
            )
            raise self.model.error(f"{problem}, in an arm of {reach:.3g} m. Is it in kg m²?")
        return whole

    def _foot(self) -> RigidBody | None:
        parts = self.place.massive(self.chain.groups[0])
        return joined(parts) if parts else None

    def _limits(self, name: str, zero: float) -> tuple[float, float]:
        limits = self.model.joints[name].limits
        if limits is None:
            self._note(f"joint {name!r} turns without end in the file, and from -π to π here")
            limits = ENDLESS
        if limits[0] >= limits[1]:
            raise self.model.error(f"joint {name!r} turns from {limits[0]:g} to {limits[1]:g} rad.")
        return limits[0] - zero, limits[1] - zero

    def _servo(self, name: str) -> dict[str, float]:
        """Figures of a servo: the robot's own file first, then the model file, then what follows from the torque."""
        given, figures = self.servos[name], self.model.joints[name]
        torque = self._needed(name, "torque", "the URDF's effort, or a forcerange, in N m")
        speed = self._needed(name, "speed", "the URDF's velocity, in rad/s")
        stiffness = given.stiffness or figures.stiffness or STIFFNESS_PER_TORQUE * torque
        damping = given.damping or figures.damping or DAMPING_S * stiffness
        armature = given.armature if given.armature is not None else figures.armature
        if not (given.stiffness or figures.stiffness):
            self._note(f"the servo of {name!r} has an assumed stiffness of {stiffness:.4g} N m/rad")
        if armature is None:
            armature = ARMATURE_PER_TORQUE * torque
            self._note(f"the rotor of {name!r} has an assumed armature of {armature:.4g} kg m²")
        return {"torque": torque, "speed": speed, "stiffness": stiffness, "damping": damping, "armature": armature}

    def _needed(self, name: str, word: str, where: str) -> float:
        """A figure that nothing else follows from; where it is missing, all joints that lack it are named."""
        if (value := self._said(name, word)) is not None:
            return value
        lacking = [each for each in self.chain.names if self._said(each, word) is None]
        which = f"servo=Servo({word}=...)" if len(lacking) > 1 else f"servos={{{name!r}: Servo({word}=...)}}"
        have = "joints {} have" if len(lacking) > 1 else "joint {} has"
        problem = f"{have.format(', '.join(map(repr, lacking)))} no {word} above zero ({where})"
        raise self.model.error(f"{problem}. Say it: {which}.")

    def _said(self, name: str, word: str) -> float | None:
        given = getattr(self.servos[name], word)
        value = given if given is not None else getattr(self.model.joints[name], word)
        return None if value is None or not np.isfinite(value) or value <= 0.0 else float(value)

    def _shapes(self, group: int, seat: np.ndarray) -> tuple[Shape, ...]:
        """Shapes of what moves together, in the frame of its link; what collides is hidden where there are looks."""
        shapes = self.place.shapes(self.chain.groups[group], seat)
        for shape in shapes:
            if shape.collides and shape.filling < CONVEX:
                link, share = self._title(group), f"{shape.filling:.0%}"
                self._note(f"a mesh of link {link!r} collides as its convex hull, of which it fills {share}")
        dressed = any(not shape.collides for shape in shapes)
        return tuple(replace(shape, seen=not (shape.collides and dressed)) for shape in shapes)


def _checked_zero(model: Model, chain: Chain, zero: tuple[float, ...] | None) -> tuple[float, ...]:
    values = tuple(float(value) for value in zero) if zero is not None else (0.0,) * len(chain.joints)
    if len(values) != len(chain.joints) or not np.isfinite(values).all():
        raise model.error(f"zero has one angle for each of {', '.join(chain.names)}, got {values}.")
    return values


def _check_servos(model: Model, chain: Chain, servos: Mapping[str, Servo]) -> None:
    for name in servos:
        if name not in chain.names:
            raise model.error(f"servos names {name!r}; the arm's joints are {', '.join(chain.names)}.")


def _locked(model: Model, locked: Mapping[str, float] | None) -> dict[int, float]:
    return {model.compiled.joint(name).id: float(value) for name, value in (locked or {}).items()}


def _clean(values: np.ndarray) -> list[float]:
    """Round to zero what is nothing beside the largest value: products that a rotation by π/2 leaves behind."""
    return [float(value) for value in np.where(np.abs(values) < 1e-9 * np.abs(values).max(), 0.0, values)]


def _vector(values: np.ndarray) -> Vector:
    x, y, z = (float(value) for value in np.round(values, 12) + 0.0)
    return (x, y, z)
