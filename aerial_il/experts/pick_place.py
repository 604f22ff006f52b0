"""Expert for pick and place: hover, descend, close, lift, carry, lower, let go, back off; retry on a miss."""

from typing import ClassVar

import numpy as np

from aerial_il.core.arrays import length, planar_length
from aerial_il.experts.expert import Expert, pointing_down
from aerial_il.suite.episode import measured
from aerial_il.suite.props import CUBE_HALF_M, TABLE_HEIGHT_M
from aerial_il.suite.tasks import pick_place
from aerial_il.suite.tasks.pick_place import IN_BOWL_M

HOVER, DESCEND, CLOSE, LIFT, CARRY, LOWER, RELEASE, RETREAT = range(8)

CRUISE_M = 0.15  # tool above the cube's or bowl's resting height while travelling
ALIGNED_M = 0.02  # sideways error at which the tool may descend
LOST_ALIGNMENT_M = 0.05  # and at which it goes back up
DESCENT_PATIENCE_STEPS = 100  # on the way down for longer than this, something is under a finger
LOST_M = 0.035  # a cube this far from a closed gripper has been dropped
AT_HEIGHT_M = 0.012
CARRY_SPEED_M_S = 0.2  # base speed at which the cube may be lowered
GRIP_STEPS = 3  # contact on both pads before lifting; a policy cannot see how long it has waited
GRIP_PATIENCE_STEPS = 60  # closing for longer than this is a miss
DROP_GATE_M = 0.055  # cube above the bowl's underside at which it may be let go
DROP_TARGET_M = 0.035  # beyond its gate, so that the gate is passed at speed
LIFT_LEAD_M = 0.015  # sent up by this much at first, by more as it rises: a lift started too soon pulls little
NOISE_ON_THE_WAY, NOISE_IN_FINE_WORK = 0.5, 0.2  # a command that wanders by a centimetre comes down on the cube
DESCENT_LEAD_M = 0.08  # how far ahead of itself the tool is sent while it goes down
OPEN_ENOUGH = 0.8
FINGER_CLEAR_M = 0.05  # tool above the cube where open fingers just pass over it
FINGER_ROOM_M = 0.012  # between an open finger and the cube where the bowl is near
BESIDE_BOWL_M = 0.16  # a cube nearer to the bowl is gripped by the faces that do not face it

cube_yaw = measured.number(pick_place.cube_yaw)


