"""Looks: other colours, textures, lights and things beside the workspace than demonstrations were seen with."""

from __future__ import annotations

from colorsys import hsv_to_rgb, rgb_to_hsv
from dataclasses import dataclass
from typing import Any, ClassVar

import mujoco
import numpy as np

from aerial_il.robots.robot import Robot
from aerial_il.suite.disturbances.disturbance import Disturbance, Strength
from aerial_il.suite.disturbances.nominal import LIGHTS, SHAPES, SHAPES_SIZE, Nominal

HUE_DEG, BRIGHTER = 2.0, 0.12  # at strength 1, of what a task may name by its colour: hue, logarithm of its value
PALE, PAINTED = 0.25, 0.35  # largest saturation of surroundings at strength 1; share of them whose texture is another
LIGHT, TURN = 0.25, 0.35  # largest logarithm of a light's intensity, and rad of its direction, at strength 1
RING_M, LEAST_M, MOST_M = (1.3, 2.4), 0.04, 0.14  # where things stand about the origin, and their half sizes
SIDES, WALL_M, WALL_HALF_M = 0.7, (3.5, 6.0), (3.0, 0.02, 1.5)  # share of the sides that have a wall; how far away
BOX, CYLINDER, ELLIPSOID = (
    int(kind) for kind in (mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_ELLIPSOID)
)


@dataclass(frozen=True)
class Looks(Disturbance):
    """A scene that looks otherwise and is the same: nothing of it can be touched.

    Colours of ground and table, lights and their directions are drawn; everything else keeps its hue within
    2 degrees (4 at a strength of 2), and gets lighter or darker. Things that cannot be touched stand on the ground
    beside the workspace, and walls behind them.

    Attributes:
        strength_of_change: everything changes by so many times what is seen in training; of more than 1, by at least
            one less, so that what 2 draws is never seen at 1.
    """

    strength_of_change: float = 1.0
    strength: ClassVar[Strength | None] = Strength("1 as in training, 2 beyond all that is seen there", 0.0, 2.0)
    varies: ClassVar[tuple[str, ...]] = ("geom_rgba", "geom_matid", "mat_texrepeat", LIGHTS, SHAPES)

    @classmethod
    def of(cls, strength: float) -> Looks:
        return cls(strength)

    def unfelt(self, robot: Robot) -> str | None:
        return None if robot.mounted_cameras else f"{robot.name} has no cameras"

    def vary(self, fields: dict[str, np.ndarray], nominal: Nominal, rng: np.random.Generator) -> dict[str, Any]:
        if self.strength_of_change > 0.0:
            self._paint(fields, nominal.scene, rng)
            self._light(fields[LIGHTS], rng)
            fields[SHAPES] = np.concatenate([self._things(rng), self._walls(rng)])
        return {}

    def _amount(self, rng: np.random.Generator, size: int | tuple[int, ...] = 1) -> np.ndarray:
        """Draw by how much something changes: of either sign, 0 to 1 at strength 1, 1 to 2 at strength 2."""
        most = self.strength_of_change
        return rng.choice([-1.0, 1.0], size) * rng.uniform(max(0.0, most - 1.0), most, size)

    def _paint(self, fields: dict[str, np.ndarray], scene: mujoco.MjModel, rng: np.random.Generator) -> None:
        surroundings = _surroundings(scene)
        colours = fields["geom_rgba"]
        for geom in range(scene.ngeom):
            if geom in surroundings:
                colours[geom, :3] = self._surface(rng)
                if rng.random() < PAINTED:
                    fields["geom_matid"][geom] = -1 if scene.geom_matid[geom] >= 0 else 0
            else:
                colours[geom, :3] = self._shade(colours[geom, :3], rng)
        fields["mat_texrepeat"] *= np.exp(0.5 * self._amount(rng))

    def _surface(self, rng: np.random.Generator) -> tuple[float, float, float]:
        """Return the colour of a surface that no task names by it: pale at strength 1, stronger and darker beyond."""
        change = abs(float(self._amount(rng)[0]))
        return hsv_to_rgb(rng.random(), PALE * change, 0.95 - 0.3 * change)

    def _shade(self, rgb: np.ndarray, rng: np.random.Generator) -> tuple[float, float, float]:
        hue, saturation, value = rgb_to_hsv(*rgb.tolist())
        turned, brighter = self._amount(rng, 2)
        value = min(1.0, value * float(np.exp(BRIGHTER * brighter)))
        return hsv_to_rgb((hue + HUE_DEG / 360.0 * turned) % 1.0, saturation, value)

    def _light(self, lights: np.ndarray, rng: np.random.Generator) -> None:
        lights[:3] *= np.exp(LIGHT * self._amount(rng, (3, 1)))
        lights[3] += TURN * np.linalg.norm(lights[3]) * self._amount(rng, 3)

    def _things(self, rng: np.random.Generator) -> np.ndarray:
        """Return 3 to 7 solids of strong colours that stand on the ground in a ring about the workspace."""
        rows = []
        for _ in range(rng.integers(3, 8)):
            kind, half = rng.choice([BOX, CYLINDER, ELLIPSOID]), rng.uniform(LEAST_M, MOST_M, 3)
            size = half[[0, 0, 2]] if kind == CYLINDER else half
            (angle, yaw), radius = rng.uniform(-np.pi, np.pi, 2), rng.uniform(*RING_M)
            colour = hsv_to_rgb(rng.random(), rng.uniform(0.3, 0.9), rng.uniform(0.3, 0.95))
            rows.append(_row(kind, size, [radius * np.cos(angle), radius * np.sin(angle), half[2]], yaw, colour))
        return np.array(rows)

    def _walls(self, rng: np.random.Generator) -> np.ndarray:
        """Return up to four walls about the scene."""
        rows = []
        for yaw in 0.5 * np.pi * np.flatnonzero(rng.random(4) < SIDES):
            away = rng.uniform(*WALL_M)
            pos = [-away * np.sin(yaw), away * np.cos(yaw), WALL_HALF_M[2]]
            rows.append(_row(BOX, WALL_HALF_M, pos, yaw, self._surface(rng)))
        return np.reshape(rows, (-1, SHAPES_SIZE))


def _surroundings(scene: mujoco.MjModel) -> set[int]:
    """Return the geoms whose colour no task names: the ground and what stands on it for good, and tables."""
    geoms = range(scene.ngeom)
    return {geom for geom in geoms if scene.geom_bodyid[geom] == 0 or scene.geom(geom).name.startswith("table")}


def _row(kind: float, size: Any, pos: Any, yaw: float, rgb: Any) -> np.ndarray:
    """Return one of ``SHAPES``."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([kind, *size, *pos, c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0, *rgb])


TIERS: dict[str, Looks] = {}
