"""Robots of one's own: hulls of meshes, a vehicle from MJCF, an arm from URDF with rotors from PX4."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import aerial_il
from aerial_il import robots
from aerial_il.cli.main import main
from aerial_il.data.dataset import open_dataset
from aerial_il.robots.parts.arm import Arm
from aerial_il.robots.parts.described import hull, model
from aerial_il.robots.parts.described.arm import read_arm
from aerial_il.robots.parts.described.error import ModelFileError
from aerial_il.robots.parts.described.rotorcraft import ReadRotorcraft, read_rotorcraft
from aerial_il.robots.parts.gripper import NO_GRIPPER
from aerial_il.robots.robot import Robot
from tests.contract import test_feasibility, test_scene
from tests.contract.test_feasibility import register, solved
from tests.project.test_examples import FILE, found_beside_ours
from tests.robots import test_figures, test_robots
from tests.robots.described.test_refused import mesh
from tests.robots.described.writing import QUAD_MJCF, stl
from tests.robots.test_robots import compiled

PAGE = Path(__file__).parents[3] / "docs" / "own_robot.md"


@pytest.fixture(scope="module", autouse=True)
def gull(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """The files of the page where they belong."""
    top = tmp_path_factory.mktemp("checkout")
    shown = FILE.findall(PAGE.read_text(encoding="utf-8"))
    assert [path for path, _ in shown] == [f"aerial_il/robots/gull{end}" for end in ("_arm.urdf", "_rotors.px4", ".py")]
    for path, text in shown:
        (top / path).parent.mkdir(parents=True, exist_ok=True)
        (top / path).write_text(text, encoding="utf-8")
    with found_beside_ours(top):
        yield


def test_it_is_registered_and_supports_what_its_arm_allows() -> None:
    assert "gull" in aerial_il.list_robots()
    supported = {task for robot, task in aerial_il.list_cells() if robot == "gull"}
    assert {"reach", "pick_place"} <= supported
    assert supported == {task for robot, task in aerial_il.list_cells() if robot == "ua_quad_arm4"}


def test_it_is_what_a_robot_of_ours_must_be() -> None:
    robot = robots.get("gull")
    test_robots.test_actuators_come_in_the_order_rotors_joints_gripper(robot)
    test_robots.test_servos_hold_the_arm_in_any_posture(robot)
    test_robots.test_rest_postures_point_where_they_say(robot)
    test_robots.test_the_gripper_opens_closes_and_squeezes(robot)
    test_figures.test_the_centre_of_mass_is_that_of_the_simulated_robot(robot)
    test_figures.test_the_inertia_is_that_of_the_simulated_robot(robot)
    test_figures.test_hover_thrusts_balance_weight_and_the_arm(robot)


@pytest.mark.parametrize("task", ["reach", "pick_place"])
def test_its_expert_solves_the_task_and_nothing_else_does(task: str) -> None:
    test_scene.test_every_element_has_a_name("gull", task)
    test_scene.test_the_stored_scene_compiles_to_the_same_model("gull", task)
    test_feasibility.test_the_expert_solves_it("gull", task, "calm")
    test_feasibility.test_random_actions_do_not("gull", task)


def test_it_picks_and_places_in_gusts() -> None:
    assert solved("gull", "pick_place", "gusts") >= 3


def test_flights_of_another_robot_become_its_own(tmp_path: Path) -> None:
    flown = ["expert.noise=0", "episodes=1", "seed=7", "progress=false", f"out={tmp_path / 'one'}"]
    assert main(["collect", "robot=fa_hexa_arm4", "task=insert_peg", *flown]) == 0
    made = ["episodes=8", "threads=1", "progress=false", f"out={tmp_path / 'many'}"]
    assert main(["generate", f"dataset={tmp_path / 'one'}", "robot=gull", *made]) == 0
    flights = list(open_dataset(tmp_path / "many"))
    assert len(flights) >= 7
    assert {flight.spec.robot for flight in flights} == {"gull"}


def blob(count: int) -> np.ndarray:
    """Points (count, 3) on an ellipsoid of half sizes 5, 2 and 1 cm, m."""
    points = np.random.default_rng(0).normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True) * [0.05, 0.02, 0.01]


def volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Signed volume of a closed mesh, m³: positive if its faces are counter-clockwise seen from outside."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float(np.sum(a * np.cross(b, c)) / 6.0)


def test_a_hull_of_few_points_is_nearly_whole_and_faces_out() -> None:
    fine = blob(20_000)
    vertices, faces = hull.of_few_points(fine)
    assert 100 < len(vertices) <= hull.POINTS
    assert 0.95 * ConvexHull(fine).volume < volume(vertices, faces) < ConvexHull(fine).volume
    np.testing.assert_allclose(np.ptp(vertices, axis=0), np.ptp(fine, axis=0), rtol=0.02)


def test_a_flat_mesh_has_a_hull_too() -> None:
    vertices, faces = hull.of_few_points(blob(1000) * [1.0, 1.0, 0.0])
    assert len(faces) > 2
    assert np.all(vertices[:, 2] == 0.0)


def test_meshes_as_fine_as_manufacturers_make_them_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fine = blob(3000)
    (tmp_path / "lower.stl").write_bytes(stl(fine, [tuple(face) for face in ConvexHull(fine).simplices]))
    (tmp_path / "arm.urdf").write_text(mesh("lower.stl"), encoding="utf-8")
    whole = read_arm(tmp_path / "arm.urdf").arm.links[1].shapes
    monkeypatch.setattr(model, "MOST_VERTICES", 2000)
    result = read_arm(tmp_path / "arm.urdf")
    assert sum(len(shape.vertices) for shape in result.arm.links[1].shapes) <= hull.POINTS
    assert any("its meshes have 3000 vertices" in note for note in result.notes)
    sizes = [np.sort(shape.half_extent) for shape in (*whole, *result.arm.links[1].shapes)]
    np.testing.assert_allclose(sizes[0], sizes[-1], rtol=0.05)


assert register  # a fixture


def read(folder: Path, text: str = QUAD_MJCF, **options: object) -> ReadRotorcraft:
    (folder / "tern.xml").write_text(text, encoding="utf-8")
    known = {"rotor_radius": 0.1, "tau_up": 0.015, "tau_down": 0.025, "drag": (0.2, 0.2, 0.3)}
    return read_rotorcraft(folder / "tern.xml", **(known | options))  # type: ignore[arg-type]


def flying(result: ReadRotorcraft) -> Robot:
    return Robot("tern", "A quadrotor from an MJCF.", result.base, Arm(), NO_GRIPPER, rest_forward=(), rest_down=())


def test_rotors_and_inertia_are_the_files_about_its_centre(tmp_path: Path) -> None:
    result = read(tmp_path)
    base = result.base
    assert base.mass == 1.5
    np.testing.assert_allclose(base.inertia, [0.015, 0.016, 0.028])
    np.testing.assert_allclose(result.origin, [-0.02, 0.0, -0.01])
    np.testing.assert_allclose(base.rotor_pos[0], [0.15, 0.15, 0.03])
    np.testing.assert_allclose(base.rotor_axis, np.tile([0.0, 0.0, 1.0], (4, 1)))
    np.testing.assert_allclose(base.rotor_drag_ratio, [0.016, -0.016, -0.016, 0.016])
    np.testing.assert_allclose(base.rotor_max, 13.0, err_msg="gear times control range, for the last as well")
    np.testing.assert_allclose(base.hub_size, [0.10, 0.05, 0.04])


def test_it_hovers(tmp_path: Path, register: type) -> None:
    robot = flying(read(tmp_path))
    register.add(robot)
    assert compiled(robot).geom("hub_0").contype[0] == 2
    assert solved("tern", "hover") == 4


def changed(old: str, new: str) -> str:
    assert old in QUAD_MJCF
    return QUAD_MJCF.replace(old, new)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (changed('gear="0 0 2 0 0 0.032"', 'gear="1 0 0 0 0 0"'), "'rr' has the gear \"1 0 0 0 0 0\""),
        (changed(' ctrlrange="0 6.5"', ""), r"'rr' has no ctrlrange. .*max_thrust="),
        (changed("0 6.5", "-2 -1"), "'rr' thrusts from -4 to -2 N"),
        (QUAD_MJCF[: QUAD_MJCF.index("<actuator>")] + "</mujoco>", "it has no rotors.*PX4"),
        (QUAD_MJCF.replace("-0.016", "0.016"), "cannot produce lift and three torques"),
        (changed("</worldbody>", '<body name="box"/></worldbody>'), "holds 2 bodies in the world: box, tern"),
        (changed('mass="1.5"', 'mass="0"'), "MuJoCo cannot compile it|has no mass"),
    ],
)
def test_what_is_no_vehicle_is_refused_in_words(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ModelFileError, match=message):
        read(tmp_path, text)


def test_the_vehicle_itself_cannot_be_dropped(tmp_path: Path) -> None:
    with pytest.raises(ModelFileError, match="drop names body 'tern' or one above it; that is the vehicle itself"):
        read(tmp_path, QUAD_MJCF, drop=["tern"])


def test_a_camera_is_left_away_and_a_propeller_is_welded(tmp_path: Path) -> None:
    more = '<body name="eye" pos="0.1 0 0"><geom size="0.02" mass="0.5"/></body><body name="prop" pos="0.17 0.15 0.05">'
    more += '<joint name="spin" axis="0 0 1"/><geom size="0.01" mass="0.01"/></body><site name="fl"'
    result = read(tmp_path, changed('<site name="fl"', more), drop=["eye"])
    assert result.base.mass == pytest.approx(1.51)
    assert result.notes == ("products of inertia up to ", "body 'prop' is welded where it stands.")[1:]
