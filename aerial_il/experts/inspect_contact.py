"""Expert for contact inspection: stand off, come down along the normal, and press by a force loop."""

import numpy as np

from aerial_il.core.arrays import length
from aerial_il.experts.expert import Expert, facing, turned_towards
from aerial_il.suite.episode import measured
from aerial_il.suite.props.plate import PRELOAD_N, STIFFNESS
from aerial_il.suite.tasks import inspect_contact
from aerial_il.suite.tasks.inspect_contact import FORCE_N

APPROACH, PRESS = range(2)

STAND_OFF_M = 0.06  # of the fingertips over the plate
ARRIVED_M = 0.03
ALIGNED_M, ALIGNED_COS = 0.015, np.cos(np.deg2rad(4.0))  # off the spot and off square when it may go down
LOST_ALIGNMENT_M = 0.035
NOISE_WHILE_PRESSING = 0.2  # a newton or so
SLIPPED_M = 0.018  # then the contact is better started anew
AIM_N = 5.9  # to get 5: the loop has no integral part, so that it depends on the present alone
TURN_RAD = 0.1  # the tool is turned at most this far ahead: else a long arm runs into its joints' stops
COMPLIANCE_M_N = 0.012  # of the admittance: depth added per newton that is missing

normal, slip = measured.vector(inspect_contact.normal), measured.vector(inspect_contact.slip)
normal_force, squareness = measured.number(inspect_contact.normal_force), measured.number(inspect_contact.squareness)
in_touch = measured.truth(inspect_contact.in_touch)


class InspectContactExpert(Expert):
    """Admittance control: the depth at which the spring gives the required force, corrected by the measured force."""

    phase_names = ("approach", "press")

    def first_phase(self) -> np.ndarray:
        return np.full(self.view.n, APPROACH)

    def next_phase(self) -> np.ndarray:
        height, sideways = self._offset()
        over = (sideways <= ALIGNED_M) & (height <= STAND_OFF_M + ARRIVED_M) & (squareness(self.view) >= ALIGNED_COS)
        begin = (self.phase == APPROACH) & over
        give_up = (self.phase == PRESS) & ((sideways > LOST_ALIGNMENT_M) | (length(slip(self.view)) > SLIPPED_M))
        return np.where(begin, PRESS, np.where(give_up, APPROACH, self.phase))

    def command(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        view = self.view
        rot6d, out = facing(view.site_mat("plate"))
        travel, _ = view.joint("plate")
        sprung = (FORCE_N - PRELOAD_N) / STIFFNESS
        missing = np.where(in_touch(view), AIM_N - normal_force(view), 0.0)
        depth = np.where(self.phase == PRESS, sprung + COMPLIANCE_M_N * missing, -STAND_OFF_M) - travel
        tip = view.site_pos("plate") - depth[:, None] * out + self._sideways()
        rot6d = turned_towards(view.tool_mat, rot6d, TURN_RAD)
        return tip + view.robot.gripper.tip_distance * out, rot6d, np.zeros(view.n)

    def noise_share(self) -> np.ndarray:
        return np.where(self.phase == PRESS, NOISE_WHILE_PRESSING, 1.0)

    def _sideways(self) -> np.ndarray:
        """(n, 3) where to press, from the plate's middle, m: right there, until contact begins somewhere near it."""
        view = self.view
        start = _tangential(normal(view), view.tip_pos - view.site_pos("plate")) - slip(view)
        return np.where(in_touch(view)[:, None], start, 0.0)

    def _offset(self) -> tuple[np.ndarray, np.ndarray]:
        """(n,) height of the fingertips over the plate and their distance from its middle along it, m."""
        view, out = self.view, normal(self.view)
        ahead = view.tip_pos - view.site_pos("plate")
        height = ahead[:, 0] * out[:, 0] + ahead[:, 1] * out[:, 1] + ahead[:, 2] * out[:, 2]
        return height, length(_tangential(out, ahead))


def _tangential(out: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """(n, 3) part of vectors (n, 3) that lies in the planes with normals ``out`` (n, 3)."""
    across = out[:, 0] * vectors[:, 0] + out[:, 1] * vectors[:, 1] + out[:, 2] * vectors[:, 2]
    return vectors - across[:, None] * out


EXPERT = InspectContactExpert
