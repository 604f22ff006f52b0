"""What of ROS 2 is used, imported where it is used first, and a node with a thread that serves it."""

import importlib
import threading
from functools import cache
from types import SimpleNamespace
from typing import Any

from aerial_il.core.errors import InvalidValueError

MESSAGES = {
    "geometry_msgs.msg": "PointStamped PoseStamped Transform TwistStamped Vector3Stamped WrenchStamped",
    "nav_msgs.msg": "Odometry",
    "rosgraph_msgs.msg": "Clock",
    "sensor_msgs.msg": "CameraInfo Image JointState",
    "std_msgs.msg": "Bool Float64 Float64MultiArray Header MultiArrayDimension String",
    "std_srvs.srv": "Trigger",
    "trajectory_msgs.msg": "JointTrajectory MultiDOFJointTrajectory",
    "builtin_interfaces.msg": "Time",
    "rclpy.qos": "QoSProfile DurabilityPolicy",
    "rclpy.executors": "SingleThreadedExecutor ExternalShutdownException",
    "rclpy.exceptions": "InvalidNamespaceException",
    "rclpy.validate_namespace": "validate_namespace",
    "rclpy.signals": "SignalHandlerOptions",
    "rclpy.parameter": "Parameter",
    "rclpy.parameter_client": "AsyncParameterClient",
}


@cache
def ros() -> Any:
    """Return ``rclpy`` and the classes of :data:`MESSAGES`, by their names.

    Raises:
        InvalidValueError: they are not installed; says how to get them.
    """
    try:
        classes = {
            name: getattr(importlib.import_module(module), name)
            for module, names in MESSAGES.items()
            for name in names.split()
        }
        return SimpleNamespace(rclpy=importlib.import_module("rclpy"), **classes)
    except ImportError as error:
        raise InvalidValueError(
            f"link=ros2 needs ROS 2 ({error}). Source your ROS (source /opt/ros/DISTRO/setup.bash), or "
            "make setup-links in a checkout, or pip install 'aerial_il[ros2]'."
        ) from error


def lasting() -> Any:
    """Return the quality of service by which whoever comes late gets the last message, too."""
    return ros().QoSProfile(depth=1, durability=ros().DurabilityPolicy.TRANSIENT_LOCAL)


class Served:
    """A node in a context of its own, whose callbacks run in a thread of its own.

    Args:
        name: of the node. namespace: of its topics, e.g. ``/aerial``.

    Raises:
        InvalidValueError: ROS 2 is not installed, or the namespace is none.
    """

    def __init__(self, name: str, namespace: str) -> None:
        rclpy = ros().rclpy
        try:
            ros().validate_namespace(namespace)
        except ros().InvalidNamespaceException as error:
            raise InvalidValueError(f"link.namespace={namespace} is no namespace, e.g. /aerial: {error}") from error
        self._context = rclpy.Context()
        rclpy.init(args=[], context=self._context, signal_handler_options=ros().SignalHandlerOptions.NO)
        self.node = rclpy.create_node(name, namespace=namespace, context=self._context)
        self._executor = ros().SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._serve, name=f"{namespace}/{name}", daemon=True)

    def start(self) -> None:
        """Begin to serve, when all publishers, subscriptions and services are there."""
        self._thread.start()

    def close(self) -> None:
        """End the thread and the node; in this order, else the middleware hangs."""
        self._executor.shutdown()
        if self._thread.is_alive():
            self._thread.join()
        self.node.destroy_node()
        self._context.try_shutdown()

    def _serve(self) -> None:
        try:
            self._executor.spin()
        except ros().ExternalShutdownException:
            pass
