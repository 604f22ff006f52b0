"""Cameras with a rate and a delay of their own: what is shown when, alike in faces, recordings, restored flights."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import aerial_il
from aerial_il.collection.collect import collect
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import EnvSpec, camera_text
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.scenario import Scenario
from tests.contract.registered import CELLS

ROBOT, TASK = CELLS[0]
WRIST, BASE = "wrist@24x32@25Hz@60ms", "base:depth@16x20@16.7Hz"  # every 2 steps, 3 late; every 3 steps
STEPS = 11
shown_by_hand = {  # step -> the step whose image is shown
    "wrist_rgb": [0, 0, 0, 0, 0, 2, 2, 4, 4, 6, 6, 8],
    "base_depth": [0, 0, 0, 3, 3, 3, 6, 6, 6, 9, 9, 9],
}


def load(num_envs: int = 2, cameras: tuple[str, ...] = (WRIST, BASE), threads: int = 1) -> BatchEnvironment:
    return aerial_il.load_batch(ROBOT, TASK, num_envs=num_envs, cameras=cameras, num_threads=threads)


def flown(env: BatchEnvironment) -> Iterator[dict[str, np.ndarray]]:
    """Yield what is seen from the reset of seeds 3, 4, … on."""
    yield env.reset(3)
    action = np.tile(env.spec.action.clip(np.full(env.spec.action.size, 0.4)), (env.num_envs, 1))
    for _ in range(STEPS):
        yield env.step(action).obs


@pytest.mark.render
def test_images_are_those_of_a_camera_without_rate_and_delay_at_their_time() -> None:
    with_timing, without = load(), load(cameras=("wrist@24x32", "base:depth@16x20"))
    try:
        seen, all_of_them = list(flown(with_timing)), list(flown(without))
    finally:
        with_timing.close()
        without.close()
    for name, steps in shown_by_hand.items():
        for step, source in enumerate(steps):
            np.testing.assert_array_equal(seen[step][name], all_of_them[source][name], err_msg=f"{name}, {step}")
        assert (seen[-1][name] != seen[0][name]).any()


@pytest.mark.render
def test_all_faces_and_numbers_of_worlds_show_the_same() -> None:
    worlds, many = load(), load(num_envs=3, threads=2)
    single = aerial_il.load(ROBOT, TASK, cameras=(WRIST, BASE))
    face = gymnasium.make(f"aerial_il/{TASK}-{ROBOT}-v0", cameras=(WRIST, BASE))
    try:
        seen, beside = list(flown(worlds)), list(flown(many))
        alone, faced = [single.reset(seed=3).observation], [face.reset(seed=3)[0]]
        action = worlds.spec.action.clip(np.full(worlds.spec.action.size, 0.4))
        alone += [single.step(action).observation for _ in range(STEPS)]
        faced += [face.step(action)[0] for _ in range(STEPS)]
    finally:
        for env in (worlds, many, single, face):
            env.close()
    for step, each in enumerate(seen):
        for name in shown_by_hand:
            for other in (beside[step][name][0], alone[step][name], faced[step][name]):
                np.testing.assert_array_equal(each[name][0], other, err_msg=f"{name}, {step}")


@pytest.mark.render
def test_a_world_keeps_its_own_time_and_a_restored_one_looks_at_once() -> None:
    env, single = load(), aerial_il.load(ROBOT, TASK, cameras=(WRIST, BASE))
    try:
        whole = list(flown(env))
        first = np.array([True, False])
        env.reset(3)
        action = np.tile(env.spec.action.clip(np.full(env.spec.action.size, 0.4)), (2, 1))
        for step in range(1, 6):
            alone = env.step(action, first).obs
            np.testing.assert_array_equal(alone["wrist_rgb"][0], whole[step]["wrist_rgb"][0])
            np.testing.assert_array_equal(alone["wrist_rgb"][1], whole[0]["wrist_rgb"][1])
        state, fresh = env.get_state(), env.observe()
        np.testing.assert_array_equal(env.observe()["wrist_rgb"], fresh["wrist_rgb"])
        assert (fresh["wrist_rgb"][0] != alone["wrist_rgb"][0]).any(), "a look at the world as it stands"
        np.testing.assert_array_equal(env.step(action, ~first).obs["wrist_rgb"][0], alone["wrist_rgb"][0])
        continued = env.set_state(state)
        np.testing.assert_array_equal(continued["wrist_rgb"], fresh["wrist_rgb"])
        single.set_state(state[:1])
        for _ in range(4):
            one, two = single.step(action[0]).observation, env.step(action).obs
            np.testing.assert_array_equal(one["wrist_rgb"], two["wrist_rgb"][0])
    finally:
        env.close()
        single.close()


@pytest.mark.render
def test_an_image_is_recorded_once_and_read_as_it_was_shown(tmp_path: Path) -> None:
    sizes = {}
    for rate in ("", "@10Hz@20ms"):
        env = load(1, cameras=(f"wrist@24x32{rate}", "base@24x32"))
        try:
            collect(env, aerial_il.expert(ROBOT, TASK), range(3, 4), tmp_path / f"at{rate}", progress=False)
        finally:
            env.close()
        (path,) = (tmp_path / f"at{rate}").rglob("*.mcap")
        sizes[rate] = path.stat().st_size
    (episode,) = aerial_il.open_dataset(str(tmp_path / "at@10Hz@20ms"), cameras=True)
    (often,) = aerial_il.open_dataset(str(tmp_path / "at"), cameras=True)
    wrist, each = episode.obs["wrist_rgb"], often.obs["wrist_rgb"]
    assert len(wrist) == len(each) == len(episode) + 1
    for step in range(len(wrist)):
        np.testing.assert_array_equal(wrist[step], each[max(0, (step - 1) // 5 * 5)], err_msg=str(step))
    np.testing.assert_array_equal(episode.obs["base_rgb"], often.obs["base_rgb"])
    assert sizes["@10Hz@20ms"] < sizes[""] - 0.25 * len(wrist) * 600
    differing = episode.spec.differences(often.spec)
    assert [each for each in differing if "wrist_rgb" in each] == [
        "observation.fields.wrist_rgb.delay: 1 != 0",
        "observation.fields.wrist_rgb.every: 5 != 1",
    ]


def test_what_is_written_of_an_image_opens_it_again() -> None:
    spec = Scenario(ROBOT, TASK, cameras=(WRIST, BASE, "scene")).spec
    again = EnvSpec.from_dict(spec.to_dict())
    assert again == spec
    images = spec.observation.of_group("image")
    texts = [camera_text(field, spec.control_dt_s) for field in images]
    assert texts == ["wrist@24x32@25Hz@60ms", "base:depth@16x20@16.67Hz", "scene@240x320"]
    assert Scenario(ROBOT, TASK, cameras=texts).spec == spec
    plain = Scenario(ROBOT, TASK, cameras=("wrist",)).spec.to_dict()["observation"]["fields"]
    assert not {"every", "delay"} & set().union(*plain), "as specifications were written before"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("wrist@30Hz", r"at 50Hz, 25Hz, 16.7Hz, 12.5Hz, 10Hz"),
        ("wrist@0Hz", "at 50Hz, 25Hz"),
        ("wrist@30ms", "whole control steps of 20 ms, 0 to 200ms"),
        ("wrist@220ms", "0 to 200ms"),
        ("wrist@soon", "'soon' is neither a size, 64x64, nor a rate, 25Hz, nor a delay, 40ms"),
        ("wrist@0x20", "up to"),
        ("wrist@", "'' is neither"),
    ],
)
def test_what_no_camera_does_is_refused(text: str, said: str) -> None:
    with pytest.raises(InvalidValueError, match=said):
        Scenario(ROBOT, TASK, cameras=(text,))
    with pytest.raises(InvalidValueError, match="asked for once"):
        Scenario(ROBOT, TASK, cameras=("wrist", "wrist@25Hz"))
