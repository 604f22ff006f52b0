"""Perceived state of n worlds: where it is kept, and which of it belongs to which object."""

from __future__ import annotations

from functools import partial
from typing import Any

import mujoco
import numpy as np

from aerial_il.control.vehicle import alone
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.seeding import episode_rng
from aerial_il.suite.episode.estimation import (
    EXACT,
    FRAME,
    HINGE,
    NOT_SEEN,
    OBJECT,
    SIGHT,
    SLIDE,
    STILL,
    Perception,
    begin_sight,
)
from aerial_il.suite.physics import episode_state as layout
from aerial_il.suite.physics.noise import gaussian
from aerial_il.suite.physics.view import View
from aerial_il.suite.scenario import Scenario

KINDS = {mujoco.mjtJoint.mjJNT_HINGE: HINGE, mujoco.mjtJoint.mjJNT_SLIDE: SLIDE}
POSE_SIZE, JOINT_SIZE, VELOCITY_SIZE = 7, 2, 3  # numbers that are remembered of a site, a joint, a velocity
NUM_ERRORS = 6  # of an object
MOST_OBJECTS = 6  # whose random numbers have channels of their own, see ``estimation``


class Perceived:
    """State of n worlds as policies see it: the truth, or an estimate where the scenario's tier has one.

    An object is what hangs from one body of the scene: its sites and joints share one error.

    Args:
        scenario: the environment. view: the worlds. hooks: (1,) of the tier's disturbances.

    Attributes:
        records: (n,) :data:`aerial_il.suite.physics.world.WORLD`, which observations are read off.
        perception: how they are filled. objects: names of the bodies that are seen, in the order of their errors.

    Raises:
        InvalidValueError: the task has more objects, or more that moves, than the episode's memory holds; or reads
            something that belongs to none of the objects whose sites it reads.
    """

    def __init__(self, scenario: Scenario, view: View, hooks: np.ndarray) -> None:
        self.view, self._model, self._task = view, view.model, scenario.task
        self._roots: list[int] = []
        self._places = 0  # of what is remembered
        self._sight_of = partial(episode_rng, scenario.robot_name, scenario.task_name, "sight")
        vehicle, estimation = scenario.robot.vehicle.record, scenario.tier.parts.get("estimation")
        sight, self.records = np.zeros(1, SIGHT), view.records
        if estimation:
            for name, value in vars(estimation).items():
                sight[name] = value
            self._sort_out(sight)
            self.records = self._own_records()
        self.perception = Perception(1 if estimation else 0, sight, alone(vehicle), hooks)
        self.objects = tuple(self._model.body(root).name for root in self._roots)

    def begin(self, mask: np.ndarray) -> None:
        """Let the worlds in ``mask`` (n,) bool, whose episodes start, have looked for ever as they do now."""
        if self.perception.active:
            self._draw_errors(mask)
            records = self.view.records
            begin_sight(self.perception, records.ctypes.data, records.itemsize, mask)

    def resume(self, mask: np.ndarray) -> None:
        """The same for those in ``mask`` whose state remembers nothing seen: one of a tier in which all is exact."""
        sight = self.perception.sight[0]
        end = sight["past"] + layout.MAX_LAG * sight["past_size"]
        self.begin(mask & ~self.view.userdata[:, sight["errors"] : end].any(axis=1))

    def drawn(self, seed: int) -> dict[str, Any]:
        """Biases of what is seen in the episode ``seed``, as plain values; empty where the truth is shown."""
        if not self.perception.active:
            return {}
        sight, found = self.perception.sight[0], {}
        found["seen_frame_bias_m"] = [float(sight["frame_bias"] * gaussian(seed, 0, FRAME + k)) for k in range(3)]
        for which, name in enumerate(self.objects):
            units = [float(gaussian(seed, which, OBJECT + k)) for k in range(6)]
            found[f"seen_{name}_bias_m"] = [float(sight["position_bias"]) * unit for unit in units[:3]]
            found[f"seen_{name}_bias_rad"] = [float(sight["angle_bias"]) * unit for unit in units[3:]]
        return found

    def _sort_out(self, sight: np.ndarray) -> None:
        """Give each site, joint and mocap body its object, and its place among what is remembered."""
        names, model, record = self._task.names, self._model, self.view.records[0]
        sites = [int(model.site(name).bodyid[0]) for name in names.sites]
        commanded = [name in self._task.commanded for name in names.sites]
        roots = [int(model.body_rootid[body]) for body, exact in zip(sites, commanded, strict=True) if not exact]
        self._roots = list(dict.fromkeys(roots))
        most, _ = self._task.sight
        if not len(self._roots) <= most <= MOST_OBJECTS:
            raise InvalidValueError(
                f"{self._task.name} shows {len(self._roots)} objects, its `sight` says {most}: say as many, "
                f"{MOST_OBJECTS} at most."
            )
        for k, body in enumerate(sites):
            sight["site_objects"][0, k] = EXACT if commanded[k] else self._roots.index(model.body_rootid[body])
            sight["site_slots"][0, k] = self._slot(POSE_SIZE) if self._moves(body) else STILL
        for which in range(len(self._roots)):
            sight["centres"][0, which] = list(sight["site_objects"][0, : len(sites)]).index(which)
        for k, name in enumerate(names.joints):
            kind = KINDS.get(mujoco.mjtJoint(int(model.joint(name).type[0])), NOT_SEEN)
            sight["joint_kinds"][0, k], sight["joint_slots"][0, k] = kind, STILL
            if kind != NOT_SEEN:
                sight["joint_objects"][0, k] = self._object_of(f"joint {name}", int(model.joint(name).bodyid[0]))
                sight["joint_slots"][0, k] = self._slot(JOINT_SIZE)
        for k, (name, state) in enumerate(self._task.velocities.items()):
            which = sight["site_objects"][0, names.sites.index(name)]
            sight["velocity_states"][0, k], sight["velocity_objects"][0, k] = state, which
            sight["velocity_slots"][0, k] = self._slot(VELOCITY_SIZE)
        for k, name in enumerate(names.mocaps):
            is_commanded = name in self._task.commanded
            sight["mocap_objects"][0, k] = (
                EXACT if is_commanded else self._object_of(f"body {name}", model.body(name).id)
            )
        sight["num_objects"], sight["num_sites"] = len(self._roots), len(sites)
        sight["num_joints"], sight["num_mocaps"] = len(names.joints), len(names.mocaps)
        sight["num_forces"], sight["num_velocities"] = len(self._task.force_sensors), len(self._task.velocities)
        self._find_memory(sight)
        fingers = 2 * int(record["grips"])
        sight["own_qpos"] = record["fingers"] + fingers
        sight["own_qvel"] = record["first_dof"] + record["num_joints"] + fingers

    def _find_memory(self, sight: np.ndarray) -> None:
        """Say where errors and past lie: in the fixed layout, or at the end where they do not fit in there."""
        objects, moving = self._task.sight
        sight["memory"] = memory = self._model.nuserdata
        sight["errors"], sight["past"], sight["past_size"] = layout.ERRORS.start, layout.PAST.start, layout.PAST_SIZE
        if behind := layout.sight_size(objects, moving):
            sight["errors"], sight["past_size"] = memory - behind, moving
            sight["past"] = sight["errors"] + NUM_ERRORS * objects

    def _draw_errors(self, mask: np.ndarray) -> None:
        """Draw the errors with which episodes start that lie behind the layout; ``estimation`` draws the others."""
        sight = self.perception.sight[0]
        if sight["errors"] == layout.ERRORS.start:
            return
        size = sight["past"] - sight["errors"]
        for i in np.flatnonzero(mask):
            userdata = self.view.userdata[i]
            rng = self._sight_of(int(userdata[layout.SEED]))
            userdata[sight["errors"] : sight["past"]] = rng.standard_normal(size)

    def _slot(self, size: int) -> int:
        """Take ``size`` numbers of the memory for what moves."""
        first, self._places = self._places, self._places + size
        _, most = self._task.sight
        if self._places > most:
            raise InvalidValueError(
                f"The moving sites, joints and velocities of task {self._task.name!r} take {self._places} numbers, and "
                f"an estimate holds {most}: {POSE_SIZE}, {JOINT_SIZE} and {VELOCITY_SIZE} for each. Name one site per "
                "object, and compute its other points from there, along the axes of site_mat, or say more in `sight`."
            )
        return first

    def _moves(self, body: int) -> bool:
        """Whether a body hangs from any joint."""
        while body and not self._model.body_dofnum[body]:
            body = int(self._model.body_parentid[body])
        return body > 0

    def _object_of(self, what: str, body: int) -> int:
        root = int(self._model.body_rootid[body])
        if root not in self._roots:
            raise InvalidValueError(
                f"{self._task.name} reads {what}, but no site of the object that it belongs to: add one to the task's "
                "names, or name it in its `commanded`."
            )
        return self._roots.index(root)

    def _own_records(self) -> np.ndarray:
        """Records that point to numbers of their own; what is never written there cannot be seen, and stays NaN."""
        view, names = self.view, self._task.names
        records, sites = view.records.copy(), len(names.sites) + 2  # the last two are tool and base
        sizes = {
            "qpos": view.model.nq,
            "qvel": view.model.nv,
            "site_xpos": 3 * sites,
            "site_xmat": 9 * sites,
            "mocap_pos": 3 * max(1, len(names.mocaps)),
            "userdata": layout.USERDATA_SIZE,
        }
        self._buffers = {name: np.full((view.n, size), np.nan) for name, size in sizes.items()}
        for name, buffer in self._buffers.items():
            records[name] = [row.ctypes.data for row in buffer]
        records["sites"][:, : len(names.sites)] = np.arange(len(names.sites))
        records["mocaps"][:, : len(names.mocaps)] = np.arange(len(names.mocaps))
        records["tool"], records["base"] = sites - 2, sites - 1
        return records
