"""Expert for picking from a moving table: that for pick and place, sent ahead of a cube that rides on."""

import numpy as np

from aerial_il.experts.pick_place import DESCEND, LIFT, PickPlaceExpert
from aerial_il.suite.episode import measured
from aerial_il.suite.props import CUBE_HALF_M, TABLE_HEIGHT_M
from aerial_il.suite.tasks import pick_moving

AHEAD_S = 0.03  # by which the tool follows its command late
INWARD = 0.04  # share of the way to the middle of the course: what it bends by meanwhile
DESCENT_LEAD_M = 0.03  # the controller takes up a command's speed only while the tool is near to it
OFF_TABLE_M = 0.01  # under the cube, before the tool may stay behind

table_offset, table_vel = measured.vector(pick_moving.table_offset), measured.vector(pick_moving.table_vel)


class PickMovingExpert(PickPlaceExpert):
    """Until the cube is off the table the tool is sent to where the table will have taken it."""

    def command(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        view, (position, rot6d, gripper) = self.view, super().command()
        lying = view.site_pos("cube")[:, 2] < TABLE_HEIGHT_M + CUBE_HALF_M + OFF_TABLE_M
        riding = (self.phase < LIFT) | ((self.phase == LIFT) & lying)
        position += np.where(riding[:, None], AHEAD_S * table_vel(view) - INWARD * table_offset(view), 0.0)
        slow = np.maximum(position[:, 2], view.tool_pos[:, 2] - DESCENT_LEAD_M)
        position[:, 2] = np.where(self.phase == DESCEND, slow, position[:, 2])
        return position, rot6d, gripper


EXPERT = PickMovingExpert
