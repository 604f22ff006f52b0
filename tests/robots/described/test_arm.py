"""An arm from a file is the arm that the file describes: to the bit where we wrote it, to theory where it is turned."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from aerial_il import robots
from aerial_il.core.errors import InvalidValueError
from aerial_il.robots.parts.described.arm import ReadArm, Servo, read_arm
from aerial_il.robots.parts.described.error import ModelFileError
from aerial_il.robots.parts.gripper import NO_GRIPPER
from aerial_il.robots.parts.z1 import FOOT_KG, FOOT_M, UPRIGHT
from aerial_il.robots.robot import Robot
from tests.robots.described.writing import BOX, PITCH, PITCH_MJCF, cube, stl, urdf_of
from tests.robots.test_robots import compiled

FIELDS = ("body_mass", "body_ipos", "body_iquat", "body_pos", "body_quat", "jnt_axis", "jnt_range", "jnt_pos")
SERVO = ("actuator_gainprm", "actuator_biasprm", "actuator_forcerange", "dof_armature")
Z1_SERVOS = {
    f"joint_{j}": Servo(stiffness=link.stiffness, damping=link.damping, armature=link.armature)
    for j, link in enumerate(UPRIGHT)
}


def read(folder: Path, text: str, name: str = "arm.urdf", **options: object) -> ReadArm:
    """Read a text as a file."""
    (folder / name).write_text(text, encoding="utf-8")
    return read_arm(folder / name, **options)  # type: ignore[arg-type]


def carrying(arm: ReadArm) -> Robot:
    """A vehicle with the arm and nothing in its hand."""
    rest = (0.0,) * len(arm.joints)
    base = robots.get("ua_quad_arm4").base
    return Robot("carrier", "A test.", base, arm.arm, NO_GRIPPER, rest_forward=rest, rest_down=rest)


@pytest.mark.parametrize(("name", "rpy", "mount"), [("z1", (0, 0, 0), 0.0), ("big_four_z1", (np.pi, 0, 0), -0.06)])
def test_the_z1_written_as_urdf_reads_back_as_our_robot(
    tmp_path: Path, name: str, rpy: tuple[float, float, float], mount: float
) -> None:
    ours = robots.get(name)
    text = urdf_of(UPRIGHT, foot_m=FOOT_M, foot_kg=FOOT_KG)
    result = read(tmp_path, text, mount=(0.0, 0.0, mount), mount_rpy=rpy, servos=Z1_SERVOS)
    assert result.foot_kg == FOOT_KG
    again = replace(ours, arm=result.arm)
    a, b = compiled(again), compiled(ours)
    for field in (*FIELDS, *SERVO):
        np.testing.assert_array_equal(getattr(a, field), getattr(b, field), err_msg=field)
    np.testing.assert_allclose(a.body_inertia, b.body_inertia, rtol=0, atol=1e-15)
    for field, value in ours.vehicle._asdict().items():
        np.testing.assert_allclose(getattr(again.vehicle, field), value, rtol=0, atol=1e-12, err_msg=field)


def test_the_round_trip_notices_one_gram(tmp_path: Path) -> None:
    heavier = (*UPRIGHT[:2], replace(UPRIGHT[2], mass=0.840), *UPRIGHT[3:])
    result = read(tmp_path, urdf_of(heavier, foot_m=FOOT_M, foot_kg=FOOT_KG), servos=Z1_SERVOS)
    assert not np.array_equal(
        compiled(replace(robots.get("z1"), arm=result.arm)).body_mass, compiled(robots.get("z1")).body_mass
    )


def tool_of_file(path: Path, tool: str, base: str, joints: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """Tool position and rotation in the base link's frame, by MuJoCo's own reading of the file."""
    spec = mujoco.MjSpec.from_file(str(path))
    spec.compiler.fusestatic = False
    model = spec.compile()
    data = mujoco.MjData(model)
    for name, value in joints.items():
        data.joint(name).qpos[0] = value
    mujoco.mj_kinematics(model, data)
    turn = data.body(base).xmat.reshape(3, 3).T
    return turn @ (data.body(tool).xpos - data.body(base).xpos), turn @ data.body(tool).xmat.reshape(3, 3)


SKEWED = 'ixy="2e-6" ixz="1e-6" iyz="-3e-6"'
TWISTED = PITCH.replace(
    '<origin xyz="0.2 0 0"/>\n<axis xyz="0 1 0"/>',
    '<origin xyz="0.2 0.03 0" rpy="0.4 -0.3 0.2"/>\n<axis xyz="0.3 -0.2 1"/>',
)
TWISTED = TWISTED.replace('izz="9e-5" ixy="0" ixz="0" iyz="0"', f'izz="9e-5" {SKEWED}')
TWISTED = TWISTED.replace('<origin xyz="0.05 0 0"/><mass', '<origin xyz="0.05 0 0.01" rpy="0.3 0.2 0.1"/><mass')
assert TWISTED.count(SKEWED) == TWISTED.count('rpy="0.4 -0.3 0.2"') == TWISTED.count('rpy="0.3 0.2 0.1"') == 1


def zero_of(path: Path) -> tuple[float, ...]:
    """The angles at which its tool points ahead, as the error says them."""
    with pytest.raises(ModelFileError, match=r"zero=\(") as caught:
        read_arm(path)
    return tuple(float(part) for part in str(caught.value).split("zero=(")[1].split(",)")[0].split(","))


def test_frames_that_are_turned_anyhow_end_where_mujoco_says(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(TWISTED, encoding="utf-8")
    zero = zero_of(tmp_path / "arm.urdf")
    result = read_arm(tmp_path / "arm.urdf", zero=zero, mount=(0.02, 0.0, -0.05))
    robot = carrying(result)
    at_zero = tool_of_file(tmp_path / "arm.urdf", "flange", "plate", dict(zip(result.joints, zero, strict=True)))[1]
    rng = np.random.default_rng(0)
    for values in rng.uniform(-1.0, 1.0, (5, 2)):
        pos, rot = robot.tool_at(result.posture(*values))
        wanted, turned = tool_of_file(
            tmp_path / "arm.urdf", "flange", "plate", dict(zip(result.joints, values, strict=True))
        )
        np.testing.assert_allclose(pos - [0.02, 0.0, -0.05], wanted, atol=1e-9)
        np.testing.assert_allclose(rot, turned @ at_zero.T, atol=1e-9)


@pytest.mark.parametrize(
    ("mass", "moments"),
    [
        ("0", ""),
        ("1e-9", 'ixx="0" iyy="0" izz="0"'),
        ("1e-6", 'ixx="1e-6" iyy="1e-6" izz="1e-6" ixy="1e-6" ixz="1e-6" iyz="1e-6"'),
    ],
)  # of no solid; the last two as manufacturers write them
def test_a_frame_with_hardly_any_mass_is_a_frame(tmp_path: Path, mass: str, moments: str) -> None:
    frame = f'<link name="flange"><inertial><mass value="{mass}"/><inertia {moments}/></inertial></link>'
    result = read(tmp_path, PITCH.replace('<link name="flange"/>', frame))
    plain = read(tmp_path, PITCH)
    assert [(a.mass, a.centre, a.tensor) for a in result.arm.links] == [
        (a.mass, a.centre, a.tensor) for a in plain.arm.links
    ]


def test_the_simulated_links_have_the_whole_inertia_of_the_file(tmp_path: Path) -> None:
    """Kinetic energy of every link, spun about three axes, is that of the file's own model."""
    (tmp_path / "arm.urdf").write_text(TWISTED, encoding="utf-8")
    own = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.urdf"))
    zero = zero_of(tmp_path / "arm.urdf")
    model = compiled(carrying(read_arm(tmp_path / "arm.urdf", zero=zero)))
    for ours, theirs in (("link_0", "upper"), ("link_1", "lower")):
        np.testing.assert_allclose(np.sort(model.body(ours).inertia), np.sort(own.body(theirs).inertia), rtol=1e-9)
    masses = np.zeros((model.nv, model.nv)), np.zeros((own.nv, own.nv))
    for one, joints, full in ((model, (0.0, 0.0), masses[0]), (own, zero, masses[1])):
        data = mujoco.MjData(one)
        data.qpos[-2:] = joints
        mujoco.mj_forward(one, data)
        mujoco.mj_fullM(one, data, full)
    armature = np.diag(model.dof_armature[-2:])
    np.testing.assert_allclose(masses[0][-2:, -2:] - armature, masses[1], rtol=1e-9)


