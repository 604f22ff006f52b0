"""A vehicle out of an MJCF: a body with mass and inertia, and thrusts at sites of it."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from aerial_il.control.allocation import mixer_matrix, wrench_matrix
from aerial_il.core.errors import InvalidValueError
from aerial_il.robots.parts.arm import Vector
from aerial_il.robots.parts.described.error import ModelFileError
from aerial_il.robots.parts.described.inertia import RigidBody, flaw, joined
from aerial_il.robots.parts.described.model import Model, read_model
from aerial_il.robots.parts.described.placement import Placement
from aerial_il.robots.parts.described.shape import Shape
from aerial_il.robots.parts.rotorcraft import Rotorcraft

SKEW = 0.02  # of the largest moment: products of inertia that are noted
SITE = int(mujoco.mjtTrn.mjTRN_SITE)


@dataclass(frozen=True, eq=False, kw_only=True)
class DescribedRotorcraft(Rotorcraft):
    """A multirotor with the shapes of a file; discs and booms of its rotors are ours."""

    shapes: tuple[Shape, ...] = ()

    def _add_hub(self, spec: mujoco.MjSpec, body: mujoco.MjsBody) -> None:
        if not any(shape.collides for shape in self.shapes):
            super()._add_hub(spec, body)
        for k, shape in enumerate(self.shapes):
            shape.add_to(spec, body, f"hub_{k}")


@dataclass(frozen=True, eq=False)
class ReadRotorcraft:
    """What a file says of a vehicle.

    Attributes:
        base: for ``Robot(base=...)``; its origin is the vehicle's centre of mass.
        origin: (3,) where the file's body has its own origin in that frame, m.
        notes: what was assumed or left out, a sentence each.
    """

    base: Rotorcraft
    origin: Vector
    notes: tuple[str, ...]


def read_rotorcraft(
    path: str | Path,
    *,
    rotor_radius: float,
    tau_up: float,
    tau_down: float,
    drag: Vector,
    body: str | None = None,
    max_thrust: float | None = None,
    hub_size: Vector | None = None,
    drop: Collection[str] = (),
    meshes: str | Path | None = None,
) -> ReadRotorcraft:
    """Read a vehicle from an MJCF, whose rotors are actuators at sites: ``gear="0 0 1 0 0 RATIO"`` along the site's z.

    Args:
        path: the file. meshes: folder that holds its meshes, the file's own if None.
        rotor_radius: m. tau_up, tau_down: time constants of rising and falling thrust, s. drag: of the body, N s/m:
            an MJCF does not say them.
        body: the vehicle's, the file's first if None. drop: bodies left away, such as a camera or another arm.
        max_thrust: N per rotor, where the actuators have no ``ctrlrange``.
        hub_size: half sizes of the body's middle, m; those of its shapes if None.

    Raises:
        ModelFileError: the file is no such vehicle; names body or actuator, value and what to change.
    """
    model = read_model(path, meshes)
    kept = _bodies(model, body, drop)
    place = Placement(model, model.data({}), kept[0], np.zeros(3), np.eye(3))
    whole = _whole(model, place, kept)
    pos, axis, ratio, low, high = _rotors(model, place, kept, max_thrust)
    shapes = place.shapes(kept, whole.com)
    base = DescribedRotorcraft(
        mass=whole.mass,
        inertia=_vector(np.diag(whole.tensor)),
        rotor_pos=pos - whole.com,
        rotor_axis=axis,
        rotor_drag_ratio=ratio,
        max_thrust=high,
        min_thrust=low,
        tau_up=tau_up,
        tau_down=tau_down,
        rotor_radius=rotor_radius,
        drag=drag,
        hub_size=hub_size or _extent(shapes) or Rotorcraft.hub_size,
        shapes=shapes,
    )
    _check_rotors(base, path)
    return ReadRotorcraft(base, _vector(-whole.com), tuple(_notes(model, whole, kept)))


def _bodies(model: Model, body: str | None, drop: Collection[str]) -> list[int]:
    """The vehicle's bodies, its root first, without those dropped and what hangs on them."""
    root = model.body(body, "body") if body else model.only_root("bodies in the world", "body")
    dropped = {below for name in drop for below in model.below(model.body(name, "drop"))}
    if root in dropped:
        raise model.error(f"drop names body {model.name(root)!r} or one above it; that is the vehicle itself.")
    return [below for below in model.below(root) if below not in dropped]


