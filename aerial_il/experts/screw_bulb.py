"""Expert for the bulb: hover, descend, close, turn with the whole vehicle; grip again whenever the lamp slips out."""

import numpy as np

from aerial_il.core.arrays import planar_length
from aerial_il.experts.expert import Expert, pointing_down
from aerial_il.suite.episode import measured
from aerial_il.suite.tasks import screw_bulb
from aerial_il.suite.tasks.screw_bulb import SCREWED_RAD

HOVER, DESCEND, CLOSE, TURN = range(4)

CRUISE_M = 0.12  # tool above the flats while travelling
ALIGNED_M, LOST_ALIGNMENT_M = 0.012, 0.03  # sideways error at which the tool may descend, and goes back up
FACING_COS = np.cos(np.deg2rad(8.0))
AT_HEIGHT_M = 0.003
DESCENT_LEAD_M = 0.08  # how far ahead of itself the tool is sent while it goes down
DESCENT_PATIENCE_STEPS = 150  # on the way down for longer than this, something is under a finger
GRIP_STEPS, GRIP_PATIENCE_STEPS = 5, 60
SLIPPED_M = 0.012  # with the tool this far above the flats' middle, it had better grip anew
LOST_STEPS = 25  # a pad may leave a lamp that is held for an instant
TURN_LEAD_RAD = 0.4  # the heading is sent this far ahead of the tool's: a vehicle turns late
BEYOND_RAD = 0.25  # how far past two turns it is turned
NOISE_IN_FINE_WORK = 0.2

bulb_yaw = measured.number(screw_bulb.bulb_yaw)
gripped = measured.truth(screw_bulb.gripped)


class ScrewBulbExpert(Expert):
    """The tool stays over the lamp's axis, and the vehicle flies round it."""

    phase_names = ("hover", "descend", "close", "turn")

    def first_phase(self) -> np.ndarray:
        return np.where(gripped(self.view), TURN, HOVER)

    def next_phase(self) -> np.ndarray:
        view = self.view
        away = view.tool_pos - view.site_pos("bulb")
        beside, held = planar_length(away), gripped(view)
        over = (beside <= ALIGNED_M) & self._facing()
        rules = (
            (HOVER, over & (away[:, 2] <= CRUISE_M + 0.05), DESCEND),
            (DESCEND, (beside > LOST_ALIGNMENT_M) | (self.timer > DESCENT_PATIENCE_STEPS), HOVER),
            (DESCEND, over & (away[:, 2] <= AT_HEIGHT_M), CLOSE),
            (CLOSE, held & (self.timer >= GRIP_STEPS), TURN),
            (CLOSE, self.timer > GRIP_PATIENCE_STEPS, HOVER),
            (TURN, ~held & (self.timer > LOST_STEPS) & (beside > ALIGNED_M), HOVER),
            (TURN, away[:, 2] > SLIPPED_M, HOVER),
        )
        return self.following(rules)

    def command(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        view, phase = self.view, self.phase
        position = view.site_pos("bulb").copy()
        down = np.maximum(position[:, 2], view.tool_pos[:, 2] - DESCENT_LEAD_M)
        position[:, 2] += np.where(phase == HOVER, CRUISE_M, 0.0)
        position[:, 2] = np.select([phase == DESCEND, phase == TURN], [down, view.tool_pos[:, 2]], position[:, 2])
        turned, _ = view.joint("bulb_turn")
        ahead = np.clip(SCREWED_RAD + BEYOND_RAD - turned, 0.0, TURN_LEAD_RAD)
        yaw = np.where(phase == TURN, self._heading() - ahead, self._flats())
        return position, pointing_down(yaw), np.where(phase >= CLOSE, 0.0, 1.0)

    def noise_share(self) -> np.ndarray:
        return np.where(self.phase == HOVER, 1.0, NOISE_IN_FINE_WORK)

    def _heading(self) -> np.ndarray:
        """(n,) heading of the tool, rad."""
        mat = self.view.tool_mat
        return np.arctan2(-mat[:, 1], mat[:, 4])

    def _flats(self) -> np.ndarray:
        """(n,) heading at which the fingers meet two flats, rad: of the four, the one nearest to the tool's."""
        yaw, heading = bulb_yaw(self.view), self._heading()
        return yaw + 0.5 * np.pi * np.round((heading - yaw) / (0.5 * np.pi))

    def _facing(self) -> np.ndarray:
        """(n,) bool: the fingers are square to two flats."""
        return np.cos(self._heading() - self._flats()) >= FACING_COS


EXPERT = ScrewBulbExpert
