"""Taking over from a policy in a real flight: who flew is recorded as it was, and nobody's command jumps."""

from pathlib import Path

import numpy as np
import pytest

import aerial_il
from aerial_il.core.contracts import Observation
from aerial_il.core.errors import DemoError
from aerial_il.data.episode import Episode
from aerial_il.data.folder import DatasetFolder
from aerial_il.data.recording.reader import read_episode
from aerial_il.data.replay import replay
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.layout import Interface, Layout
from aerial_il.policies.parts.normaliser import Normaliser
from aerial_il.policies.parts.switches import Switches
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.teleop.devices.scripted import Scripted
from aerial_il.teleop.input.frame import LABELS, DeviceFrame, bits_of
from aerial_il.teleop.piloting.arbiter import HAND_OVER_TICKS, Arbiter, Flier
from aerial_il.teleop.piloting.pilot import ManualPilot
from aerial_il.teleop.session.cockpit import Cockpit
from aerial_il.teleop.session.logbook import POLICY_ACTION, Logbook
from aerial_il.teleop.session.refly import refly
from aerial_il.teleop.session.session import State
from tests.teleop.hands import schedule, shipped, world

START, TAKEN, GIVEN, END = 4, 40, 90, 140  # ticks: recording has begun, take-over is held, let go, the recording ends


def flight(env: BatchEnvironment, out: Path, *, begin: int = TAKEN, end: int = GIVEN) -> Episode:
    """Record the expert's flight of reach, from which a person takes over and flies aside for a while."""
    logbook = Logbook(env, str(out), operator="ada", first_seed=5000, policy="expert")
    cockpit = Cockpit(env, shipped("scripted"), logbook, policy=aerial_il.expert("fa_hexa_arm4", "reach"), countdown=3)
    script = schedule(
        (1, 2, ["record"]),
        (begin, end, ["take_over"]),
        (begin + 10, end, ["lateral+"]),
        (END, END + 1, ["record"]),
        (END + 3, END + 4, ["save"]),
    )
    device = Scripted(script, cockpit.bindings)
    for _ in range(END + 6):
        cockpit.tick(device.frame())
    cockpit.close()
    (file,) = DatasetFolder(out).files("failures")
    return read_episode(file)


@pytest.fixture(scope="module")
def env() -> BatchEnvironment:
    return world(tier="gusts")


@pytest.fixture(scope="module")
def shared(env: BatchEnvironment, tmp_path_factory: pytest.TempPathFactory) -> Episode:
    return flight(env, tmp_path_factory.mktemp("shared"))


def test_each_frame_says_who_flew_and_whose_every_action_is(shared: Episode) -> None:
    held = shared.is_intervention
    begin, end = np.flatnonzero(held)[[0, -1]]
    assert (begin, end) == (TAKEN - START, GIVEN - START - 1)
    assert held[begin : end + 1].all(), "one intervention, without a gap"
    own = shared.extras[POLICY_ACTION]
    assert shared.extra_labels[POLICY_ACTION] == shared.spec.action.labels
    assert np.isfinite(own).all(), "the policy is asked whoever flies"
    np.testing.assert_array_equal(shared.asked, held)
    np.testing.assert_array_equal(shared.actions[:begin], own[:begin])
    after = end + 1 + HAND_OVER_TICKS
    np.testing.assert_array_equal(shared.actions[after:], own[after:])
    settled = slice(begin + HAND_OVER_TICKS, end + 1)
    np.testing.assert_array_equal(shared.actions[settled], shared.expert_actions[settled])
    assert np.abs(shared.actions[settled, :3] - own[settled, :3]).max() > 0.05, "the person went elsewhere"
    assert shared.provenance["policy"] == "expert with human:ada"


def test_it_replays_by_its_actions_and_by_its_log(env: BatchEnvironment, shared: Episode) -> None:
    assert replay(env, shared) == len(shared)
    assert refly(env, shared) == len(shared)


@pytest.mark.parametrize("cheat", ["unmarked", "marked", "label", "policy", "log"])
def test_a_recording_of_another_story_is_refused(env: BatchEnvironment, shared: Episode, cheat: str) -> None:
    """Marks of interventions, labels and the policy's actions cannot be made up afterwards."""
    from dataclasses import replace

    step = TAKEN - START + 20
    held, labels, extras = shared.is_intervention.copy(), shared.expert_actions.copy(), dict(shared.extras)
    own, rows = extras[POLICY_ACTION].copy(), extras["device"].copy()
    if cheat == "unmarked":
        held[step] = False
    elif cheat == "marked":
        step, held[3] = 3, True
    elif cheat == "label":
        labels[step, 0] += 1e-9
    elif cheat == "policy":
        step, own[3, 0] = 3, own[3, 0] + 1e-9
    else:
        rows[step, LABELS.index("held_low")] = bits_of(
            ["lateral+"], shipped("scripted").controls
        )  # take-over let go for a tick
    told = {"is_intervention": held, "expert_actions": labels, "extras": {"device": rows, POLICY_ACTION: own}}
    with pytest.raises(DemoError, match=f"step {step}"):
        refly(env, replace(shared, **told))


def test_the_command_does_not_jump_when_hands_change(shared: Episode) -> None:
    steps = np.linalg.norm(np.diff(shared.actions[:, :3], axis=0), axis=1)
    changes = np.flatnonzero(np.diff(shared.is_intervention.astype(int)))
    default = np.delete(steps, (changes[:, None] + np.arange(HAND_OVER_TICKS)).ravel())
    assert len(changes) == 2
    assert steps[changes].max() <= default.max()