def _check_rotors(base: Rotorcraft, path: str | Path) -> None:
    """Raise for a vehicle that its rotors cannot hold in the air."""
    try:
        mixer_matrix(wrench_matrix(base.rotor_pos, base.rotor_axis, base.rotor_drag_ratio))
    except InvalidValueError as error:
        raise ModelFileError(path, f"{error}") from error


def _whole(model: Model, place: Placement, kept: list[int]) -> RigidBody:
    """The vehicle as one rigid body, in the frame of its root."""
    parts = place.massive(kept)
    if not parts:
        raise model.error(f"body {model.name(kept[0])!r} has no mass. Give it an <inertial>.")
    whole = joined(parts)
    if problem := flaw(whole.mass, whole.tensor):
        raise model.error(f"no solid is like body {model.name(kept[0])!r}: {problem}.")
    return whole


def _rotors(
    model: Model, place: Placement, kept: list[int], max_thrust: float | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Positions (R, 3), axes (R, 3), torque per thrust (R,), smallest and largest thrusts (R,)."""
    compiled, rows = model.compiled, []
    for i in range(compiled.nu):
        site = int(compiled.actuator_trnid[i, 0])
        if int(compiled.actuator_trntype[i]) != SITE or int(compiled.site_bodyid[site]) not in kept:
            continue
        name, gear = compiled.actuator(i).name, compiled.actuator_gear[i]
        if gear[2] == 0.0 or np.any(gear[[0, 1, 3, 4]]):
            shown = " ".join(f"{value:g}" for value in gear)
            problem = f'actuator {name!r} has the gear "{shown}"; a rotor pushes and twists along the z of its site'
            raise model.error(f'{problem}: "0 0 1 0 0 RATIO".')
        axis = place.axes(place.data.site_xmat[site])[:, 2] * np.sign(gear[2])
        low, high = _thrusts(model, i, max_thrust)
        rows.append((place.point(place.data.site_xpos[site]), axis, gear[5] / gear[2], low, high))
    if not rows:
        problem = 'it has no rotors: actuators at sites of the vehicle, <general site=... gear="0 0 1 0 0 RATIO">'
        raise model.error(f"{problem}. Their figures may come from a PX4 airframe file, too.")
    pos, axis, ratio, low, high = (np.array(column) for column in zip(*rows, strict=True))
    return pos, axis, ratio, low, high


def _thrusts(model: Model, i: int, max_thrust: float | None) -> tuple[float, float]:
    """Smallest and largest thrust of one rotor, N."""
    compiled = model.compiled
    if max_thrust is not None:
        return 0.0, max_thrust
    if not compiled.actuator_ctrllimited[i]:
        name = compiled.actuator(i).name
        raise model.error(f"actuator {name!r} has no ctrlrange. Give one, or set max_thrust=... (N).")
    scale = abs(compiled.actuator_gear[i, 2]) * compiled.actuator_gainprm[i, 0]
    low, high = (float(value) for value in scale * compiled.actuator_ctrlrange[i])
    if not 0.0 < high < np.inf or low >= high:
        name = compiled.actuator(i).name
        raise model.error(f"actuator {name!r} thrusts from {low:g} to {high:g} N: up must be above 0.")
    return low, high


def _extent(shapes: tuple[Shape, ...]) -> Vector | None:
    """Half sizes of the smallest box about the centre of mass that holds the shapes, m."""
    if not shapes:
        return None
    return _vector(np.max([np.abs(shape.pos) + shape.half_extent for shape in shapes], axis=0))


def _notes(model: Model, whole: RigidBody, kept: list[int]) -> list[str]:
    found = []
    products = float(np.abs(whole.tensor - np.diag(np.diag(whole.tensor))).max())
    if products > SKEW * np.diag(whole.tensor).max():
        found.append(f"products of inertia up to {products:.3g} kg m² are left out.")
    for body in kept[1:]:
        if model.joints_of(body):
            found.append(f"body {model.name(body)!r} is welded where it stands.")
    return found + [f"{clause}." for clause in model.mesh_notes()]


def _vector(values: np.ndarray) -> Vector:
    x, y, z = (float(value) for value in values)
    return (x, y, z)
