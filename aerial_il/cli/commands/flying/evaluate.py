"""Fly a policy or an expert over fixed seeds and write evaluation.json, videos and a report.

Interrupted, the same command continues: finished flights are kept. A result of something else in the folder is
refused, a finished one is not flown again. The result does not depend on num_envs. Robot, task and action level, or the
environment from outside, are the policy's own unless they are given. An environment from outside is flown over its
whole horizon. The folder of a sweep of runs is evaluated run by run, and ranked in one table. With conditions each
flight is compared with its undisturbed twin, of the same seed, in one table and on one page.

Example: aerial-il evaluate policy=runs/pick_bc tier=gusts out=runs/pick_bc/gusts
Example: aerial-il evaluate policy=expert robot=fa_hexa_arm4 task=reach out=evaluations/expert_reach
Example: aerial-il evaluate policy=runs/pick_bc conditions=[gusts,wind=2,latency=3,motors=0.85] out=runs/pick_bc/lab
Example: aerial-il evaluate again=runs/pick_bc/gusts out=runs/pick_bc/gusts_again
Example: aerial-il evaluate policy=my_pilot:make robot=quad task=hover out=evaluations/mine
Example: aerial-il evaluate policy=runs/sweep out=evaluations/sweep
Example: aerial-il evaluate policy=runs/cart env=gymnasium:CartPole-v1 success=return:475 out=runs/cart/evaluation
"""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from aerial_il.core.errors import InvalidValueError
from aerial_il.workflows.evaluate import Evaluate, evaluate, runs_of

if TYPE_CHECKING:
    from aerial_il.evaluation.laboratory import Laboratory, Row
    from aerial_il.evaluation.result import EvaluationResult
    from aerial_il.workflows.evaluate import Evaluated
    from aerial_il.workflows.laboratory import Planned

SETTINGS, OUTPUT = Evaluate, "out"


def run(settings: Evaluate) -> None:
    """Evaluate, and print the headline; of several runs, their ranking; of conditions, what they cost."""
    if settings.again is not None:
        _again(settings, settings.again)
    elif settings.conditions:
        _under_conditions(settings)
    else:
        _evaluate(runs_of(settings))


def _evaluate(every: Sequence[Evaluate]) -> None:
    for each in every:
        _judge(each)
    if len(every) > 1:
        together([each.out for each in every])


def _under_conditions(settings: Evaluate) -> None:
    from aerial_il.cli.tables import table, wrapped
    from aerial_il.workflows.laboratory import laboratory

    def headline(one: Planned, made: Evaluated) -> None:
        print(f"{one.settings.policy}, {one.condition.label}: success {made.result.headline()}")

    found, page = laboratory(settings, each=headline)
    print(f"\n{table([_row(found, row) for row in found.rows])}\n{wrapped(found.note)}\nPage: {page}")


def _row(found: Laboratory, row: Row) -> dict[str, str]:
    """Return what one method does under one condition, as texts."""
    several = {
        name: getattr(row, name) for name in ("method", "task") if len({getattr(r, name) for r in found.rows}) > 1
    }
    low, high = (100 * end for end in row.ci95)
    text = {**several, "condition": row.condition, "success": f"{100 * row.rate:.1f} % ({low:.1f} to {high:.1f})"}
    if row.difference_ci95 is None:
        text |= {"difference": "", "p": ""}
    else:
        less, more = (100 * end for end in row.difference_ci95)
        text |= {
            "difference": f"{100 * row.difference:+.1f} ({less:+.1f} to {more:+.1f})",
            "p": f"{row.p_adjusted:.2g}",
        }
    kind = next(iter(row.failures), "")
    return {**text, "most frequent failure": f"{kind} ({row.failures[kind]})" if kind else ""}


OF_THE_REPETITION = ("again", "out", "num_envs", "threads", "overwrite", "videos", "rerun", "progress")
CODE = ("policy", "env")  # keys that may name code, which nothing runs but what the user has typed


