"""What ROS 2's viewers are told of a flight is what MuJoCo says of its states, and they take the file."""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from aerial_il.cli.main import main
from aerial_il.core.errors import DemoError
from aerial_il.core.rendering import can_render
from aerial_il.data.episode import Episode
from aerial_il.presentation.rerun.program import run
from aerial_il.presentation.rerun.ros2.kinematics import WORLD, body_name
from aerial_il.presentation.rerun.ros2.view import URDF, write_view
from tests.presentation.rerun.conftest import SIZE, Shown
from tests.presentation.rerun.ros2.forward import poses, transform
from tests.presentation.rerun.test_scene import posed

STEPS = (0, 57, -1)


class Read(NamedTuple):
    """A file as others read it: topic -> its messages, and attachments by name."""

    path: Path
    messages: dict[str, list[Any]]
    attached: dict[str, bytes]


@pytest.fixture(scope="module")
def view(episodes: list[Episode], tmp_path_factory: pytest.TempPathFactory) -> Read:
    path, store = tmp_path_factory.mktemp("ros2") / "flight.mcap", get_typestore(Stores.ROS2_HUMBLE)
    write_view(episodes[0], path)
    result = defaultdict(list)
    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            result[channel.topic].append(store.deserialize_cdr(message.data, schema.name))
        return Read(path, result, {a.name: a.data for a in reader.iter_attachments()})


def frames(view: Read, step: int) -> dict[str, np.ndarray]:
    """Return every frame in the world (4, 4), by composing what ``/tf`` and ``/tf_static`` say at a step."""
    held = {}
    for message in (*view.messages["/tf_static"], view.messages["/tf"][step]):
        for one in message.transforms:
            place, turn = one.transform.translation, one.transform.rotation
            matrix = transform(
                np.array([place.x, place.y, place.z]), Rotation.from_quat([turn.x, turn.y, turn.z, turn.w])
            )
            assert one.child_frame_id not in held, "a frame has one parent"
            held[one.child_frame_id] = (one.header.frame_id, matrix)
    result = {WORLD: np.eye(4)}

    def pose(name: str) -> np.ndarray:
        if name not in result:
            parent, matrix = held[name]
            result[name] = pose(parent) @ matrix
        return result[name]

    return {name: pose(name) for name in held}


def matrix_of(pos: np.ndarray, mat: np.ndarray) -> np.ndarray:
    return transform(pos, Rotation.from_matrix(mat.reshape(3, 3)))


@pytest.mark.parametrize("step", STEPS)
def test_every_frame_is_where_mujoco_says(view: Read, episodes: list[Episode], step: int) -> None:
    model, data = posed(episodes[0], step)
    result = frames(view, step)
    for body in range(1, model.nbody):
        expected = matrix_of(data.xpos[body], data.xmat[body])
        np.testing.assert_allclose(result[body_name(model, body)], expected, atol=1e-9)
    tool = data.site("tool")
    np.testing.assert_allclose(result["tool"], matrix_of(tool.xpos, tool.xmat), atol=1e-9)
    flip = np.diag([1.0, -1.0, -1.0])
    for camera in range(model.ncam):
        expected = matrix_of(data.cam_xpos[camera], data.cam_xmat[camera].reshape(3, 3) @ flip)
        np.testing.assert_allclose(result[f"{model.camera(camera).name}_optical"], expected, atol=1e-9)


@pytest.mark.parametrize("step", STEPS)
def test_the_urdf_at_the_joint_states_gives_the_same_frames(view: Read, step: int) -> None:
    told, result = view.messages["/joint_states"][step], frames(view, step)
    links = poses(view.attached[URDF].decode(), dict(zip(told.name, told.position, strict=True)))
    assert set(links) == {"base", "link_0", "link_1", "link_2", "link_3", "palm", "finger_left", "finger_right"}
    for link, pose in links.items():
        np.testing.assert_allclose(result["base"] @ pose, result[link], atol=1e-7, err_msg=link)


