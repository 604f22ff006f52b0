"""Expert for tossing a ball: take it, raise it behind a line, run up, let go when it would land in the bin."""

import numpy as np

from aerial_il.control.vehicle import GRAVITY
from aerial_il.core.arrays import length, planar_length
from aerial_il.experts.expert import Expert, pointing_down
from aerial_il.suite.episode import measured
from aerial_il.suite.props.toss import BALL_RADIUS_M, BIN_WALL_M
from aerial_il.suite.tasks import toss_ball
from aerial_il.suite.tasks.toss_ball import THROW_HEIGHT_M

HOVER, DESCEND, CLOSE, LIFT, AIM, RUN, STAY = range(7)

CRUISE_M, DESCENT_LEAD_M = 0.10, 0.08
ALIGNED_M, LOST_ALIGNMENT_M, AT_HEIGHT_M = 0.012, 0.04, 0.008
FINGER_CLEAR_M = 0.05  # tool above the ball where open fingers just pass over it
GRIP_STEPS, GRIP_PATIENCE_STEPS = 5, 60
DROPPED_M = 0.05
RUN_UP_M = 0.75  # from where it lets go to where it starts
READY_M, READY_M_S, POINTING_COS = 0.04, 0.05, np.cos(np.deg2rad(3.0))
TOO_NEAR_M = 0.13  # to the fence, with the ball still in the gripper
OPENING_S = 0.03  # from the command to the moment at which the fingers have let go
AIM_SHORT_M = 0.06  # of the bin's middle: the base has farther to brake before the fence
STRAY_M_S, FASTEST_M_S = 0.2, 0.95  # of the ball off the line, and along it: while the arm still swings it holds on

outside = measured.number(toss_ball.outside)
in_bin, grasped = measured.truth(toss_ball.in_bin), measured.truth(toss_ball.grasped)


