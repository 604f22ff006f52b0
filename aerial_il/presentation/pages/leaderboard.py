"""A page of standings, which opens offline."""

import os
from pathlib import Path

from aerial_il.evaluation.leaderboard import Leaderboard
from aerial_il.presentation.pages.page import write_page


def write_leaderboard(path: str | os.PathLike[str], board: Leaderboard) -> Path:
    """Write the page of ``board``."""
    methods = dict.fromkeys(each.method for each in board.standings)
    return write_page(path, "leaderboard.html.j2", board=board, cells=list(board.cells.items()), methods=len(methods))
