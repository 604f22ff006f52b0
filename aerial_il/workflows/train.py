"""Train a policy on demonstrations or from reward; killed at any moment, the same call continues."""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from aerial_il.core.checks import make_tuples
from aerial_il.core.composition import build, chosen, plain
from aerial_il.core.computer import HELD_MB
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.reading import Reading
from aerial_il.workflows.parts.names import Algorithm, MaybeRobot, MaybeTask, MaybeTier, Policy, at_least

if TYPE_CHECKING:
    from aerial_il.data.episode import Episode
    from aerial_il.policies.parts.chunk_policy import ChunkPolicy
    from aerial_il.policies.parts.network import PolicySettings
    from aerial_il.workflows.parts.environments import EnvironmentReference

COMMAND = "command.json"  # in the run's folder: what leads to it
OF_ONE_CALL = ("run", "resume", "progress")
IN_CONFIG = ("policy", "algorithm", "seed")  # of which config.yaml has what was trained with


@dataclass(frozen=True, kw_only=True)
class Dataset(Reading):
    """Which demonstrations to learn from.

    Attributes:
        path: their folder.
        episodes: how many of the successful ones (null: all).
        by_hand: whether a person flew them (null: what they say).
        others: further datasets to learn from beside it.
        weights: the share of the training that each dataset has, that of path first, e.g. [0.7,0.3] (empty: as their
            sizes give it).
        held_mb: how much memory what is trained on may take, MB; beyond it, it lies in files that vanish with the run.
        language: tell in words what is to be done, in the wordings of the tasks or as each episode says.
        latency_ms: shift what was seen against what was done until so much lies between; 0: none, as if none had been
            recorded (null: as it was recorded).
    """

    path: str | None = None
    episodes: int | None = None
    by_hand: bool | None = None
    others: tuple[str, ...] = ()
    weights: tuple[float, ...] = ()
    held_mb: int = HELD_MB
    language: bool = False
    latency_ms: float | None = None

    def __post_init__(self) -> None:
        make_tuples(self)
        if self.others and self.episodes is not None:
            raise InvalidValueError(f"dataset.episodes={self.episodes} counts those of one dataset: leave out others.")
        if self.weights and not self.others:
            raise InvalidValueError(f"dataset.weights={list(self.weights)} needs dataset.others=[PATH].")
        if self.others and self.latency_ms is not None:
            raise InvalidValueError(f"dataset.latency_ms={self.latency_ms:g} shifts one dataset: leave out others.")
        at_least(self, held_mb=0, latency_ms=0)

    @property
    def paths(self) -> tuple[str, ...]:
        """All that is learned from."""
        return (() if self.path is None else (self.path,)) + self.others


