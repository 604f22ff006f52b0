"""Expert for landing: over the pad, down at a steady speed, and stay down."""

import numpy as np

from aerial_il.experts.expert import Expert
from aerial_il.suite.props.skids import STAND_M
from aerial_il.suite.tasks.land import ON_PAD_M

APPROACH, DESCEND, STAY = range(3)
OVER_PAD_M = 0.03  # aside, before it goes down
AHEAD_M = 0.06  # by how much the commanded height is below it while it descends: about 0.3 m/s
MARGIN_M = 0.01  # of the pad that it leaves unused: beyond, it takes off again
LEVEL_M = 0.5  # height of the skids at which it comes over the pad


class LandExpert(Expert):
    """Fly over the pad and descend; once the skids touch, command a height below ground: they bear the weight."""

    phase_names = ("approach", "descend", "stay")

    def first_phase(self) -> np.ndarray:
        return np.where(self._down() & (self._aside() <= ON_PAD_M - MARGIN_M), STAY, APPROACH)

    def next_phase(self) -> np.ndarray:
        over = np.where(self._aside() <= OVER_PAD_M, DESCEND, APPROACH)
        strayed = self._aside() > ON_PAD_M - MARGIN_M
        below = np.where(self._down(), STAY, DESCEND)
        return np.where(self.phase == APPROACH, over, np.where(strayed, APPROACH, below))

    def command(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        view = self.view
        heights = [view.base_pos[:, 2].clip(LEVEL_M + STAND_M), view.base_pos[:, 2] - AHEAD_M, np.zeros(view.n)]
        target = view.site_pos("pad").copy()
        target[:, 2] = np.choose(self.phase, heights)
        heading = np.arctan2(view.base_mat[:, 3], view.base_mat[:, 0])
        return target, level(heading), np.ones(view.n)

    def noise_share(self) -> np.ndarray:
        return np.choose(self.phase, [1.0, 0.3, 0.0])

    def _aside(self) -> np.ndarray:
        """(n,) horizontal distance from the pad's centre, m."""
        return np.hypot(*(self.view.base_pos - self.view.site_pos("pad"))[:, :2].T)

    def _down(self) -> np.ndarray:
        """(n,) whether the skids are on the ground."""
        return self.view.base_pos[:, 2] <= STAND_M + 0.005


def level(heading: np.ndarray) -> np.ndarray:
    """rot6d (n, 6) of a level attitude with ``heading`` (n,) rad."""
    c, s, zero = np.cos(heading), np.sin(heading), np.zeros_like(heading)
    return np.stack([c, s, zero, -s, c, zero], axis=1)


EXPERT = LandExpert
