"""Expert for inserting a peg: hover, descend, close, lift, carry, insert, release; a lost one is picked up again."""

from typing import ClassVar

import numpy as np

from aerial_il.core.arrays import planar_length
from aerial_il.experts.expert import Expert, pointing_down
from aerial_il.suite.episode import measured
from aerial_il.suite.props import TABLE_HEIGHT_M
from aerial_il.suite.props.peg import CHAMFER_M, PEG_LENGTH_M, PEG_RADIUS_M
from aerial_il.suite.tasks import insert_peg
from aerial_il.suite.tasks.insert_peg import INSERTED_M

HOVER, DESCEND, CLOSE, LIFT, CARRY, INSERT, RELEASE, RETREAT = range(8)

CRUISE_M = 0.10  # tool above the place to grasp at
ALIGNED_M, LOST_ALIGNMENT_M = 0.015, 0.03  # sideways error at which the open gripper may descend, and goes back up
CLOSING_M = 0.007  # and at which it may close: pads are barely wider than the peg
AT_HEIGHT_M = 0.006
GRIP_M = 0.020  # from the tool to the peg's end: a tool that comes down too far does not push the palm onto the peg
FACING_COS = np.cos(np.deg2rad(10.0))
DESCENT_LEAD_M = 0.08  # how far ahead of itself the tool is sent while it goes down
LOST_GAP_M = 1.4 * PEG_RADIUS_M  # between the pads
NARROW_M = 0.05  # between the pads on the way down to a peg that lies: what stands beside it is not to be touched
GRIP_STEPS, GRIP_PATIENCE_STEPS = 3, 60
LIFT_LEAD_M = 0.015  # sent up by this much at first, by more as it rises: a lift started too soon pulls little
LYING_COS = 0.3  # a peg leaning more than this is grasped near its forward end instead of its upper one
LEANING = 0.15  # sine of the lean from which on the fingers turn to close across it
CARRY_HEIGHT_M = 0.10  # of the peg's lower end above the table: clear of stand and socket
ABOVE_HOLE_M = 0.02  # of the lower end above the chamfer, before it goes in
ENTRY_M, LEAVE_M = 0.005, 0.016  # sideways error of the lower end at which it goes down, and comes up again
ENTRY_COS, LEAVE_COS = np.cos(np.deg2rad(4.0)), np.cos(np.deg2rad(10.0))  # the same for its lean
ENTRY_PATIENCE_STEPS = 100  # pressing on the rim for longer than this is a miss
ENTRY_SPEED_M_S = 0.06
PUSH_LEAD_M = 0.03  # how far below itself the lower end is sent
DEPTH_MARGIN_M = 0.004  # beyond what is asked for, before the peg is let go
OPEN_ENOUGH, RETREAT_M = 0.8, 0.12
NOISE_ON_THE_WAY = 0.5
FINE_WORK_M, NOISE_IN_FINE_WORK = 0.05, 0.2  # a command that wanders by a centimetre meets neither peg nor bore

depth = measured.number(insert_peg.depth)
lower_end, peg_axis = measured.vector(insert_peg.lower_end), measured.vector(insert_peg.peg_axis)


