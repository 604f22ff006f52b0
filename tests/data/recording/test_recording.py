"""Recordings: packed, written and read back field by field."""

from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from aerial_il.collection.collect import collect
from aerial_il.data.recording.encoding import messages
from aerial_il.data.recording.encoding.packing import bytes_of, gather
from aerial_il.data.recording.reader import read_episode
from tests.data.crane import CraneBatch, CraneExpert

STEP_ARRAYS = "actions executed_actions expert_actions is_intervention phase rewards terminated truncated ctrl"
EVERY = 5  # steps of 20 ms from one look to the next
ARRAYS = (*STEP_ARRAYS.split(), "states", "sim_time")


def fly(seed: int, steps: int) -> dict[str, np.ndarray]:
    """Fly a crane without any of the recording code."""
    env, expert = CraneBatch(), CraneExpert()
    expert.attach(env)
    obs = env.reset(np.array([seed]))
    rows: dict[str, list[np.ndarray]] = {name: [] for name in (*ARRAYS, *env.spec.observation.names)}
    for step in range(steps + 1):
        for name, value in {**obs, "states": env.get_state(), "sim_time": env.sim_time}.items():
            rows[name].append(value[0])
        if step < steps:
            action = expert.act(obs)
            result = env.step(action)
            obs = result.obs
            got = {"actions": action, "phase": expert.phase, "rewards": result.reward, "ctrl": env.ctrl}
            got |= {"terminated": result.terminated, "truncated": result.truncated}
            got |= {"executed_actions": result.info["executed_action"], "expert_actions": expert.expert_action}
            for name, value in {**got, "is_intervention": np.zeros(1, bool)}.items():
                rows[name].append(value[0])
    return {name: np.stack(values) for name, values in rows.items()}


def test_every_value_comes_back_bit_for_bit(demo: Path) -> None:
    episode = read_episode(demo)
    flown = fly(episode.seed, len(episode))
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(episode, name), flown[name], err_msg=name)
    for name in episode.spec.observation.names:
        np.testing.assert_array_equal(episode.obs[name], flown[name], err_msg=name)
        assert episode.obs[name].dtype == episode.spec.observation[name].dtype
    assert episode.spec == CraneBatch().spec
    assert episode.success
    assert episode.uid == demo.stem
    assert episode.provenance["policy"] == "expert"
    assert episode.provenance["phases"] == ["fly", "hold"]


def test_standard_definitions_are_those_of_ros2() -> None:
    ours, theirs = get_typestore(Stores.EMPTY), get_typestore(Stores.ROS2_HUMBLE)
    types = [messages.JOINT_STATE, messages.POSE_STAMPED, messages.TF_MESSAGE]
    for name in (*types, messages.FLOAT_ARRAY, messages.COMPRESSED_IMAGE):
        ours.register(
            {k: v for k, v in get_types_from_msg(messages.definition(name), name).items() if k not in ours.types}
        )
        assert ours.hash_rihs01(name) == theirs.hash_rihs01(name)


def test_rosbags_decodes_every_message(demo: Path) -> None:
    """The bytes that our templates make are CDR, judged by another implementation."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(messages.STEPS_DEFINITION, messages.STEPS))
    episode, poses, actions = read_episode(demo), [], []
    with open(demo, "rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            decoded = store.deserialize_cdr(message.data, schema.name)
            assert bytes(store.serialize_cdr(decoded, schema.name)) == message.data
            if channel.topic == "/pose/ee":
                poses.append([decoded.pose.position.x, decoded.pose.position.z])
            if channel.topic == "/action":
                actions.append(decoded.position)
                assert decoded.name == ["x", "z"]
                stamp = decoded.header.stamp
                assert stamp.sec * 10**9 + stamp.nanosec == message.log_time
    np.testing.assert_array_equal(poses, episode.obs["ee_pos"][:-1:EVERY, [0, 2]])
    np.testing.assert_array_equal(actions, episode.actions[::EVERY])


def test_index_finds_every_message(demo: Path) -> None:
    """Tools seek by the summary and the message indexes."""
    episode = read_episode(demo)
    with open(demo, "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        counts = summary.statistics.channel_message_counts
        topics = {channel.topic: counts[i] for i, channel in summary.channels.items()}
        assert topics["/observation"] == topics["/pose/ee"] == topics["/action"] == -(-len(episode) // EVERY)
        assert topics["/step"] == -(-(len(episode) + 1) // 64)
        assert summary.statistics.message_count == sum(1 for _ in reader.iter_messages())
        later = sum(1 for _ in reader.iter_messages(topics=["/action"], starting_at=int(0.2e9)))
        assert later == topics["/action"] - 2
        assert [m.name for m in reader.iter_metadata()][-1] == "aerial_il.outcome"
        assert [a.name for a in reader.iter_attachments()] == ["model.xml"]


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    env, out = CraneBatch(1, image_size=(48, 64), max_steps=70), tmp_path_factory.mktemp("filmed")
    folder = collect(env, CraneExpert(), [0], out, progress=False).folder
    env.close()
    return folder.files()[0]


def test_images_are_kept_as_jpeg(filmed: Path) -> None:
    assert "scene_rgb" not in read_episode(filmed).obs
    episode = read_episode(filmed, cameras=["scene_rgb"])
    seen = episode.obs["scene_rgb"]
    assert seen.shape == (len(episode) + 1, 48, 64, 3)
    assert seen.dtype == np.uint8
    env = CraneBatch(1, image_size=(48, 64), max_steps=70)
    for step in (0, len(episode)):
        real = env.set_state(episode.states[[step]])["scene_rgb"][0]
        assert np.abs(seen[step].astype(float) - real).mean() < 3
    env.close()


ROW = np.dtype([("position", "<f8", (2,)), ("flag", "u1"), ("rest", "u1", (7,))])


def test_fields_reach_the_rows_of_recorded_worlds_alone() -> None:
    """The cheat would be to copy what happens to be contiguous and writable: a slice and constants are neither."""
    rows, positions = np.zeros((3, 4), ROW), np.arange(9.0).reshape(3, 3)[:, 1:]
    flags, nothing = np.broadcast_to(np.uint8(7), 3), np.zeros((3, 0))
    places = np.array([0, 2]), np.array([1, 0, 2]), np.array([3, 0, 1])
    gather(bytes_of(rows), places, [(0, positions), (16, flags), (16, nothing)])
    expected = np.zeros((3, 4), ROW)
    expected["position"][1, 3], expected["position"][2, 1] = [1.0, 2.0], [7.0, 8.0]
    expected["flag"][1, 3] = expected["flag"][2, 1] = 7
    np.testing.assert_array_equal(rows, expected)