def test_joints_are_called_and_move_as_the_model_s(view: Read, episodes: list[Episode]) -> None:
    model, data = posed(episodes[0], 57)
    told = view.messages["/joint_states"][57]
    assert told.name == ["joint_0", "joint_1", "joint_2", "joint_3", "finger_left", "finger_right"]
    for name, position, velocity in zip(told.name, told.position, told.velocity, strict=True):
        joint = model.joint(name)
        assert (position, velocity) == (data.qpos[joint.qposadr[0]], data.qvel[joint.dofadr[0]])
    assert any(np.ptp([m.position[i] for m in view.messages["/joint_states"]]) > 0.1 for i in range(6))


def test_poses_have_the_turn_that_the_recording_cannot_say(view: Read, episodes: list[Episode]) -> None:
    _, data = posed(episodes[0], 57)
    told = view.messages["/pose/cube"][57].pose
    turn = told.orientation
    cube = data.body("cube")
    np.testing.assert_allclose([told.position.x, told.position.y, told.position.z], cube.xpos, atol=1e-12)
    got = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
    np.testing.assert_allclose(got, cube.xmat.reshape(3, 3), atol=1e-9)
    assert "cube_rot6d" not in episodes[0].obs
    assert abs(turn.w) < 1 - 1e-6


def test_signals_and_times_are_the_recorded_ones(view: Read, episodes: list[Episode]) -> None:
    episode = episodes[0]
    np.testing.assert_array_equal([m.position for m in view.messages["/action"]], episode.actions)
    np.testing.assert_array_equal([m.data[0] for m in view.messages["/reward"]], episode.rewards)
    stamps = [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in view.messages["/joint_states"]]
    np.testing.assert_allclose(stamps, episode.sim_time, atol=1e-9)


def test_rosbags_opens_the_file_and_lasting_topics_last(view: Read) -> None:
    with AnyReader([view.path]) as reader:
        lasting = {c.topic for c in reader.connections if [q.durability.name for q in c.ext.offered_qos_profiles]}  # type: ignore[union-attr]
    assert lasting == {"/robot_description", "/tf_static", "/scene"}


def test_the_scene_is_everything_but_the_robot(view: Read, episodes: list[Episode]) -> None:
    model, _ = posed(episodes[0], 0)
    (told,) = view.messages["/scene"]
    assert {m.header.frame_id for m in told.markers} >= {WORLD, "cube", "bowl"}
    assert not {m.header.frame_id for m in told.markers} & {"base", "link_0", "palm"}
    (cube,) = (m for m in told.markers if m.header.frame_id == "cube")
    size = model.geom_size[model.body("cube").geomadr[0]]
    np.testing.assert_allclose([cube.scale.x, cube.scale.y, cube.scale.z], 2 * size)
    assert all(m.frame_locked for m in told.markers)


def test_rerun_shows_the_robot_where_the_frames_say(view: Read, tmp_path: Path) -> None:
    out = tmp_path / "flight.rrd"
    said = run("mcap", "convert", str(view.path), "-o", str(out))
    assert "Failed" not in said
    run("rrd", "verify", str(out))
    shown = Shown(out)
    links = {entity.split("/")[3] for entity in shown.entities if "/visual_geometries/" in entity}
    assert links == {"base", "link_0", "link_1", "link_2", "link_3", "palm", "finger_left", "finger_right"}
    children = shown.column("/tf", "Transform3D:child_frame").combine_chunks().flatten().to_pylist()
    assert {"base", "cube", *links} - {"palm"} <= {*children}
    mine = np.array(children) == "base"
    placed = shown.numbers("/tf", "Transform3D:translation").reshape(-1, 3)[mine]
    told = [m.pose.position for m in view.messages["/pose/base"]]
    np.testing.assert_allclose(placed, [[p.x, p.y, p.z] for p in told], atol=1e-5)


