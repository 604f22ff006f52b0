"""The ROS 2 package of message definitions defines what recordings hold."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree as ET

from aerial_il.data.recording.encoding import messages

PACKAGE = Path(__file__).resolve().parents[3] / "ros2" / "aerial_il_msgs"


def test_its_messages_are_those_of_the_recordings() -> None:
    told = {f"{PACKAGE.name}/msg/{path.stem}": path.read_text(encoding="utf-8") for path in PACKAGE.glob("msg/*")}
    assert told == {messages.STEPS: messages.STEPS_DEFINITION}


def test_every_message_is_built_with_its_dependencies() -> None:
    built = (PACKAGE / "CMakeLists.txt").read_text(encoding="utf-8")
    assert re.findall(r'"(msg/\w+\.msg)"', built) == [f"msg/{path.name}" for path in sorted(PACKAGE.glob("msg/*"))]
    tree = ET.parse(PACKAGE / "package.xml").getroot()
    assert tree.findtext("name") == PACKAGE.name
    used = {line.split("/")[0] for p in PACKAGE.glob("msg/*") for line in p.read_text().splitlines() if "/" in line}
    depends = {element.text for element in tree.iter("depend")}
    assert {name for name in used if not name.startswith("#")} == depends == {"std_msgs"}
    assert tree.findtext("member_of_group") == "rosidl_interface_packages"
