"""Train a policy on demonstrations; killed at any moment, the same command continues.

The run folder holds config.yaml, metrics.jsonl, tensorboard/, checkpoints/ and at the end policy/; cloning with
rollouts on the way also best/, the policy that flew best in them, which is never the one that is reported. Trackers
beside TensorBoard are extras: tracker=[tensorboard,wandb], after pip install 'aerial-il[wandb]'.

Several values are a sweep, e.g. seed=0,1,2 --multirun: one run per value in RUN/seed=0 and so on; `aerial-il report
RUN` shows them all together.

Demonstrations that a person flew are relabelled and seen from the tool, which a line says: see docs/teleop.md.
dataset.by_hand=false learns from them as recorded, true takes any recording for one by hand.

Who flies while it learns does so in the environment of the demonstrations. Learners from reward (sac, ppo, td3) need
none, only env=..., or robot=... and task=...; said beside a dataset, these are what it must have been recorded with.

Example: aerial-il train dataset=datasets/pick policy=mlp algorithm=bc run=runs/pick_bc
Example: aerial-il train dataset=datasets/pick run=runs/pick_bc evaluate_every=1000 evaluate_episodes=50
Example: aerial-il train algorithm=dagger dataset=datasets/pick run=runs/pick_dagger
Example: aerial-il train algorithm=dagger expert=my_pilot:make dataset=datasets/mine run=runs/asked
Example: aerial-il train algorithm=hg_dagger expert=human dataset=datasets/by_hand run=runs/rescued
Example: aerial-il train algorithm=sac policy=squashed_gaussian env=gymnasium:Hopper-v5 run=runs/hopper
Example: aerial-il train algorithm=ppo policy=squashed_gaussian robot=z1 task=reach horizon=200 run=runs/z1_ppo
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from aerial_il.cli.configuration import spelling
from aerial_il.cli.configuration.keys import (
    MISSING,
    MaybeLocated,
    MaybeTier,
    Named,
    at_least,
    group,
    key,
    output,
    path,
    tier,
)
from aerial_il.cli.configuration.quoting import command_line

if TYPE_CHECKING:
    from aerial_il.core.contracts import Algorithm
    from aerial_il.data.episode import Episode
    from aerial_il.workflows.parts.environments import EnvironmentReference
    from aerial_il.workflows.parts.rollout_evaluator import RolloutEvaluator

COMMAND = "command.json"


@dataclass
class Dataset:
    """Which demonstrations to learn from."""

    path: str | None = None
    episodes: int | None = None
    by_hand: bool | None = None


@dataclass
class Config:
    PRESETS: ClassVar[dict[str, str | None]] = {"experiment": None}

    dataset: Dataset = group("folder of demonstrations, how many (null: all), whether by hand", "all", path=True)
    policy: dict[str, Any] = group("policy class to train", "mlp")
    algorithm: dict[str, Any] = group("training algorithm", "bc")
    robot: Named | None = group("where reinforcement learning flies; with a dataset, the robot it must be of")
    task: Named | None = group("the same, for the task")
    run: str = output(MISSING, "folder of the run")
    env: str | None = key(None, "external environment instead of robot and task, e.g. gymnasium:Hopper-v5")
    success: str | None = key(
        None, "what makes an episode there a success: KEY:N, return:R, survived (null: as it reports)"
    )
    max_steps: int | None = key(None, "time limit there (null: its own)")
    tier: MaybeTier = tier("how rough the air is where robot= and task= are (null: calm, or any dataset's)")
    action: str | None = key(None, "action level there (null: ee_pose, or any dataset's)")
    horizon: int | None = key(
        None,
        "steps of 20 ms of an episode there, which success does not end (null: up to success, or as in any dataset)",
    )
    seed: int = key(0, "seed of the initial weights, validation split and minibatches")
    evaluate_every: int | None = key(None, "steps between two evaluations by rollouts (null: as the algorithm says)")
    evaluate_episodes: int = key(20, "number of episodes each time")
    evaluate_seed: int = key(5000, "first seed; those from 10000 on are kept for finished policies")
    evaluate_tier: str | None = key(None, "disturbance tier of these rollouts (null: as in the dataset)")
    expert: MaybeLocated = path(
        MaybeLocated,
        "whom an algorithm asks: a file of one from outside, module:factory, human, or driver (null: the task's own)",
    )
    flight_tier: str | None = key(None, "disturbance tier where it flies (null: as in the dataset)")
    num_envs: int | None = key(None, "worlds in which it flies at once (null: its own default)")
    threads: int = key(0, "threads of its flights, or processes of external environments; 0 for all cores")
    port: int = key(8642, "of the page of expert=human; another one where it is taken")
    tracker: list[str] = key(
        ["tensorboard"], "trackers of the metrics: tensorboard, wandb, mlflow; []: none", many=True
    )
    resume: bool = key(True, "continue what the run folder holds")
    progress: bool = key(True, "show a progress bar")

    def __post_init__(self) -> None:
        at_least(self, seed=0, evaluate_every=0, evaluate_episodes=1, evaluate_seed=0, num_envs=1, threads=0, port=0)

    @property
    def reference(self) -> EnvironmentReference:
        """The environment that was named."""
        from aerial_il.workflows.parts.environments import EnvironmentReference, given

        return EnvironmentReference(
            env=self.env,
            options=given(success=self.success, max_steps=self.max_steps),
            robot=self.robot.name if self.robot else None,
            task=self.task.name if self.task else None,
            tier=self.tier.name,
            action=self.action,
            horizon=self.horizon,
        )


def run(config: Config) -> None:
    """Train, and say what comes next."""
    learn(config)
    print(f"Next: {command_line(['evaluate', spelling.path('policy', config.run), f'out={config.run}/evaluation'])}")


def learn(config: Config) -> None:
    """Train, and say where the policy lies."""
    from aerial_il.algorithms.run.trackers import track_with
    from aerial_il.cli.configuration.build import build_all
    from aerial_il.workflows.parts.by_hand import suited

    settings = dict(config.algorithm)
    if config.evaluate_every is not None:
        settings["evaluate_every"] = config.evaluate_every
    policy, algorithm = build_all(config.policy, settings)
    algorithm, policy = suited(config.dataset.path, algorithm, policy, by_hand=config.dataset.by_hand)
    episodes = _demonstrations(config, algorithm, policy)
    with (
        track_with(config.tracker),
        _recording_the_command(config),
        _rollout_evaluator(config, algorithm) as evaluator,
        _training_resources(config, algorithm, policy) as handed,
    ):
        algorithm.train(
            episodes,
            policy,
            run=config.run,
            seed=config.seed,
            evaluate=evaluator,
            resume=config.resume,
            progress=config.progress,
            **handed,
        )
    print(f"Policy: {config.run}/policy")


def _demonstrations(config: Config, algorithm: Algorithm, policy: Any) -> Iterable[Episode] | None:
    """Open the demonstrations that were named, or None for an algorithm that does without."""
    from aerial_il.core.errors import InvalidValueError
    from aerial_il.workflows.parts import demonstrations

    path, reference = config.dataset.path, config.reference
    if path is not None:
        if said := [*reference.options, *(["horizon"] if reference.horizon else [])]:
            raise InvalidValueError(f"{path} already defines its environment: leave out {', '.join(said)}.")
        demonstrations.check_origin(path, reference.expected)
        demonstrations.warn_of_changes(path)
        return demonstrations.open_demonstrations(
            path, limit=config.dataset.episodes, images=policy.images, algorithm=algorithm
        )
    if algorithm.demonstrated:
        hint = "Record some: aerial-il collect robot=R task=T episodes=100 out=datasets/NAME"
        raise InvalidValueError(f"algorithm={algorithm.name} learns from demonstrations: set dataset=PATH. {hint}")
    return None


@contextmanager
def _rollout_evaluator(config: Config, algorithm: Algorithm) -> Iterator[RolloutEvaluator | None]:
    """Yield what flies the policy on the way, or None where nobody asked for it."""
    if not algorithm.evaluate_every:
        yield None
        return
    from aerial_il.workflows.parts.rollout_evaluator import RolloutEvaluator

    flights = RolloutEvaluator(
        config.evaluate_episodes, config.evaluate_seed, config.evaluate_tier, threads=config.threads, env=config.env
    )
    with flights.open() as evaluator:
        yield evaluator


@contextmanager
def _recording_the_command(config: Config) -> Iterator[None]:
    """Keep in the run's folder what was typed, once the training has ended or been stopped: then the run is ours."""
    from aerial_il.core.files import write_json

    def tell() -> None:
        dataset = {"path": config.dataset.path, "episodes": config.dataset.episodes}
        write_json(Path(config.run) / COMMAND, {"command": command(config), "dataset": dataset})

    try:
        yield
    except (KeyboardInterrupt, SystemExit):
        tell()
        raise
    tell()


