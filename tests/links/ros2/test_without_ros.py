"""Where ROS 2 is not installed."""

import subprocess
import sys


def test_who_flies_needs_neither_simulator_nor_compiler():
    program = (
        "import sys, aerial_il.links.ros2.ros2_link\n"
        "print([name for name in ('mujoco', 'numba', 'torch') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_says_how_to_get_it():
    program = (
        "import sys; sys.modules['rclpy'] = None\n"
        "from aerial_il.links.ros2.ros2_link import Ros2Link\n"
        "from aerial_il.core.errors import InvalidValueError\n"
        "try:\n    Ros2Link()\nexcept InvalidValueError as error:\n    print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert "pip install 'aerial_il[ros2]'" in done.stdout
    assert "Source your ROS" in done.stdout