def _again(settings: Evaluate, place: str) -> None:
    """Repeat an evaluation by the command in its provenance, and say which flights ended otherwise."""
    from aerial_il.cli import commands, compose
    from aerial_il.evaluation.result import load_result
    from aerial_il.workflows.spelling import words_of

    if other := words_of(settings, without=(*OF_THE_REPETITION, *CODE)):
        raise InvalidValueError(f"again={place} repeats what was flown there: leave out {' '.join(other)}.")
    if Path(settings.out).resolve() in (Path(place).resolve(), Path(place).resolve().parent):
        raise InvalidValueError(f"out={settings.out} holds the evaluation that is to be repeated: name another folder.")
    before = load_result(place)
    typed = shlex.split(str(before.provenance.get("command", "")))
    if typed[:2] != ["aerial-il", "evaluate"]:
        raise InvalidValueError(f"{place} does not say by which command it was evaluated: repeat it by hand.")
    earlier = compose.compose(commands.find("evaluate"), typed[2:])
    _require_typed(place, settings, earlier)
    own = {name: getattr(settings, name) for name in OF_THE_REPETITION if name != "again"}
    made = evaluate(replace(earlier, **own))
    if made.written is None:
        raise InvalidValueError(
            f"out={settings.out} holds a finished result, and nothing was flown: name an empty folder."
        )
    print(f"{before.policy}: success {made.result.headline()}, {before.headline()} before")
    print(_repeated(before, made.result))


def _require_typed(place: str, settings: Evaluate, earlier: Evaluate) -> None:
    """Refuse to run code that a result names and nobody typed, and what was typed but was not flown there."""
    from aerial_il.workflows.parts.typed_code import refuse_code

    flown, typed = ({name: getattr(each, name) for name in CODE} for each in (earlier, settings))
    for name in CODE:
        if typed[name] and typed[name] != flown[name]:
            raise InvalidValueError(
                f"again={place} was flown with {name}={flown[name]}, not with {name}={typed[name]}: leave it out."
            )
    refuse_code(f"again={place} was flown with", {name: flown[name] for name in CODE if not typed[name]})


def _repeated(before: EvaluationResult, now: EvaluationResult) -> str:
    """Say how many flights are the same in all their numbers, and what may explain those that are not."""
    old, new = ({episode.seed: episode for episode in result.episodes} for result in (before, now))
    differing = [seed for seed in sorted({*old, *new}) if old.get(seed) != new.get(seed)]
    flown = len({*old, *new})
    equal = f"{flown - len(differing)} of {flown} flights are equal in all their numbers."
    if lacking := sorted({*old} ^ {*new}):
        equal += f" {len(lacking)} stand on one side alone, seed {lacking[0]} first."
    if not differing:
        return equal
    named = {
        key: (before.provenance.get(key), now.provenance.get(key)) for key in ("policy_sha256", "engine", "packages")
    }
    changed = [f"{key} {old} != {new}" for key, (old, new) in named.items() if old != new]
    shown = ", ".join(map(str, differing[:5])) + (", ..." if len(differing) > 5 else "")
    return (
        f"{equal} Seeds that differ: {shown}. What differs besides: {'; '.join(changed) or 'nothing that is recorded'}."
    )


def together(folders: Sequence[str]) -> None:
    """Print a ranking of evaluations of one robot and task; of others it says nothing."""
    from aerial_il.cli.tables import ranked
    from aerial_il.evaluation.ranking import rank
    from aerial_il.evaluation.result import load_result

    results = {folder: load_result(folder) for folder in folders}
    if len(results) > 1 and len({(result.robot, result.task) for result in results.values()}) == 1:
        print(ranked(rank(results)))


def _judge(settings: Evaluate) -> None:
    judged = evaluate(settings)
    pilot, result = judged.pilot, judged.result
    if judged.written is None:
        print(f"{settings.out} holds this very result already, nothing is flown. To fly it anew, remove that folder.")
    else:
        print(f"Result: {judged.written.file}")
        if judged.written.note:
            print(judged.written.note)
        print(f"Report: {judged.written.page}")
    print(f"{pilot.robot} {pilot.task} {judged.tier}: success {result.headline()}")
    if result.provenance.get("observations") == "onboard":
        print("It acted on what is known on board, and was not told where objects are.")
    if pilot.reference.env:
        print(f"Return {result.return_line()}")
