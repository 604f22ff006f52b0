"""Expert for restocking: hook the cabinet open, stow one cube after the other, push its door shut."""

from types import MappingProxyType

import numpy as np

from aerial_il.core.kernels import kernel
from aerial_il.experts.cabinet_retrieve import SPARE_RAD, OpenCabinetExpert
from aerial_il.experts.hook import HOVER
from aerial_il.experts.open_door import YAW_LEAD_RAD, OpenDoorExpert
from aerial_il.experts.set_down import RETREAT, SetDownExpert, face_nearest
from aerial_il.experts.staged import StagedExpert
from aerial_il.suite.episode import measured
from aerial_il.suite.props import CUBE_HALF_M, TABLE_HEIGHT_M
from aerial_il.suite.props.cabinet import FLOOR_M
from aerial_il.suite.props.door import BAR_RADIUS_M, HINGE_TO_LOOP_M, LEAF_M, LOOP_M
from aerial_il.suite.tasks import restock
from aerial_il.suite.tasks.cabinet_retrieve import OPEN_ENOUGH_RAD
from aerial_il.suite.tasks.open_door import SWING_RAD_S
from aerial_il.suite.tasks.restock import COLOURS, CUBES, FIRST_CUBE

OPEN, STOW, SHUT = range(3)
SLOTS_M = np.array([[-0.075, aside] for aside in (-0.09, 0.0, 0.09)])  # in the cabinet: out of its front, to its left
LYING_M = 0.008  # over the cabinet's floor, at which a cube that is inside may stay
SHUT_RAD, AJAR_RAD = np.deg2rad(1.0), np.deg2rad(3.0)  # where it stops pushing, and where it starts anew
PUSHED_PAST_RAD = 0.1  # how far beyond closed the door is pushed at the end


@kernel
def places(world, found):
    for k in range(CUBES):
        place = restock.in_cabinet(world, restock.site_pos(world, FIRST_CUBE + k))
        found[4 * k], found[4 * k + 1], found[4 * k + 2] = place
        found[4 * k + 3] = restock.inside(world, k)


places_of = measured.row(places, 4 * CUBES)


class StowExpert(SetDownExpert):
    """The cube that is held, or the first that is not stowed, goes where there is most room."""

    def stowed(self) -> np.ndarray:
        """(n, CUBES) bool: which cubes lie in the cabinet."""
        found = places_of(self.view).reshape(-1, CUBES, 4)
        return (found[:, :, 3] > 0.0) & (found[:, :, 2] <= FLOOR_M + CUBE_HALF_M + LYING_M)

    def all_held(self) -> np.ndarray:
        """(n, CUBES) bool: which cubes are between the pads."""
        touching = self.view.touching
        return np.stack([touching(f"grip_left_{name}") & touching(f"grip_right_{name}") for name in COLOURS], axis=1)

    def high(self) -> np.ndarray:
        """(n,) bool: the tool has backed off from what it let go."""
        return (self.phase == RETREAT) & (self.view.tool_pos[:, 2] >= self._travel() - 0.05)

    def cube(self) -> np.ndarray:
        return self._chosen(np.stack([self.view.site_pos(f"cube_{name}") for name in COLOURS], axis=1))

    def held(self) -> np.ndarray:
        return np.asarray(self.all_held().any(axis=1))

    def grasp_heading(self) -> np.ndarray:
        mats = np.stack([self.view.site_mat(f"cube_{name}") for name in COLOURS], axis=1)
        mat = self._chosen(mats)
        return face_nearest(np.arctan2(mat[:, 3], mat[:, 0]), self._into())

    def goal(self) -> tuple[np.ndarray, np.ndarray]:
        found, others = places_of(self.view).reshape(-1, CUBES, 4), np.arange(CUBES) != self._which()[:, None]
        gaps = np.linalg.norm(found[:, None, :, :2] - SLOTS_M[:, None], axis=3)  # (n, slots, CUBES)
        room = np.where(others[:, None], gaps, np.inf).min(axis=2)
        slot = SLOTS_M[np.minimum(room, LEAF_M).argmax(axis=1)]
        mat, hinge = self.view.site_mat("door"), self.view.site_pos("door")
        forth, aside = slot[:, :1], slot[:, 1:] - 0.5 * LEAF_M
        level = hinge[:, :2] + forth * mat[:, [0, 3]] + aside * mat[:, [1, 4]]
        height = np.full((self.view.n, 1), TABLE_HEIGHT_M + FLOOR_M + CUBE_HALF_M)
        return np.concatenate([level, height], axis=1), self._into()

    def done(self) -> np.ndarray:
        return np.asarray(self.stowed().all(axis=1))

    def table(self) -> float:
        return TABLE_HEIGHT_M

    def _which(self) -> np.ndarray:
        """(n,) number of the cube that it is at."""
        held, stowed = self.all_held(), self.stowed()
        return np.where(held.any(axis=1), held.argmax(axis=1), (~stowed).argmax(axis=1))

    def _chosen(self, values: np.ndarray) -> np.ndarray:
        return values[np.arange(self.view.n), self._which()]

    def _into(self) -> np.ndarray:
        """(n,) heading into the cabinet, rad."""
        mat = self.view.site_mat("door")
        return np.arctan2(-mat[:, 3], -mat[:, 0])


class ShutExpert(OpenDoorExpert):
    """The fingers go into the handle as for opening, and push the leaf."""

    def next_phase(self) -> np.ndarray:
        angle, _ = self.view.joint("door")
        shut = angle <= np.where(self.phase == HOVER, AJAR_RAD, SHUT_RAD)
        return np.where(shut, HOVER, super().next_phase())

    def ahead(self) -> tuple[np.ndarray, np.ndarray]:
        view = self.view
        angle, rate = view.joint("door")
        push = np.minimum(self.push(-rate / SWING_RAD_S), (angle + PUSHED_PAST_RAD) * HINGE_TO_LOOP_M)
        touching = 0.5 * (LOOP_M - BAR_RADIUS_M) - view.robot.gripper.pad_height
        out = view.site_mat("loop")[:, [0, 3, 6]]
        return view.site_pos("loop") - (touching + push)[:, None] * out, self._heading() - YAW_LEAD_RAD


class RestockExpert(StagedExpert):
    """Opens the door while a cube is outside, closes it when none is."""

    stages = MappingProxyType({"open": OpenCabinetExpert, "stow": StowExpert, "shut": ShutExpert})

    def stage(self, now: np.ndarray) -> np.ndarray:
        angle, _ = self.view.joint("door")
        stow = self.parts[STOW]
        assert isinstance(stow, StowExpert)
        wanted = OPEN_ENOUGH_RAD + np.where(now == STOW, -SPARE_RAD, SPARE_RAD)
        held = stow.held()
        at_it = held | ((now == STOW) & ~stow.high())
        loading = ~stow.done() | at_it
        return np.where(loading, np.where((angle < wanted) & ~held, OPEN, STOW), SHUT)


EXPERT = RestockExpert
