"""A multirotor's shape: plates and canopy, booms, motors, propellers, the housings of its cameras."""

from itertools import count

import mujoco
import numpy as np

from aerial_il.presentation.studio.solids import block, disc, propeller, tube, turned
from aerial_il.presentation.studio.workshop import Workshop, hide, upright_along

CARBON, CANOPY, ACCENT = (0.20, 0.21, 0.23, 1.0), (0.93, 0.94, 0.95, 1.0), (0.93, 0.42, 0.08, 1.0)
STEEL, LENS = (0.62, 0.64, 0.67, 1.0), (0.02, 0.025, 0.05, 1.0)
BLADES = {"front": (0.95, 0.45, 0.10, 1.0), "rear": (0.26, 0.28, 0.31, 1.0)}
LENS_M, DEFAULT_SPAN_M = 0.009, 0.6  # half the width of a camera's lens on a vehicle of that span
LONGEST_STRUT_M = 0.4
LARGE_M = 0.30  # radius from which a rotor has three blades


def dress_vehicle(shop: Workshop) -> None:
    """Give the body ``base`` of a scene the look of the vehicle that it is; one without rotors keeps its own."""
    base = shop.spec.body("base")
    if base is None or shop.spec.geom("disc_0") is None:
        return
    for i in count():
        site, drawn = shop.spec.site(f"rotor_{i}"), shop.spec.geom(f"disc_{i}")
        if site is None or drawn is None:
            break
        _dress_rotor(shop, base, site, drawn, i)
    _dress_hub(shop, base)


def _dress_hub(shop: Workshop, base: mujoco.MjsBody) -> None:
    hub, shell = shop.spec.geom("hub"), shop.spec.geom("shell")
    if hub is None or hub.type != mujoco.mjtGeom.mjGEOM_BOX:
        return
    x, y, z = (float(size) for size in hub.size)
    for geom in (hub, shell):
        if geom is not None:
            hide(geom)
    dark = {"rgba": CARBON, "material": "satin"}
    shop.add(base, block, (0.92 * x, 0.92 * y, 0.62 * z), 0.25 * z, pos=(0, 0, -0.3 * z), **dark)
    for height in (-0.92, 0.28):
        shop.add(base, block, (1.12 * x, 1.12 * y, 0.07 * z), 0.06 * z, pos=(0, 0, height * z), **dark)
    shop.add(base, block, (0.98 * x, 0.86 * y, 0.62 * z), 0.58 * z, pos=(0, 0, 0.9 * z), rgba=CANOPY, material="gloss")
    shop.add(base, block, (0.10 * x, 0.868 * y, 0.628 * z), 0.58 * z, pos=(0.25 * x, 0, 0.9 * z), rgba=ACCENT,
             material="gloss")  # fmt: skip
    shop.add(base, turned, (0.0, 0.0), (0.04 * x, 0.0), (0.03 * x, 1.3 * z), (0.0, 1.3 * z),
             pos=(-0.6 * x, 0, z), **dark)  # fmt: skip
    shop.add(base, disc, 0.2 * x, 0.12 * z, 0.05 * z, pos=(-0.6 * x, 0, 2.35 * z), **dark)


def _dress_rotor(shop: Workshop, base: mujoco.MjsBody, site: mujoco.MjsSite, drawn: mujoco.MjsGeom, i: int) -> None:
    pos, radius = np.array(site.pos), float(drawn.size[0])
    hide(drawn)
    quat = upright_along(_axis(site))
    motor = float(np.clip(0.13 * radius, 0.009, 0.045))
    tall = 0.75 * motor
    side = "front" if pos[0] > 0 else "rear"
    bell = [(0.0, -tall), (0.82 * motor, -tall), (0.9 * motor, -0.75 * tall), (0.9 * motor, -0.55 * tall),
            (motor, -0.5 * tall), (motor, 0.45 * tall), (0.75 * motor, 0.75 * tall), (0.0, 0.8 * tall)]  # fmt: skip
    shop.add(base, turned, *bell, pos=tuple(pos), quat=tuple(quat), rgba=STEEL, material="metal")
    shop.add(base, disc, 1.12 * motor, 0.16 * tall, 0.1 * tall, pos=tuple(pos - 0.95 * tall * _axis(site)),
             quat=tuple(quat), rgba=CARBON, material="satin")  # fmt: skip
    height = max(0.014, 1.0 * tall)
    seat = tuple(pos + height * _axis(site))
    spinner = [(0.0, -0.3 * tall), (0.42 * motor, -0.3 * tall), (0.42 * motor, 0.15 * tall), (0.3 * motor, 0.5 * tall),
               (0.0, 0.65 * tall)]  # fmt: skip
    shop.add(base, turned, *spinner, pos=seat, quat=tuple(quat), rgba=CARBON, material="gloss")
    drive = shop.spec.actuator(f"rotor_{i}")  # until engine 3
    clockwise = float(drive.gear[5] if drive else sum(site.userdata)) > 0.0  # its drag turns the base the other way
    blades = 3 if radius >= LARGE_M else 2
    shop.add(base, propeller, radius, blades, clockwise, pos=seat, quat=tuple(quat), rgba=BLADES[side],
             material="satin", name=f"propeller_{i}")  # fmt: skip
    _dress_boom(shop, base, pos, tall, i, side)