def command(config: Config) -> str:
    """Return the words that lead to ``config``."""
    plain = {"seed": 0, "evaluate_every": None, "evaluate_episodes": 20, "evaluate_seed": 5000, "evaluate_tier": None}
    plain |= {"flight_tier": None, "num_envs": None, "threads": 0, "port": 8642}
    said = [f"{name}={getattr(config, name)}" for name, usual in plain.items() if getattr(config, name) != usual]
    said += [spelling.path("expert", config.expert.path)] if config.expert.path else []
    learned = [] if config.dataset.path is None else [spelling.path("dataset", config.dataset.path)]
    learned += [] if config.dataset.episodes is None else [f"dataset.episodes={config.dataset.episodes}"]
    learned += [] if config.dataset.by_hand is None else [f"dataset.by_hand={str(config.dataset.by_hand).lower()}"]
    return command_line(
        [
            "train",
            *learned,
            *spelling.of_group("policy", config.policy, default="mlp"),
            *spelling.of_group("algorithm", config.algorithm, default="bc"),
            *config.reference.overrides,
            *said,
            f"run={config.run}",
        ]
    )


def _training_resources(config: Config, algorithm: Algorithm, policy: Any) -> AbstractContextManager[dict[str, Any]]:
    """Return what an algorithm that flies while it learns is handed."""
    from aerial_il.workflows.parts.training_resources import training_resources

    return training_resources(
        algorithm,
        config.dataset.path,
        reference=config.reference,
        images=policy.images,
        expert=config.expert.path,
        tier=config.flight_tier,
        num_envs=config.num_envs,
        threads=config.threads,
        port=config.port,
    )