def test_urdf_and_mjcf_of_the_same_arm_give_the_same_arm(tmp_path: Path) -> None:
    servo = Servo(speed=4.0)
    urdf = read(tmp_path, PITCH, servo=servo)
    mjcf = read(tmp_path, PITCH_MJCF, "arm.xml", servo=servo)
    for a, b in zip(urdf.arm.links, mjcf.arm.links, strict=True):
        for field in ("axis", "tip", "mass", "limits", "speed", "torque", "com", "inertia"):
            np.testing.assert_allclose(getattr(a, field), getattr(b, field), atol=1e-12, err_msg=field)
    first = mjcf.arm.links[0]
    assert (first.stiffness, first.damping, first.armature) == (40.0, 2.0, 0.004), "the file's own servo"
    assert urdf.arm.links[0].stiffness == 40.0, "8 times its torque"
    assert any("assumed stiffness of 40" in note for note in urdf.notes)


def test_the_robots_own_word_goes_before_the_files(tmp_path: Path) -> None:
    result = read(tmp_path, PITCH, servo=Servo(speed=2.0), servos={"elbow": Servo(torque=1.0, stiffness=9.0)})
    shoulder, elbow = result.arm.links
    assert (shoulder.speed, shoulder.torque) == (2.0, 5.0)
    assert (elbow.torque, elbow.stiffness, elbow.speed) == (1.0, 9.0, 4.0)