@dataclass(frozen=True, kw_only=True)
class Train:
    """Settings of a training.

    Attributes:
        dataset: folder of demonstrations.
        policy: class of policy to train.
        algorithm: training algorithm.
        robot, task: where it flies without a dataset; with one, what the dataset must be of.
        run: folder of the run.
        env: external environment instead of robot and task, e.g. gymnasium:Hopper-v5.
        success: what makes an episode there a success: KEY:N, return:R, survived (null: as it reports).
        max_steps: time limit there (null: its own).
        tier: how rough the air is where robot= and task= are (null: calm, or any dataset's).
        action: action level there (null: ee_pose, or any dataset's).
        observations: what the policy may act on: truth, or onboard, which hides where objects are: images, the robot's
            own state, what it feels and what it is told are left.
        horizon: steps of 20 ms of an episode there, which success does not end (null: up to success, or as in any
            dataset).
        seed: seed of the initial weights, validation split and minibatches.
        evaluate_every: steps between two evaluations by rollouts (null: as the algorithm says).
        evaluate_episodes: number of episodes each time.
        evaluate_seed: first seed; those from 10000 on are kept for finished policies.
        evaluate_tier: disturbance tier of these rollouts (null: as in the dataset).
        expert: whom an algorithm asks: a file of one from outside, module:factory, human, or driver (null: the task's
            own).
        flight_tier: disturbance tier where it flies (null: as in the dataset).
        num_envs: worlds in which it flies at once (null: its own default).
        threads: threads of its flights, or processes of external environments; 0 for all cores.
        port: of the page of expert=human; another one where it is taken.
        tracker: trackers of the metrics: tensorboard, wandb, mlflow; []: none.
        resume: continue what the run folder holds.
        progress: show a progress bar.
    """

    PRESETS: ClassVar[dict[str, str]] = {"experiment": "a set of values"}

    dataset: Dataset = Dataset()
    policy: Policy = "mlp"
    algorithm: Algorithm = "bc"
    robot: MaybeRobot = None
    task: MaybeTask = None
    run: str
    env: str | None = None
    success: str | None = None
    max_steps: int | None = None
    tier: MaybeTier = None
    action: str | None = None
    observations: Literal["truth", "onboard"] = "truth"
    horizon: int | None = None
    seed: int = 0
    evaluate_every: int | None = None
    evaluate_episodes: int = 20
    evaluate_seed: int = 5000
    evaluate_tier: MaybeTier = None
    expert: str | None = None
    flight_tier: MaybeTier = None
    num_envs: int | None = None
    threads: int = 0
    port: int = 8642
    tracker: tuple[str, ...] = ("tensorboard",)
    resume: bool = True
    progress: bool = True

    def __post_init__(self) -> None:
        at_least(self, seed=0, evaluate_every=0, evaluate_episodes=1, evaluate_seed=0, num_envs=1, threads=0, port=0)

    @classmethod
    def like(cls, run: str, typed: Container[str] = ()) -> Train:
        """run whose settings hold where nothing else is said; another policy or algorithm has its own defaults"""
        from aerial_il.workflows.parts.earlier_run import settings_of

        return settings_of(cls, run, typed)


def train(settings: Train) -> ChunkPolicy:
    """Train as ``settings`` say, and return the policy.

    Raises:
        AerialError: settings that do not go together, or demonstrations that cannot be learned from.
    """
    from aerial_il.algorithms.run.trackers import track_with
    from aerial_il.data.memory import MEMORY
    from aerial_il.workflows.parts.by_hand import suited
    from aerial_il.workflows.parts.environments import EnvironmentReference, given
    from aerial_il.workflows.parts.rollout_evaluator import RolloutEvaluator
    from aerial_il.workflows.parts.training_resources import training_resources

    dataset, threads = settings.dataset, settings.threads
    policy = chosen("policy", settings.policy, at="policy.")
    algorithm = chosen("algorithm", settings.algorithm, at="algorithm.")
    if settings.evaluate_every is not None:
        algorithm = _evaluated(algorithm, settings.evaluate_every)
    if dataset.path is None and algorithm.demonstrated:
        hint = "Record some: aerial-il collect robot=R task=T episodes=100 out=datasets/NAME"
        raise InvalidValueError(f"algorithm={algorithm.name} learns from demonstrations: set dataset=PATH. {hint}")
    if dataset.weights and algorithm.name != "bc":
        raise InvalidValueError(f"dataset.weights is for algorithm=bc; {algorithm.name} takes each step as often.")
    if dataset.language and algorithm.needs:
        raise InvalidValueError(
            "dataset.language=true is for algorithms that do not fly while they learn, e.g. algorithm=bc: "
            f"nobody tells {algorithm.name} in words what to do there."
        )
    if settings.flight_tier and "env" not in algorithm.needs:
        raise InvalidValueError(
            f"flight_tier={settings.flight_tier} is for algorithms that fly while they learn; {algorithm.name} learns "
            f"from demonstrations as they are. Record them there: aerial-il collect tier={settings.flight_tier}"
        )
    if settings.observations == "onboard":
        policy = _onboard(policy)
    for path in dataset.paths:
        algorithm, policy = suited(path, algorithm, policy, by_hand=dataset.by_hand, reading=dataset)
    own = {name: getattr(settings, name) for name in ("env", "robot", "task", "tier", "action", "horizon")}
    where = EnvironmentReference(options=given(success=settings.success, max_steps=settings.max_steps), **own)
    again = "collect" in algorithm.needs  # the demonstrations are recorded once more, beside what it flies
    failures = getattr(algorithm, "failures", False)
    episodes = _demonstrations(dataset, policy.images, where, failures=failures, states=again)
    rollouts = (settings.evaluate_episodes, settings.evaluate_seed, settings.evaluate_tier)
    evaluating = (
        RolloutEvaluator(*rollouts, threads=threads, env=settings.env).open()
        if algorithm.evaluate_every
        else nullcontext()
    )
    resources = training_resources(
        algorithm, dataset.path, reference=where, images=policy.images, expert=settings.expert,
        tier=settings.flight_tier, num_envs=settings.num_envs, threads=threads, port=settings.port, reading=dataset,
    )  # fmt: skip
    kept = _command_kept(settings)
    held = MEMORY.limited(dataset.held_mb)
    with track_with(list(settings.tracker)), kept, evaluating as evaluate, resources as handed, held:
        return algorithm.train(
            episodes, policy, run=settings.run, seed=settings.seed, evaluate=evaluate,
            resume=settings.resume, progress=settings.progress, **handed,
        )  # fmt: skip


