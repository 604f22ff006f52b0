"""Pictures as the mean of several exposures, between which lamps, lens and propellers move a little.

That gives soft shadows from lamps of some size and from the sky, smooth edges, and propellers that blur as they do in
front of a camera's shutter.
"""

from collections.abc import Callable

import mujoco
import numpy as np

from aerial_il.suite.rendering import Renderer

KEY_DIR, KEY_SPREAD = np.array([0.15, 0.75, -1.2]), 0.08  # where the main lamp shines; half its size seen from below
DISTANCE_M = 3.0  # of lamps from what is looked at; they shine in parallel
# brightness of the lamps, and of what comes from everywhere
KEY, SKY, FILL, BOUNCE, AMBIENT = 0.44, 0.27, 0.24, 0.22, 0.33
WARM, COOL = np.array([1.0, 0.975, 0.93]), np.array([0.93, 0.97, 1.0])
FILL_DIR, UP = np.array([-0.87, 0.10, -0.48]), np.array([0.0, 0.0, 1.0])
LOWEST_SKY = 0.5  # sine of the height from which the sky still shines: shadows of lower lamps would be ragged
SKY_SHADOWS = 12  # fewer exposures would show each of the sky's shadows by itself
GOLDEN = 0.6180339887498949


def expose(renderer: Renderer, count: int, lookat: np.ndarray, prepare: Callable[[float], None]) -> np.ndarray:
    """Return the mean (H, W, 3) uint8 of ``count`` exposures; of only a few, the sky casts no shadows.

    Args:
        renderer: of the stage. count: of exposures. lookat: (3,) m, about which shadows are drawn.
        prepare: called with a share of the shutter's time, to put into the renderer's scene what is seen then.
    """
    total = np.zeros((renderer.height, renderer.width, 3), np.float32)
    for k in range(count):
        prepare(k / count)
        light(renderer.scene, lookat, k, count)
        if count > 1:
            _shift_lens(renderer.scene, k, count, renderer.height)
        total += renderer.render()
    return np.clip(total / count + 0.5, 0, 255).astype(np.uint8)


def light(scene: mujoco.MjvScene, lookat: np.ndarray, k: int = 0, count: int = 1) -> None:
    """Put the lamps into a scene where they are in exposure ``k`` of ``count``."""
    key, sky = lamp_directions(k, count)
    scene.nlight = 4
    _set_lamp(scene.lights[0], key, lookat, KEY * WARM, shadow=True, specular=0.5, ambient=AMBIENT * COOL)
    _set_lamp(scene.lights[1], sky, lookat, SKY * COOL, shadow=count >= SKY_SHADOWS)
    _set_lamp(scene.lights[2], FILL_DIR, lookat, FILL * COOL, specular=0.25)
    _set_lamp(scene.lights[3], UP, lookat, BOUNCE * WARM)
    scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = True
    scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
    scene.flags[mujoco.mjtRndFlag.mjRND_FOG] = True
    scene.flags[mujoco.mjtRndFlag.mjRND_HAZE] = False


def lamp_directions(k: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return where the main lamp, and the lamp that stands for the sky, shine in exposure ``k`` of ``count``.

    Over all exposures, the first is spread evenly over a disc and the second over the sky, most of it from above.
    """
    if count == 1:
        return KEY_DIR / np.linalg.norm(KEY_DIR), -UP
    turn, out = 2.0 * np.pi * GOLDEN * k, np.sqrt((k + 0.5) / count)
    side = np.cross(KEY_DIR, UP)
    side /= np.linalg.norm(side)
    over = np.cross(side, KEY_DIR)
    key = KEY_DIR + KEY_SPREAD * out * (np.cos(turn) * np.linalg.norm(KEY_DIR) * side + np.sin(turn) * over)
    tilt = max(LOWEST_SKY, float(np.sqrt(1.0 - out**2)))
    level = np.sqrt(1.0 - tilt**2)
    return key / np.linalg.norm(key), -np.array([level * np.cos(turn), level * np.sin(turn), tilt])


def _set_lamp(
    lamp: mujoco.MjvLight, direction: np.ndarray, lookat: np.ndarray, colour: np.ndarray, *, shadow: bool = False,
    specular: float = 0.0, ambient: np.ndarray | None = None,
) -> None:  # fmt: skip
    lamp.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    lamp.headlight, lamp.castshadow, lamp.texid = 0, int(shadow), -1
    lamp.dir[:] = direction
    lamp.pos[:] = lookat - DISTANCE_M * direction
    lamp.attenuation[:] = 1.0, 0.0, 0.0
    lamp.ambient[:] = 0.0 if ambient is None else ambient
    lamp.diffuse[:], lamp.specular[:] = colour, specular


def _shift_lens(scene: mujoco.MjvScene, k: int, count: int, height: int) -> None:
    """Move the picture by less than a pixel."""
    right, up = (k + 0.5) / count - 0.5, (GOLDEN * k + 0.25) % 1.0 - 0.5
    for camera in scene.camera:
        pixel = (camera.frustum_top - camera.frustum_bottom) / height
        camera.frustum_center += right * pixel
        camera.frustum_top += up * pixel
        camera.frustum_bottom += up * pixel
