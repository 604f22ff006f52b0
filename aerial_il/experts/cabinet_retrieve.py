"""Expert for the cabinet: hook its door open, fetch the cube from above, set it down on the marked place."""

from types import MappingProxyType

import numpy as np

from aerial_il.experts.open_door import OpenDoorExpert
from aerial_il.experts.set_down import SetDownExpert, face_nearest
from aerial_il.experts.staged import StagedExpert
from aerial_il.suite.episode import measured
from aerial_il.suite.props import CUBE_HALF_M, TABLE_HEIGHT_M
from aerial_il.suite.tasks import cabinet_retrieve
from aerial_il.suite.tasks.cabinet_retrieve import OPEN_ENOUGH_RAD

OPEN, FETCH = range(2)
SPARE_RAD = np.deg2rad(6.0)  # beyond enough before the door is let go; short of it, it is opened again

set_down = measured.truth(cabinet_retrieve.set_down)
cube_within = measured.truth(cabinet_retrieve.cube_within)


class OpenCabinetExpert(OpenDoorExpert):
    """As with any door, but farther."""

    open_rad = OPEN_ENOUGH_RAD


class FetchExpert(SetDownExpert):
    """In the cabinet the fingers close across it, whose walls are farther away on that side."""

    def cube(self) -> np.ndarray:
        return self.view.site_pos("cube")

    def held(self) -> np.ndarray:
        return self.view.touching("grip_left") & self.view.touching("grip_right")

    def grasp_heading(self) -> np.ndarray:
        mat, cabinet = self.view.site_mat("cube"), self.view.site_mat("door")
        return face_nearest(np.arctan2(mat[:, 3], mat[:, 0]), np.arctan2(-cabinet[:, 3], -cabinet[:, 0]))

    def goal(self) -> tuple[np.ndarray, np.ndarray]:
        return self.view.site_pos("spot") + np.array([0.0, 0.0, CUBE_HALF_M]), np.zeros(self.view.n)

    def done(self) -> np.ndarray:
        return set_down(self.view)

    def table(self) -> float:
        return TABLE_HEIGHT_M


class CabinetRetrieveExpert(StagedExpert):
    """Opens the door again where it has fallen back before the cube is out."""

    stages = MappingProxyType({"open": OpenCabinetExpert, "fetch": FetchExpert})

    def stage(self, now: np.ndarray) -> np.ndarray:
        angle, _ = self.view.joint("door")
        wanted = OPEN_ENOUGH_RAD + np.where(now == FETCH, -SPARE_RAD, SPARE_RAD)
        held = self.view.touching("grip_left") & self.view.touching("grip_right")
        return np.where((angle < wanted) & cube_within(self.view) & ~held, OPEN, FETCH)


EXPERT = CabinetRetrieveExpert