FINGER = f"""<link name="finger"><inertial><mass value="0.03"/>
<inertia ixx="1e-6" iyy="1e-6" izz="1e-6" ixy="0" ixz="0" iyz="0"/></inertial>{BOX}</link>
<joint name="grip" type="prismatic"><parent link="flange"/><child link="finger"/><origin xyz="0.05 0 0"/>
<axis xyz="0 1 0"/><limit lower="0" upper="0.02" effort="3" velocity="1"/></joint></robot>"""


def test_a_finger_is_welded_on_or_dropped_as_the_robot_says(tmp_path: Path) -> None:
    text = PITCH.replace("</robot>", FINGER)
    with pytest.raises(ModelFileError, match=r"ends at 'flange': grip\. .*locked=.*drop=\['finger'\].*tool="):
        read(tmp_path, text, tool="flange")
    welded = read(tmp_path, text, tool="flange", locked={"grip": 0.02}).arm.links[-1]
    dropped = read(tmp_path, text, tool="flange", drop=["finger"]).arm.links[-1]
    assert welded.mass == pytest.approx(0.13)
    assert dropped.mass == pytest.approx(0.10)
    assert welded.com[1] == pytest.approx(0.02 * 0.03 / 0.13), "where it is locked"
    assert dropped.com[1] == 0.0


def test_a_convex_mesh_collides_and_looks_hide_what_collides(tmp_path: Path) -> None:
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "upper.STL").write_bytes(cube(0.03))
    mesh = '<geometry><mesh filename="package://small/meshes/upper.STL" scale="1 2 1"/></geometry>'
    text = PITCH.replace(
        '<collision><origin xyz="0.1 0 0"/><geometry><box size="0.2 0.02 0.02"/></geometry></collision>',
        f"<visual>{mesh}</visual><collision>{mesh}</collision>",
    )
    result = read(tmp_path, text)
    looks, hull = sorted(result.arm.links[0].shapes, key=lambda shape: shape.collides)
    assert looks.seen
    assert not hull.seen
    np.testing.assert_allclose(hull.half_extent, [0.03, 0.06, 0.03], atol=1e-6)
    model = compiled(carrying(result))
    touching = [
        model.geom(i) for i in range(model.ngeom) if model.geom(i).name.startswith("link_0") and model.geom_contype[i]
    ]
    assert len(touching) == 1
    assert touching[0].type == mujoco.mjtGeom.mjGEOM_MESH
    assert touching[0].group == 3


def test_a_hollow_mesh_is_said_to_collide_as_its_hull(tmp_path: Path) -> None:
    corner = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0.1, 0.1, 0.1]])
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 4), (2, 3, 4), (3, 1, 4)]
    (tmp_path / "dent.stl").write_bytes(stl(0.1 * corner, faces))
    text = PITCH.replace('<box size="0.1 0.02 0.02"/>', '<mesh filename="dent.stl"/>')
    assert any(
        "'lower' collides as its convex hull, of which it fills 30%" in note for note in read(tmp_path, text).notes
    )


def test_a_missing_mesh_of_looks_is_left_out_with_a_note(tmp_path: Path) -> None:
    looks = '<visual><geometry><mesh filename="meshes/fine.dae"/></geometry></visual></link>\n<link name="flange"/>'
    result = read(tmp_path, PITCH.replace('</link>\n<link name="flange"/>', looks))
    assert any("looks are left out: meshes/fine.dae is no .stl" in note for note in result.notes)
    assert all(shape.collides for link in result.arm.links for shape in link.shapes)


def test_a_joint_without_end_turns_from_minus_pi_to_pi(tmp_path: Path) -> None:
    text = PITCH.replace('name="elbow" type="revolute"', 'name="elbow" type="continuous"')
    result = read(tmp_path, text)
    assert result.arm.links[1].limits == (-np.pi, np.pi)
    assert any("'elbow' turns without end" in note for note in result.notes)


def test_a_posture_has_a_value_for_each_joint(tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match=r"2 values \(shoulder, elbow\)"):
        read(tmp_path, PITCH).posture(0.0)


def test_a_guessed_gripper_is_said(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    result = read(tmp_path, PITCH)
    assert "its gripper sits at" in result.notes[0]
    assert "tool=... and approach=... would say it" in caplog.text
