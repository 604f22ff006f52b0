"""A simulated robot on ROS 2, until it is ended: serve.py ROBOT TASK NAMESPACE SPEED [CAMERA ...]."""

import signal
import sys
import threading

from aerial_il.links.robot import SimulatedRobot
from aerial_il.links.ros2.robot_node import RobotNode


def main(robot: str, task: str, namespace: str, speed: str, *cameras: str) -> None:
    ended = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: ended.set())
    simulated = SimulatedRobot(robot, task, cameras=cameras, image_size=(24, 32))
    for _ in range(2):  # compile before the clock runs
        simulated.order("arm")
        simulated.order("take_off", height_m=0.0)
        simulated.tick()
        simulated.reset(0)
    node = RobotNode(simulated, namespace=namespace, speed=float(speed), clock=False)
    print("ready", flush=True)
    try:
        node.run(ended.is_set)
    finally:
        print(node.pace, flush=True)
        node.close()
        simulated.close()


if __name__ == "__main__":
    main(*sys.argv[1:])
