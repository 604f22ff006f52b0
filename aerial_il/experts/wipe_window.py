"""Expert for the window: stand off, press by a force loop, slide from each patch to the nearest that is left."""

import numpy as np

from aerial_il.core.arrays import length
from aerial_il.experts.expert import Expert, facing, turned_towards
from aerial_il.suite.episode import measured
from aerial_il.suite.props.window import PANE_HALF_M, PRELOAD_N, STIFFNESS
from aerial_il.suite.tasks import wipe_window
from aerial_il.suite.tasks.wipe_window import FORCE_N, FORCE_TOLERANCE_N, WIPED_SHARE

APPROACH, WIPE, LEAVE = range(3)

STAND_OFF_M = 0.06  # of the fingertips over the pane
ARRIVED_M = 0.03
LIFTED_M = 0.12  # fingertips farther from the pane have left it
LOST_COS = np.cos(np.deg2rad(25.0))  # so far off square, or over the edge of the pane, it had better start anew
CLEAR_M = 0.03  # of the fingertips over the pane: from there they may travel along it
ALIGNED_M, ALIGNED_COS = 0.03, np.cos(np.deg2rad(12.0))  # off the patch and off square when it may touch the pane
STROKE_M = 0.02  # how far ahead of themselves the fingertips are sent along the pane, with the right force
PASSED_M = 0.012  # off the middle of a patch: nearer, they slide on over it
SLOW = 0.3  # share of that with a wrong one
AIM_N = 5.2  # the loop has no integral part, so that it depends on the present alone
TURN_RAD = 0.3  # the tool is turned at most this far ahead: else a long arm runs into its joints' stops
COMPLIANCE_M_N = 0.008  # of the admittance: depth added per newton that is missing
NOISE_WHILE_WIPING = 0.2

normal_force, wiped_share = measured.number(wipe_window.normal_force), measured.number(wipe_window.wiped_share)
tip_on_pane, tip_to_dirt = measured.vector(wipe_window.tip_on_pane), measured.vector(wipe_window.tip_to_dirt)
ahead_of_trail = measured.vector(wipe_window.ahead_of_trail)
in_touch = measured.truth(wipe_window.in_touch)


class WipeWindowExpert(Expert):
    """Admittance control along the normal, a stroke of constant length along the pane: it passes over each patch."""

    phase_names = ("approach", "wipe", "leave")

    def first_phase(self) -> np.ndarray:
        return np.where(in_touch(self.view), WIPE, APPROACH)

    def next_phase(self) -> np.ndarray:
        height, sideways = tip_on_pane(self.view)[:, 2], length(self._along_pane())
        over = (height <= STAND_OFF_M + ARRIVED_M) & (sideways <= ALIGNED_M) & (self._squareness() >= ALIGNED_COS)
        over &= height >= CLEAR_M
        done = wiped_share(self.view) >= WIPED_SHARE
        rules = (
            (APPROACH, done, LEAVE),
            (APPROACH, over, WIPE),
            (WIPE, done, LEAVE),
            (WIPE, (height > LIFTED_M) | self._astray(), APPROACH),
            (LEAVE, ~done, APPROACH),
        )
        return self.following(rules)

    def command(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        view = self.view
        rot6d, out = facing(view.site_mat("pane"))
        travel, _ = view.joint("pane")
        touching, force = in_touch(view), normal_force(view)
        sprung = (FORCE_N - PRELOAD_N) / STIFFNESS
        missing = np.where(touching, AIM_N - force, 0.0)
        depth = np.where(self.phase == WIPE, sprung + COMPLIANCE_M_N * missing, -STAND_OFF_M) - travel
        along = self._along_pane()
        stroke = self._way(along) * self._stroke(touching, force)[:, None]
        height = tip_on_pane(view)[:, 2]
        away = np.where((height >= CLEAR_M)[:, None], along, 0.0)
        sideways = np.where((self.phase == WIPE)[:, None], stroke, away)
        tip = view.tip_pos + sideways - (depth + height)[:, None] * out
        rot6d = turned_towards(view.tool_mat, rot6d, TURN_RAD)
        return tip + view.robot.gripper.tip_distance * out, rot6d, np.zeros(view.n)

    def noise_share(self) -> np.ndarray:
        return np.where(self.phase == WIPE, NOISE_WHILE_WIPING, 1.0)

    def _stroke(self, touching: np.ndarray, force: np.ndarray) -> np.ndarray:
        """(n,) how far ahead to slide, m: not before there is contact, slowly while the force is wrong."""
        right = np.abs(force - FORCE_N) <= 0.8 * FORCE_TOLERANCE_N
        return np.where(touching, STROKE_M * np.where(right, 1.0, SLOW), 0.0)

    def _way(self, along: np.ndarray) -> np.ndarray:
        """(n, 3) unit vectors to slide along: to a patch ``along`` (n, 3) m away; over its middle, on as before."""
        way = np.where((length(along) < PASSED_M)[:, None], ahead_of_trail(self.view), along)
        return way / np.maximum(length(way), 1e-6)[:, None]

    def _along_pane(self) -> np.ndarray:
        """(n, 3) the way to the nearest patch along the pane, world, m."""
        out, way = self.view.site_mat("pane")[:, [2, 5, 8]], tip_to_dirt(self.view)
        return way - (way * out).sum(axis=1)[:, None] * out

    def _squareness(self) -> np.ndarray:
        """(n,) cosine of the larger of two angles: of the tool's axis to the pane's normal, of their level axes."""
        tool, pane = self.view.tool_mat, self.view.site_mat("pane")
        ahead = -(tool[:, [0, 3, 6]] * pane[:, [2, 5, 8]]).sum(axis=1)
        return np.minimum(ahead, (tool[:, [1, 4, 7]] * pane[:, [1, 4, 7]]).sum(axis=1))

    def _astray(self) -> np.ndarray:
        """(n,) bool: the fingertips are over the edge of the pane, or the tool is far off square."""
        off = np.abs(tip_on_pane(self.view)[:, :2]) > np.array(PANE_HALF_M[:2])
        return off.any(axis=1) | (self._squareness() < LOST_COS)


EXPERT = WipeWindowExpert
