"""The ROS 2 message types of a demonstration: their definitions, and templates to write them by the thousand.

Standard types carry what people look at, so that rerun, Foxglove and ROS 2 tools show it without help. One type of our
own, ``aerial_il_msgs/msg/Steps``, carries what must be exact.
"""

from functools import cache

from aerial_il.data.recording.encoding.cdr import CdrTemplate

JOINT_STATE = "sensor_msgs/msg/JointState"
POSE_STAMPED = "geometry_msgs/msg/PoseStamped"
TF_MESSAGE = "tf2_msgs/msg/TFMessage"
FLOAT_ARRAY = "std_msgs/msg/Float64MultiArray"
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
STEPS = "aerial_il_msgs/msg/Steps"

STEPS_DEFINITION = """\
# Consecutive control steps, exact to the bit, column by column. A step is a row of numbers: the metadata
# aerial_il.episode name them and their sizes, in order, under "columns". The last step of a file is the state in which
# the flight ended; the numbers of its action and outcome are zero.
std_msgs/Header header
# number of the first of these steps, and how many they are
uint32 first
uint32 count
# all numbers of the first of these steps
float64[] start
# the columns that change later on, ascending from 0, and their numbers in all of these steps: column after column
uint32[] changing
float64[] values
"""

# Definitions of other packages' types in the order of the ROS 2 interface files, without their comments.
_DEFINITIONS = {
    "builtin_interfaces/msg/Time": "int32 sec\nuint32 nanosec\n",
    "std_msgs/msg/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
    "std_msgs/msg/MultiArrayDimension": "string label\nuint32 size\nuint32 stride\n",
    "std_msgs/msg/MultiArrayLayout": "std_msgs/MultiArrayDimension[] dim\nuint32 data_offset\n",
    FLOAT_ARRAY: "std_msgs/MultiArrayLayout layout\nfloat64[] data\n",
    "geometry_msgs/msg/Point": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/msg/Vector3": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/msg/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
    "geometry_msgs/msg/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
    POSE_STAMPED: "std_msgs/Header header\ngeometry_msgs/Pose pose\n",
    "geometry_msgs/msg/Transform": "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n",
    "geometry_msgs/msg/TransformStamped": (
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n"
    ),
    TF_MESSAGE: "geometry_msgs/TransformStamped[] transforms\n",
    JOINT_STATE: "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n",
    COMPRESSED_IMAGE: "std_msgs/Header header\nstring format\nuint8[] data\n",
    STEPS: STEPS_DEFINITION,
}


@cache
def definition(message_type: str) -> str:
    """Return the ``ros2msg`` schema text of a type: its own definition, then those of the types it uses."""
    texts, pending, seen = [_DEFINITIONS[message_type]], [message_type], {message_type}
    while pending:
        for name in _used_types(pending.pop(0)):
            if name not in seen:
                seen.add(name)
                pending.append(name)
                texts.append(f"MSG: {name.replace('/msg/', '/')}\n{_DEFINITIONS[name]}")
    return ("=" * 80 + "\n").join(texts)


def _used_types(message_type: str) -> list[str]:
    words = (line.split()[0].removesuffix("[]") for line in _DEFINITIONS[message_type].splitlines() if line[0] != "#")
    return [word.replace("/", "/msg/") for word in words if "/" in word]


def joint_state(names: tuple[str, ...], *, velocity: bool = False) -> CdrTemplate:
    """Template of a ``JointState`` with slots ``position`` and, if asked for, ``velocity``."""
    template = CdrTemplate().header("").strings(names).sequence("position", "<f8", len(names))
    template.sequence("velocity", "<f8", len(names) if velocity else 0)
    return template.sequence("effort", "<f8", 0)


def pose_stamped(frame: str) -> CdrTemplate:
    """Template of a ``PoseStamped`` with slots ``position`` (3) and ``orientation`` (4, x y z w)."""
    return CdrTemplate().header(frame).slot("position", "<f8", 3).slot("orientation", "<f8", 4)


def transforms(frame: str, children: tuple[str, ...]) -> CdrTemplate:
    """Template of a ``TFMessage`` with slots ``translation<i>`` (3) and ``rotation<i>`` (4, x y z w)."""
    template = CdrTemplate().constant("<u4", len(children))
    for i, child in enumerate(children):
        template.header(frame, suffix=str(i)).string(child)
        template.slot(f"translation{i}", "<f8", 3).slot(f"rotation{i}", "<f8", 4)
    return template


def float_array(count: int) -> CdrTemplate:
    """Template of a ``Float64MultiArray`` with the slot ``data``."""
    return CdrTemplate().constant("<u4", 0).constant("<u4", 0).sequence("data", "<f8", count)


def compressed_image(frame: str, image_format: str) -> CdrTemplate:
    """Template of a ``CompressedImage`` up to its data, which follow as a slot ``size`` and that many bytes."""
    return CdrTemplate().header(frame).string(image_format).slot("size", "<u4")
