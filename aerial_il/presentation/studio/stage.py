"""The copy of a scene that people see: a clean floor and sky, rounded edges, the robot's real shapes.

States of the scene are states of its copy: bodies, joints and actuators are the same, only what is drawn differs.
"""

import mujoco

from aerial_il.core.errors import AerialError
from aerial_il.presentation.studio.limbs import dress_arm, dress_gripper
from aerial_il.presentation.studio.props import dress_props
from aerial_il.presentation.studio.solids import block, disc
from aerial_il.presentation.studio.vehicle import dress_cameras, dress_vehicle
from aerial_il.presentation.studio.workshop import PREFIX, Workshop, hide

HORIZON = (0.93, 0.945, 0.96)
FLOOR, SEAM = (0.87, 0.88, 0.89), (0.76, 0.775, 0.80)
TILE_M = 0.5
SHADOW_REACH = 1.15  # half of the square in which shadows fall, in extents of the scene
MATERIALS = {  # specular, shininess
    "matte": (0.08, 0.2),
    "satin": (0.30, 0.45),
    "gloss": (0.65, 0.85),
    "metal": (0.80, 0.65),
}
SIZES = ("nq", "nv", "na", "nu", "nmocap", "nuserdata", "nbody", "njnt", "nsite", "ncam")
ROUNDING, LARGEST_ROUNDING_M = 0.18, 0.006


class StageError(AerialError):
    """A scene whose copy would not take its states."""


def staged(model: mujoco.MjModel, xml: str) -> mujoco.MjModel:
    """Compile the scene ``xml``, of which ``model`` was compiled, as people shall see it.

    Raises:
        StageError: its states would not fit.
    """
    spec = mujoco.MjSpec.from_string(xml)
    _set_light(spec)
    _set_stage(spec)
    shop = Workshop(spec)
    dress_vehicle(shop)
    dress_arm(shop)
    dress_gripper(shop)
    dress_cameras(shop)
    dress_props(shop)
    _round_off(shop)
    copy = spec.compile()
    if different := [name for name in SIZES if getattr(copy, name) != getattr(model, name)]:
        raise StageError(f"{spec.modelname}: its copy has another {', '.join(different)}.")
    return copy


def _set_light(spec: mujoco.MjSpec) -> None:
    visual = spec.visual
    visual.headlight.active = 0
    visual.quality.numslices, visual.quality.numstacks, visual.quality.numquads = 26, 12, 2
    visual.map.shadowclip = SHADOW_REACH
    visual.map.fogstart, visual.map.fogend = 2.5, 10.0
    visual.rgba.fog = visual.rgba.haze = [*HORIZON, 1.0]
    visual.global_.offwidth, visual.global_.offheight = 4096, 4096


def _set_stage(spec: mujoco.MjSpec) -> None:
    for light in list(spec.lights):
        spec.delete(light)
    for name, (specular, shininess) in MATERIALS.items():
        spec.add_material(name=f"{PREFIX}_{name}", specular=specular, shininess=shininess, rgba=[1, 1, 1, 1])
    for texture in spec.textures:
        if texture.type == mujoco.mjtTexture.mjTEXTURE_SKYBOX:
            texture.builtin, texture.rgb1, texture.rgb2 = mujoco.mjtBuiltin.mjBUILTIN_FLAT, HORIZON, HORIZON
    spec.add_texture(
        name=f"{PREFIX}_floor", type=mujoco.mjtTexture.mjTEXTURE_2D, builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        mark=mujoco.mjtMark.mjMARK_EDGE, rgb1=FLOOR, rgb2=FLOOR, markrgb=SEAM, width=256, height=256,
    )  # fmt: skip
    floor = spec.add_material(name=f"{PREFIX}_floor", texrepeat=[1 / TILE_M, 1 / TILE_M], texuniform=True, specular=0.0)
    floor.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = f"{PREFIX}_floor"
    for geom in spec.geoms:
        if geom.type == mujoco.mjtGeom.mjGEOM_PLANE:
            geom.material = f"{PREFIX}_floor"


def _round_off(shop: Workshop) -> None:
    """Round the edges of every box and cylinder that is still seen; the rest becomes a little shiny."""
    for geom in list(shop.spec.geoms):
        if geom.name.startswith(PREFIX) or geom.rgba[3] == 0.0 or geom.type == mujoco.mjtGeom.mjGEOM_PLANE:
            continue
        if geom.group > 2 or geom.material or geom.rgba[3] < 1.0:
            continue
        look = {"pos": tuple(geom.pos), "quat": tuple(geom.quat), "rgba": tuple(geom.rgba), "material": "satin"}
        size = tuple(float(s) for s in geom.size)
        if geom.type == mujoco.mjtGeom.mjGEOM_BOX:
            shop.add(geom.parent, block, size, min(LARGEST_ROUNDING_M, ROUNDING * min(size)), **look)
        elif geom.type == mujoco.mjtGeom.mjGEOM_CYLINDER:
            shop.add(geom.parent, disc, size[0], size[1], min(LARGEST_ROUNDING_M, ROUNDING * min(size[:2])), **look)
        else:
            geom.material = f"{PREFIX}_satin"
            continue
        hide(geom)
