"""Standing on what the gripper holds: thrust is let go once a vehicle that is sent down does not fall.

A position loop whose acceleration is limited never gives up its thrust: held by its gripper, a vehicle would hover on
the spot for good. As in the land detector of PX4 ("ground contact": a descent is commanded, and nothing moves), a
gripper that is closed, a reference well below the base and a base at rest mean, after a while, that something bears
the weight. Then the rotors run down and the arm keeps the posture of the reference, which carries the base. A
reference that is no longer below brings the thrust back at once.
"""

from aerial_il.control import controller_state as layout
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import clip, norm

BORNE_S = layout.LAW  # where the law remembers for how long it has been borne, s
BELOW_M, STILL_M_S = 0.25, 0.15  # of the reference below the base; of the base
CLOSED = 0.9  # of the gripper
SURE_S, FADE_S = 0.5, 0.5  # until thrust is let go, and while it is
RETURN = 4.0  # times faster than it goes, thrust comes back


@kernel
def let_go(state, pos, vel, dt):
    """Note whether the vehicle is borne; return the share of its thrust, 0 to 1, that is let go.

    Args:
        state: controller state; the time for which it has been borne is advanced.
        pos, vel: measured, of the base, world, m and m/s. dt: s.
    """
    sent_down = pos[2] - state[layout.BASE_POS + 2] >= BELOW_M and state[layout.CLOSED] >= CLOSED
    change = dt if sent_down and norm(vel) <= STILL_M_S else -RETURN * dt
    state[BORNE_S] = clip(state[BORNE_S] + change, 0.0, SURE_S + FADE_S)
    return max(0.0, state[BORNE_S] - SURE_S) / FADE_S


@kernel
def keep_posture(vehicle, scratch, state, share):
    """Take the servos' set-points, and their velocity, by ``share`` of the way to the posture of the reference."""
    for j in range(vehicle.num_joints):
        command, reference = state[layout.JOINT_CMD + j], state[layout.JOINT_REF + j]
        state[layout.JOINT_CMD + j] = command + share * (reference - command)
        scratch.servo_vel[j] *= 1.0 - share
