"""Policies fly robots over links: as the evaluation says in lockstep, guarded, recorded, on time or counted late."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from aerial_il import experts, load_batch
from aerial_il.cli.main import main
from aerial_il.collection.collect import collect
from aerial_il.core import language
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.latency import NO_LATENCY, Latency
from aerial_il.core.specs import EnvSpec, ObservationSpec
from aerial_il.data.folder import FAILURES
from aerial_il.data.recording.reader import read_episode
from aerial_il.evaluation.rollouts import evaluate
from aerial_il.links.environment import LinkedEnvironment
from aerial_il.links.guard import Guard
from aerial_il.links.link import LinkError, Mode, Order, Reading
from aerial_il.links.loop import hold_action
from aerial_il.links.onboard import fly as fly_onboard
from aerial_il.links.pilot import LinkPilot
from aerial_il.links.robot import SimulatedRobot
from aerial_il.links.simulated.in_process import SimulatedLink
from aerial_il.links.simulated.link import Simulated
from aerial_il.links.watch import Watch
from aerial_il.policies import get
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.execution import Execution
from aerial_il.policies.parts.language import TOLD
from aerial_il.policies.parts.layout import Interface, Layout
from aerial_il.policies.parts.normaliser import Normaliser
from aerial_il.policies.parts.switches import Switches
from aerial_il.policies.parts.tasks import united
from aerial_il.suite.late import late
from aerial_il.workflows.fly import Fly

ROBOT, TASK = "ua_quad_arm4", "reach"
TOOL_ALONE = ("base_*", "joint_*", "wrist_force")


def fresh_policy(name: str, *, spec: EnvSpec | None = None, **settings: object) -> ChunkPolicy:
    """Return an untrained policy of the robot, which hovers about, as all that it says is relative to its tool."""
    spec = spec or load_batch(ROBOT, TASK, num_envs=1, num_threads=1).spec
    small = {"chunk": 16, "execute": 4, "ensemble": None, "relative": True, "masked_fields": TOOL_ALONE}
    config = get(name)(**{**small, **settings})
    layout, size = Layout.of(spec, config), spec.action.size
    interface = Interface(layout, Normaliser.none(layout.size), Normaliser.none(size), 10.0, Switches.none(size))
    torch.manual_seed(0)
    return ChunkPolicy(config, interface, config.build(layout.size, size))


def linked(settings: Simulated | None = None, guard: Guard | None = None, **robot: object) -> LinkedEnvironment:
    link = (settings or Simulated()).connect(lambda: SimulatedRobot(ROBOT, TASK, **robot))  # pyright: ignore[reportArgumentType]
    return LinkedEnvironment(link, guard)


def still(env: LinkedEnvironment) -> np.ndarray:
    return hold_action(env.spec, env.loop.obs)[None]


@pytest.mark.parametrize(
    ("latency", "execution"),
    [(NO_LATENCY, Execution()), (Latency(observation_delay_ms=40), Execution(chunks="dropped"))],
)
def test_in_lockstep_it_flies_as_it_was_evaluated(latency: Latency, execution: Execution) -> None:
    policy = fresh_policy("mlp").executing(execution, latency)
    wide = Guard(fence=(-9.0, -9.0, -9.0, 9.0, 9.0, 9.0))
    ours = linked(guard=wide, latency=latency)
    flown = evaluate(ours, LinkPilot(policy.fresh()), range(3), policy_name="a", progress=False)
    env = late(load_batch(ROBOT, TASK, num_envs=1), latency)
    judged = evaluate(env, policy.fresh(), range(3), policy_name="a", progress=False)
    for one, other in zip(flown.episodes, judged.episodes, strict=True):
        assert one.to_dict() == other.to_dict()


class Mute(SimulatedLink):
    """A link whose readings stop for some ticks, or are spoiled."""

    silent = range(0)
    spoiled = range(0)
    ticks = 0
    sent = 0

    def step(self) -> None:
        before = self._newest
        super().step()
        self.ticks += 1
        if self.ticks in self.silent:
            self._newest = before
        if self.ticks in self.spoiled:
            bad = {**self._newest.obs, "base_pos": np.full(3, np.nan)}
            self._newest = Reading(bad, self._newest.stamp_s, self._newest.mode, armed=True)

    def send(self, level: str, action: np.ndarray) -> None:
        self.sent += 1
        super().send(level, action)


@pytest.mark.parametrize("what", ["silent", "spoiled"])
def test_without_news_it_hovers_and_then_flies_on(what: str) -> None:
    link = Mute(SimulatedRobot(ROBOT, TASK))
    setattr(link, what, range(60, 90))
    env, policy = LinkedEnvironment(link), fresh_policy("mlp")
    pilot = LinkPilot(policy)
    pilot.attach(env)
    obs = env.reset(0)
    pilot.reset()
    pilot.begin(np.array([0]))
    hovering = []
    for tick in range(150):
        obs = env.step(pilot.act(obs)).obs
        assert all(np.isfinite(value).all() for value in obs.values())
        if link.robot.mode is Mode.HOLDING:
            hovering.append(tick)
    assert env.loop.held >= 25
    assert link.sent == 150 - env.loop.held
    assert min(hovering) <= 60 + 15, "within 300 ms"
    assert max(hovering) < 100, "and not for longer than it takes"
    assert not env.loop.trouble


def test_set_points_and_readings_may_be_lost() -> None:
    env = linked(Simulated(loss=0.05))
    result = evaluate(env, LinkPilot(fresh_policy("mlp")), [0], policy_name="a", progress=False)
    assert result.episodes[0].steps > 50
    assert max(env.loop.timing.age_s) >= env.spec.control_dt_s
    assert env.loop.held == 0


def test_beyond_the_fence_the_flight_ends() -> None:
    env = linked(guard=Guard(fence=(-3.0, -3.0, 0.0, 3.0, 3.0, 1.4)))
    env.reset(0)
    up = still(env) + np.array([0.0, 0.0, 0.4, *[0.0] * 7])
    result = next(result for result in (env.step(up) for _ in range(200)) if result.truncated[0])
    assert "beyond the fence" in env.loop.trouble
    assert "beyond the fence" in str(result.info["ended"][0])
    assert "beyond the fence" in env.loop.troubles[0][1]
    assert not result.info["crash"][0]


def test_every_tick_in_which_the_guard_objected_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    env = linked()
    env.reset(0)
    read = env.loop.link.read

    def blinded() -> Reading | None:
        reading = read()
        blind = reading is not None and 5 <= env.loop.steps < 9
        return replace(reading, obs={**reading.obs, "ee_pos": np.full(3, np.nan)}) if blind else reading

    monkeypatch.setattr(env.loop.link, "read", blinded)
    for _ in range(20):
        env.step(still(env))
    assert env.loop.held > 0
    assert not env.loop.trouble, "it is over"
    assert env.loop.troubles[0] == (env.loop.held, "ee_pos is not finite")


def test_a_fence_within_which_it_does_not_start_is_refused() -> None:
    with pytest.raises(InvalidValueError, match=r"beyond the fence. Set guard\.fence"):
        linked(guard=Guard(fence=(-3.0, -3.0, 0.0, 3.0, 3.0, 1.0))).reset(0)


def test_a_robot_that_is_gone_ends_the_flight() -> None:
    link = Mute(SimulatedRobot(ROBOT, TASK))
    link.silent = range(20, 10_000)
    env = LinkedEnvironment(link)
    with pytest.raises(LinkError, match="is lost: no news of the robot for 5"):
        evaluate(env, LinkPilot(fresh_policy("mlp")), [0], policy_name="a", progress=False)


def test_a_reading_of_an_earlier_episode_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    env = linked()
    env.reset(1)
    stale = env.loop.link.read()
    monkeypatch.setattr(env.loop.link, "read", lambda: stale)
    with pytest.raises(LinkError, match="10 s after"):
        env.reset(2)


def test_a_success_after_held_ticks_is_no_demonstration(tmp_path: Path) -> None:
    link = Mute(SimulatedRobot(ROBOT, TASK))
    link.silent = range(30, 45)
    env = LinkedEnvironment(link)
    flown = collect(env, LinkPilot(experts.make(ROBOT, TASK)), [0], tmp_path, progress=False)
    (path,) = flown.folder.files(FAILURES)
    note = read_episode(path).provenance["note"]
    assert flown.failures == [0]
    assert "hovered by itself for" in note
    assert "no news" in note


def test_a_success_after_the_robot_hovered_by_itself_is_no_demonstration(tmp_path: Path) -> None:
    """Nothing is wrong with it: somebody told it to hover, and no set point counted meanwhile."""
    link = SimulatedLink(SimulatedRobot(ROBOT, TASK))
    env, step = LinkedEnvironment(link), link.step

    def told() -> None:
        if env.loop.steps in (10, 30):
            link.order(Order.HOVER if env.loop.steps == 10 else Order.FOLLOW)
        step()

    link.step = told
    collection = collect(env, LinkPilot(experts.make(ROBOT, TASK)), [0], tmp_path, progress=False)
    assert (collection.demos, collection.failures) == ([], [0])
    (file,) = (tmp_path / FAILURES).glob("*.mcap")
    episode = read_episode(file)
    assert episode.success is False
    assert "hovered by itself for 2" in episode.provenance["note"]


def test_who_is_landed_is_no_crash(tmp_path: Path) -> None:
    link = SimulatedLink(SimulatedRobot(ROBOT, TASK))
    env, step = LinkedEnvironment(link), link.step

    def told() -> None:
        if env.loop.steps == 10:
            link.order(Order.LAND)
        step()

    link.step = told
    (flown,) = collect(env, LinkPilot(fresh_policy("mlp")), [0], tmp_path, progress=False).flights.values()
    assert flown.failure == "other"
    (file,) = (tmp_path / FAILURES).glob("*.mcap")
    assert read_episode(file).provenance["note"] == "the robot is landing"


def test_actions_that_arrive_late_are_recorded_as_they_were_executed(tmp_path: Path) -> None:
    env = linked(latency=Latency(action_delay_ms=60))
    collect(env, LinkPilot(fresh_policy("mlp")), [0], tmp_path, progress=False)
    env.close()
    (file,) = tmp_path.glob("*/*.mcap")
    episode = read_episode(file)
    np.testing.assert_array_equal(episode.executed_actions[3:], episode.actions[:-3])


def test_what_is_gripped_stays_gripped_after_trouble() -> None:
    link = Mute(SimulatedRobot(ROBOT, TASK))
    link.silent = range(40, 60)
    env = LinkedEnvironment(link)
    obs = env.reset(0)
    pilot = LinkPilot(fresh_policy("mlp").executing(Execution(), thinking=3), think_ticks=3)
    pilot.attach(env)
    pilot.reset()
    closed = still(env)
    closed[0, -1] = 0.0
    starved = 0
    for _ in range(80):
        said = pilot.act(obs)
        if pilot.starved > starved > 3:
            assert said[0, -1] == 0.0, "as it was commanded last"
        starved = pilot.starved
        obs = env.step(closed).obs
    pilot.close()
    assert starved == 6, "it thought anew"


def test_a_clock_that_jumps_is_trouble() -> None:
    env = linked()
    env.reset(0)
    reading, watch = env.loop.link.read(), Watch(Guard(), env.spec)
    assert reading is not None
    seen = []
    for stamp in (1.0, 1.02, 0.5, 0.52, 30.0, *np.arange(30.02, 30.2, 0.02)):
        watch.see(Reading(reading.obs, stamp, Mode.FLYING, armed=True), stamp)
        seen.append("jumped" in watch.trouble)
    assert seen[:5] == [False, False, True, True, True]
    assert not seen[-1], "a few readings later it is over"


def test_a_reading_does_not_age_while_lost_ticks_are_made_up_for() -> None:
    env = linked()
    env.reset(0)
    reading, watch = env.loop.link.read(), Watch(Guard(), env.spec)
    assert reading is not None
    for now_s in (1.0, *[1.3] * 10, 1.34, 1.36):
        watch.see(replace(reading, stamp_s=min(now_s, 1.3)), now_s)
        assert not watch.trouble
    watch.see(replace(reading, stamp_s=1.3), 1.38)
    assert watch.trouble == "no news of the robot for 80 ms"


def test_who_lands_it_ends_the_flight() -> None:
    env = linked()
    env.reset(0)
    env.loop.link.order(Order.LAND)
    assert env.step(still(env)).truncated[0]
    assert "landing" in env.loop.trouble or "standing" in env.loop.trouble


@pytest.mark.parametrize("chunks", ["plain", "dropped"])
def test_thinking_beside_the_flight_changes_nothing_but_when(chunks: str) -> None:
    def flown() -> list[np.ndarray]:
        policy = fresh_policy("act").executing(Execution(chunks=chunks), thinking=3)  # pyright: ignore[reportArgumentType]
        env, pilot = linked(), LinkPilot(policy, think_ticks=3)
        pilot.attach(env)
        obs, actions = env.reset(0), []
        pilot.reset()
        for _ in range(60):
            actions.append(pilot.act(obs))
            obs = env.step(actions[-1]).obs
        pilot.close()
        assert pilot.starved == 3, "before its first answer"
        return actions

    first, second = flown(), flown()
    np.testing.assert_array_equal(first, second)


def test_chunks_may_be_joined_without_a_step() -> None:
    def steps(blend: int) -> float:
        policy = fresh_policy("diffusion")
        env, pilot = linked(), LinkPilot(policy, blend_ticks=blend)
        pilot.attach(env)
        obs, actions = env.reset(0), []
        pilot.reset()
        for _ in range(80):
            actions.append(pilot.act(obs)[0, :3])
            obs = env.step(pilot._last).obs  # pyright: ignore[reportArgumentType]
        return float(np.linalg.norm(np.diff(actions, axis=0), axis=1)[3::4].max())  # from one chunk to the next

    assert steps(8) < 0.6 * steps(0)


def test_a_thought_that_leaves_too_little_of_a_chunk_is_refused() -> None:
    with pytest.raises(InvalidValueError, match="are left to fly while"):
        fresh_policy("mlp").executing(Execution(chunks="dropped"), thinking=200)


def test_in_real_time_ticks_are_counted(tmp_path: Path) -> None:
    env = linked(Simulated(clock="wall", speed=4.0))
    pilot = LinkPilot(fresh_policy("mlp"))
    pilot.attach(env)
    obs = env.reset(0)
    pilot.reset()
    for _ in range(50):
        obs = env.step(pilot.act(obs)).obs
    env.close()
    said = env.loop.timing.summary()
    assert said["ticks"] == 50
    assert said["work_ms_p50"] > 0.0


@pytest.mark.render
def test_images_are_shown_in_real_time() -> None:
    env = linked(Simulated(clock="wall"), cameras=("wrist", "wrist:depth"), image_size=(30, 40))
    for seed in (0, 1):  # a reset draws on this thread, flying on the robot's
        first = env.reset(seed)["wrist_rgb"]
        for _ in range(10):
            obs = env.step(still(env)).obs
    env.close()
    shown = obs["wrist_rgb"]
    assert shown.shape == first.shape == (1, 30, 40, 3)
    assert obs["wrist_depth"].shape == (1, 30, 40)
    assert shown.std() > 0.0


def test_the_command_records_what_trains(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fresh_policy("mlp").save(tmp_path / "policy")
    out = tmp_path / "flown"
    typed = ["fly", f"policy={tmp_path / 'policy'}", f"out={out}", "episodes=2", "seed=0", "progress=false"]
    typed += ["guard.fence=[-9,-9,-9,9,9,9]"]  # whoever knows nothing flies about
    assert main(typed) == 0
    said = capsys.readouterr().out
    assert "Success 0 of 2" in said or "of 2 (" in said
    assert "late by more than 5 ms" in said
    assert len([*out.glob("*/*.mcap")]) == 2
    assert main(["validate", str(out), "replay=true", "progress=false"]) == 0
    assert main(typed) == 0, "what is flown is not flown again"
    assert "2 flights were there already" in capsys.readouterr().out


def test_a_policy_of_several_tasks_flies_in_real_time(tmp_path: Path) -> None:
    specs = [load_batch(ROBOT, task, num_envs=1, num_threads=1).spec for task in (TASK, "press_button")]
    fresh_policy("mlp", spec=united(specs)).save(tmp_path / "policy")
    clock = ["link.clock=wall", "link.speed=8", "think_ms=0", "guard.fence=[-1,-1,0,1,1,1.6]"]
    typed = ["fly", f"policy={tmp_path / 'policy'}", f"task={TASK}", "seed=0", *clock, "progress=false"]
    assert main([*typed, f"out={tmp_path / 'flown'}"]) == 0
    assert len([*(tmp_path / "flown").glob("*/*.mcap")]) == 1


@pytest.mark.parametrize("key", ["think_ms", "blend_ms"])
def test_nan_is_refused(tmp_path: Path, key: str) -> None:
    with pytest.raises(InvalidValueError, match=f"{key}=nan"):
        Fly(policy="random", out=str(tmp_path), **{key: np.nan})  # pyright: ignore[reportArgumentType]


def test_a_policy_of_another_robot_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fresh_policy("mlp", relative=False, masked_fields=()).save(tmp_path / "policy")
    typed = ["fly", f"policy={tmp_path / 'policy'}", "robot=fa_hexa_arm4", f"out={tmp_path / 'flown'}"]
    assert main(typed) == 2
    assert "trained for reach on ua_quad_arm4" in "".join(capsys.readouterr())


def test_a_robot_that_shows_nothing_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    env = linked()
    monkeypatch.setattr(env.loop.link, "read", lambda: None)
    with pytest.raises(LinkError, match="shows nothing"):
        env.reset(0)


def test_onboard_a_policy_is_told_the_task_of_its_robot(monkeypatch: pytest.MonkeyPatch) -> None:
    specs = [load_batch(ROBOT, task, num_envs=1).spec for task in (TASK, "press_button")]
    shown = [replace(spec, observation=ObservationSpec((*spec.observation.fields, TOLD))) for spec in specs]
    policy = fresh_policy("mlp", spec=united(shown))
    told, embedded = list[str](), language.embedded
    monkeypatch.setattr(language, "embedded", lambda text: (told.append(text), embedded(text))[1])
    fly_onboard(policy, SimulatedLink(SimulatedRobot(ROBOT, "press_button")), seconds=0.04, seed=1)
    assert {*told} == {specs[1].instruction}


def test_flights_of_other_weights_are_not_taken_for_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A policy that was trained anew has the name of the one before."""
    monkeypatch.chdir(tmp_path)
    words = ["fly", "policy=policy", "episodes=1", "out=flown", "progress=false"]
    for hidden, code in ((8, 0), (8, 0), (16, 2)):
        fresh_policy("mlp", hidden=(hidden,)).save("policy")
        assert main(words) == code
        assert len([*Path("flown").rglob("*.mcap")]) == 1, "the same is not flown twice"
    assert "policy_sha256" in capsys.readouterr().err
