"""The whole path once: fly, record, convert, learn, evaluate, report. A finished stage is not done again."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from aerial_il.core.places import claim_folder
from aerial_il.workflows.collect import Collect, Expert, collect
from aerial_il.workflows.convert import Convert, convert
from aerial_il.workflows.evaluate import Evaluate, evaluate
from aerial_il.workflows.parts.names import Algorithm, Controller, Policy, Robot, Task, Tier, at_least
from aerial_il.workflows.report import Report, report
from aerial_il.workflows.spelling import command_line, words_of
from aerial_il.workflows.train import Dataset, Train, train

QUIET = ("progress", "overwrite")  # set by the demo itself, and left out of the printed commands


@dataclass(frozen=True, kw_only=True)
class Demo:
    """What is shown.

    Attributes:
        robot: robot that flies.
        task: task that it does.
        tier: disturbance tier, e.g. gusts, hard-payload, calm+latency.
        expert: how the expert flies.
        controller: control law of the base.
        policy: class of policy to train.
        algorithm: training algorithm.
        out: folder for everything.
        episodes: demonstrations flown.
        evaluation_episodes: held-out seeds flown by the policy.
        evaluation_seed: first of them.
        seed: first seed of the demonstrations, and seed of the training.
        progress: show progress bars.
    """

    robot: Robot = "ua_quad_arm4"
    task: Task = "pick_place"
    tier: Tier = "calm"
    expert: Expert = Expert()
    controller: Controller = "geometric_observer"
    policy: Policy = "mlp"
    algorithm: Algorithm = "bc"
    out: str = "runs/demo"
    episodes: int = 100
    evaluation_episodes: int = 200
    evaluation_seed: int = 10_000
    seed: int = 0
    progress: bool = True

    def __post_init__(self) -> None:
        at_least(self, episodes=2, evaluation_episodes=1, evaluation_seed=0, seed=0)


@dataclass(frozen=True)
class Stage:
    """A stage: what it is called, the command that does it alone, and what does it and returns what is to be said."""

    title: str
    command: str
    do: Callable[[], str]


def stages(settings: Demo) -> Iterator[Stage]:
    """Yield the stages in their order; each is to be done before the next is asked for."""
    claim_folder(settings.out, ("dataset/recordings.jsonl", "dataset/demos/*"))
    flight, derived, training, judged, page = _settings(settings)
    lerobot = Path(settings.out) / "dataset" / "derived" / "lerobot"
    yield Stage("Fly and record", _line("collect", flight), lambda: f"Dataset: {collect(flight)}")
    yield Stage(
        "Convert for LeRobot", _line("convert", derived), lambda: f"LeRobot dataset: {convert(derived) and lerobot}"
    )
    yield Stage("Learn", _line("train", training), lambda: f"Policy: {train(training) and training.run}/policy")
    yield Stage("Evaluate", _line("evaluate", judged), lambda: _judge(judged))
    yield Stage("Report", _line("report", page), lambda: f"Report: {report(page)}")


def _settings(settings: Demo) -> tuple[Collect, Convert, Train, Evaluate, Report]:
    out, progress = Path(settings.out), settings.progress
    dataset, training, judged = str(out / "dataset"), str(out / "training"), str(out / "evaluation")
    flight = Collect(
        robot=settings.robot, task=settings.task, tier=settings.tier, expert=settings.expert,
        controller=settings.controller, out=dataset, episodes=settings.episodes, seed=settings.seed, progress=progress,
    )  # fmt: skip
    learned = Train(
        dataset=Dataset(path=dataset), policy=settings.policy, algorithm=settings.algorithm, run=training,
        seed=settings.seed, progress=progress,
    )  # fmt: skip
    flown = Evaluate(
        policy=training, tier=settings.tier, controller=settings.controller, out=judged,
        episodes=settings.evaluation_episodes, seed=settings.evaluation_seed, overwrite=True, progress=progress,
    )  # fmt: skip
    page = Report(result=(judged,), run=training, dataset=dataset)
    return flight, Convert(path=dataset, progress=progress), learned, flown, page


def _line(name: str, settings: object) -> str:
    return command_line([name, *words_of(settings, without=QUIET)])


def _judge(settings: Evaluate) -> str:
    done = evaluate(settings)
    return f"{done.pilot.robot} {done.pilot.task} {done.tier}: success {done.result.headline()}"
