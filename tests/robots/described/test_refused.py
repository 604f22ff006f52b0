"""Files that are wrong, or written to do harm: each is refused in words that say what to change."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from aerial_il.core.errors import AerialError
from aerial_il.robots.parts.described import mesh_files, model, tree
from aerial_il.robots.parts.described.arm import Servo, read_arm
from aerial_il.robots.parts.described.error import ModelFileError
from tests.robots.described.writing import BOX, PITCH, PITCH_MJCF, cube

MASS, PLATE, END, ELBOW = '<mass value="0.1"/>', '<link name="plate"/>', "</robot>", '"elbow" type="revolute"'
AXIS, WORLD, ACTUATORS = '<axis xyz="0 1 0"/><limit lower="-2"', "<worldbody>", "<actuator>"
LOWER_BOX = '<geometry><box size="0.1 0.02 0.02"/></geometry>'


def changed(text: str, old: str, new: str) -> str:
    assert old in text, "the test would change nothing"
    return text.replace(old, new)


def of_mesh(reference: str) -> str:
    return f'<geometry><mesh filename="{reference}"/></geometry>'


def mesh(reference: str) -> str:
    return changed(PITCH, LOWER_BOX, of_mesh(reference))


URDF_CHANGES = {
    "no inertial": (
        PITCH[PITCH.index('<inertial><origin xyz="0.05') : PITCH.index('<collision><origin xyz="0.05')],
        "",
        "have no <inertial>: lower. Give <mass>",
    ),
    "no mass": (MASS, '<mass value="0"/>', "link 'lower': its mass is 0 kg"),
    "a plate like no solid": (
        PLATE,
        '<link name="plate"><inertial><mass value="0.1"/></inertial></link>',
        "no solid is like link 'plate'",
    ),
    "negative mass": (MASS, '<mass value="-1"/>', "its mass is -1 kg"),
    "mass of words": (MASS, '<mass value="light"/>', "value of the inertial of link 'lower'.*'light'"),
    "mass not finite": (MASS, '<mass value="inf"/>', "not a finite number: 'inf'"),
    "negative moment": ('ixx="1e-5"', 'ixx="-1e-5"', "'lower': its principal moments .*above zero"),
    "no solid's moments": ('ixx="1e-5"', 'ixx="3e-4"', "'lower': .*exceeds the sum of the others"),
    "grams and millimetres": (
        'ixx="1e-5" iyy="9e-5" izz="9e-5"',
        'ixx="10" iyy="90" izz="90"',
        "inertia of link 'lower' is that of its 0.1 kg at 30 m .*Is it in kg m²",
    ),
    "no limits": ('<limit lower="-2" upper="2" effort="3" velocity="4"/>', "", "'elbow' is revolute and has no <limit"),
    "limits the wrong way": ('lower="-2" upper="2"', 'lower="2" upper="-2"', "'elbow' turns from 2 to -2 rad"),
    "limit not finite": ('upper="2" effort="3"', 'upper="nan" effort="3"', "upper of the limit of joint 'elbow'"),
    "no torque": ('effort="3"', 'effort="0"', "'elbow' has no torque above zero.*Servo\\(torque="),
    "no speed": (' effort="3" velocity="4"', ' effort="3"', "'elbow' has no speed above zero.*Servo\\(speed="),
    "no axis": (AXIS, '<axis xyz="0 0 0"/><limit lower="-2"', "axis of joint 'elbow' is 0 0 0"),
    "axis of two": (AXIS, '<axis xyz="0 1"/><limit lower="-2"', "joint 'elbow' is not 3 finite"),
    "slides": (ELBOW, '"elbow" type="prismatic"', "'elbow' .* is of type slide.*locked="),
    "floats": (ELBOW, '"elbow" type="floating"', "'elbow' is of type 'floating'; those read"),
    "mimics": (
        'effort="3" velocity="4"/>',
        'effort="3" velocity="4"/><mimic joint="shoulder"/>',
        "'elbow' .*mimics 'shoulder'",
    ),
    "a link twice": (
        '<link name="flange"/>',
        '<link name="flange"/><link name="lower"/>',
        "<link> a second time: 'lower'",
    ),
    "an unknown parent": ('<parent link="upper"/>', '<parent link="uper"/>', "'elbow' names the link 'uper'"),
    "two parents": (
        END,
        '<joint name="again" type="fixed"><parent link="plate"/><child link="lower"/></joint></robot>',
        "'lower' hangs from two joints",
    ),
    "two roots": (END, '<link name="stray"/></robot>', "and here do: plate, stray"),
    "a loop": (
        END,
        '<joint name="back" type="fixed"><parent link="flange"/><child link="plate"/></joint></robot>',
        "and here do: none",
    ),
    "a missing mesh": (
        LOWER_BOX,
        of_mesh("meshes/lower.stl"),
        "'lower' collides as a mesh .*meshes/lower.stl was looked for in .*meshes/lower.stl and is not there.*meshes=",
    ),
    "a collada mesh": (
        LOWER_BOX,
        of_mesh("lower.dae"),
        "'lower' collides as a mesh .*lower.dae is no .stl, .obj, .msh file; convert",
    ),
    "a broken mesh": (LOWER_BOX, of_mesh("broken.stl"), "MuJoCo cannot compile it"),
    "a way out": (LOWER_BOX, of_mesh("../../../etc/passwd.stl"), "points out of .* nothing outside is read"),
    "a way out of a package": (LOWER_BOX, of_mesh("package://arm/../../etc/passwd.stl"), "points out of"),
    "the root": (LOWER_BOX, of_mesh("/etc/passwd.stl"), "points out of"),
    "a file of the root": (LOWER_BOX, of_mesh("file:///etc/passwd.stl"), "points out of"),
    "a link out": (LOWER_BOX, of_mesh("out/passwd.stl"), "points out of"),
    "another machine": (LOWER_BOX, of_mesh("http://example.org/lower.stl"), "is not on this machine"),
}
URDF = {name: (changed(PITCH, old, new), message) for name, (old, new, message) in URDF_CHANGES.items()} | {
    "a template": (
        changed(PITCH, "<robot ", '<robot xmlns:xacro="http://ros.org/wiki/xacro" ').replace(
            "</robot>", "<xacro:arm/></robot>"
        ),
        "Expand it first: xacro",
    ),
    "no joints": ('<robot name="rock"><link name="rock"/></robot>', "0 joints turn, and the controller flies 1 to 8"),
    "a document type": ('<!DOCTYPE robot [<!ENTITY a "aaaa">]>' + PITCH, "declares a document type or entities"),
    "malformed": (PITCH[:-20], "not well-formed XML"),
    "something else": ("<sdf/>", "begins with <sdf>: neither URDF"),
    "deep": ("<robot>" + 200 * "<link>" + 200 * "</link>" + "</robot>", "more elements than are read"),
    "no text": ("", "not well-formed"),
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder for model files, with a broken mesh and a symbolic link that leads out."""
    result = tmp_path / "arm"
    result.mkdir()
    (result / "broken.stl").write_bytes(cube(0.01)[:-7])
    (result / "out").symlink_to("/etc")
    return result