def _dress_boom(shop: Workshop, base: mujoco.MjsBody, pos: np.ndarray, below: float, i: int, side: str) -> None:
    """Replace the boom by a tapering tube that ends under the motor, with a sleeve of the rotor's colour."""
    boom = shop.spec.geom(f"boom_{i}")
    if boom is None:
        return
    hide(boom)
    thick = 0.030 * float(np.linalg.norm(pos))
    end = pos - [0.0, 0.0, below]
    start = 0.12 * np.array([end[0], end[1], 0.0])
    along, length = end - start, float(np.linalg.norm(end - start))
    quat = tuple(upright_along(along))
    shop.add(base, tube, length, (1.25 * thick, thick, 0.8 * thick), pos=tuple(start), quat=quat, rgba=CARBON,
             material="satin")  # fmt: skip
    sleeve = start + 0.68 * along
    shop.add(base, tube, 0.12 * length, (1.12 * thick, 1.15 * thick, 1.08 * thick), pos=tuple(sleeve), quat=quat,
             rgba=ACCENT if side == "front" else CANOPY, material="gloss")  # fmt: skip


def _axis(site: mujoco.MjsSite) -> np.ndarray:
    axis = np.empty(3)
    mujoco.mju_rotVecQuat(axis, np.array([0.0, 0.0, 1.0]), np.array(site.quat, float))
    return axis


def dress_cameras(shop: Workshop) -> None:
    """Put a housing with a lens where the robot's own cameras are, on a strut from the hub or from the link."""
    hub = shop.spec.geom("hub")
    for camera in shop.spec.cameras:
        if camera.parent.name == "world":
            continue
        pos = np.array(camera.pos, float)
        foot = np.array([pos[0], 0.0, 0.0])
        if camera.name == "base":
            foot = pos if hub is None or hub.type != mujoco.mjtGeom.mjGEOM_BOX else _nearest_in(hub, pos)
        _dress_camera(shop, camera, foot, LENS_M * float(np.clip(span_m(shop) / DEFAULT_SPAN_M, 0.6, 1.5)))


def _nearest_in(hub: mujoco.MjsGeom, pos: np.ndarray) -> np.ndarray:
    half = 0.8 * np.array(hub.size, float)
    return np.clip(pos, -half, half)


def _dress_camera(shop: Workshop, camera: mujoco.MjsCamera, foot: np.ndarray, size: float) -> None:
    body, quat, ahead = camera.parent, tuple(float(q) for q in camera.quat), np.empty(3)
    mujoco.mju_rotVecQuat(ahead, np.array([0.0, 0.0, -1.0]), np.array(quat))
    back = np.array(camera.pos, float) - 1.2 * size * ahead
    look = {"rgba": CARBON, "material": "satin"}
    shop.add(body, block, (1.5 * size, size, 0.8 * size), 0.25 * size, pos=tuple(back), quat=quat, **look)
    shop.add(body, disc, 0.7 * size, 0.5 * size, 0.1 * size, pos=tuple(back + 0.9 * size * ahead), quat=quat,
             rgba=LENS, material="gloss")  # fmt: skip
    strut = foot - back
    length = float(np.linalg.norm(strut))
    if 2.0 * size < length < LONGEST_STRUT_M:
        shop.add(body, disc, 0.28 * size, 0.5 * length, 0.1 * size, pos=tuple(back + 0.5 * strut),
                 quat=tuple(upright_along(strut)), **look)  # fmt: skip


def span_m(shop: Workshop) -> float:
    """Return the distance between a multirotor's outermost rotors, the default where there are none."""
    sites = [site for site in shop.spec.sites if site.name.startswith("rotor_")]
    if shop.spec.geom("disc_0") is None or not sites:
        return DEFAULT_SPAN_M
    return 2.0 * max(float(np.hypot(site.pos[0], site.pos[1])) for site in sites)
