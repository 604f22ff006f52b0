"""Go the whole path once: fly, record, convert, learn, evaluate, report. Interrupted, the same command continues.

Each stage is announced as the command that does it alone; a finished stage is not done again.

Example: aerial-il demo
Example: aerial-il demo robot=fa_hexa_arm4 task=reach episodes=50 out=runs/demo_reach
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aerial_il.cli.commands.datasets import convert
from aerial_il.cli.commands.flying import collect, evaluate
from aerial_il.cli.commands.runs import report, train
from aerial_il.cli.configuration import spelling
from aerial_il.cli.configuration.keys import Located, MaybeLocated, Named, TierName, at_least, group, key, output
from aerial_il.cli.configuration.quoting import command_line


@dataclass
class Config:
    robot: Named = group("robot that flies", "ua_quad_arm4")
    task: Named = group("task that it does", "pick_place")
    tier: TierName = group("disturbance tier, e.g. gusts, hard-payload, calm+latency", "calm", composed=True)
    expert: collect.Expert = group("how the expert flies", "noisy")
    controller: Named = group("control law of the base", "geometric_observer")
    policy: dict[str, Any] = group("policy class to train", "mlp")
    algorithm: dict[str, Any] = group("training algorithm", "bc")
    out: str = output("runs/demo", "folder for everything")
    episodes: int = key(100, "demonstrations flown")
    evaluation_episodes: int = key(200, "held-out seeds flown by the policy")
    evaluation_seed: int = key(10000, "first seed")
    seed: int = key(0, "first seed of the demonstrations, and seed of the training")
    progress: bool = key(True, "show progress bars")

    def __post_init__(self) -> None:
        at_least(self, episodes=2, evaluation_episodes=1, evaluation_seed=0, seed=0)


def run(config: Config) -> None:
    """Run every stage that is not finished, then say where everything lies and how well the policy flies."""
    from aerial_il.evaluation.result import load_result

    out, started = Path(config.out), time.perf_counter()
    dataset, training, judged = out / "dataset", out / "training", out / "evaluation"
    cell = [f"robot={config.robot.name}", f"task={config.task.name}", f"tier={config.tier.name}"]
    law = f"controller={config.controller.name}"
    recipe = [*spelling.of_group("policy", config.policy, default="mlp")]
    recipe += spelling.of_group("algorithm", config.algorithm, default="bc")
    flown = [f"tier={config.tier.name}", f"episodes={config.evaluation_episodes}", f"seed={config.evaluation_seed}"]

    who = f"expert.noise={config.expert.noise}" if config.expert.path is None else f"expert={config.expert.path}"
    flight = [who, f"episodes={config.episodes}", f"seed={config.seed}"]
    _announce("Fly and record", "collect", *cell, law, *flight, f"out={dataset}")
    collect.record(_collect(config, dataset))
    _announce("Convert for LeRobot", "convert", f"path={dataset}")
    convert.run(convert.Config(str(dataset), progress=config.progress))
    _announce("Learn", "train", f"dataset={dataset}", *recipe, f"seed={config.seed}", f"run={training}")
    train.learn(_train(config, dataset, training))
    _announce("Evaluate", "evaluate", f"policy={training}", law, *flown, f"out={judged}")
    if not _is_current(judged, training, config):
        evaluate.run(_evaluate(config, training, judged))
    _announce("Report", "report", f"result={judged}", f"run={training}", f"dataset={dataset}")
    report.run(report.Config(result=[str(judged)], run=str(training), dataset=MaybeLocated(str(dataset))))

    print(f"\nDone in {time.perf_counter() - started:.0f} s.")
    print(f"  demonstrations  {dataset}/demos (MCAP), {dataset}/derived/lerobot (LeRobot)")
    print(f"  policy          {training}/policy")
    print(f"  report          {judged}/report.html")
    print(f"  success         {load_result(judged).headline()}, on seeds that the policy has never seen")


def _collect(config: Config, dataset: Path) -> collect.Config:
    return collect.Config(
        robot=config.robot,
        task=config.task,
        tier=config.tier,
        expert=config.expert,
        controller=config.controller,
        out=str(dataset),
        episodes=config.episodes,
        seed=config.seed,
        progress=config.progress,
    )


def _train(config: Config, dataset: Path, training: Path) -> train.Config:
    return train.Config(
        dataset=train.Dataset(str(dataset)),
        policy=config.policy,
        algorithm=config.algorithm,
        run=str(training),
        seed=config.seed,
        progress=config.progress,
    )


def _evaluate(config: Config, training: Path, judged: Path) -> evaluate.Config:
    return evaluate.Config(
        policy=Located(str(training)),
        tier=config.tier,
        controller=config.controller,
        out=str(judged),
        episodes=config.evaluation_episodes,
        seed=config.evaluation_seed,
        overwrite=True,
        progress=config.progress,
    )


def _is_current(judged: Path, training: Path, config: Config) -> bool:
    """Whether this very evaluation of this very policy lies there, with its page."""
    from aerial_il.core.checkpoint import digest
    from aerial_il.core.errors import InvalidValueError
    from aerial_il.evaluation.result import load_result
    from aerial_il.policies import load_policy

    try:
        result = load_result(judged)
    except InvalidValueError:
        return False
    wanted = list(range(config.evaluation_seed, config.evaluation_seed + config.evaluation_episodes))
    same_policy = result.provenance.get("policy_sha256") == digest(load_policy(training).to_checkpoint())
    flown = (result.tier, result.provenance.get("environment", {}).get("controller"), result.seeds)
    same_flights = flown == (config.tier.name, config.controller.name, wanted)
    return (judged / "report.html").exists() and same_policy and same_flights


def _announce(what: str, *typed: str) -> None:
    print(f"\n{what}\n  {command_line(typed)}", flush=True)
