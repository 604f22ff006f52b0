"""Whoever flies a robot, until it is killed: velocities without an end. python -m tests.links.ros2.stream NAMESPACE."""

import sys
import time

import numpy as np

from aerial_il.links.ros2.ros2_link import Ros2Link


def main(namespace: str) -> None:
    link = Ros2Link(namespace, level="velocity")
    action = np.zeros(link.spec.action.size)
    action[0] = 0.2
    print("ready", flush=True)
    while True:
        link.send("velocity", action)
        time.sleep(0.005)


if __name__ == "__main__":
    main(*sys.argv[1:])
