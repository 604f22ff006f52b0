"""What rerun is told of a scene is what MuJoCo says of the recorded states."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from aerial_il.core.errors import DemoError
from aerial_il.data.episode import Episode
from aerial_il.presentation.rerun.flight import Flight
from aerial_il.presentation.rerun.geometry import shape_of
from aerial_il.presentation.rerun.motion import compile_scene, move
from aerial_il.presentation.rerun.program import run
from aerial_il.presentation.rerun.scene import M_PER_M_S, M_PER_N
from aerial_il.suite.physics import episode_state as layout
from aerial_il.suite.physics.physics_batch import STATE
from tests.presentation.rerun.conftest import Shown

BODIES = {"base": "robot/base", "link_2": "robot/link_2", "finger_left": "robot/finger_left", "cube": "props/cube"}


def posed(episode: Episode, step: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return the scene in a recorded state, by MuJoCo alone."""
    model = mujoco.MjModel.from_xml_string(episode.model_xml)
    data = mujoco.MjData(model)
    mujoco.mj_setState(model, data, episode.states[step], STATE)
    mujoco.mj_forward(model, data)
    return model, data


def poses(shown: Shown, entity: str) -> tuple[np.ndarray, np.ndarray]:
    """Return positions (N, 3) and rotations (N, 3, 3) that were logged."""
    pos = shown.numbers(entity, "Transform3D:translation").reshape(-1, 3)
    xyzw = shown.numbers(entity, "Transform3D:quaternion").reshape(-1, 4).astype(float)
    mats = np.zeros((len(xyzw), 9))
    for mat, quat in zip(mats, np.roll(xyzw, 1, axis=1), strict=True):
        mujoco.mju_quat2Mat(mat, quat / np.linalg.norm(quat))
    return pos, mats.reshape(-1, 3, 3)


