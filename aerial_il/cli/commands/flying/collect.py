"""Let the expert fly and record every flight; killed at any moment, the same command continues.

Each seed is one episode. Successes go to demos/, the others, labelled so, to failures/.

launcher=processes, slurm or ray divides the seeds among jobs that record into the same folder, on one machine or many.
The dataset is the same, byte for byte, however many there are.

Example: aerial-il collect robot=fa_hexa_arm4 task=reach episodes=100 out=datasets/reach
Example: aerial-il collect task=pick_place episodes=50 cameras=[wrist,scene] lerobot=true out=datasets/pick_seen
Example: aerial-il collect robot=quad task=hover expert=my_pilot:make episodes=20 out=datasets/mine
Example: aerial-il collect task=pick_place episodes=100000 launcher=processes out=datasets/large
Example: aerial-il collect env=gymnasium:AdroitHandDoor-v1 policy=dapg_policies.npz success=success:25 out=datasets/door
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from aerial_il.cli.commands.datasets import convert
from aerial_il.cli.configuration import spelling
from aerial_il.cli.configuration.keys import MISSING, MaybeLocated, Named, TierName, at_least, group, key, output, path
from aerial_il.cli.configuration.quoting import command_line
from aerial_il.core.errors import InvalidValueError

if TYPE_CHECKING:
    from aerial_il.core.contracts import BatchEnv, Policy

SHARDS = ".shards"  # below the dataset: logs of the jobs that recorded it


@dataclass
class Expert:
    """How the expert flies."""

    noise: float = 0.0
    path: str | None = None

    def __post_init__(self) -> None:
        at_least(self, noise=0.0)


@dataclass
class Config:
    robot: Named = group("robot that flies", "ua_quad_arm4")
    task: Named = group("task that it does", "pick_place")
    tier: TierName = group("disturbance tier, e.g. gusts, hard-payload, calm+latency", "calm", composed=True)
    expert: Expert = group("how the expert flies, or your own expert: module:factory", "noisy", path=True)
    controller: Named = group("control law of the base", "geometric_observer")
    policy: MaybeLocated = path(
        MaybeLocated, "who flies in env=...: a run, an expert's file, module:factory, model.zip, or random"
    )
    env: str | None = key(None, "external environment instead of robot and task, e.g. gymnasium:CartPole-v1")
    success: str | None = key(
        None, "what makes an episode there a success: KEY:N, return:R, survived (null: as it reports)"
    )
    max_steps: int | None = key(None, "time limit there (null: its own)")
    horizon: int | None = key(None, "record so many steps of 20 ms, through success (null: up to the first success)")
    out: str = output(MISSING, "folder of the dataset")
    action: str = key("ee_pose", "action level that is recorded")
    episodes: int = key(100, "number of episodes, one for each seed")
    seed: int = key(0, "first seed; evaluations start at 10000")
    cameras: list[str] = key([], "cameras to record: scene, wrist, base")
    image_size: list[int] = key([240, 320], "height and width of their images")
    mix: bool = key(False, "add to a dataset of another tier, flight law, pilot or settings")
    lerobot: bool = key(False, "derive a LeRobot dataset too, in derived/lerobot of the folder")
    num_envs: int = key(64, "worlds flown at once")
    threads: int = key(0, "simulation threads, or processes of external environments; 0 for all cores")
    shard: int = key(1000, "episodes of each job, where launcher= divides the work")
    rerun: bool = key(False, "show the first world in rerun while it flies; a file where there is no screen")
    progress: bool = key(True, "show a progress bar")

    def __post_init__(self) -> None:
        at_least(self, episodes=1, seed=0, num_envs=1, threads=0, shard=1)
        if len(self.image_size) != 2:
            raise InvalidValueError(f"image_size={self.image_size} is not height and width, e.g. image_size=[240,320].")


def run(config: Config) -> None:
    """Record, and say what comes next."""
    (record if config.env is None else record_outside)(config)
    name = config.task.name if config.env is None else config.env.partition(":")[2]
    print(f"Next: {command_line(['train', spelling.path('dataset', config.out), f'run=runs/{name}'])}")


def shards(config: Config) -> list[tuple[tuple[str, ...], str]]:
    """Return, for each part of the seeds, the words that choose it and a folder for its log."""
    end = config.seed + config.episodes
    return [
        (
            (f"seed={first}", f"episodes={min(config.shard, end - first)}", "lerobot=false", "rerun=false"),
            f"{config.out}/{SHARDS}/seed={first}",
        )
        for first in range(config.seed, end, config.shard)
    ]


def record(config: Config) -> None:
    """Record what is missing, and derive the LeRobot dataset if it is wanted."""
    import aerial_il
    from aerial_il.core.rendering import require_rendering
    from aerial_il.workflows.parts import typed_code
    from aerial_il.workflows.parts.environments import EnvironmentReference

    _check_of_the_suite(config)
    if config.cameras:
        require_rendering(f"cameras=[{','.join(config.cameras)}]")
    robot, task, own = config.robot.name, config.task.name, config.expert.path
    expert = aerial_il.expert(robot, task, noise=config.expert.noise) if own is None else typed_code.policy_of(own)
    where = EnvironmentReference(
        robot=robot,
        task=task,
        tier=config.tier.name,
        action=config.action,
        controller=config.controller.name,
        horizon=config.horizon,
        cameras=tuple(config.cameras),
        image_size=(config.image_size[0], config.image_size[1]),
    )
    env = where.load(num_envs=min(config.num_envs, config.episodes), threads=config.threads)
    _record(config, env, expert, own or "expert", {"noise": config.expert.noise} if own is None else {})


def _check_of_the_suite(config: Config) -> None:
    """Refuse what is read for external environments alone, instead of recording something else in silence."""
    said = {"policy": config.policy.path, "success": config.success, "max_steps": config.max_steps}
    for name, value in said.items():
        if value is not None:
            instead = {
                "policy": "here experts fly, yours too with expert=module:factory; aerial-il evaluate flies a policy",
                "success": "the task decides here",
                "max_steps": f"here horizon={value} records so many steps",
            }[name]
            raise InvalidValueError(f"{name}={value} is for env=...: {instead}.")


def record_outside(config: Config) -> None:
    """Record what is missing of an environment from outside, each episode over its whole horizon."""
    from aerial_il.workflows.parts import environments, pilots

    source = config.policy.path
    if config.rerun:
        raise InvalidValueError("rerun=true works in this suite only: leave out env=... or rerun=true.")
    environments.check_horizon(config.env, config.horizon)
    if source is None:
        raise InvalidValueError(f"env={config.env} has no expert of its own: set policy=... too.")
    options = environments.given(success=config.success, max_steps=config.max_steps)
    noise = config.expert.noise
    pilot = pilots.pilot(source, robot=None, task=None, action=None, env=config.env, options=options, noise=noise)
    env = pilot.environment(config.tier.name, num_envs=min(config.num_envs, config.episodes), threads=config.threads)
    _record(config, env, pilot.policy, source, {"noise": noise})


def _record(config: Config, env: BatchEnv, policy: Policy, name: str, settings: Mapping[str, Any]) -> None:
    """Fly the seeds that are missing and close ``env``; then derive the LeRobot dataset if it is wanted."""
    from aerial_il.collection.collect import collect
    from aerial_il.workflows.parts.watching import watched

    try:
        with watched(env, config.threads, wanted=config.rerun) as seen:
            collect(
                seen,
                policy,
                range(config.seed, config.seed + config.episodes),
                config.out,
                policy_name=name,
                settings=settings,
                mix=config.mix,
                progress=config.progress,
            )
    finally:
        env.close()
    if config.lerobot:
        convert.run(convert.Config(config.out, progress=config.progress))