@pytest.mark.parametrize("case", URDF)
def test_a_wrong_urdf_is_refused_in_words(folder: Path, case: str) -> None:
    text, message = URDF[case]
    file = folder / "arm.urdf"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ModelFileError, match=message) as caught:
        read_arm(file)
    assert str(caught.value).startswith(f"{file}: ")


def test_the_file_that_these_cases_change_is_read(folder: Path) -> None:
    (folder / "arm.urdf").write_text(PITCH, encoding="utf-8")
    assert len(read_arm(folder / "arm.urdf").arm.links) == 2


MJCF = {
    "include": (WORLD, '<include file="/etc/passwd"/><worldbody>', "<include> is not supported"),
    "plugin": (WORLD, '<extension><plugin plugin="mujoco.elasticity.cable"/></extension><worldbody>', "it runs code"),
    "replicate": (
        '<body name="flange" pos="0.1 0 0"/>',
        '<replicate count="9999999"><body/></replicate>',
        "generates many",
    ),
    "height field": (
        WORLD,
        '<asset><hfield name="h" file="h.png" size="1 1 1 1"/></asset><worldbody>',
        "it is terrain",
    ),
    "a way out": (WORLD, '<asset><mesh name="m" file="../m.stl"/></asset><worldbody>', "points out of"),
    "a way out by meshdir": (
        '<compiler angle="radian"',
        '<asset><mesh name="m" file="m.stl"/></asset><compiler meshdir="/etc" angle="radian"',
        "points out of",
    ),
    "a built mesh": (
        WORLD,
        '<asset><mesh name="m" builtin="sphere" params="9"/></asset><worldbody>',
        "generated by MuJoCo",
    ),
    "two joints": (
        '<joint name="elbow"',
        '<joint name="twist" axis="1 0 0" range="-1 1"/><joint name="elbow"',
        "'lower' has 2 joints",
    ),
    "a ball": ('<joint name="elbow" axis="0 1 0"', '<joint name="elbow" type="ball"', "of type ball"),
    "coupled": (
        ACTUATORS,
        '<equality><joint joint1="elbow" joint2="shoulder"/></equality><actuator>',
        "'shoulder' .*<equality> ties",
    ),
    "a loop": (
        ACTUATORS,
        '<equality><connect body1="lower" body2="plate" anchor="0 0 0"/></equality><actuator>',
        "closes a loop",
    ),
    "unknown words": (WORLD, "<wordbody>", "MuJoCo cannot compile it|not well-formed"),
    "no limits": (' range="-1 2"', ' range="2 -1"', "'shoulder' turns from 2 to -1 rad"),
    "no solid": ('diaginertia="1e-5 9e-5 9e-5"', 'diaginertia="1e-3 9e-5 9e-5"', "MuJoCo cannot compile it.*A .* B"),
    "two arms": ("</worldbody>", '<body name="other"/></worldbody>', "it holds 2 robots or parts: other, plate"),
}


