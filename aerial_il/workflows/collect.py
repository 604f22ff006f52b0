"""Record flights of an expert, or of whoever flies in an environment from outside; each seed is one episode."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.latency import NO_LATENCY, Latency
from aerial_il.workflows.parts.names import Controller, Robot, Task, Tier, at_least
from aerial_il.workflows.parts.shards import shards_of

if TYPE_CHECKING:
    from aerial_il.core.contracts import BatchEnv, Policy


OF_THE_SUITE = ("robot", "task", "tier", "action", "controller", "cameras", "image_size")


@dataclass(frozen=True, kw_only=True)
class Expert:
    """How the expert flies.

    Attributes:
        noise: perturbation of its commands, from 0 (none) to 1 (all that it can recover from), so that a policy learns
            to come back.
        look: fly so that the robot's cameras see what comes next: heading for it where the heading is free, and slower
            where it is near.
        path: your own expert: module:factory.
    """

    noise: float = 0.3
    look: bool = False
    path: str | None = None

    def __post_init__(self) -> None:
        at_least(self, noise=0.0)

    @property
    def options(self) -> dict[str, Any]:
        """What recordings say of how it flew."""
        return {"noise": self.noise, **({"look": True} if self.look else {})}


@dataclass(frozen=True, kw_only=True)
class Collect:
    """What is recorded.

    Attributes:
        robot: robot that flies.
        task: task that it does.
        tier: disturbance tier, e.g. gusts, hard-payload, calm+latency.
        expert: how the expert flies, or your own expert: module:factory.
        controller: control law of the base.
        latency: how late is recorded what is seen, and done what is commanded.
        policy: who flies in env=...: a run, an expert's file, module:factory, model.zip, or random.
        env: external environment instead of robot and task, e.g. gymnasium:CartPole-v1.
        success: what makes an episode there a success: KEY:N, return:R, survived (null: as it reports).
        max_steps: time limit there (null: its own).
        horizon: record so many steps of 20 ms, through success (null: up to the first success).
        out: folder of the dataset.
        action: action level that is recorded.
        episodes: number of episodes, one for each seed.
        seed: first seed; evaluations start at 10000.
        cameras: cameras to record: scene, wrist, base; with a size, rate and delay of its own wrist@64x64@25Hz@40ms.
        image_size: height and width of images that say none.
        mix: add to a dataset of another tier, flight law, pilot or settings.
        lerobot: derive a LeRobot dataset too, in derived/lerobot of the folder.
        num_envs: worlds flown at once.
        threads: simulation threads, or processes of external environments; 0 for all cores.
        shard: episodes of each job, where launcher= divides the work.
        rerun: show the first world in rerun while it flies; a file where there is no screen.
        progress: show a progress bar.
    """

    robot: Robot = "ua_quad_arm4"
    task: Task = "pick_place"
    tier: Tier = "calm"
    expert: Expert = Expert()
    controller: Controller = "geometric_observer"
    latency: Latency = NO_LATENCY
    policy: str | None = None
    env: str | None = None
    success: str | None = None
    max_steps: int | None = None
    horizon: int | None = None
    out: str
    action: str = "ee_pose"
    episodes: int = 100
    seed: int = 0
    cameras: tuple[str, ...] = ()
    image_size: tuple[int, int] = (240, 320)
    mix: bool = False
    lerobot: bool = False
    num_envs: int = 64
    threads: int = 0
    shard: int = 1000
    rerun: bool = False
    progress: bool = True

    def __post_init__(self) -> None:
        at_least(self, episodes=1, seed=0, num_envs=1, threads=0, shard=1)


def collect(settings: Collect) -> str:
    """Record what is missing, derive the LeRobot dataset if it is wanted, and return the folder."""
    (_in_the_suite if settings.env is None else _outside)(settings)
    if settings.lerobot:
        from aerial_il.workflows.convert import Convert, convert

        convert(Convert(path=settings.out, progress=settings.progress))
    return settings.out


def shards(settings: Collect) -> list[tuple[tuple[str, ...], str]]:
    """Return, for each part of the seeds, the words that choose it and a folder for its log."""
    seeds = range(settings.seed, settings.seed + settings.episodes)
    return shards_of(settings.out, seeds, settings.shard, words=("lerobot=false", "rerun=false"))


def _in_the_suite(settings: Collect) -> None:
    from aerial_il import experts
    from aerial_il.core.rendering import require_rendering
    from aerial_il.workflows.parts import typed_code
    from aerial_il.workflows.parts.environments import EnvironmentReference

    _check_of_the_suite(settings)
    if settings.cameras:
        require_rendering(f"cameras=[{','.join(settings.cameras)}]")
    robot, task, own, options = settings.robot, settings.task, settings.expert.path, settings.expert.options
    expert = experts.make(robot, task, **options) if own is None else typed_code.policy_of(own)
    where = EnvironmentReference(
        robot=robot,
        task=task,
        tier=settings.tier,
        action=settings.action,
        controller=settings.controller,
        horizon=settings.horizon,
        cameras=settings.cameras,
        image_size=settings.image_size,
    )
    env = where.load(num_envs=min(settings.num_envs, settings.episodes), threads=settings.threads)
    _record(settings, env, expert, own or "expert", options if own is None else {})


def _check_of_the_suite(settings: Collect) -> None:
    """Refuse what is read for external environments alone, instead of recording something else in silence."""
    instead = {
        "policy": "here experts fly, yours too with expert=module:factory; aerial-il evaluate flies a policy",
        "success": "the task decides here",
        "max_steps": f"here horizon={settings.max_steps} records so many steps",
    }
    for name, advice in instead.items():
        if (value := getattr(settings, name)) is not None:
            raise InvalidValueError(f"{name}={value} is for env=...: {advice}.")


def _outside(settings: Collect) -> None:
    """Record what is missing of an environment from outside, each episode over its whole horizon."""
    from aerial_il.workflows.parts import environments, pilots

    source, noise = settings.policy, settings.expert.noise
    if settings.rerun:
        raise InvalidValueError("rerun=true works in this suite only: leave out env=... or rerun=true.")
    environments.check_horizon(settings.env, settings.horizon)
    environments.refuse_unread(settings.env, settings, OF_THE_SUITE)
    read = ("noise",) if (source or "").endswith(".npz") else ()  # of an expert's file
    names = (each.name for each in fields(Expert) if each.name not in read)
    environments.refuse_unread(settings.env, settings.expert, names, group="expert.")
    if source is None:
        raise InvalidValueError(f"env={settings.env} has no expert of its own: set policy=... too.")
    options = environments.given(success=settings.success, max_steps=settings.max_steps)
    pilot = pilots.pilot(source, robot=None, task=None, action=None, env=settings.env, options=options, noise=noise)
    env = pilot.environment(settings.tier, num_envs=min(settings.num_envs, settings.episodes), threads=settings.threads)
    _record(settings, env, pilot.policy, source, {"noise": noise} if source.endswith(".npz") else {})  # of an expert's


def _record(settings: Collect, env: BatchEnv, policy: Policy, name: str, flown_with: Mapping[str, Any]) -> None:
    """Fly the seeds that are missing, and close ``env``."""
    from aerial_il.collection.collect import collect as fly
    from aerial_il.evaluation.rollouts import known_by
    from aerial_il.suite.late import late
    from aerial_il.workflows.info import remember
    from aerial_il.workflows.parts.watching import watched

    seeds = range(settings.seed, settings.seed + settings.episodes)
    with closing(env), watched(env, settings.threads, wanted=settings.rerun) as seen:
        recorded = fly(
            late(seen, settings.latency), policy, seeds, settings.out,
            policy_name=name, settings={**flown_with, **known_by(policy), **settings.latency.said}, mix=settings.mix,
            progress=settings.progress,
        )  # fmt: skip
        remember(recorded, env.spec)
