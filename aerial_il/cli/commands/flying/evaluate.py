"""Fly a policy or an expert over fixed seeds and write evaluation.json, videos and a report.

Interrupted, the same command continues: finished flights are kept. A result of something else in the folder is
refused, a finished one is not flown again. The result does not depend on num_envs. Robot, task and action level, or the
environment from outside, are the policy's own unless they are given. An environment from outside is flown over its
whole horizon.

Example: aerial-il evaluate policy=runs/pick_bc tier=gusts out=runs/pick_bc/gusts
Example: aerial-il evaluate policy=expert robot=fa_hexa_arm4 task=reach out=evaluations/expert_reach
Example: aerial-il evaluate policy=my_pilot:make robot=quad task=hover out=evaluations/mine
Example: aerial-il evaluate policy=runs/cart env=gymnasium:CartPole-v1 success=return:475 out=runs/cart/evaluation
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from aerial_il.cli.configuration.keys import MISSING, Located, Named, TierName, at_least, group, key, output, path
from aerial_il.cli.configuration.quoting import command_line

if TYPE_CHECKING:
    from aerial_il.core.contracts import BatchEnv
    from aerial_il.evaluation.result import EvaluationResult
    from aerial_il.workflows.parts.pilots import Pilot


@dataclass
class Config:
    PRESETS: ClassVar[dict[str, str | None]] = {"evaluation": "standard"}

    policy: Located = path(
        Located,
        "a run, a policy, an expert's file (.npz), module:factory, a model.zip of SB3, or: expert, random, hover",
    )
    robot: Named | None = group("robot that flies (null: the one that the policy was trained on)")
    task: Named | None = group("task that it does (null: the task that the policy was trained on)")
    tier: TierName = group("disturbance tier, e.g. gusts, hard-payload, calm+latency", "calm", composed=True)
    env: str | None = key(None, "external environment, e.g. gymnasium:CartPole-v1 (null: the policy's own)")
    success: str | None = key(
        None, "what makes an episode there a success: KEY:N, return:R, survived (null: as it reports)"
    )
    max_steps: int | None = key(None, "time limit there (null: its own)")
    controller: Named = group("control law of the base", "geometric_observer")
    out: str = output(MISSING, "folder for evaluation.json, videos/ and report.html")
    action: str | None = key(None, "action level (null: the policy's own, ee_pose for experts)")
    episodes: int = key(200, "number of episodes, one for each seed")
    seed: int = key(10000, "first seed")
    num_envs: int = key(64, "worlds flown at once")
    threads: int = key(0, "simulation threads, or processes of external environments; 0 for all cores")
    overwrite: bool = key(False, "replace the result of another evaluation in that folder")
    videos: int = key(2, "films of successes, and as many of failures")
    rerun: bool = key(False, "show the first world in rerun while it flies; a file where there is no screen")
    progress: bool = key(True, "show a progress bar")

    def __post_init__(self) -> None:
        at_least(self, episodes=1, seed=0, num_envs=1, threads=0, videos=0)


def run(config: Config) -> None:
    """Evaluate, write the results, print the headline."""
    from aerial_il.workflows.parts import environments, pilots
    from aerial_il.workflows.parts.watching import watched

    pilot = pilots.pilot(
        config.policy.path,
        robot=config.robot.name if config.robot else None,
        task=config.task.name if config.task else None,
        action=config.action,
        env=config.env,
        options=environments.given(success=config.success, max_steps=config.max_steps),
    )
    seeds = range(config.seed, config.seed + config.episodes)
    env = pilot.environment(
        config.tier.name,
        num_envs=min(config.num_envs, len(seeds)),
        threads=config.threads,
        controller=config.controller.name,
    )
    try:
        with watched(env, config.threads, wanted=config.rerun) as seen:
            result = _judged(config, pilot, seen, seeds)
    finally:
        env.close()
    tier = env.spec.tier if pilot.reference.env else config.tier.name
    print(f"{pilot.robot} {pilot.task} {tier}: success {result.headline()}")
    if pilot.reference.env:
        print(f"Return {result.return_line()}")


def _judged(config: Config, pilot: Pilot, env: BatchEnv, seeds: range) -> EvaluationResult:
    """Fly what is not flown yet, and write what comes of it."""
    from aerial_il.evaluation.destination import CALLED, finished, subject_of
    from aerial_il.evaluation.journal import Journal
    from aerial_il.evaluation.rollouts import evaluate, origin_of
    from aerial_il.workflows.parts import results

    spec, name, journal = env.spec, config.policy.path, Journal(config.out)
    origin = origin_of(env, pilot.policy)
    cell = {"robot": spec.robot, "task": spec.task, "tier": spec.tier}
    subject = subject_of(**cell, policy=name, seeds=seeds, provenance=origin)
    if found := finished(config.out, subject, called=name, overwrite=config.overwrite):
        print(f"{config.out} holds this very result already, nothing is flown. To fly it anew, remove that folder.")
        return found
    journal.begin({**subject, CALLED: name})
    command = {"command": _command(config, pilot)}
    result = evaluate(
        env, pilot.policy, seeds, policy_name=name, origin=command, journal=journal, progress=config.progress
    )
    results.save(result, config.out, env=env, videos=config.videos)
    journal.close()
    return result


def _command(config: Config, pilot: Pilot) -> str:
    ours = () if pilot.reference.env else (f"tier={config.tier.name}", f"controller={config.controller.name}")
    flown = (*ours, f"episodes={config.episodes}", f"seed={config.seed}", f"out={config.out}")
    return command_line(["evaluate", *pilot.overrides, *flown])