def _onboard(policy: PolicySettings) -> PolicySettings:
    """Return a policy that is not shown what a robot does not know by itself."""
    from aerial_il.policies.parts.layout import TO_BE_SEEN

    if not policy.images:
        raise InvalidValueError(
            "observations=onboard hides where objects are, and the policy sees no images: name some of the dataset, "
            "e.g. policy.images=[wrist_rgb,base_rgb]."
        )
    return replace(policy, masked_fields=(*policy.masked_fields, TO_BE_SEEN))


def command(settings: Train) -> str:
    """Return the command line that leads to ``settings``."""
    from aerial_il.workflows.spelling import command_line, words_of

    return command_line(["train", *words_of(settings, without=("resume", "progress", "tracker"))])


def _evaluated(algorithm: Any, every: int) -> Any:
    """Return the algorithm with rollouts on the way, as often as was asked for."""
    own = {"evaluate_every": every}
    changes = own if "evaluate_every" in type(algorithm).__dataclass_fields__ else {"cadence": own}
    return build(type(algorithm), changes, base=algorithm)


def _demonstrations(
    dataset: Dataset, images: Sequence[str], where: EnvironmentReference, *, failures: bool, states: bool
) -> Iterable[Episode] | None:
    """Open the demonstrations that were named, or None for an algorithm that does without."""
    from aerial_il.workflows.parts import demonstrations

    if (path := dataset.path) is None:
        return None
    if said := [*where.options, *(["horizon"] if where.horizon else [])]:
        raise InvalidValueError(f"{path} already defines its environment: leave out {', '.join(said)}.")
    if (latency_ms := dataset.latency_ms) is not None and states:
        raise InvalidValueError("dataset.latency_ms is for algorithms that learn from demonstrations as they are.")
    for each in dataset.paths:
        demonstrations.check_origin(each, where.expected, dataset)
        demonstrations.warn_of_changes(each, dataset)
    return demonstrations.open_demonstrations(
        path, limit=dataset.episodes, others=dataset.others, weights=dataset.weights, latency_ms=latency_ms,
        language=dataset.language, images=images, failures=failures, states=states, reading=dataset,
    )  # fmt: skip


@contextmanager
def _command_kept(settings: Train) -> Iterator[None]:
    """Keep in the run's folder what leads to it, once the training has ended or been stopped: then the run is ours."""
    from aerial_il.core.files import write_json

    dataset = settings.dataset

    def keep() -> None:
        said = ("path", "episodes", "others", "weights", "latency_ms", "language")
        learned_from = {**{name: getattr(dataset, name) for name in said}, "reading": dataset.answers}
        own = {key: each for key, each in plain(settings).items() if key not in (*OF_ONE_CALL, *IN_CONFIG)}
        content = {"command": command(settings), "dataset": learned_from, "settings": own}
        write_json(Path(settings.run) / COMMAND, content)

    try:
        yield
    except (KeyboardInterrupt, SystemExit):
        keep()
        raise
    keep()
