"""Arms as manufacturers and labs describe them: each is read, or a line says what to write, which is then enough."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aerial_il.robots.parts.described.arm import ReadArm, Servo, read_arm
from aerial_il.robots.parts.described.error import ModelFileError

TURN = np.pi / 2
CAN = '<collision><origin xyz="0 0 0.05"/><geometry><cylinder radius="0.04" length="0.1"/></geometry></collision>'
MESH = '<{}><geometry><mesh filename="package://maker_description/{}.{}"/></geometry></{}>'


def link(name: str, mass: float = 0.0, shapes: str = "") -> str:
    inertia = f'<inertia ixx="{mass / 100}" iyy="{mass / 100}" izz="{mass / 200}" ixy="0" ixz="0" iyz="0"/>'
    solid = f'<inertial><mass value="{mass}"/><origin xyz="0 0 0.05"/>{inertia}</inertial>' if mass else ""
    return f'<link name="{name}">{shapes}{solid}</link>'


def joint(name: str, ends: tuple[str, str], xyz: str, rpy: str = "0 0 0", kind: str = "fixed", more: str = "") -> str:
    between = f'<parent link="{ends[0]}"/><child link="{ends[1]}"/><origin xyz="{xyz}" rpy="{rpy}"/>'
    return f'<joint name="{name}" type="{kind}">{between}{more}</joint>'


def turning(low: float, high: float, effort: float, more: str = "") -> str:
    return f'<axis xyz="0 0 1"/><limit lower="{low}" upper="{high}" effort="{effort}" velocity="2.2"/>{more}'


def six(shapes: str = "") -> str:
    """Six joints as xacro expands them: a world, frames by several names, and what simulators and drivers want."""
    names = ("shoulder_link", "upper_arm_link", "forearm_link", "wrist_1_link", "wrist_2_link", "wrist_3_link")
    frames = ("world", "base_link", "base", "flange", "tool0", "ft_frame")
    places = ("0 0 0.16", "0 0 0", "-0.42 0 0", "-0.39 0 0.13", "0 -0.1 0", "0 0.1 0")
    turns = ("0 0 0", f"{TURN} 0 0", "0 0 0", "0 0 0", f"{TURN} 0 0", f"{TURN} {np.pi} {np.pi}")
    limits = '<safety_controller k_velocity="0" k_position="20" soft_lower_limit="-6" soft_upper_limit="6"/>'
    parts = [*map(link, frames), link("base_link_inertia", 4.0, shapes)]
    parts += [link(name, 2.0, shapes) for name in names]
    parts.append(joint("base_joint", ("world", "base_link"), "0 0 0"))
    parts.append(joint("base_turned", ("base_link", "base_link_inertia"), "0 0 0", f"0 0 {np.pi}"))
    ends = zip(("base_link_inertia", *names), names, strict=False)
    for each, between, xyz, rpy in zip(names, ends, places, turns, strict=True):
        parts.append(
            joint(each.replace("link", "joint"), between, xyz, rpy, "revolute", turning(-6.2, 6.2, 150, limits))
        )
    parts.append(joint("base_fixed", ("base_link", "base"), "0 0 0", f"0 0 {np.pi}"))
    parts.append(joint("flange_fixed", ("wrist_3_link", "flange"), "0 0 0", f"0 {-TURN} {-TURN}"))
    parts.append(joint("tool_fixed", ("flange", "tool0"), "0 0 0", f"{TURN} 0 {TURN}"))
    parts.append(joint("ft_fixed", ("wrist_3_link", "ft_frame"), "0 0 0", f"{np.pi} 0 0"))
    parts.append(
        '<ros2_control name="six" type="system"><joint name="x"><param name="p">1</param></joint></ros2_control>'
    )
    parts.append('<transmission name="t"/><gazebo reference="base_link"><selfCollide>true</selfCollide></gazebo>')
    head = '<?xml version="1.0" ?>\n<!-- by xacro -->\n<robot name="six" xmlns:xacro="http://ros.org/wiki/xacro">'
    return f"{head}{''.join(parts)}</robot>"


def seven(mass: float = 2.0, kind: str = "revolute") -> str:
    """Seven joints, a hand with two fingers of which one mimics the other, and a frame between their tips."""
    places = ("0 0 0.33", "0 0 0", "0 -0.32 0", "0.08 0 0", "-0.08 0.38 0", "0 0 0", "0.09 0 0")
    turns = (0.0, -TURN, TURN, TURN, -TURN, TURN, TURN)
    parts = [link(f"link{i}", mass, CAN) for i in range(8)] + [link("hand", mass, CAN), link("hand_tcp")]
    parts += [link("leftfinger", mass / 100), link("rightfinger", mass / 100)]
    for i, (xyz, roll) in enumerate(zip(places, turns, strict=True), start=1):
        between = (f"link{i - 1}", f"link{i}")
        parts.append(joint(f"joint{i}", between, xyz, f"{roll} 0 0", kind, turning(-3.0, 3.0, 87)))
    parts.append(joint("hand_joint", ("link7", "hand"), "0 0 0.1", f"0 0 {-TURN / 2}"))
    slide = '<axis xyz="0 1 0"/><limit lower="0" upper="0.04" effort="20" velocity="0.2"/>'
    parts.append(joint("finger_joint1", ("hand", "leftfinger"), "0 0 0.06", kind="prismatic", more=slide))
    mimics = f'{slide}<mimic joint="finger_joint1"/>'
    parts.append(joint("finger_joint2", ("hand", "rightfinger"), "0 0 0.06", kind="prismatic", more=mimics))
    parts.append(joint("tcp", ("hand", "hand_tcp"), "0 0 0.1"))
    return f'<robot name="seven">{"".join(parts)}</robot>'


CLASSES = """<mujoco model="three"><compiler angle="radian" meshdir="assets" autolimits="true"/>
<option integrator="implicitfast"/><default><default class="arm"><joint axis="0 0 1" range="-2.9 2.9" armature="0.1"/>
<general biastype="affine" ctrlrange="-2.9 2.9" forcerange="-87 87" gainprm="4500" biasprm="0 -4500 -450"/>
<default class="small"><joint range="-2 2"/><general forcerange="-12 12"/></default>
<default class="collision"><geom type="capsule" size="0.04 0.08" group="3"/></default></default></default>
<worldbody><light pos="0 0 2"/><body name="link0" childclass="arm">
<inertial mass="1" pos="0 0 0.05" diaginertia="0.01 0.01 0.01"/><geom class="collision"/>
<body name="link1" pos="0 0 0.3"><inertial mass="2" pos="0 0 0.05" diaginertia="0.02 0.02 0.01"/>
<joint name="joint1"/><geom class="collision"/><body name="link2" quat="1 -1 0 0" pos="0 0 0.1">
<inertial mass="1" pos="0 0 0.05" diaginertia="0.02 0.02 0.01"/><joint name="joint2"/><geom class="collision"/>
<body name="link3" pos="0.2 0 0"><inertial mass="0.5" pos="0 0 0.05" diaginertia="5e-3 5e-3 5e-3"/>
<joint name="joint3" class="small"/><geom class="collision"/>
<site name="attachment_site" pos="0 0 0.1" quat="0.7071067811865476 0 0.7071067811865476 0"/>
</body></body></body></body></worldbody><actuator><general class="arm" name="a1" joint="joint1"/>
<general class="arm" name="a2" joint="joint2"/><general class="small" name="a3" joint="joint3"/></actuator>
<keyframe><key name="home" qpos="0 0 0"/></keyframe></mujoco>"""


def said(file: Path, **options: Any) -> str:
    with pytest.raises(ModelFileError) as caught:
        read_arm(file, **options)
    message = str(caught.value).removeprefix(f"{file}: ")
    assert "\n" not in message
    return message


def pointed_ahead(file: Path, **options: Any) -> ReadArm:
    """Read an arm with the zero that the error asks for."""
    zero = re.search(r"zero=\(([^)]+),\)", said(file, **options))
    assert zero
    return read_arm(file, zero=tuple(map(float, zero[1].split(","))), **options)


@pytest.fixture
def file(tmp_path: Path, request: pytest.FixtureRequest) -> Path:
    text = request.param
    place = tmp_path / ("arm.xml" if text.startswith("<mujoco") else "arm.urdf")
    place.write_text(text)
    return place


@pytest.mark.parametrize("file", [six(CAN), six()], indirect=True, ids=["shapes", "no shapes"])
def test_six_joints_expanded_by_xacro(file: Path) -> None:
    assert said(file) == "it has 3 ends: base, ft_frame, tool0. Name the one that carries the gripper with tool=...."
    read = pointed_ahead(file, tool="tool0", approach="z")
    assert read.joints == (
        "shoulder_joint", "upper_arm_joint", "forearm_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint",
    )  # fmt: skip
    assert read.foot_kg == 4.0
    assert sum("assumed stiffness of 1200" in note for note in read.notes) == 6


@pytest.mark.parametrize("file", [six(MESH.format("collision", "arm", "stl", "collision"))], indirect=True)
def test_a_mesh_that_is_not_there_is_asked_for(file: Path) -> None:
    message = said(file, tool="tool0", approach="z", zero=(-TURN / 2, 0, 0, 0, TURN / 2, 0))
    assert "package://maker_description/arm.stl was looked for in" in message
    assert message.endswith("meshes=....")


@pytest.mark.parametrize("file", [six(CAN + MESH.format("visual", "arm", "dae", "visual"))], indirect=True)
def test_looks_in_a_format_that_is_not_read_are_left_out(file: Path) -> None:
    notes = pointed_ahead(file, tool="tool0", approach="z").notes
    assert any(note.startswith("looks are left out") for note in notes)


FINGERS = ["leftfinger", "rightfinger"]


@pytest.mark.parametrize("file", [seven()], indirect=True)
def test_seven_joints_and_a_hand_whose_fingers_mimic(file: Path) -> None:
    message = said(file, tool="hand_tcp", approach="z")
    assert "locked={'finger_joint1': 0.0, 'finger_joint2': 0.0}" in message
    assert f"drop={FINGERS}" in message, "both at once"
    welded = pointed_ahead(file, tool="hand_tcp", approach="z", locked={"finger_joint1": 0.0, "finger_joint2": 0.0})
    without = pointed_ahead(file, tool="hand_tcp", approach="z", drop=FINGERS)
    assert len(welded.joints) == len(without.joints) == 7
    last = (welded.arm.links[-1].mass, without.arm.links[-1].mass)
    np.testing.assert_allclose(last, (4.04, 4.0))


@pytest.mark.parametrize("file", [seven(mass=0.0)], indirect=True)
def test_links_without_inertia_are_all_named(file: Path) -> None:
    names = ", ".join([*(f"link{i}" for i in range(1, 8)), *FINGERS])
    assert said(file).startswith(f"links that joints move have no <inertial>: {names}. Give <mass>")


@pytest.mark.parametrize("file", [seven(kind="continuous")], indirect=True)
def test_continuous_joints_turn_once_round(file: Path) -> None:
    read = pointed_ahead(file, tool="hand_tcp", approach="z", drop=FINGERS)
    assert sum("turns without end in the file" in note for note in read.notes) == 7
    np.testing.assert_allclose([b - a for a, b in (each.limits for each in read.arm.links)], 2 * np.pi)


@pytest.mark.parametrize("file", [CLASSES], indirect=True)
def test_an_mjcf_of_classes_ends_at_its_site(file: Path) -> None:
    assert said(file).startswith("joints 'joint1', 'joint2', 'joint3' have no speed above zero")
    assert said(file).endswith("Say it: servo=Servo(speed=...).")
    servo = Servo(speed=2.0)
    read = pointed_ahead(file, tool="attachment_site", approach="x", servo=servo)
    assert [each.torque for each in read.arm.links] == [87, 87, 12]
    assert [each.armature for each in read.arm.links] == [0.1] * 3
    assert read.arm.links[1].limits[1] - read.arm.links[1].limits[0] == pytest.approx(5.8)
    np.testing.assert_allclose(np.linalg.norm(read.arm.links[-1].tip), 0.1)
    assert "there is no link 'hand' for tool" in said(file, tool="hand", servo=servo)


INCLUDING = '<mujoco><include file="arm.xml"/></mujoco>'


@pytest.mark.parametrize("file", [CLASSES], indirect=True)
def test_an_mjcf_that_includes_another_is_made_plain(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(file.parent)
    scene = Path("scene.xml")
    scene.write_text(INCLUDING)
    command = re.search(r'python -c "(.*)"$', said(scene))
    assert command
    exec(command[1], {})
    assert read_arm("plain.xml", servo=Servo(speed=2.0)).joints == ("joint1", "joint2", "joint3")