class TossBallExpert(Expert):
    """The tool points at the bin and runs towards it; it lets go when the parabola from here ends in the bin."""

    phase_names = ("hover", "descend", "close", "lift", "aim", "run", "stay")
    lead_m = 0.25  # at which it is sent at full speed

    def first_phase(self) -> np.ndarray:
        return np.where(grasped(self.view), LIFT, np.where(self._gone(), STAY, HOVER))

    def next_phase(self) -> np.ndarray:
        view = self.view
        ball, tool = view.site_pos("ball"), view.tool_pos
        beside, held = planar_length(ball - tool), grasped(view)
        aligned = self._aligned()
        dropped = (length(ball - tool) > DROPPED_M) & ~held
        at_start = length(self._on_line(self._start_m()) - tool) <= READY_M
        rules = (
            (HOVER, self._gone(), STAY),
            (HOVER, aligned & (tool[:, 2] <= ball[:, 2] + CRUISE_M + 0.05), DESCEND),
            (DESCEND, beside > LOST_ALIGNMENT_M, HOVER),
            (DESCEND, aligned & (tool[:, 2] - ball[:, 2] <= AT_HEIGHT_M), CLOSE),
            (CLOSE, held & (self.timer >= GRIP_STEPS), LIFT),
            (CLOSE, self.timer > GRIP_PATIENCE_STEPS, HOVER),
            (LIFT, dropped, HOVER),
            (LIFT, tool[:, 2] >= THROW_HEIGHT_M - 0.1, AIM),
            (AIM, dropped, HOVER),
            (AIM, at_start & (length(view.base_vel) <= READY_M_S) & self._pointing(), RUN),
            (RUN, dropped, STAY),
            (RUN, (self._short_by() <= 0.0) & self._steady(), STAY),
            (RUN, outside(view) < TOO_NEAR_M, AIM),
        )
        return self.following(rules)

    def command(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        view, phase = self.view, self.phase
        ball, tool = view.site_pos("ball"), view.tool_pos
        over, down, up = ball.copy(), ball.copy(), tool.copy()
        over[:, 2] += CRUISE_M
        beside_it = self._aligned() | (tool[:, 2] < ball[:, 2] + 0.5 * FINGER_CLEAR_M)
        down[:, 2] = np.maximum(ball[:, 2] + np.where(beside_it, 0.0, FINGER_CLEAR_M), tool[:, 2] - DESCENT_LEAD_M)
        up[:, 2] = THROW_HEIGHT_M
        places = [over, down, ball, up, self._on_line(self._start_m()), self._on_line(self._along() - self.lead_m)]
        places.append(places[AIM])
        position = np.select([(phase == p)[:, None] for p in range(7)], places)
        x, y, zero = self._line()[:, 0], self._line()[:, 1], np.zeros(view.n)
        level = np.stack([x, y, zero, -y, x, zero], axis=1)
        rot6d = np.where((phase >= AIM)[:, None], level, pointing_down(np.arctan2(y, x)))
        gripper = np.where((phase >= CLOSE) & (phase <= RUN), 0.0, 1.0)
        return position, rot6d, gripper

    def _aligned(self) -> np.ndarray:
        """(n,) bool: no finger comes down on the ball."""
        beside = planar_length(self.view.site_pos("ball") - self.view.tool_pos)
        return beside <= min(ALIGNED_M, self.view.robot.gripper.stroke - BALL_RADIUS_M)

    def _line(self) -> np.ndarray:
        """(n, 3) level unit vector of the throw: from the tee to the bin."""
        way = (self.view.site_pos("bin") - self.view.site_pos("tee")) * [1.0, 1.0, 0.0]
        return way / length(way)[:, None]

    def _along(self) -> np.ndarray:
        """(n,) how far the tool is from the bin along the line, m."""
        return ((self.view.site_pos("bin") - self.view.tool_pos) * self._line()).sum(axis=1)

    def _on_line(self, away: np.ndarray) -> np.ndarray:
        """(n, 3) point of the line, at the height of the throw, ``away`` (n,) m before the bin."""
        point = self.view.site_pos("bin") - away[:, None] * self._line()
        point[:, 2] = THROW_HEIGHT_M
        return point

    def _start_m(self) -> np.ndarray:
        """(n,) how far from the bin the run-up starts, m."""
        reach = self.view.robot.tool_at(self.view.robot.rest_forward)[0][0]
        return np.full(self.view.n, toss_ball.fence_radius(self.view.robot) - reach + RUN_UP_M)

    def _pointing(self) -> np.ndarray:
        """(n,) bool: the tool points at the bin."""
        return (self.view.tool_mat[:, 0::3] * self._line()).sum(axis=1) >= POINTING_COS

    def _short_by(self) -> np.ndarray:
        """(n,) by how much the ball would fall short of where it is to land, m, if it were let go now."""
        view, vel, ball = self.view, self._ball_vel(), self.view.site_pos("ball")
        drop = np.maximum(ball[:, 2] - BIN_WALL_M, 0.0)
        flight = (vel[:, 2] + np.sqrt(vel[:, 2] ** 2 + 2.0 * GRAVITY * drop)) / GRAVITY
        landing = (vel * self._line()).sum(axis=1) * (flight + OPENING_S)
        return ((view.site_pos("bin") - ball) * self._line()).sum(axis=1) - AIM_SHORT_M - landing

    def _steady(self) -> np.ndarray:
        """(n,) bool: the ball goes along the line of the throw, at the speed at which a tool is led."""
        velocity, line = self._ball_vel(), self._line()
        along = (velocity * line).sum(axis=1)
        return (length(velocity - along[:, None] * line) <= STRAY_M_S) & (along <= FASTEST_M_S)

    def _ball_vel(self) -> np.ndarray:
        _, speed = self.view.free_joint("ball")
        return self.view.qvel[:, speed][:, :3]

    def _gone(self) -> np.ndarray:
        """(n,) bool: the ball is in the bin or on its way."""
        return in_bin(self.view) | (planar_length(self.view.site_pos("bin") - self.view.site_pos("ball")) < 0.5)


EXPERT = TossBallExpert