class PickPlaceExpert(Expert):
    """Object-centred way-points, a regrasp whenever the cube is not where it should be.

    Attributes:
        cube: name of its site. grips: names of what feels it between the pads.
    """

    cube: ClassVar[str] = "cube"
    grips: ClassVar[tuple[str, str]] = ("grip_left", "grip_right")
    phase_names = ("hover", "descend", "close", "lift", "carry", "lower", "release", "retreat")
    travels = (HOVER, CARRY)

    def first_phase(self) -> np.ndarray:
        return np.where(self._held(), LIFT, HOVER)

    def next_phase(self) -> np.ndarray:
        view = self.view
        cube, bowl, tool = view.site_pos(self.cube), view.site_pos("bowl"), view.tool_pos
        beside_cube, beside_bowl = planar_length(cube - tool), planar_length(bowl - cube)
        over_cube = (beside_cube <= self._room()) & self._facing_cube()
        at_cube = over_cube & (tool[:, 2] - cube[:, 2] <= AT_HEIGHT_M)
        held = self._held()
        lifted = tool[:, 2] >= TABLE_HEIGHT_M + CUBE_HALF_M + CRUISE_M - 0.03
        low = cube[:, 2] - bowl[:, 2] <= DROP_GATE_M
        lost = (self.timer > 5) & ~held & (length(cube - tool) > LOST_M)  # a pad may leave a held cube for an instant
        slow = planar_length(view.base_vel) <= CARRY_SPEED_M_S
        inside = planar_length(cube - bowl) <= IN_BOWL_M
        gone_up = tool[:, 2] >= bowl[:, 2] + CRUISE_M
        rules = (
            (HOVER, inside & ~held, RETREAT),
            (HOVER, over_cube & (tool[:, 2] <= cube[:, 2] + CRUISE_M + 0.05), DESCEND),
            (DESCEND, inside & ~held, RETREAT),
            (DESCEND, (beside_cube > LOST_ALIGNMENT_M) | (self.timer > DESCENT_PATIENCE_STEPS), HOVER),
            (DESCEND, at_cube, CLOSE),
            (CLOSE, held & (self.timer >= GRIP_STEPS), LIFT),
            (CLOSE, self.timer > GRIP_PATIENCE_STEPS, HOVER),
            (LIFT, lost, HOVER),
            (LIFT, lifted, CARRY),
            (CARRY, lost, HOVER),
            (CARRY, (beside_bowl <= ALIGNED_M) & slow, LOWER),
            (LOWER, lost & ~inside, HOVER),
            (LOWER, beside_bowl > LOST_ALIGNMENT_M, CARRY),
            (LOWER, (low & (beside_bowl <= ALIGNED_M)) | (lost & inside), RELEASE),
            (RELEASE, view.gripper[:, 0] >= OPEN_ENOUGH, RETREAT),
            (RETREAT, gone_up & ~inside, HOVER),
        )
        return self.following(rules)

    def command(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        view, phase = self.view, self.phase
        cube, bowl, tool = view.site_pos(self.cube), view.site_pos("bowl"), view.tool_pos
        to_cube = (phase == HOVER) | (phase == DESCEND) | (phase == CLOSE)
        down = tool[:, 2] - DESCENT_LEAD_M
        drop = bowl[:, 2] + DROP_TARGET_M + tool[:, 2] - cube[:, 2]
        height = np.select(
            [phase == p for p in range(8)],
            [
                cube[:, 2] + CRUISE_M,
                np.maximum(cube[:, 2] + np.where(self._over_faces(), 0.0, FINGER_CLEAR_M), down),
                cube[:, 2],
                self._lift_height(),
                bowl[:, 2] + CUBE_HALF_M + CRUISE_M,
                np.maximum(drop, down),
                bowl[:, 2] + DROP_TARGET_M,
                bowl[:, 2] + CRUISE_M + 0.1,
            ],
        )
        over_bowl = bowl[:, :2] + np.where((phase <= LOWER)[:, None], tool[:, :2] - cube[:, :2], 0.0)
        sideways = np.where(to_cube[:, None], cube[:, :2], over_bowl)
        sideways = np.where((phase == LIFT)[:, None], tool[:, :2], sideways)
        yaw = np.where(to_cube, self._cube_yaw(), 0.0)
        narrow = (CUBE_HALF_M + FINGER_ROOM_M) / view.robot.gripper.stroke
        ready = np.where(to_cube & self._beside_bowl(), min(1.0, narrow), 1.0)
        gripper = np.where((phase >= CLOSE) & (phase <= LOWER), 0.0, ready)
        return np.concatenate([sideways, height[:, None]], axis=1), pointing_down(yaw), gripper

    def noise_share(self) -> np.ndarray:
        fine = (self.phase == DESCEND) | (self.phase == CLOSE)
        return np.where(fine, NOISE_IN_FINE_WORK, NOISE_ON_THE_WAY)

    def _lift_height(self) -> np.ndarray:
        """(n,) height, m, at which the tool is sent up with the cube: the farther, the higher it is already."""
        raised = np.maximum(self.view.site_pos(self.cube)[:, 2] - TABLE_HEIGHT_M - CUBE_HALF_M, 0.0)
        top = TABLE_HEIGHT_M + CUBE_HALF_M + CRUISE_M
        return np.minimum(top, self.view.tool_pos[:, 2] + LIFT_LEAD_M + raised)

    def _held(self) -> np.ndarray:
        left, right = (self.view.touching(name) for name in self.grips)
        return left & right

    def _cube_yaw(self) -> np.ndarray:
        """(n,) heading at which the fingers meet two faces of the cube, in ±45° unless the bowl is in their way."""
        yaw = cube_yaw(self.view)
        to_bowl = self.view.site_pos("bowl") - self.view.site_pos(self.cube)
        along_fingers = -np.sin(yaw) * to_bowl[:, 0] + np.cos(yaw) * to_bowl[:, 1]
        across = np.cos(yaw) * to_bowl[:, 0] + np.sin(yaw) * to_bowl[:, 1]
        blocked = self._beside_bowl() & (np.abs(along_fingers) > np.abs(across))
        return np.where(blocked, yaw - np.copysign(0.5 * np.pi, yaw), yaw)

    def _room(self) -> float:
        """Sideways error at which no finger comes down on the cube, m."""
        return min(ALIGNED_M, self.view.robot.gripper.stroke - CUBE_HALF_M)

    def _over_faces(self) -> np.ndarray:
        """(n,) bool: the fingers are down beside the cube, or may go down there without touching its top."""
        above = self.view.tool_pos - self.view.site_pos(self.cube)
        return (planar_length(above) <= self._room()) | (above[:, 2] < 0.5 * FINGER_CLEAR_M)

    def _beside_bowl(self) -> np.ndarray:
        """(n,) bool: the cube stands so near to the bowl that a finger may have no room between them."""
        return planar_length(self.view.site_pos("bowl") - self.view.site_pos(self.cube)) < BESIDE_BOWL_M

    def _facing_cube(self) -> np.ndarray:
        """(n,) bool: the fingers are within 8° of two of the cube's faces."""
        mat, yaw = self.view.tool_mat, self._cube_yaw()
        y_axis = mat[:, [1, 4]]  # first two entries of the tool's y axis
        return -np.sin(yaw) * y_axis[:, 0] + np.cos(yaw) * y_axis[:, 1] >= np.cos(np.deg2rad(8.0))


EXPERT = PickPlaceExpert