def differences(shown: Shown, episode: Episode) -> Iterator[float]:
    """Yield how far logged poses are from those of ``episode``, of chosen bodies at chosen steps."""
    for step in (0, 57, len(episode) // 2, len(episode)):
        model, data = posed(episode, step)
        for name, entity in BODIES.items():
            body = model.body(name).id
            pos, mats = (part[step] for part in poses(shown, f"/scene/{entity}"))
            yield float(np.abs(pos - data.xpos[body]).max())
            yield float(np.abs(mats - data.xmat[body].reshape(3, 3)).max())


def test_poses_are_those_of_mujoco(shown: Shown, episodes: list[Episode]) -> None:
    assert max(differences(shown, episodes[0])) < 1e-5  # rerun keeps single precision


def test_poses_of_another_flight_would_be_noticed(shown: Shown, episodes: list[Episode]) -> None:
    assert len(episodes[1]) > 57
    short = replace(episodes[1], states=episodes[1].states[: len(episodes[0]) + 1])
    shifted = replace(episodes[0], states=np.roll(episodes[0].states, 1, axis=0))
    for other in (short, shifted):
        steps = min(len(episodes[0]), len(other.states) - 1)
        far = [
            np.abs(poses(shown, "/scene/robot/base")[0][k] - posed(other, k)[1].body("base").xpos).max()
            for k in (57, steps)
        ]
        assert max(far) > 1e-3


def test_moving_bodies_alone_have_a_pose_in_every_state(shown: Shown, episodes: list[Episode]) -> None:
    for entity in (*BODIES.values(), "props/bowl"):
        assert len(poses(shown, f"/scene/{entity}")[0]) == len(episodes[0]) + 1, entity
    for chunk in shown.chunks:
        if str(chunk.entity_path).startswith("/scene/fixed"):
            assert chunk.is_static


def test_every_visible_geom_is_drawn_once(shown: Shown, episodes: list[Episode]) -> None:
    model = compile_scene(episodes[0])
    for i in range(model.ngeom):
        body = model.body(model.geom_bodyid[i]).name
        below = "fixed" if body == "world" else f"{'props' if body in ('cube', 'bowl') else 'robot'}/{body}"
        entity = f"/scene/{below}/{model.geom(i).name}"
        result = [chunk for chunk in shown.chunks if str(chunk.entity_path) == entity]
        assert [(chunk.num_rows, chunk.is_static) for chunk in result] == [(1, True)], entity


def test_colours_and_sizes_are_the_models(shown: Shown, episodes: list[Episode]) -> None:
    model = compile_scene(episodes[0])
    cube = model.geom("cube")
    half = shown.numbers("/scene/props/cube/cube", "Boxes3D:half_sizes")
    assert half == pytest.approx(cube.size, abs=1e-6)
    (colour,) = shown.numbers("/scene/props/cube/cube", "Boxes3D:colors")
    rgba = [(int(colour) >> shift) & 255 for shift in (24, 16, 8, 0)]
    assert rgba == np.round(255 * cube.rgba).astype(int).tolist()


def test_thrusts_contacts_and_wind_are_mujocos(shown: Shown, episodes: list[Episode]) -> None:
    episode = episodes[0]
    held = int(np.flatnonzero(episode.phase == list(episode.provenance["phases"]).index("carry"))[5])
    _, data = posed(episode, held)
    vectors = shown.column("/scene/forces/thrust", "Arrows3D:vectors")[held].as_py()
    thrust = data.userdata[layout.THRUST]
    up = [data.site(f"rotor_{i}").xmat.reshape(3, 3)[:, 2] * thrust[i] for i in range(6)]
    assert np.asarray(vectors) == pytest.approx(M_PER_N * np.asarray(up), abs=1e-5)
    points = np.asarray(shown.column("/scene/forces/contact", "Arrows3D:origins")[held].as_py())
    assert 0 < len(points) <= data.ncon
    for point in points:
        assert np.abs(data.contact.pos - point).max(axis=1).min() < 1e-5
    blow = np.asarray(shown.column("/scene/wind", "Arrows3D:vectors")[held].as_py()) / M_PER_M_S
    assert 0.5 < np.linalg.norm(blow) < 30.0
    assert shown.column("/scene/forces/contact", "Arrows3D:origins")[0].as_py() in ([], None)


def test_a_flight_of_engine_3_shows_the_same_thrusts_and_wind(episodes: list[Episode]) -> None:
    """Its rotors were actuators, their thrusts activations."""
    episode, spec = episodes[0], mujoco.MjSpec.from_string(episodes[0].model_xml)
    spec.nuserdata = layout.PAST.stop
    for i in range(6):
        motor = spec.add_actuator(name=f"rotor_{i}", target=f"rotor_{i}", trntype=mujoco.mjtTrn.mjTRN_SITE)
        motor.gear, motor.dyntype, motor.dynprm[0] = [0, 0, 1, 0, 0, 0], mujoco.mjtDyn.mjDYN_FILTEREXACT, 0.03
    model, today = (each.compile() for each in (spec, mujoco.MjSpec.from_string(episode.model_xml)))
    data, states = mujoco.MjData(model), []
    for state in episode.states[:20]:
        now, rows = mujoco.MjData(today), np.empty(mujoco.mj_stateSize(model, STATE))
        mujoco.mj_setState(today, now, state, STATE)
        data.qpos, data.qvel, data.act = now.qpos, now.qvel, now.userdata[layout.THRUST][:6]
        data.userdata = now.userdata[: layout.PAST.stop]
        mujoco.mj_getState(model, data, rows, STATE)
        states.append(rows)
    then, moved = move(model, np.stack(states), episode.spec), move(today, episode.states[:20], episode.spec)
    np.testing.assert_allclose(then.thrust, moved.thrust, atol=1e-12)
    assert np.abs(moved.thrust).max() > 1.0
    np.testing.assert_array_equal(then.wind, moved.wind)


def test_the_forces_on_a_held_robot_carry_its_weight() -> None:
    """A block on the ground is pushed upwards by its own weight, whichever geom comes first."""
    for first, second in (("plane", "box"), ("box", "plane")):
        geoms = {"plane": "<geom type='plane' size='1 1 1'/>", "box": ""}
        body = "<body name='base' pos='0 0 0.0999'><freejoint/><geom type='box' size='.1 .1 .1' mass='2'/></body>"
        xml = f"<mujoco><worldbody>{geoms[first]}{body}{geoms[second]}</worldbody></mujoco>"
        model = mujoco.MjModel.from_xml_string(xml)
        data = mujoco.MjData(model)
        for _ in range(400):
            mujoco.mj_step(model, data)
        state = np.empty(mujoco.mj_stateSize(model, STATE))
        mujoco.mj_getState(model, data, state, STATE)
        contacts = move(model, state[None]).contacts
        assert contacts.forces.sum(axis=0) == pytest.approx([0, 0, 2 * 9.81], abs=0.1)
        assert contacts.on_robot_n[0] == pytest.approx(2 * 9.81, abs=0.2)


def test_capsules_reach_from_end_to_end() -> None:
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><geom type='capsule' fromto='0.1 0.2 0.3 0.5 -0.2 0.9' size='.02'/></worldbody></mujoco>"
    )
    shape = shape_of(model, 0, np.array([1, 2, 3, 255]))
    start = np.asarray(shape.translations.as_arrow_array().flatten())  # type: ignore[union-attr]
    ends = np.array([[0.1, 0.2, 0.3], [0.5, -0.2, 0.9]])
    assert np.abs(ends - start.astype(float)).max(axis=1).min() < 1e-6


