"""Expert for sorting pegs: inserts one after the other as for a single peg, in the order that the task remembers."""

import numpy as np

from aerial_il.core.contracts import BatchEnv
from aerial_il.core.kernels import kernel
from aerial_il.experts.expert import UNDECIDED, HasSimulation
from aerial_il.experts.insert_peg import HOVER, RELEASE, RETREAT, InsertPegExpert
from aerial_il.suite.episode import measured
from aerial_il.suite.props.peg import PEG_LENGTH_M
from aerial_il.suite.tasks import sort_pegs
from aerial_il.suite.tasks.sort_pegs import COLOURS, PEGS

CLEAR_M = 0.03  # of a carried peg's lower end over pegs that stand
BACKED_OFF_M = 0.02  # of the tool over the end of the peg that was let go, before it goes to the next


@kernel
def axes(world, found):
    for k in range(PEGS):
        found[3 * k], found[3 * k + 1], found[3 * k + 2] = sort_pegs.axis_of(world, k)


@kernel
def depths(world, found):
    for k in range(PEGS):
        found[k] = sort_pegs.depth_in(world, k, PEGS + k)


axes_of, depths_of = measured.row(axes, 3 * PEGS), measured.row(depths, PEGS)
next_peg = measured.number(sort_pegs.next_peg)


class SortPegsExpert(InsertPegExpert):
    """Hold in mind which peg it is at; a peg in the gripper that it is not the turn of is let go."""

    carry_height_m = PEG_LENGTH_M + CLEAR_M

    def attach(self, env: BatchEnv | HasSimulation) -> None:
        super().attach(env)
        self.which = np.zeros(self.view.n, int)

    def first_phase(self) -> np.ndarray:
        held, turn = self._all_held(), self._next()
        now = np.where(held.any(axis=1), held.argmax(axis=1), turn)
        self.which = np.where(self.phase == UNDECIDED, now, self.which)
        return np.where((self.which != turn) & self._held(), RELEASE, super().first_phase())

    def next_phase(self) -> np.ndarray:
        over, turn = self.view.tool_pos[:, 2] - self._peg()[:, 2], self._next()
        off = (self.phase == RETREAT) & (over >= 0.5 * PEG_LENGTH_M + BACKED_OFF_M)
        phase = np.where(off & (self.which != turn), HOVER, super().next_phase())
        self.which = np.where(phase == HOVER, turn, self.which)
        return phase

    def _next(self) -> np.ndarray:
        """(n,) number of the peg that is to be inserted next."""
        return next_peg(self.view).astype(int)

    def _all_held(self) -> np.ndarray:
        """(n, PEGS) bool: which pegs are between the pads."""
        touching = self.view.touching
        return np.stack([touching(f"grip_left_{name}") & touching(f"grip_right_{name}") for name in COLOURS], axis=1)

    def _chosen(self, values: np.ndarray) -> np.ndarray:
        """Values (n, ...) of the peg it is at, of those (n, PEGS, ...) of all."""
        return values[np.arange(self.view.n), self.which]

    def _all(self, site: str) -> np.ndarray:
        return np.stack([self.view.site_pos(f"{site}_{name}") for name in COLOURS], axis=1)

    def _peg(self) -> np.ndarray:
        return self._chosen(self._all("peg"))

    def _hole(self) -> np.ndarray:
        return self._chosen(self._all("hole"))

    def _axis(self) -> np.ndarray:
        return self._chosen(axes_of(self.view).reshape(-1, PEGS, 3))

    def _lower_end(self) -> np.ndarray:
        return self._peg() - 0.5 * PEG_LENGTH_M * self._axis()

    def _depth(self) -> np.ndarray:
        return self._chosen(depths_of(self.view))

    def _held(self) -> np.ndarray:
        return self._chosen(self._all_held())


EXPERT = SortPegsExpert
