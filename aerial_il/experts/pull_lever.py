"""Expert for the lever: go down behind the crossbar, pull it along its arc."""

import numpy as np

from aerial_il.experts.hook import HookExpert
from aerial_il.suite.episode import measured
from aerial_il.suite.props.lever import BAR_RADIUS_M, LEVER_M
from aerial_il.suite.tasks import pull_lever
from aerial_il.suite.tasks.pull_lever import PULLED_RAD, SWING_RAD_S

BEYOND_RAD = 0.2  # how far past the pin it is pulled at the end

hooked, behind_bar = measured.truth(pull_lever.hooked), measured.vector(pull_lever.behind_bar)


class PullLeverExpert(HookExpert):
    """The tool faces the lever and pulls it towards the vehicle."""

    tolerance_m = (0.018, 0.03)

    def entry(self) -> tuple[np.ndarray, np.ndarray]:
        return behind_bar(self.view), self._heading()

    def hooked(self) -> np.ndarray:
        return hooked(self.view)

    def ahead(self) -> tuple[np.ndarray, np.ndarray]:
        view = self.view
        angle, rate = view.joint("lever")
        push = np.minimum(self.push(rate / SWING_RAD_S), (PULLED_RAD + BEYOND_RAD - angle) * LEVER_M)
        direction, arm = view.site_mat("lever")[:, [0, 3, 6]], (view.site_pos("bar") - view.site_pos("lever")) / LEVER_M
        forward = direction[:, 0] * arm[:, 0] + direction[:, 1] * arm[:, 1]
        level = push * arm[:, 2] - view.robot.gripper.pad_height - BAR_RADIUS_M
        target = view.site_pos("bar") + level[:, None] * direction
        target[:, 2] -= push * forward
        return target, self._heading()

    def _heading(self) -> np.ndarray:
        """(n,) heading against the pull, rad."""
        mat = self.view.site_mat("lever")
        return np.arctan2(-mat[:, 3], -mat[:, 0])


EXPERT = PullLeverExpert