def test_the_command_stands_where_the_action_says(shown: Shown, episodes: list[Episode]) -> None:
    told = shown.numbers("/scene/command", "Points3D:positions").reshape(-1, 3)
    assert told == pytest.approx(episodes[0].executed_actions[:, :3], abs=1e-6)


@pytest.mark.render
def test_pictures_stand_in_the_frustum_of_their_camera(shown: Shown, episodes: list[Episode]) -> None:
    pos, mats = poses(shown, "/scene/cameras/wrist_rgb")
    for step in (0, len(episodes[0])):
        model, data = posed(episodes[0], step)
        assert pos[step] == pytest.approx(data.camera("wrist").xpos, abs=1e-5)
        assert mats[step] == pytest.approx(data.camera("wrist").xmat.reshape(3, 3), abs=1e-5)
    assert len(shown.column("/scene/cameras/wrist_rgb", "EncodedImage:blob")) == len(episodes[0]) + 1
    (focal, *_) = shown.numbers("/scene/cameras/wrist_rgb", "Pinhole:image_from_camera")
    assert focal == pytest.approx(12.0 / np.tan(np.deg2rad(model.cam("wrist").fovy[0]) / 2), rel=1e-6)


def test_a_flight_without_states_keeps_its_signals_and_says_so(
    episodes: list[Episode], write: Callable[..., Shown]
) -> None:
    bare = replace(episodes[0], states=np.zeros((len(episodes[0]) + 1, 0)), model_xml="")
    flight = Flight.of(bare)
    assert flight.motion is None
    assert "Its signals can be shown" in flight.notes[0]
    shown = write({"": flight})
    assert not [entity for entity in shown.entities if entity.startswith("/scene")]
    assert "/signals/reward" in shown.entities


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"model_xml": ""}, "no scene"),
        ({"model_xml": "<mujoco><worldbody><geom/></mujoco>"}, "not well-formed"),
        ({"states": np.zeros((3, 7))}, "its states are not its scene's"),
    ],
)
def test_a_scene_that_cannot_be_had_is_named(change: dict, said: str, episodes: list[Episode]) -> None:
    with pytest.raises(DemoError, match=said):
        compile_scene(replace(episodes[0], **change))


def test_reruns_own_verifier_finds_nothing(shown: Shown) -> None:
    assert "without error" in run("rrd", "verify", str(shown.path))


def test_the_verifier_finds_a_damaged_file(shown: Shown, tmp_path) -> None:
    damaged = tmp_path / "cut.rrd"
    damaged.write_bytes(shown.path.read_bytes()[:-2000])
    with pytest.raises(Exception, match="rrd verify failed"):
        run("rrd", "verify", str(damaged))
