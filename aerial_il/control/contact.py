"""Giving way in contact: what presses against the tool, as the joints feel it, and how far the arm goes along with it.

The arm's set-points are solved from where the base really is, so that the arm cancels what wind does to the base. A
base that yields because the tool is pressed against something must not be cancelled so: the arm would stretch as far as
the base moves away, push it farther, and throw the vehicle. Along the force that is felt the arm therefore keeps the
posture of the reference, and across it it goes on to cancel (compliance along the contact's normal, as in Raibert and
Craig, "Hybrid position/force control of manipulators", 1981).
"""

from aerial_il.control import controller_state as layout
from aerial_il.control.dynamics import put, total_mass, vec
from aerial_il.control.inverse_kinematics import solve_cholesky
from aerial_il.control.vehicle import GRAVITY
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import add, dot, norm, scale, sub

SHORTEST_LEVER = 0.05  # m: below it a joint's torque says nothing about a force
FELT_SHARE = 0.13  # of the vehicle's weight: a force that the arm begins to give way to; to twice as much it does fully
LEAST_N = 4.0  # N: lighter vehicles too press a probe or a button without giving way
RISE, FALL = 30.0, 2.0  # 1/s: how fast the estimate follows a force that grows, or fades


@kernel
def feel_contact(vehicle, scratch, state, joints, dt):
    """Update the estimate of the force on the tool from how far the joints lag behind their set-points.

    Args:
        vehicle: the nominal model. scratch: working memory, with the tool's Jacobian.
        state: controller state; ``CONTACT`` (world frame, N) is advanced.
        joints: (J,) measured, rad. dt: s.
    """
    gram, force = scratch.gram, scratch.residual
    for r in range(3):
        total = 0.0
        for j in range(vehicle.num_joints):
            lag = vehicle.joint_stiffness[j] * (state[layout.JOINT_CMD + j] - joints[j])
            total -= scratch.jacobian[r, 4 + j] * lag
        force[r] = total
        for s in range(r + 1):
            total = SHORTEST_LEVER * SHORTEST_LEVER if r == s else 0.0
            for j in range(vehicle.num_joints):
                total += scratch.jacobian[r, 4 + j] * scratch.jacobian[s, 4 + j]
            gram[r, s] = total
    solve_cholesky(gram, force, 3)
    before, now = vec(state, layout.CONTACT), vec(force, 0)
    rate = RISE if norm(now) > norm(before) else FALL
    put(state, layout.CONTACT, add(before, scale(min(1.0, rate * dt), sub(now, before))))


@kernel
def give_way(vehicle, state, pos):
    """Return how far (3,), m, the tool is to stay behind its reference: what contact has moved the base by.

    Args:
        vehicle: the nominal model. state: controller state. pos: measured base position.
    """
    force, least = vec(state, layout.CONTACT), max(LEAST_N, FELT_SHARE * GRAVITY * total_mass(vehicle))
    size = norm(force)
    if size <= least:
        return (0.0, 0.0, 0.0)
    along = scale(1.0 / size, force)
    yielded = max(0.0, dot(along, sub(pos, vec(state, layout.BASE_POS))))
    return scale(min(1.0, size / least - 1.0) * yielded, along)
