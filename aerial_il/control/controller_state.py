"""Layout of the flight controller's state between ticks: one row of numbers per vehicle.

Keeping it outside of any object lets a simulator store it with its own state, so that a snapshot of the one is a
snapshot of both.
"""

from aerial_il.control.vehicle import MAX_JOINTS

READY = 0  # 0 until the first tick has seated the references at the current state
TOOL_POS, TOOL_VEL, TOOL_ROT, TOOL_OMEGA = 1, 4, 7, 16  # end-effector reference, world frame
TARGET_POS, TARGET_VEL = 19, 22  # last commanded position and its rate
BASE_POS, BASE_YAW, BASE_VEL, BASE_YAW_RATE = 25, 28, 29, 32  # base reference, world frame
JOINT_REF, JOINT_CMD = 33, 33 + MAX_JOINTS  # posture of the reference and servo set-points
LINEAR, ANGULAR = 49, 52  # observer: momentum at the last tick
FORCE, TORQUE = 55, 58  # observer: estimated disturbance (N, N m) about the centre of mass
CLOSED = 61  # low-passed gripper command: 1 closed, 0 open
TOOL_ACC = 62  # acceleration of the end-effector reference until the next action
LAW, LAW_SIZE = 65, 6  # what a flight law remembers
TARGET_ROT = 71  # last commanded orientation, world from tool; kept at the level ee_delta
CONTACT = 80  # force on the tool as the joints feel it, world frame, N
CONTROLLER_STATE_SIZE = 83