@pytest.mark.parametrize("case", MJCF)
def test_a_wrong_mjcf_is_refused_in_words(folder: Path, case: str) -> None:
    old, new, message = MJCF[case]
    text = changed(PITCH_MJCF, old, new)
    if case == "a ball":
        text = text.replace(' range="-2 2" actuatorfrcrange="-3 3"', "").replace(
            '<motor name="elbow" joint="elbow" ctrlrange="-4 4"/>', ""
        )
    (folder / "arm.xml").write_text(text, encoding="utf-8")
    with pytest.raises(ModelFileError, match=message):
        read_arm(folder / "arm.xml", servo=Servo(speed=4.0))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"base": "plat"}, "no link 'plat' for base. Links: .*plate"),
        ({"tool": "hand"}, "no link 'hand' for tool"),
        ({"tool": "plate", "base": "upper"}, "'plate' does not hang from 'upper'"),
        ({"drop": ["hand"]}, "no link 'hand' for drop"),
        ({"tool": "flange", "drop": ["lower"]}, "does not hang from 'plate', or is dropped"),
        ({"locked": {"wrist": 0.0}}, r"'wrist', which is no joint. Joints: elbow, shoulder"),
        ({"servos": {"wrist": Servo()}}, "servos names 'wrist'; the arm's joints are shoulder, elbow"),
        ({"zero": (0.0,)}, "zero has one angle for each of shoulder, elbow"),
        ({"zero": (0.0, float("nan"))}, "zero has one angle for each"),
        ({"approach": "y"}, "its joints cannot turn it there"),
        ({"approach": "z"}, "zero="),
        ({"approach": "-x"}, "zero="),
    ],
)
def test_what_the_robots_file_asks_for_in_vain_is_named(folder: Path, options: dict, message: str) -> None:
    (folder / "arm.urdf").write_text(PITCH, encoding="utf-8")
    with pytest.raises(AerialError, match=message):
        read_arm(folder / "arm.urdf", **options)


def test_too_many_ends_are_listed(folder: Path) -> None:
    second = '<link name="camera"/><joint name="eye" type="fixed"><parent link="lower"/><child link="camera"/></joint>'
    (folder / "arm.urdf").write_text(PITCH.replace("</robot>", f"{second}</robot>"), encoding="utf-8")
    with pytest.raises(ModelFileError, match="it has 2 ends: camera, flange"):
        read_arm(folder / "arm.urdf")
    assert read_arm(folder / "arm.urdf", tool="flange").joints == ("shoulder", "elbow")


def test_sizes_are_bounded(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "arm.urdf").write_text(mesh("lower.stl"), encoding="utf-8")
    (folder / "lower.stl").write_bytes(cube(0.01))
    assert read_arm(folder / "arm.urdf")
    with monkeypatch.context() as patch:
        patch.setattr(model, "MOST_VERTICES", 7)
        with pytest.raises(
            ModelFileError, match="its 1 meshes have 8 vertices even as coarse hulls, and 7 is the most"
        ):
            read_arm(folder / "arm.urdf")
    with monkeypatch.context() as patch:
        patch.setattr(mesh_files, "MAX_BYTES", 100)
        with pytest.raises(ModelFileError, match=r"lower\.stl has 684 bytes, and 100 is the most"):
            read_arm(folder / "arm.urdf")
    monkeypatch.setattr(tree, "MAX_BYTES", 100)
    with pytest.raises(ModelFileError, match="bytes, and 100 is the most that is read"):
        read_arm(folder / "arm.urdf")


def test_what_is_no_plain_file_is_not_opened(folder: Path) -> None:
    os.mkfifo(folder / "pipe.urdf")  # opened, it would wait for ever
    for name in ("pipe.urdf", "nothing.urdf", "."):
        with pytest.raises(ModelFileError, match="there is no such file"):
            read_arm(folder / name)
    (folder / "latin.urdf").write_bytes(PITCH.replace("small", "größe").encode("latin-1"))
    with pytest.raises(ModelFileError, match="cannot be read as UTF-8"):
        read_arm(folder / "latin.urdf")


def test_a_folder_for_meshes_is_the_only_one(folder: Path) -> None:
    elsewhere = folder.parent / "meshes"
    elsewhere.mkdir()
    (elsewhere / "lower.stl").write_bytes(cube(0.01))
    (folder / "arm.urdf").write_text(mesh("package://arm/lower.stl"), encoding="utf-8")
    with pytest.raises(ModelFileError, match="is not there"):
        read_arm(folder / "arm.urdf")
    assert read_arm(folder / "arm.urdf", meshes=elsewhere)


def test_a_box_without_mass_beside_a_link_weighs_nothing(folder: Path) -> None:
    """MuJoCo alone would make it of water."""
    fixed = '<joint name="c" type="fixed"><parent link="lower"/><child link="cover"/></joint>'
    cover = f'<link name="cover">{BOX}</link>{fixed}</robot>'
    (folder / "arm.urdf").write_text(PITCH.replace("</robot>", cover), encoding="utf-8")
    assert read_arm(folder / "arm.urdf", tool="flange").arm.links[1].mass == pytest.approx(0.1)
