"""Working memory of the controller's tick: one block, made once and used for one vehicle after the other."""

import numpy as np

from aerial_il.control.vehicle import MAX_JOINTS, MAX_ROTORS

FRAME_SIZE = 15  # joint position (3), link rotation (9), joint axis (3); see ``dynamics.forward_kinematics``
_COORDINATES = 4 + MAX_JOINTS  # base x, y, z, yaw and the joints
_EQUATIONS = max(6, MAX_JOINTS)

SCRATCH = np.dtype(
    [
        ("frames", np.float64, (MAX_JOINTS + 1, FRAME_SIZE)),  # placed links, then the tool
        *((name, np.float64, (6, _COORDINATES)) for name in ("jacobian", "scaled")),
        ("gram", np.float64, (_EQUATIONS, _EQUATIONS)),
        *((name, np.float64, (6,)) for name in ("error", "weight", "residual")),
        *((name, np.float64, (_COORDINATES,)) for name in ("mobility", "pull", "step")),
        ("solution", np.float64, (_EQUATIONS,)),
        *((name, np.float64, (MAX_JOINTS,)) for name in ("servo_vel", "servo_torque")),
        ("rest", np.float64, (MAX_JOINTS,)),  # stays zero
        *((name, np.float64, (7 + MAX_JOINTS,)) for name in ("pos", "measured_pos")),  # of whoever calls the tick
        *((name, np.float64, (6 + MAX_JOINTS,)) for name in ("vel", "measured_vel")),
        ("thrust", np.float64, (MAX_ROTORS,)),
        # What a flight law is given, and what it writes: position (m), velocity (m/s) and rotation of the base, world;
        # angular velocity in the base frame and the world's (rad/s); acceleration of the reference, world (m/s²);
        # centre of mass minus base origin, world (m); time between two ticks (s); then force (N) and torque (N m).
        *((name, np.float64, (3,)) for name in ("base_pos", "base_vel")),
        ("base_rot", np.float64, (9,)),
        *((name, np.float64, (3,)) for name in ("rate", "omega", "feed_forward", "lever")),
        ("joint_vel", np.float64, (MAX_JOINTS,)),
        ("dt", np.float64),
        *((name, np.float64, (3,)) for name in ("force", "torque")),  # base frame, about the base origin
    ],
    align=True,
)


def make_scratch() -> np.record:
    """Allocate working memory for vehicles of any size; two threads must not share it.

    A block of fixed size, because compiled code reads it without counting references, which arrays would cost it.
    """
    return np.zeros(1, SCRATCH).view(np.recarray)[0]
