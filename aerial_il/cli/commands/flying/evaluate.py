"""Fly a policy or an expert over fixed seeds and write evaluation.json, videos and a report.

Interrupted, the same command continues: finished flights are kept. A result of something else in the folder is
refused, a finished one is not flown again. The result does not depend on num_envs. Robot, task and action level, or the
environment from outside, are the policy's own unless they are given. An environment from outside is flown over its
whole horizon. The folder of a sweep of runs is evaluated run by run, and ranked in one table.

Example: aerial-il evaluate policy=runs/pick_bc tier=gusts out=runs/pick_bc/gusts
Example: aerial-il evaluate policy=expert robot=fa_hexa_arm4 task=reach out=evaluations/expert_reach
Example: aerial-il evaluate policy=my_pilot:make robot=quad task=hover out=evaluations/mine
Example: aerial-il evaluate policy=runs/sweep out=evaluations/sweep
Example: aerial-il evaluate policy=runs/cart env=gymnasium:CartPole-v1 success=return:475 out=runs/cart/evaluation
"""

from __future__ import annotations

from collections.abc import Sequence

from aerial_il.workflows.evaluate import Evaluate, evaluate, runs_of

SETTINGS, OUTPUT = Evaluate, "out"


def run(settings: Evaluate) -> None:
    """Evaluate, and print the headline; of several runs, their ranking."""
    every = runs_of(settings)
    for each in every:
        _judge(each)
    if len(every) > 1:
        together([each.out for each in every])


def together(folders: Sequence[str]) -> None:
    """Print a ranking of evaluations of one robot and task; of others it says nothing."""
    from aerial_il.cli.tables import table
    from aerial_il.evaluation.ranking import rank
    from aerial_il.evaluation.result import load_result

    results = {folder: load_result(folder) for folder in folders}
    if len(results) > 1 and len({(result.robot, result.task) for result in results.values()}) == 1:
        ranking = rank(results)
        print(f"{table(ranking.rows())}\n{ranking.note}")


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
    if pilot.reference.env:
        print(f"Return {result.return_line()}")
