"""A parallel gripper: two fingers coupled by a tendon, closing with a limited force along the tool's y axis."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco

from aerial_il.robots.parts.collision import ROBOT

METAL, RUBBER = [0.75, 0.77, 0.80, 1.0], [0.15, 0.15, 0.16, 1.0]
PAD_CONTACT = {
    "friction": [1.2, 0.02, 0.001],
    "solref": [0.01, 1.0],
    "solimp": [0.95, 0.99, 0.001, 0.5, 2.0],
}


@dataclass(frozen=True)
class Gripper:
    """Two fingers of ``finger_length`` m on a palm, each travelling ``stroke`` m; the tool lies between their pads.

    Attributes:
        mass: kg, palm and fingers together. stroke: m per finger. finger_length: m.
        pad_height: half height of the pads along the tool's z, m. force: N per finger.
    """

    mass: float
    stroke: float
    finger_length: float
    pad_height: float
    force: float

    @property
    def tool_distance(self) -> float:
        """From the end of the last link to the tool point, m."""
        return 0.8 * self.finger_length

    @property
    def tip_distance(self) -> float:
        """From the tool point to the fingers' ends, m."""
        return self.finger_length - self.tool_distance

    @property
    def com_distance(self) -> float:
        """From the end of the last link to the gripper's centre of mass, m."""
        return 0.3 * self.finger_length

    @property
    def palm_half(self) -> float:
        """Half thickness of the palm: from the end of the last link to the palm's face, m."""
        return 0.12 * self.finger_length

    @property
    def inertia(self) -> tuple[float, float, float]:
        """Nominal diagonal inertia about the gripper's centre of mass, kg m²."""
        width, depth = 2.0 * self.stroke, self.finger_length
        return (self.mass * width**2 / 12, self.mass * depth**2 / 12, self.mass * (width**2 + depth**2) / 12)

    def add_to(self, spec: mujoco.MjSpec, link: mujoco.MjsBody, start: tuple[float, float, float]) -> None:
        """Mount the gripper at ``start`` m, along the x axis of ``link``, with one actuator ``gripper`` (m)."""
        box = mujoco.mjtGeom.mjGEOM_BOX
        palm_mass, finger_mass = 0.6 * self.mass, 0.2 * self.mass
        palm = link.add_body(name="palm", pos=start)
        size = [self.palm_half, self.stroke + 0.012, self.pad_height]
        palm.add_geom(name="palm", type=box, size=size, mass=palm_mass, rgba=METAL, **ROBOT)
        tendon = spec.add_tendon(name="gripper")
        for side, sign in (("left", 1.0), ("right", -1.0)):
            self._add_finger(palm, side, sign, finger_mass)
            tendon.wrap_joint(f"finger_{side}", 0.5)
        equal = spec.add_equality(
            name="fingers", type=mujoco.mjtEq.mjEQ_JOINT, name1="finger_left", name2="finger_right"
        )
        equal.objtype = mujoco.mjtObj.mjOBJ_JOINT
        equal.data[1] = 1.0
        equal.solref = [0.01, 1.0]
        drive = spec.add_actuator(name="gripper", target="gripper", trntype=mujoco.mjtTrn.mjTRN_TENDON)
        drive.set_to_position(kp=2.0 * self.force / (0.25 * self.stroke), kv=0.05 * 2.0 * self.force / self.stroke)
        drive.forcelimited, drive.forcerange = True, [-2.0 * self.force, 2.0 * self.force]
        drive.ctrllimited, drive.ctrlrange = True, [0.0, self.stroke]

    def _add_finger(self, palm: mujoco.MjsBody, side: str, sign: float, mass: float) -> None:
        box = mujoco.mjtGeom.mjGEOM_BOX
        half, thick = 0.5 * self.finger_length, 0.006
        finger = palm.add_body(name=f"finger_{side}", pos=[half, 0, 0])
        finger.add_joint(
            name=f"finger_{side}", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, sign, 0], range=[0, self.stroke],
            limited=True, armature=0.02, damping=0.5,
        )  # fmt: skip
        back = {"pos": [0, sign * 1.5 * thick, 0], "size": [half, 0.5 * thick, 0.7 * self.pad_height], "rgba": METAL}
        finger.add_geom(name=f"finger_{side}", type=box, mass=0.5 * mass, **back, **ROBOT)
        front = {"pos": [0.2 * half, sign * 0.5 * thick, 0], "size": [0.8 * half, 0.5 * thick, self.pad_height]}
        finger.add_geom(name=f"pad_{side}", type=box, mass=0.5 * mass, rgba=RUBBER, **front, **ROBOT, **PAD_CONTACT)


NO_GRIPPER = Gripper(mass=0.0, stroke=0.0, finger_length=0.0, pad_height=0.0, force=0.0)
