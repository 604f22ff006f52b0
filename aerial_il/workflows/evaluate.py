"""Fly a policy or an expert over fixed seeds, and write evaluation.json, videos and a report."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.latency import NO_LATENCY, Latency
from aerial_il.policies.parts.execution import AS_TRAINED, Execution
from aerial_il.workflows.parts.names import Controller, MaybeRobot, MaybeTask, Tier, at_least

if TYPE_CHECKING:
    from aerial_il.core.contracts import BatchEnv
    from aerial_il.evaluation.result import EvaluationResult
    from aerial_il.workflows.parts.pilots import Pilot
    from aerial_il.workflows.parts.results import Written


@dataclass(frozen=True, kw_only=True)
class Evaluate:
    """What is flown.

    Attributes:
        policy: a run, a policy, an expert's file (.npz), module:factory, a model.zip of SB3, or: expert, random, hover.
        robot: robot that flies (null: the one that the policy was trained on).
        task: task that it does (null: the task that the policy was trained on).
        tier: disturbance tier, e.g. gusts, hard-payload, calm+latency, calm+wind:2.
        instruction: what the policy is told, where it was trained with dataset.language=true (null: the task's own).
        conditions: disturbances with a strength, on top of the tier, or tiers: each is flown over the same seeds.
        env: external environment, e.g. gymnasium:CartPole-v1 (null: the policy's own).
        success: what makes an episode there a success: KEY:N, return:R, survived (null: as it reports).
        max_steps: time limit there (null: its own).
        controller: control law of the base.
        latency: how late the robot sees and acts.
        execution: how a policy flies its chunks, with latency or on another robot.
        again: an earlier evaluation that is repeated, flight by flight; it says all but out= and how fast it goes.
        out: folder for evaluation.json, videos/ and report.html.
        action: action level (null: the policy's own, ee_pose for experts).
        episodes: number of episodes, one for each seed.
        seed: first seed.
        num_envs: worlds flown at once.
        threads: simulation threads, or processes of external environments; 0 for all cores.
        overwrite: replace the result of another evaluation in that folder.
        videos: films of successes, and as many of failures.
        rerun: show the first world in rerun while it flies; a file where there is no screen.
        progress: show a progress bar.
    """

    PRESETS: ClassVar[dict[str, str]] = {"evaluation": "a set of values"}

    policy: str = ""
    robot: MaybeRobot = None
    task: MaybeTask = None
    tier: Tier = "calm"
    instruction: str | None = None
    conditions: tuple[str, ...] = ()
    env: str | None = None
    success: str | None = None
    max_steps: int | None = None
    controller: Controller = "geometric_observer"
    latency: Latency = NO_LATENCY
    execution: Execution = AS_TRAINED
    again: str | None = None
    out: str
    action: str | None = None
    episodes: int = 200
    seed: int = 10_000
    num_envs: int = 64
    threads: int = 0
    overwrite: bool = False
    videos: int = 2
    rerun: bool = False
    progress: bool = True

    def __post_init__(self) -> None:
        at_least(self, episodes=1, seed=0, num_envs=1, threads=0, videos=0)
        if not self.policy and not self.again:
            raise InvalidValueError("evaluate needs policy=... (or again=..., an evaluation to repeat).")


@dataclass(frozen=True)
class Evaluated:
    """What came of it.

    Attributes:
        result: the flights, with their numbers. pilot: who flew, and where. tier: how rough the air was.
        written: the files; None where the folder held this very result already, and nothing was flown.
    """

    result: EvaluationResult
    pilot: Pilot
    tier: str
    written: Written | None


def runs_of(settings: Evaluate) -> list[Evaluate]:
    """Return the settings for each run where ``policy`` is the folder of a sweep, else these alone.

    Raises:
        InvalidValueError: one of the runs is not finished.
    """
    from aerial_il.evaluation.training_run import find_runs
    from aerial_il.policies import FINAL

    place = Path(settings.policy)
    runs = find_runs(place) if place.is_dir() and not (place / FINAL).is_dir() else []
    if not runs or runs == [place]:
        return [settings]
    if waiting := [run.name for run in runs if not (run / FINAL).is_dir()]:
        hint = f"Finish them with the command that began them, or name one run: policy={place}/NAME"
        raise InvalidValueError(f"policy={place} is a sweep in which {', '.join(waiting)} did not finish. {hint}")
    return [replace(settings, policy=str(run), out=str(Path(settings.out) / run.name)) for run in runs]


def evaluate(settings: Evaluate) -> Evaluated:
    """Fly what is not flown yet, and write what comes of it.

    Raises:
        InvalidValueError: the folder holds another result, or the settings do not go together.
    """
    from aerial_il.suite.late import late
    from aerial_il.workflows.parts import environments, pilots
    from aerial_il.workflows.parts.watching import watched

    pilot = pilots.pilot(
        settings.policy,
        robot=settings.robot,
        task=settings.task,
        action=settings.action,
        env=settings.env,
        options=environments.given(success=settings.success, max_steps=settings.max_steps),
    )
    environments.refuse_unread(pilot.reference.env, settings, ("tier", "controller"))
    pilot = _executing(pilot, settings)
    _tell(pilot, settings)
    seeds = range(settings.seed, settings.seed + settings.episodes)
    worlds = min(settings.num_envs, len(seeds))
    env = pilot.environment(settings.tier, num_envs=worlds, threads=settings.threads, controller=settings.controller)
    with closing(env), watched(env, settings.threads, wanted=settings.rerun) as seen:
        result, written = _judged(settings, pilot, late(seen, settings.latency), seeds)
    return Evaluated(result, pilot, env.spec.tier if pilot.reference.env else settings.tier, written)


def _executing(pilot: Pilot, settings: Evaluate) -> Pilot:
    """Return the pilot whose policy flies its chunks as was asked for."""
    from aerial_il.policies.parts.flying import FlyingPolicy

    if settings.execution == AS_TRAINED:
        return pilot
    if not isinstance(pilot.policy, FlyingPolicy):
        raise InvalidValueError(f"execution is for policies that fly chunks; policy={settings.policy} does not.")
    return replace(pilot, policy=pilot.policy.executing(settings.execution, settings.latency))


def _tell(pilot: Pilot, settings: Evaluate) -> None:
    """Tell a policy in words what to do."""
    from aerial_il.core import language
    from aerial_il.policies.parts.flying import FlyingPolicy

    if settings.instruction is None:
        return
    if not (isinstance(pilot.policy, FlyingPolicy) and pilot.policy.assignment.by_words):
        raise InvalidValueError(
            f"instruction={settings.instruction!r} is for policies that are told in words; policy={settings.policy} is "
            "not: train one with dataset.language=true."
        )
    if not language.tokens(settings.instruction):
        raise InvalidValueError(f"instruction={settings.instruction!r} has no words.")
    pilot.policy.told = settings.instruction


def _judged(settings: Evaluate, pilot: Pilot, env: BatchEnv, seeds: range) -> tuple[EvaluationResult, Written | None]:
    """Return the result and the files that were written."""
    from aerial_il.evaluation import rollouts
    from aerial_il.evaluation.destination import CALLED, finished, subject_of
    from aerial_il.evaluation.journal import Journal
    from aerial_il.evaluation.leaderboard import TRAINED, trained
    from aerial_il.evaluation.training_run import is_run, read_run
    from aerial_il.workflows.parts import results
    from aerial_il.workflows.parts.seen_seeds import warn_of_seen

    spec, name, journal = env.spec, settings.policy, Journal(settings.out)
    origin = rollouts.origin_of(env, pilot.policy)
    cell = {"robot": spec.robot, "task": spec.task, "tier": spec.tier}
    subject = subject_of(**cell, policy=name, seeds=seeds, provenance=origin)
    if done := finished(settings.out, subject, called=name, overwrite=settings.overwrite):
        return done, None
    command: dict[str, Any] = {"command": _command(settings, pilot)}
    if is_run(name):
        run = read_run(name)
        warn_of_seen(run, spec, seeds)
        command[TRAINED] = trained(run)
    journal.start({**subject, CALLED: name})
    result = rollouts.evaluate(
        env, pilot.policy, seeds, policy_name=name, origin=command, journal=journal, progress=settings.progress
    )
    shown = {"policy": pilot.policy, "videos": settings.videos}
    written = results.save(result, Path(settings.out), env=env, **shown, progress=settings.progress)
    journal.close()
    return result, written


def _command(settings: Evaluate, pilot: Pilot) -> str:
    from aerial_il.workflows.spelling import command_line

    ours = () if pilot.reference.env else (f"tier={settings.tier}", f"controller={settings.controller}")
    said = (f"latency.{name}={value:g}" for name, value in settings.latency.said.items())
    said = (*said, *([f"instruction={settings.instruction}"] if settings.instruction is not None else []))
    said = (*said, *(f"execution.{name}={value}" for name, value in settings.execution.said.items()))
    flown = (*ours, *said, f"episodes={settings.episodes}", f"seed={settings.seed}", f"out={settings.out}")
    return command_line(["evaluate", *pilot.overrides, *flown])
