"""A page of standings from evaluations alone; a submission is judged on seeds that are drawn on the day."""

from __future__ import annotations

import secrets
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from aerial_il.core.errors import AerialError, InvalidValueError
from aerial_il.workflows.parts.names import at_least

if TYPE_CHECKING:
    from collections.abc import Callable

    from aerial_il.evaluation.leaderboard import Leaderboard
    from aerial_il.evaluation.result import EvaluationResult

DRAWN_FROM, DRAWN_TO = 1_000_000, 2**31  # seeds of submissions; nobody can have trained on them


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What stands on it.

    Attributes:
        result: evaluations, or folders with several at any depth below.
        submission: a policy to be judged in every cell and tier of the board that it flies in: a folder, or
            module:factory of an installed wheel.
        tiers: in which a submission is judged (empty: those of the board).
        episodes: of a submission in each cell and tier.
        fewest: episodes that a result needs to stand on the board.
        out: the page.
        progress: show progress bars.
    """

    result: tuple[str, ...]
    submission: str | None = None
    tiers: tuple[str, ...] = ()
    episodes: int = 200
    fewest: int = 50
    out: str = "leaderboard.html"
    progress: bool = True

    def __post_init__(self) -> None:
        at_least(self, episodes=1, fewest=1)


def leaderboard(settings: Settings, *, told: Callable[[str], None]) -> tuple[Leaderboard, Path]:
    """Judge the submission, if there is one, and write the page.

    Args:
        settings: what stands on it. told: of each evaluation of a submission, in a line.

    Raises:
        InvalidValueError: there is no evaluation, or nothing that the submission flies in.
    """
    from aerial_il.evaluation.leaderboard import standings
    from aerial_il.presentation.pages.page import write_page

    results = _results(settings)
    if settings.submission is not None:
        results |= _judged(settings, results, told)
    board = standings(results, fewest=settings.fewest)
    methods, cells = {each.method for each in board.standings}, list(board.cells.items())
    return board, write_page(settings.out, "leaderboard.html.j2", board=board, cells=cells, methods=len(methods))


def _results(settings: Settings) -> dict[str, EvaluationResult]:
    from aerial_il.evaluation.result import find_results, load_result

    found: dict[str, EvaluationResult] = {}
    for place in map(Path, settings.result):
        if place.is_dir():
            found |= {str(folder): load_result(folder) for folder in find_results(place)}
        else:
            found[str(place.parent)] = load_result(place)
    if not found:
        raise InvalidValueError(
            f"result={list(settings.result)} holds no evaluation. Make one: aerial-il evaluate policy=... out=..."
        )
    return found


def _judged(
    settings: Settings, results: dict[str, EvaluationResult], told: Callable[[str], None]
) -> dict[str, EvaluationResult]:
    """Fly a submission in the cells of the board, over seeds that are drawn now."""
    from aerial_il.workflows.evaluate import Evaluate, evaluate

    submission = str(settings.submission)
    today = datetime.now(UTC).strftime("%Y-%m-%d")
    seed = DRAWN_FROM + secrets.randbelow(DRAWN_TO - DRAWN_FROM)
    name = Path(submission).name.replace(":", "-")
    first = Path(settings.result[0])
    folder = (first if first.is_dir() else first.parent) / "submissions" / f"{today}-{name}-{seed}"
    cells = dict.fromkeys((result.robot, result.task) for result in results.values())
    tiers = settings.tiers or tuple(dict.fromkeys(result.tier for result in results.values()))
    judged, reasons = dict[str, "EvaluationResult"](), list[str]()
    for robot, task in cells:
        for tier in tiers:
            out = folder / f"{robot}-{task}-{tier}"
            wanted = Evaluate(
                policy=submission, robot=robot, task=task, tier=tier, episodes=settings.episodes, seed=seed, videos=0,
                out=str(out), progress=settings.progress,
            )  # fmt: skip
            try:
                result = evaluate(wanted).result
            except AerialError as error:
                reasons.append(f"{robot} {task} {tier}: not flown, {error}")
                continue
            told(f"{robot} {task} {tier}: success {result.headline()}")
            judged[str(out)] = result
    if not judged:
        raise InvalidValueError(f"{submission} flies in no cell of the board. {reasons[0]}")
    for reason in reasons:
        told(reason)
    return judged
