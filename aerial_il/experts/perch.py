"""Expert for perching: come down on the bar, grip it, lean on it until the rotors stop, stand, and fly off."""

import numpy as np

from aerial_il.experts.expert import Expert, pointing_down
from aerial_il.suite.episode import measured
from aerial_il.suite.props.perch import BAR_HALF_M
from aerial_il.suite.tasks import perch

HOVER, DESCEND, CLOSE, STAND, RISE, RELEASE, LEAVE = range(7)

OVER_M = 0.12  # of the tool over the bar's middle where it is brought into line
ALIGNED_M, LOST_ALIGNMENT_M = 0.008, 0.025  # across the bar: where it goes down, and where it goes up again
FACING_COS = np.cos(np.deg2rad(6.0))
SEATED_M = 0.004  # of the palm over the bar
LEAD_DOWN_M = 0.06  # how far ahead of itself the tool is sent while it goes down
SUNK_M = 0.3  # below itself, while it stands
GRIP_STEPS, GRIP_PATIENCE_STEPS, PATIENCE_STEPS = 5, 60, 60
FLYING_SHARE, FLYING_STEPS = 0.9, 10  # of the weight that the rotors bear before it lets go of the bar
WIDE = 0.85
CLOSING = 0.1  # of the opening, ahead of the fingers: they meet the bar softly
GONE_M = perch.AWAY_M + 0.08

offset = measured.vector(perch.offset)
clamped = measured.truth(perch.clamped)
thrust_share = measured.number(perch.thrust_share)


class PerchExpert(Expert):
    """The gripper's palm is set on the bar; a command far below then makes the rotors stop, one above starts them."""

    phase_names = ("hover", "descend", "close", "stand", "rise", "release", "leave")
    lead_m = SUNK_M

    def first_phase(self) -> np.ndarray:
        held = np.where(self._done(), RISE, STAND)
        return np.where(clamped(self.view), held, np.where(self._done(), LEAVE, HOVER))

    def next_phase(self) -> np.ndarray:
        across, held, done = np.abs(offset(self.view)[:, 1]), clamped(self.view), self._done()
        facing = np.cos(self._bar() - self._heading()) >= FACING_COS
        over = (across <= ALIGNED_M) & facing & (np.abs(offset(self.view)[:, 0]) <= 0.03)
        flying = (thrust_share(self.view) >= FLYING_SHARE) & (self.timer >= FLYING_STEPS)
        rules = (
            (HOVER, over, DESCEND),
            (DESCEND, (across > LOST_ALIGNMENT_M) | (self.timer > PATIENCE_STEPS), HOVER),
            (DESCEND, offset(self.view)[:, 2] <= self._seat() + SEATED_M, CLOSE),
            (CLOSE, held & (self.timer >= GRIP_STEPS), STAND),
            (CLOSE, self.timer > GRIP_PATIENCE_STEPS, HOVER),
            (STAND, ~held & (self.timer > GRIP_STEPS), HOVER),
            (STAND, done, RISE),
            (RISE, flying, RELEASE),
            (RELEASE, self.view.gripper[:, 0] >= WIDE, LEAVE),
        )
        return self.following(rules)

    def command(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        view, phase, bar = self.view, self.phase, self.view.site_pos("perch")
        tool, seat = view.tool_pos, bar[:, 2] + self._seat()
        heights = [
            bar[:, 2] + OVER_M,
            np.maximum(seat, tool[:, 2] - LEAD_DOWN_M),
            seat,
            tool[:, 2] - SUNK_M,
            tool[:, 2],
            tool[:, 2],
            bar[:, 2] + GONE_M,
        ]
        target = np.concatenate([bar[:, :2], np.choose(phase, heights)[:, None]], axis=1)
        target[:, :2] = np.where(((phase >= STAND) & (phase < LEAVE))[:, None], tool[:, :2], target[:, :2])
        opening = view.gripper[:, 0]
        met = view.robot.gripper.stroke * opening <= BAR_HALF_M[1] + 0.5 * perch.GRIP_SLACK_M
        closing = np.where(met, 0.0, np.maximum(opening - CLOSING, 0.0))
        opening = np.select([phase < CLOSE, phase == CLOSE, phase <= RISE], [1.0, closing, 0.0], 1.0)
        return target, pointing_down(self._bar()), opening

    def noise_share(self) -> np.ndarray:
        return np.choose(self.phase, [1.0, 0.2, 0.0, 0.0, 0.0, 0.0, 0.5])

    def _done(self) -> np.ndarray:
        """(n,) bool: it has stood for long enough."""
        return self.view.task_state[:, perch.DONE] > 0.0

    def _seat(self) -> float:
        """Height of the tool over the bar's middle with the palm on the bar, m."""
        gripper = self.view.robot.gripper
        return BAR_HALF_M[2] - gripper.tool_distance + gripper.palm_half

    def _bar(self) -> np.ndarray:
        """(n,) heading along the bar, of both the nearer to the tool's, rad."""
        mat, now = self.view.site_mat("perch"), self._heading()
        yaw = np.arctan2(mat[:, 3], mat[:, 0])
        return now + (yaw - now + 0.5 * np.pi) % np.pi - 0.5 * np.pi

    def _heading(self) -> np.ndarray:
        """(n,) heading of the tool, rad."""
        mat = self.view.tool_mat
        return np.arctan2(-mat[:, 1], mat[:, 4])


EXPERT = PerchExpert
