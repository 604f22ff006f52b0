"""Expert for the slider: come down behind the handle with the gripper closed, and push; go back up when it slips."""

import numpy as np

from aerial_il.core.arrays import planar_length
from aerial_il.experts.expert import Expert, pointing_down
from aerial_il.suite.props.slider import HANDLE_HALF_M, RAIL_M
from aerial_il.suite.tasks.push_slider import BEHIND_M

OVER, LOWER, PUSH = range(3)

CLEAR_M = HANDLE_HALF_M[2] + 0.06  # fingertips above the handle's middle while they travel
HOLD_M = -0.01  # and while they push
AROUND_M = 0.12  # this close to the handle the gripper first rises, then moves across
ALIGNED_M = 0.02  # off the ready point: lower
LOST_ALIGNMENT_M = 0.035  # sideways: the handle is 7 cm wide
LOW_M = 0.015  # fingertips above the handle's middle: push
PUSH_LEAD_M = 0.07  # how far ahead of itself the gripper is sent
CONTACT_M = 0.02  # fingertips behind the handle's middle while they touch it
PRESS_M = 0.01  # beyond the end of the rail, against friction


class PushSliderExpert(Expert):
    """The handle is a broad plate; the phases only have to keep the gripper behind it."""

    phase_names = ("over", "lower", "push")

    def first_phase(self) -> np.ndarray:
        along, aside, above = self._offset()
        behind = (along < 0.0) & (along > -1.5 * BEHIND_M) & (np.abs(aside) <= ALIGNED_M) & (above <= LOW_M)
        return np.where(behind, PUSH, OVER)

    def next_phase(self) -> np.ndarray:
        along, aside, above = self._offset()
        ready = (np.abs(along + BEHIND_M) <= ALIGNED_M) & (np.abs(aside) <= ALIGNED_M)
        lost = (np.abs(aside) > LOST_ALIGNMENT_M) | (along > 0.0)
        rules = (
            (OVER, ready & (above <= CLEAR_M + 0.04), LOWER),
            (LOWER, lost, OVER),
            (LOWER, above <= LOW_M, PUSH),
            (PUSH, lost | (above > HANDLE_HALF_M[2]), OVER),
        )
        return self.following(rules)

    def command(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        view, phase = self.view, self.phase
        tip, handle, direction = view.tip_pos, view.site_pos("slider"), view.site_mat("slider")[:, [0, 3, 6]]
        along, _, above = self._offset()
        behind = handle - BEHIND_M * direction
        rising = (above < CLEAR_M - 0.02) & (planar_length(tip - handle) < AROUND_M) & (along > -BEHIND_M)
        over = np.where(rising[:, None], tip, behind)
        to_go = RAIL_M - view.joint("slider")[0] - along - CONTACT_M
        pushing = handle + (along + np.minimum(to_go + PRESS_M, PUSH_LEAD_M))[:, None] * direction
        target = np.where((phase == PUSH)[:, None], pushing, np.where((phase == OVER)[:, None], over, behind))
        target[:, 2] = handle[:, 2] + np.where(phase == OVER, CLEAR_M, HOLD_M) + view.robot.gripper.tip_distance
        return target, pointing_down(self._yaw()), np.zeros(view.n)

    def _offset(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(n,) fingertips from the handle's middle, m: along the rail, aside, above."""
        ahead, mat = self.view.tip_pos - self.view.site_pos("slider"), self.view.site_mat("slider")
        along, aside = (ahead[:, 0] * mat[:, k] + ahead[:, 1] * mat[:, 3 + k] for k in (0, 1))
        return along, aside, ahead[:, 2]

    def _yaw(self) -> np.ndarray:
        """(n,) heading in ±45° at which a flat side of the closed gripper meets the handle."""
        mat = self.view.site_mat("slider")
        rail = np.arctan2(mat[:, 3], mat[:, 0])
        return rail - 0.5 * np.pi * np.round(rail / (0.5 * np.pi))


EXPERT = PushSliderExpert
