"""How chunks are flown with latency, joined, and led to what a robot can follow."""

import numpy as np
import pytest
import torch

import aerial_il
from aerial_il import robots
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.latency import Latency
from aerial_il.policies import get
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.chunking import ActionPlan
from aerial_il.policies.parts.embodiment import Follower
from aerial_il.policies.parts.execution import Execution
from aerial_il.policies.parts.guiding import Guide, soft_mask
from aerial_il.policies.parts.layout import Interface, Layout
from aerial_il.policies.parts.normaliser import Normaliser
from aerial_il.policies.parts.switches import Switches
from tests.algorithms.point_mass import PointMassBatch
from tests.policies.test_registry import fresh_policy

TOOL_ALONE = ("gripper", "wrist_force", "base_*", "joint_*", "ee_*")


def of_the_gripper(name: str = "diffusion", **settings: object) -> ChunkPolicy:
    """Return an untrained policy of the oracle that sees the tool alone, unless it is told otherwise."""
    env = aerial_il.load_batch("floating_gripper", "reach", num_envs=1, num_threads=1)
    config = get(name)(**{"relative": True, "masked_fields": TOOL_ALONE, "width": 16, **settings})
    layout, size = Layout.of(env.spec, config), env.spec.action.size
    interface = Interface(layout, Normaliser.none(layout.size), Normaliser.none(size), 10.0, Switches.none(size))
    torch.manual_seed(0)
    return ChunkPolicy(config, interface, config.build(layout.size, size))


def test_the_first_actions_of_each_chunk_are_dropped() -> None:
    chunk = np.arange(6, dtype=np.float32).reshape(1, 6, 1)
    plan = ActionPlan(6, 3, None, delay=2)
    plan.add(chunk, np.ones(1, bool))
    assert [plan.pop().item() for _ in range(3)] == [2, 3, 4]
    actions, known = plan.committed(np.ones(1, bool))
    assert known.tolist() == [[True] * 3 + [False] * 3]
    assert actions[0, :3, 0].tolist() == [3, 4, 5]
    with pytest.raises(InvalidValueError, match=r"delay of 4 steps must lie in \[0, 3\]"):
        ActionPlan(6, 3, None, delay=4)


def test_what_was_sent_is_held_and_what_is_planned_less_and_less() -> None:
    mask = soft_mask(np.array([[True] * 7 + [False] * 3, [False] * 10]), 2)
    assert mask[0, :2].tolist() == [1, 1]
    assert (np.diff(mask[0, 1:8]) < 0).all()
    assert not mask[0, 7:].any()
    assert not mask[1].any()


@pytest.mark.parametrize("name", ["diffusion", "flow"])
def test_a_guide_that_wants_nothing_changes_nothing(name: str) -> None:
    network = fresh_policy(name).network
    obs, noise = torch.randn(3, 2, 15), torch.randn(3, network.noise_size)
    with torch.no_grad():
        free = network(obs, noise)
        free_too = network(obs, noise, Guide((torch.zeros(3, 50), torch.zeros(3, 50))))
    torch.testing.assert_close(free, free_too, atol=1e-5, rtol=1e-4)


@pytest.mark.parametrize("name", ["diffusion", "flow"])
def test_denoising_is_led_to_the_plan_that_is_held(name: str) -> None:
    network = fresh_policy(name).network
    obs, noise = torch.randn(3, 2, 15), torch.randn(3, network.noise_size)
    plan, held = torch.full((3, 5, 10), 0.5), torch.zeros(3, 5, 10)
    held[:, :2] = 1.0
    with torch.no_grad():
        free = network(obs, noise)
        led = network(obs, noise, Guide((plan.flatten(1), held.flatten(1))))
    assert (led - plan)[:, :2].square().mean() < (free - plan)[:, :2].square().mean()


def test_slow_vehicles_reach_less_and_take_their_limits() -> None:
    ahead = torch.zeros(1, 8, 9)
    ahead[..., 0] = 1.0
    reached = {
        name: Follower.of(robots.get(name)).reached(ahead, torch.zeros(1, 9), torch.zeros(1, 3), 0.05)[0, :, 0]
        for name in ("floating_gripper", "fa_hexa_arm4", "ua_quad_arm4", "big_four_z1")
    }
    assert (reached["floating_gripper"].diff() > 0).all()
    assert reached["floating_gripper"][-1] > reached["ua_quad_arm4"][-1] > 0
    assert reached["floating_gripper"][-1] > reached["big_four_z1"][-1] > 0
    torch.testing.assert_close(reached["floating_gripper"], reached["fa_hexa_arm4"])


