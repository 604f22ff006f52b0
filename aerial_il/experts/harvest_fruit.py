"""Expert for the fruit: take the nearest ripe one beside its leaf, pull, carry it over the basket and let go."""

import math

import numpy as np

from aerial_il.core.kernels import kernel
from aerial_il.experts.set_down import SetDownExpert
from aerial_il.suite.episode import measured
from aerial_il.suite.props import TABLE_HEIGHT_M
from aerial_il.suite.tasks import harvest_fruit
from aerial_il.suite.tasks.harvest_fruit import RIPE, RIPE_COUNT

DROP_M = 0.055  # of the fruit over the basket's underside, where it is let go: fingers stay over the rim
GATE_M = 0.012  # that it may be higher


@kernel
def states(world, found):
    for k in range(RIPE_COUNT):
        found[3 * k] = harvest_fruit.grasped(world, k)
        found[3 * k + 1] = harvest_fruit.in_basket(world, k)
        found[3 * k + 2] = harvest_fruit.fallen(world, k)


@kernel
def yaws(world, found):
    for k in range(RIPE_COUNT):
        c, s = harvest_fruit.leaf_heading(world, k)
        found[k] = 0.5 * math.atan2(s, c)


yaws_of = measured.row(yaws, RIPE_COUNT)
states_of = measured.row(states, 3 * RIPE_COUNT)


class HarvestFruitExpert(SetDownExpert):
    """The fingers come down on the sides where there is no leaf."""

    at_height_m = 0.006

    def cube(self) -> np.ndarray:
        return self._fruits()[np.arange(self.view.n), self._which()]

    def held(self) -> np.ndarray:
        return np.asarray(self._states()[:, :, 0].any(axis=1))

    def grasp_heading(self) -> np.ndarray:
        return yaws_of(self.view)[np.arange(self.view.n), self._which()]

    def goal(self) -> tuple[np.ndarray, np.ndarray]:
        return self.view.site_pos("basket") + np.array([0.0, 0.0, DROP_M]), np.zeros(self.view.n)

    def done(self) -> np.ndarray:
        return np.asarray(self._states()[:, :, 1].any(axis=1))

    def table(self) -> float:
        return TABLE_HEIGHT_M

    def down(self) -> np.ndarray:
        return self.cube()[:, 2] - self.goal()[0][:, 2] <= GATE_M

    def _fruits(self) -> np.ndarray:
        """(n, RIPE_COUNT, 3) middles of the ripe fruits, world, m."""
        return np.stack([self.view.site_pos(name) for name in RIPE], axis=1)

    def _states(self) -> np.ndarray:
        """(n, RIPE_COUNT, 3) bool: which are held, in the basket, on the floor."""
        return states_of(self.view).reshape(-1, RIPE_COUNT, 3) > 0.0

    def _which(self) -> np.ndarray:
        """(n,) number of the fruit it is about: one that is held, or else the nearest on the plants or the table."""
        held, _, fallen = np.moveaxis(self._states(), 2, 0)
        away = self._fruits() - self.view.tool_pos[:, None]
        distance = np.hypot(away[:, :, 0], away[:, :, 1]) + np.where(fallen, 10.0, 0.0) - np.where(held, 10.0, 0.0)
        return distance.argmin(axis=1)


EXPERT = HarvestFruitExpert