class InsertPegExpert(Expert):
    """Servo the peg's lower end, not the tool: however it sits in the gripper, it is held upright over the hole."""

    phase_names = ("hover", "descend", "close", "lift", "carry", "insert", "release", "retreat")
    travels = (HOVER, CARRY)
    carry_height_m: ClassVar[float] = CARRY_HEIGHT_M

    def first_phase(self) -> np.ndarray:
        held = self._held()
        inside = self._depth()
        phase = np.where(held & (inside > 0.0), INSERT, np.where(held, LIFT, HOVER))
        return np.where(inside >= INSERTED_M, RELEASE, phase)

    def next_phase(self) -> np.ndarray:
        view = self.view
        tool, end, hole, grasp = view.tool_pos, self._lower_end(), self._hole(), self._grasp()[0]
        beside, beside_hole = planar_length(grasp - tool), planar_length(end - hole)
        over = (beside <= ALIGNED_M) & self._facing_peg()
        held, inside = self._held(), self._depth()
        lost = self._lost()
        upright, straight = (self._axis()[:, 2] >= limit for limit in (ENTRY_COS, LEAVE_COS))
        ready = (beside_hole <= ENTRY_M) & upright & (planar_length(view.base_vel) <= ENTRY_SPEED_M_S)
        low = end[:, 2] <= hole[:, 2] + CHAMFER_M + ABOVE_HOLE_M + 0.02
        out = end[:, 2] > hole[:, 2] - PEG_RADIUS_M
        rules = (
            (HOVER, over & (tool[:, 2] <= grasp[:, 2] + CRUISE_M + 0.04), DESCEND),
            (DESCEND, beside > LOST_ALIGNMENT_M, HOVER),
            (DESCEND, over & (beside <= CLOSING_M) & (tool[:, 2] - grasp[:, 2] <= AT_HEIGHT_M), CLOSE),
            (CLOSE, held & (self.timer >= GRIP_STEPS) & (inside > 0.0), INSERT),
            (CLOSE, held & (self.timer >= GRIP_STEPS), LIFT),
            (CLOSE, self.timer > GRIP_PATIENCE_STEPS, HOVER),
            (LIFT, lost, HOVER),
            (LIFT, end[:, 2] >= TABLE_HEIGHT_M + self.carry_height_m - 0.02, CARRY),
            (CARRY, lost, HOVER),
            (CARRY, ready & low, INSERT),
            (INSERT, inside >= INSERTED_M + DEPTH_MARGIN_M, RELEASE),
            (INSERT, lost, HOVER),
            (INSERT, out & ((beside_hole > LEAVE_M) | ~straight), CARRY),
            (INSERT, out & (self.timer > ENTRY_PATIENCE_STEPS), CARRY),
            (RELEASE, view.gripper[:, 0] >= OPEN_ENOUGH, RETREAT),
            (RETREAT, inside < INSERTED_M, HOVER),
        )
        return self.following(rules)

    def command(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        view, phase = self.view, self.phase
        grasp, heading = self._grasp()
        down = np.maximum(grasp[:, 2], view.tool_pos[:, 2] - DESCENT_LEAD_M)
        height = np.where(phase == HOVER, grasp[:, 2] + CRUISE_M, np.where(phase == DESCEND, down, grasp[:, 2]))
        picking = np.concatenate([grasp[:, :2], height[:, None]], axis=1)
        position, rot6d = picking, pointing_down(heading)
        carrying, leaving = (phase == CARRY) | (phase == INSERT), phase >= RELEASE
        for here, (there, turned) in (
            (phase == LIFT, self._lift()), (carrying, self._carry()), (leaving, self._leave())
        ):  # fmt: skip
            position = np.where(here[:, None], there, position)
            rot6d = np.where(here[:, None], turned, rot6d)
        narrow = min(1.0, NARROW_M / (2.0 * view.robot.gripper.stroke))
        opening = np.where((phase == DESCEND) & (self._axis()[:, 2] < LYING_COS), narrow, 1.0)
        return position, rot6d, np.where((phase >= CLOSE) & ~leaving, 0.0, opening)

    def noise_share(self) -> np.ndarray:
        beside_hole = planar_length(self._lower_end() - self._hole())
        picking, inserting = (self.phase == DESCEND) | (self.phase == CLOSE), self.phase == INSERT
        fine = picking | inserting | ((self.phase == CARRY) & (beside_hole <= FINE_WORK_M))
        return np.where(fine, NOISE_IN_FINE_WORK, NOISE_ON_THE_WAY)

    def _peg(self) -> np.ndarray:
        """(n, 3) middle of the peg, world, m."""
        return self.view.site_pos("peg")

    def _axis(self) -> np.ndarray:
        """(n, 3) unit vector from its lower end to its upper one."""
        return peg_axis(self.view)

    def _hole(self) -> np.ndarray:
        """(n, 3) mouth of the hole in which it goes, world, m."""
        return self.view.site_pos("hole")

    def _lower_end(self) -> np.ndarray:
        """(n, 3) its lower end, world, m."""
        return lower_end(self.view)

    def _depth(self) -> np.ndarray:
        """(n,) how deep it is in, m."""
        return depth(self.view)

    def _held(self) -> np.ndarray:
        """(n,) bool: it is between the pads."""
        return self.view.touching("grip_left") & self.view.touching("grip_right")

    def _lost(self) -> np.ndarray:
        """(n,) bool: the fingers have closed on nothing; that one pad lifts off for a moment means little."""
        view = self.view
        gap = 2.0 * view.robot.gripper.stroke * view.gripper[:, 0]
        return (gap < LOST_GAP_M) & ~self._held()

    def _grasp(self) -> tuple[np.ndarray, np.ndarray]:
        """Grasp of the peg: position of the tool, (n, 3) m, and its heading there, (n,) rad within ±90°.

        An upright peg is taken near its upper end. One that lies is taken near the end that points forward, which
        comes to be the upper end when the tool is raised.
        """
        view, axis = self.view, self._axis()
        forward = np.where(axis[:, :1] < 0.0, -axis, axis)
        leaning = planar_length(axis) > LEANING
        heading = np.where(leaning, np.arctan2(forward[:, 1], forward[:, 0]), 0.0)
        lying = axis[:, 2] < LYING_COS
        along = np.where(lying[:, None], forward, axis)
        place = self._peg() + (0.5 * PEG_LENGTH_M - GRIP_M) * along
        place[:, 2] += np.where(lying, max(0.0, view.robot.gripper.tip_distance - PEG_RADIUS_M), 0.0)
        return place, heading

    def _lift(self) -> tuple[np.ndarray, np.ndarray]:
        """Tool position (n, 3) and rot6d (n, 6) that take the peg straight up."""
        raised = self._lower_end()[:, 2] - TABLE_HEIGHT_M
        return self._straight_up(np.minimum(self.carry_height_m - raised, LIFT_LEAD_M + np.maximum(raised, 0.0)))

    def _leave(self) -> tuple[np.ndarray, np.ndarray]:
        """Tool position (n, 3) and rot6d (n, 6) while it opens and then backs off upwards."""
        over = self._hole()[:, 2] + 0.5 * PEG_LENGTH_M + RETREAT_M - self.view.tool_pos[:, 2]
        return self._straight_up(np.where(self.phase == RETREAT, over, 0.0))

    def _straight_up(self, height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Tool position (n, 3) raised by ``height`` (n,) m, and its present heading and pitch as rot6d (n, 6)."""
        view = self.view
        ahead, side = view.tool_mat[:, [0, 3, 6]], view.tool_mat[:, [1, 4, 7]]
        position = view.tool_pos.copy()
        position[:, 2] += height
        heading, pitch = np.arctan2(-side[:, 0], side[:, 1]), np.arctan2(-ahead[:, 2], planar_length(ahead))
        return position, _yaw_and_pitch(heading, pitch)

    def _carry(self) -> tuple[np.ndarray, np.ndarray]:
        """Tool position (n, 3) and rot6d (n, 6) that hold the peg upright with its lower end where it is to be."""
        view = self.view
        axis = _into(view.tool_mat, self._axis())
        upwards = np.where((axis[:, 2] < axis[:, 0])[:, None], -axis, axis)  # the end that the raised tool has on top
        middle = _into(view.tool_mat, self._peg() - view.tool_pos)
        rot6d = _yaw_and_pitch(np.zeros(view.n), np.arctan2(-upwards[:, 0], upwards[:, 2]))
        end = middle - 0.5 * PEG_LENGTH_M * upwards
        position = self._end_target() - _out_of(rot6d, end)
        guided = (self.phase == INSERT) & (self._depth() > 0.0)  # by the bore: give way sideways instead of wedging
        position[:, :2] = np.where(guided[:, None], view.tool_pos[:, :2], position[:, :2])
        return position, rot6d

    def _end_target(self) -> np.ndarray:
        """(n, 3) where the peg's lower end is to go, world, m."""
        hole, end = self._hole(), self._lower_end()
        bottom = hole[:, 2] - PEG_RADIUS_M - INSERTED_M - 2.0 * DEPTH_MARGIN_M
        beside = planar_length(end - hole)
        aligned = np.clip((LEAVE_M - beside) / (LEAVE_M - ENTRY_M), 0.0, 1.0)
        down = np.maximum(bottom, end[:, 2] - PUSH_LEAD_M * aligned)
        far = beside > 0.03
        above = np.where(far, TABLE_HEIGHT_M + self.carry_height_m, hole[:, 2] + CHAMFER_M + ABOVE_HOLE_M)
        height = np.where(self.phase == INSERT, down, above)
        return np.concatenate([hole[:, :2], height[:, None]], axis=1)

    def _facing_peg(self) -> np.ndarray:
        """(n,) bool: the fingers are turned as wanted."""
        y_axis, yaw = self.view.tool_mat[:, [1, 4]], self._grasp()[1]
        return -np.sin(yaw) * y_axis[:, 0] + np.cos(yaw) * y_axis[:, 1] >= FACING_COS


def _into(mat: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """World vector (n, 3) in the frame of ``mat`` (n, 9), world from frame."""
    return mat[:, 0:3] * vector[:, 0:1] + mat[:, 3:6] * vector[:, 1:2] + mat[:, 6:9] * vector[:, 2:3]


def _out_of(rot6d: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Vector (n, 3) of a frame in the world; ``rot6d`` (n, 6): world from frame."""
    x, y = rot6d[:, :3], rot6d[:, 3:]
    z = np.cross(x, y)
    return x * vector[:, 0:1] + y * vector[:, 1:2] + z * vector[:, 2:3]


def _yaw_and_pitch(yaw: np.ndarray, pitch: np.ndarray) -> np.ndarray:
    """rot6d (n, 6) of a tool with heading ``yaw`` and downward pitch ``pitch`` (n,) rad."""
    c, s, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    return np.stack([c * cp, s * cp, -sp, -s, c, np.zeros_like(yaw)], axis=1)


EXPERT = InsertPegExpert