@pytest.mark.parametrize(("robot", "said"), [("quad", "has no arm"), ("z1", "stands fixed")])
def test_robots_without_a_tool_that_flies_are_refused(robot: str, said: str) -> None:
    with pytest.raises(InvalidValueError, match=said):
        Follower.of(robots.get(robot))


def test_one_that_sees_the_tool_alone_flies_other_robots(caplog: pytest.LogCaptureFixture) -> None:
    env = aerial_il.load_batch("ua_quad_arm4", "reach", num_envs=2, num_threads=1)
    policy = of_the_gripper()
    policy.attach(env)
    assert "Trained on floating_gripper, it flies ua_quad_arm4" in caplog.text
    plain = policy.act(env.reset(0))
    guided = of_the_gripper().executing(Execution(guidance=1.5))
    guided.attach(env)
    assert not np.array_equal(guided.act(env.reset(0)), plain)
    with pytest.raises(InvalidValueError, match="train one with policy=diffusion_umi"):
        of_the_gripper(masked_fields=("gripper",)).attach(env)


@pytest.mark.parametrize("chunks", ["dropped", "realtime"])
def test_chunks_are_flown_in_time_by_each_world_alone(chunks: str) -> None:
    """Two worlds that are reset at different times act as each would by itself."""
    latency = Latency(observation_delay_ms=20, action_delay_ms=20)
    pair, alone = (of_the_gripper().executing(Execution(chunks=chunks), latency) for _ in range(2))
    env = aerial_il.load_batch("floating_gripper", "reach", num_envs=2, num_threads=1)
    obs = env.reset(0)
    for _ in range(13):
        pair.act(obs)
    pair.reset(np.array([False, True]))
    single = {name: values[1:] for name, values in obs.items()}
    for _ in range(13):
        np.testing.assert_allclose(pair.act(obs)[1:], alone.act(single), atol=1e-4)


@pytest.mark.parametrize(
    ("name", "told", "said"),
    [
        ("mlp", {"guidance": 1.5}, "guidance=1.5 needs a policy that denoises"),
        ("mlp", {"chunks": "realtime"}, "chunks=realtime needs a policy that denoises"),
        ("diffusion", {"chunks": "dropped", "delay_ms": 200}, r"10 steps must lie in \[0, 4\]"),
        ("diffusion", {"chunks": "dropped", "delay_ms": 30}, "multiple of the control step"),
        ("mlp", {"newest": 99}, r"execute is 99; it must lie in \[1, "),
    ],
)
def test_what_cannot_be_flown_so_is_refused(name: str, told: dict[str, object], said: str) -> None:
    with pytest.raises(InvalidValueError, match=said):
        fresh_policy(name).executing(Execution(**told))


@pytest.mark.parametrize(
    "told",
    [
        {"delay_ms": -20},
        {"guidance": -1.0},
        {"chunks": "fast"},
        {"newest": -1},
        {"newest": 4, "chunks": "realtime"},
    ],
)
def test_settings_that_cannot_be_are_refused(told: dict[str, object]) -> None:
    with pytest.raises(InvalidValueError):
        Execution(**told)


def test_an_execution_as_trained_flies_as_before() -> None:
    env = PointMassBatch(2)
    obs = env.reset(0)
    before, after = fresh_policy("diffusion"), fresh_policy("diffusion").executing(Execution())
    for _ in range(6):
        np.testing.assert_array_equal(before.act(obs), after.act(obs))


def test_the_newest_chunk_alone_can_be_flown_by_a_policy_that_takes_the_mean() -> None:
    """It asks again when so many actions were flown, and flies them as they were told."""
    env, steps = PointMassBatch(2), 3
    mean, newest = fresh_policy("mlp"), fresh_policy("mlp").executing(Execution(newest=steps))
    assert mean.config.ensemble is not None
    differing = False
    for step in range(7):
        obs = env.reset(step)
        if step % steps == 0:
            question = newest.look(obs)
            assert question is not None
            chunk = newest.think(question)
            newest.plan(question, chunk)
        else:
            assert newest.look(obs) is None
        flown = newest.next()
        np.testing.assert_array_equal(flown, newest.spec.action.clip(chunk[:, step % steps].astype(np.float64)))
        differing |= not np.array_equal(flown, mean.act(obs))
    assert differing
