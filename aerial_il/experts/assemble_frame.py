"""Expert for the frame: lift the beam off, turn it along the hooks, lower it between their walls."""

import numpy as np

from aerial_il.experts.set_down import LOWER_PATIENCE_STEPS, SEATED_M, SetDownExpert
from aerial_il.suite.episode import measured
from aerial_il.suite.props import TABLE_HEIGHT_M
from aerial_il.suite.props.frame import BEAM_HALF_M, WALL_M
from aerial_il.suite.tasks import assemble_frame

ASTRAY_M = 0.007  # beside the middle of a hook, over its walls, from where on the beam goes up again
WALLS_M = WALL_M - BEAM_HALF_M[2]  # from the beam where it is to lie to where it comes between the walls
ALONG_M = 0.02  # of its middle from the frame's

beam_turn = measured.number(assemble_frame.beam_turn)
beside_hooks = measured.number(assemble_frame.beside_hooks)
over_hooks = measured.number(assemble_frame.over_hooks)
beam_yaw = measured.number(assemble_frame.beam_yaw)
assembled = measured.truth(assemble_frame.assembled)


class AssembleFrameExpert(SetDownExpert):
    """What is brought to the hooks is where the beam crosses them: its position and its heading in one."""

    at_height_m = 0.004  # held by the fingers' ends, a beam slips out
    down_m = 0.003

    def cube(self) -> np.ndarray:
        return self.view.site_pos("beam")

    def held(self) -> np.ndarray:
        return self.view.touching("grip_left") & self.view.touching("grip_right")

    def grasp_heading(self) -> np.ndarray:
        yaw, heading = beam_yaw(self.view), self._heading()
        return yaw + np.pi * np.round((heading - yaw) / np.pi)

    def goal(self) -> tuple[np.ndarray, np.ndarray]:
        return self.view.site_pos("frame"), self._heading() + beam_turn(self.view)

    def done(self) -> np.ndarray:
        return assembled(self.view)

    def table(self) -> float:
        return TABLE_HEIGHT_M

    def beside_goal(self) -> np.ndarray:
        """(n,) how far the beam is beside the middle of a hook, or further than it may be along the frame, m."""
        return np.maximum(beside_hooks(self.view), super().beside_goal() - ALONG_M)

    def down(self) -> np.ndarray:
        return over_hooks(self.view) <= SEATED_M

    def astray(self) -> np.ndarray:
        over_walls = over_hooks(self.view) > WALLS_M
        return (over_walls & (beside_hooks(self.view) > ASTRAY_M)) | (self.timer > LOWER_PATIENCE_STEPS)


EXPERT = AssembleFrameExpert
