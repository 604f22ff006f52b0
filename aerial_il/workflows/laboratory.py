"""Policies under conditions: every policy in every condition over the same seeds, one table, one page."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from aerial_il.core.errors import InvalidValueError

if TYPE_CHECKING:
    from aerial_il.evaluation.laboratory import Condition, Laboratory
    from aerial_il.evaluation.result import EvaluationResult
    from aerial_il.presentation.films.video import Clip
    from aerial_il.workflows.evaluate import Evaluate, Evaluated
    from aerial_il.workflows.parts.environments import EnvironmentReference

    Starts = dict[int, tuple[str, float, float]]  # seed -> what is where, x and y in m

FILE_NAME, PAGE = "conditions.json", "conditions.html"
SCHEMA = "aerial_il.conditions/1"


@dataclass(frozen=True)
class Planned:
    """One policy under one condition.

    Attributes:
        method: what its trainings have in common. condition: what disturbs it. settings: of its evaluation.
    """

    method: str
    condition: Condition
    settings: Evaluate


def planned(settings: Evaluate) -> list[Planned]:
    """Return what is to be flown: each policy without disturbance, its twin, then under each condition.

    Raises:
        InvalidValueError, UnknownNameError: a condition is unknown, out of its range, typed twice, or one that robot or
            policy cannot notice.
    """
    from aerial_il.workflows.evaluate import runs_of

    conditions, every = _conditions(settings), runs_of(settings)
    methods = _methods([each.policy for each in every])
    for each in every:
        _check_noticed(each, conditions)
    plan, filmed = list[Planned](), set[str]()
    for each in every:
        method = methods.get(each.policy, each.policy)
        films = 0 if method in filmed else min(1, each.videos)  # of one training: they take longer than the flights
        filmed.add(method)
        own = replace(each, conditions=(), videos=films)
        for condition in conditions:
            out = str(Path(each.out) / condition.folder)
            plan.append(Planned(method, condition, replace(own, tier=condition.tier, out=out)))
    return plan


def laboratory(settings: Evaluate, *, each: Callable[[Planned, Evaluated], None]) -> tuple[Laboratory, Path]:
    """Fly what is not flown yet, compare every condition with the undisturbed twins, and write table and page.

    Args:
        settings: with conditions. each: told of every evaluation as it ends.

    Returns:
        The comparison, and the page.
    """
    from aerial_il.core.files import write_json
    from aerial_il.evaluation.failures import kind_of
    from aerial_il.evaluation.laboratory import compared
    from aerial_il.presentation.pages.conditions import typical_failure, write_conditions
    from aerial_il.workflows.evaluate import evaluate
    from aerial_il.workflows.parts.results import footage_of
    from aerial_il.workflows.spelling import command_line, words_of

    flown: dict[str, dict[str, list[EvaluationResult]]] = {}
    plan = planned(settings)
    films: list[tuple[str, Clip]] = []
    starts: dict[str, Starts] = {}  # of each task
    several = len({one.method for one in plan}) > 1
    for one in plan:
        made = evaluate(one.settings)
        if made.pilot.task not in starts:
            starts[made.pilot.task] = _starts_of(made.pilot.reference, one.settings)
        flown.setdefault(one.method, {}).setdefault(one.condition.label, []).append(made.result)
        if film := typical_failure(made.result, footage_of(Path(one.settings.out), made.result).clips):
            who = f"{one.method}, {one.condition.label}" if several else one.condition.label
            films.append((f"{who}: {kind_of(film.episode)}", film))
        each(one, made)
    found = compared(flown, plan[0].condition.label)
    out, command = Path(settings.out), command_line(["evaluate", *words_of(settings)])
    write_json(out / FILE_NAME, {"schema": SCHEMA, "command": command, **found.to_dict()})
    page = write_conditions(out / PAGE, found, flown, starts=starts, films=films, command=command)
    return found, page


def _conditions(settings: Evaluate) -> list[Condition]:
    """Return the conditions, that of the twins first."""
    from aerial_il.evaluation.laboratory import Condition
    from aerial_il.suite import tiers

    if settings.env:
        raise InvalidValueError(f"conditions are disturbances of the suite; env={settings.env} is from outside.")
    twins = Condition.of(settings.tier, settings.tier)
    typed = [Condition.of(text, settings.tier) for text in settings.conditions]
    every = [twins, *(condition for condition in typed if condition != twins)]
    known: dict[str, str] = {}
    for condition in every:
        name = tiers.get(condition.tier).name
        if name in known:
            raise InvalidValueError(f"conditions={condition.label} is {known[name]} again: leave one out.")
        known[name] = condition.label
    return every


def _methods(folders: list[str]) -> dict[str, str]:
    """Return folder of a run -> what all trainings of its kind have in common, of a sweep; else nothing."""
    from aerial_il.evaluation.training_run import is_run, read_run
    from aerial_il.presentation.pages.run_report import grouped

    if len(folders) < 2:
        return {}
    runs = [read_run(folder) for folder in folders if is_run(folder)]
    return {str(run.path): label for label, members in grouped(runs).items() for run in members}


def _check_noticed(settings: Evaluate, conditions: list[Condition]) -> None:
    """Refuse conditions that change nothing for this robot or this policy."""
    from aerial_il import robots
    from aerial_il.suite import tiers
    from aerial_il.workflows.parts import pilots

    pilot = pilots.pilot(settings.policy, robot=settings.robot, task=settings.task, action=settings.action)
    if pilot.reference.env:
        raise InvalidValueError(f"conditions are disturbances of the suite; {settings.policy} flies outside of it.")
    robot = robots.get(pilot.robot)
    for condition in conditions:
        tier = tiers.get(condition.tier)
        for name in (part for part in tier.parts if f"+{part}" in tier.name):  # those that were added
            reason = tier.parts[name].unfelt(robot)
            if tier.parts[name].seen_alone and not pilot.reference.cameras:
                reason = f"{settings.policy} looks through no camera"
            if reason:
                raise InvalidValueError(f"conditions={condition.label} would change nothing: {reason}. Leave it out.")


def _starts_of(reference: EnvironmentReference, settings: Evaluate) -> Starts:
    """Reset an environment to each seed, and look where the first thing is that the task shows."""
    import numpy as np

    seeds = np.arange(settings.seed, settings.seed + settings.episodes)
    where: Starts = {}
    with closing(replace(reference, cameras=()).load(num_envs=settings.num_envs, threads=settings.threads)) as env:
        fields = env.spec.observation.of_group("task")
        place = next((f.name for f in fields if f.labels == ("x", "y", "z") and f.frame == "world"), "ee_pos")
        for first in range(0, len(seeds), env.num_envs):
            part = seeds[first : first + env.num_envs]
            obs = env.reset(np.resize(part, env.num_envs))
            where |= {int(seed): (place, *obs[place][k, :2].tolist()) for k, seed in enumerate(part)}
    return where
