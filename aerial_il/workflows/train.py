"""Train a policy on demonstrations; killed at any moment, the same call continues."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import nullcontext
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from aerial_il.core.errors import InvalidValueError

if TYPE_CHECKING:
    from aerial_il.core.contracts import Policy
    from aerial_il.data.episode import Episode
    from aerial_il.workflows.parts.environments import EnvironmentReference


@dataclass(frozen=True, kw_only=True)
class Dataset:
    """Which demonstrations to learn from.

    Attributes:
        path: their folder.
        episodes: how many; null for all.
        by_hand: whether a person flew them; null for what they say.
    """

    path: str | None = None
    episodes: int | None = None
    by_hand: bool | None = None


@dataclass(frozen=True, kw_only=True)
class Train:
    """Settings of a training.

    Attributes:
        run: folder of the run.
        dataset: folder of demonstrations.
        policy: class of policy to train.
        algorithm: training algorithm.
        env: external environment instead of robot and task, e.g. gymnasium:Hopper-v5.
        success: what makes an episode there a success: KEY:N, return:R, survived (null: as it reports).
        max_steps: time limit there (null: its own).
        robot, task: where reinforcement learning flies; with a dataset, what it must be of.
        tier: how rough the air is there (null: calm, or any dataset's).
        action: action level there (null: ee_pose, or any dataset's).
        horizon: steps of 20 ms of an episode there, which success does not end (null: up to success).
        seed: of the initial weights, validation split and minibatches.
        evaluate_episodes: number of rollouts each time.
        evaluate_seed: first seed; those from 10000 on are kept for finished policies.
        evaluate_tier: disturbance tier of these rollouts (null: as in the dataset).
        expert: whom an algorithm asks.
        flight_tier: disturbance tier where it flies (null: as in the dataset).
        num_envs: worlds in which it flies at once (null: its own default).
        threads: of its flights; 0 for all cores.
        port: of the page of expert=human.
        tracker: trackers of the metrics: tensorboard, wandb, mlflow.
        resume: continue what the run folder holds.
        progress: show a progress bar.
    """

    CHOICES: ClassVar[dict[str, str]] = {"policy": "mlp", "algorithm": "bc"}

    run: str
    dataset: Dataset = Dataset()
    policy: Any = "mlp"
    algorithm: Any = "bc"
    env: str | None = None
    success: str | None = None
    max_steps: int | None = None
    robot: str | None = None
    task: str | None = None
    tier: str | None = None
    action: str | None = None
    horizon: int | None = None
    seed: int = 0
    evaluate_episodes: int = 20
    evaluate_seed: int = 5000
    evaluate_tier: str | None = None
    expert: str | None = None
    flight_tier: str | None = None
    num_envs: int | None = None
    threads: int = 0
    port: int = 8642
    tracker: tuple[str, ...] = ("tensorboard",)
    resume: bool = True
    progress: bool = True


def train(settings: Train) -> Policy:
    """Train as ``settings`` say, and return the policy."""
    from aerial_il.algorithms.run.trackers import track_with
    from aerial_il.workflows.chosen import chosen
    from aerial_il.workflows.parts.by_hand import suited
    from aerial_il.workflows.parts.environments import EnvironmentReference, given
    from aerial_il.workflows.parts.rollout_evaluator import RolloutEvaluator
    from aerial_il.workflows.parts.training_resources import training_resources

    dataset = settings.dataset
    policy, algorithm = chosen("policy", settings.policy), chosen("algorithm", settings.algorithm)
    if dataset.path is not None:
        algorithm, policy = suited(dataset.path, algorithm, policy, by_hand=dataset.by_hand)
    options = given(success=settings.success, max_steps=settings.max_steps)
    own = {name: getattr(settings, name) for name in ("env", "robot", "task", "tier", "action", "horizon")}
    where = EnvironmentReference(options=options, **own)
    rollouts = RolloutEvaluator(
        settings.evaluate_episodes, settings.evaluate_seed, settings.evaluate_tier, threads=settings.threads
    )
    resources = training_resources(
        algorithm, dataset.path, reference=where, images=policy.images, expert=settings.expert,
        tier=settings.flight_tier, num_envs=settings.num_envs, threads=settings.threads, port=settings.port,
    )  # fmt: skip
    evaluating = rollouts.open() if algorithm.evaluate_every else nullcontext()
    with track_with(list(settings.tracker)), evaluating as evaluator, resources as handed:
        return algorithm.train(
            _demonstrations(settings.dataset, algorithm, policy, where), policy, run=settings.run, seed=settings.seed,
            evaluate=evaluator, resume=settings.resume, progress=settings.progress, **handed,
        )  # fmt: skip


def _demonstrations(
    dataset: Dataset, algorithm: Any, policy: Any, where: EnvironmentReference
) -> Iterable[Episode] | None:
    """Open the demonstrations that were named, or None for an algorithm that does without."""
    from aerial_il.workflows.parts import demonstrations

    path = dataset.path
    if path is not None:
        if said := [*where.options, *(["horizon"] if where.horizon else [])]:
            raise InvalidValueError(f"{path} already defines its environment: leave out {', '.join(said)}.")
        demonstrations.check_origin(path, where.expected)
        demonstrations.warn_of_changes(path)
        limit = dataset.episodes
        return demonstrations.open_demonstrations(path, limit=limit, images=policy.images, algorithm=algorithm)
    if algorithm.demonstrated:
        hint = "Record some: aerial-il collect robot=R task=T episodes=100 out=datasets/NAME"
        raise InvalidValueError(f"algorithm={algorithm.name} learns from demonstrations: set dataset=PATH. {hint}")
    return None