def test_without_a_spread_the_same_change_of_hands_would_jump(env: BatchEnvironment) -> None:
    """The control: what the test above measures is there to be measured."""
    jumps = {ticks: np.abs(np.diff(_commands(env, ticks), axis=0)[TAKEN - 1]).max() for ticks in (1, HAND_OVER_TICKS)}
    assert jumps[1] > 3 * jumps[HAND_OVER_TICKS]


def _commands(env: BatchEnvironment, ticks: int) -> np.ndarray:
    """Fly the expert, and at tick ``TAKEN`` take over; return the commanded positions (T, 3)."""
    bindings, expert = shipped("scripted"), aerial_il.expert("fa_hexa_arm4", "reach")
    obs = env.reset(5001)
    expert.attach(env)
    arbiter = Arbiter(ManualPilot(env.spec, env.scenario.robot.vehicle, bindings), expert, hand_over_ticks=ticks)
    arbiter.engage(obs)
    device, result = Scripted(schedule((TAKEN, 200, ["take_over"])), bindings), []
    for _ in range(TAKEN + 3):
        turn = arbiter.act(device.frame(), obs)
        result.append(turn.action[:3])
        obs = env.step(turn.action[None]).obs
    return np.array(result)


def test_who_takes_over_hovers_there_and_keeps_the_grip() -> None:
    """The targets are the present pose; the gripper goes on by the last command, not by where its fingers stand."""
    env = world(task="pick_place")
    obs = env.reset(5000)
    pilot = ManualPilot(env.spec, env.scenario.robot.vehicle, shipped("scripted"))
    pilot.engage({name: values[0] for name, values in obs.items()}, np.append(np.zeros(9), 0.0))
    action = pilot.act(DeviceFrame(seq=1), {name: values[0] for name, values in obs.items()})
    np.testing.assert_allclose(action[:3], obs["ee_pos"][0], atol=1e-9)
    assert obs["gripper"][0, 0] == 1.0
    assert action[-1] == 0.0


def test_handed_back_a_chunked_policy_plans_anew(env: BatchEnvironment) -> None:
    policy, fresh = _network(env), _network(env)
    bindings, seen = shipped("scripted"), []
    arbiter = Arbiter(ManualPilot(env.spec, env.scenario.robot.vehicle, bindings), policy)
    obs = env.reset(5000)
    arbiter.engage(obs)
    device = Scripted(schedule((4, 8, ["take_over"])), bindings)
    for _ in range(9):
        seen.append((obs, arbiter.act(device.frame(), obs)))
        obs = env.step(seen[-1][1].action[None]).obs
    before, after = seen[7], seen[8]
    assert (before[1].flier, after[1].flier) == (Flier.PERSON, Flier.POLICY)
    np.testing.assert_array_equal(after[1].policy_action, fresh.act(after[0])[0])
    stale = _network(env)
    for shown, _ in seen[:8]:
        stale.act(shown)
    assert not np.array_equal(stale.act(after[0])[0], after[1].policy_action), "its old plan is another one"


def _network(env: BatchEnvironment) -> ChunkPolicy:
    """Return a network with the same random weights each time, which plans ten steps ahead."""
    import torch

    config, size = MLP(chunk=10, execute=10, ensemble=None), env.spec.action.size
    layout, data = Layout.of(env.spec, config), np.random.default_rng(0)
    scalers = (Normaliser.fit(data.normal(size=(99, size))) for size in (layout.size, size))
    interface = Interface(layout, *scalers, config.obs_clip, Switches.none(size))
    torch.manual_seed(0)
    return ChunkPolicy(config, interface, config.build(layout.size, size))


def test_when_nobody_is_there_the_policy_waits(env: BatchEnvironment) -> None:
    expert = aerial_il.expert("fa_hexa_arm4", "reach")
    obs = env.reset(5000)
    expert.attach(env)
    arbiter = Arbiter(ManualPilot(env.spec, env.scenario.robot.vehicle, shipped("scripted")), expert)
    arbiter.engage(obs)
    turn = arbiter.act(DeviceFrame(seq=0), obs)
    assert turn.flier is Flier.NOBODY
    assert not turn.is_intervention
    assert np.isnan(turn.label).all()
    np.testing.assert_allclose(turn.action[:3], obs["ee_pos"][0])
    assert arbiter.act(DeviceFrame(seq=1), obs).flier is Flier.POLICY
    for _ in range(20):
        turn = arbiter.act(DeviceFrame(seq=1), obs)
    assert turn.flier is Flier.NOBODY, "a connection that is lost is not a hand that lets go"


def test_a_policy_that_fails_sets_the_flight_back_and_is_told(env: BatchEnvironment, tmp_path: Path) -> None:
    class Broken:
        def act(self, obs: Observation) -> np.ndarray:
            from aerial_il.core.errors import NonFiniteActionError

            raise NonFiniteActionError("network output", np.array([0]))

        def reset(self, mask: np.ndarray | None = None) -> None:
            pass

    logbook = Logbook(env, str(tmp_path), operator="ada", policy="broken")
    cockpit = Cockpit(env, shipped("scripted"), logbook, policy=Broken(), countdown=3)
    cockpit.tick(DeviceFrame(seq=1))
    assert cockpit.state is State.IDLE
    assert "Set back to the start" in cockpit.message