@pytest.mark.render
@pytest.mark.skipif(not can_render(), reason="no rendering back end")
def test_the_camera_sees_the_cube_where_its_matrix_says(view: Read, episodes: list[Episode]) -> None:
    told = view.messages["/camera/wrist_rgb/camera_info"][0]
    assert (told.height, told.width) == SIZE
    step, rows, columns = next(drawn_cube(episodes[0]))
    result = frames(view, step)
    x, y, depth = told.k.reshape(3, 3) @ (np.linalg.inv(result["wrist_optical"]) @ result["cube"])[:3, 3]
    assert depth > 0
    assert (x / depth, y / depth) == pytest.approx((columns.mean() + 0.5, rows.mean() + 0.5), abs=1.0)


def drawn_cube(episode: Episode) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Yield steps at which the cube is whole in the wrist's picture, with rows and columns of its pixels."""
    model, _ = posed(episode, 0)
    cube = model.body("cube").geomadr[0]
    with mujoco.Renderer(model, *SIZE) as renderer:
        renderer.enable_segmentation_rendering()
        for step in range(0, len(episode), 10):
            renderer.update_scene(posed(episode, step)[1], camera="wrist")
            drawn = renderer.render()
            rows, columns = np.nonzero((drawn[..., 0] == cube) & (drawn[..., 1] == int(mujoco.mjtObj.mjOBJ_GEOM)))
            inside = rows.size >= 6 and rows.min() > 0 and columns.min() > 0
            if inside and rows.max() < SIZE[0] - 1 and columns.max() < SIZE[1] - 1:
                yield step, rows, columns


@pytest.mark.render
@pytest.mark.skipif(not can_render(), reason="no rendering back end")
def test_pictures_of_each_kind_are_kept(episodes: list[Episode], tmp_path: Path) -> None:
    episode = episodes[0]
    depth = np.full((len(episode) + 1, *SIZE), 1.5, np.float32)
    seen = episode.spec.observation
    field = replace(seen["wrist_rgb"], name="wrist_depth", shape=SIZE, dtype="float32")
    spec = replace(episode.spec, observation=replace(seen, fields=(*seen.fields, field)))
    path = write_view(replace(episode, spec=spec, obs={**episode.obs, "wrist_depth": depth}), tmp_path / "a.mcap")
    with AnyReader([path]) as reader:
        topics = {c.topic: c for c in reader.connections}
        _, _, raw = next(reader.messages([topics["/camera/wrist_depth/image"]]))
        image: Any = reader.deserialize(raw, "sensor_msgs/msg/Image")
    assert (image.encoding, image.height, image.width) == ("16UC1", *SIZE)
    assert set(image.data.view("<u2")) == {1500}
    assert topics["/camera/wrist_rgb/image"].msgtype == "sensor_msgs/msg/CompressedImage"


def test_the_command_writes_a_file_for_each_flight(
    grasps: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["convert", str(grasps), "format=mcap", "out=views", "cameras=[]", "progress=false"]) == 0
    recorded = sorted((grasps / "demos").glob("*.mcap"))
    assert sorted(p.name for p in Path("views").iterdir()) == [p.name for p in recorded]
    assert main(["convert", str(recorded[0]), "out=one.mcap", "cameras=[]", "progress=false"]) == 0
    assert Path("one.mcap").read_bytes() == Path("views", recorded[0].name).read_bytes()
    assert main(["convert", str(grasps), "out=all.mcap", "progress=false"]) == 2
    assert "out=all.mcap holds one flight" in capsys.readouterr().err
    assert main(["convert", str(recorded[0]), "format=mcap", "progress=false"]) == 2
    assert "say where its other form goes" in capsys.readouterr().err


def test_a_flight_without_a_scene_is_refused(episodes: list[Episode], tmp_path: Path) -> None:
    with pytest.raises(DemoError, match="holds no scene"):
        write_view(replace(episodes[0], model_xml=""), tmp_path / "a.mcap")
    assert not list(tmp_path.iterdir())
