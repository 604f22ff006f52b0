"""Compare evaluations: two in all their numbers, paired by seed where possible; several in one ranking.

Each success rate stands with its 95 % interval; of several, each is tested against the best, adjusted by Holm's method.

Example: aerial-il compare runs/one/evaluation runs/two/evaluation
Example: aerial-il compare runs/a/evaluation runs/b/evaluation runs/c/evaluation
Example: aerial-il compare runs/sweep format=latex
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from aerial_il.cli.as_json import AsJson
from aerial_il.cli.tables import table
from aerial_il.core.errors import InvalidValueError
from aerial_il.workflows.compare import Compare, compare

Row = Mapping[str, str]
LATEX = {"\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "_": r"\_", "#": r"\#", "$": r"\$", "{": r"\{", "}": r"\}"}


@dataclass(frozen=True, kw_only=True)
class Shown(AsJson, Compare):
    """How it is shown.

    Attributes:
        format: of a ranking: text, csv or latex (booktabs).
    """

    format: Literal["text", "csv", "latex"] = "text"


SETTINGS, BARE = Shown, ("result",)


def run(settings: Shown) -> None:
    """Print the comparison."""
    from aerial_il.evaluation.ranking import Ranking

    made = compare(settings)
    if not isinstance(made, Ranking):
        if settings.format != "text":
            raise InvalidValueError(f"format={settings.format} is of a ranking; two are compared as text, or --json.")
        settings.show(made.to_dict(), made.summary)
        return
    writers = {"text": lambda: f"{table(made.rows())}\n{made.note}", "csv": lambda: _csv(made.rows()),
               "latex": lambda: _latex(made.rows(), made.note)}  # fmt: skip
    settings.show(made.to_dict(), writers[settings.format])


def _csv(rows: Sequence[Row]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, rows[0], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue().rstrip()


def _latex(rows: Sequence[Row], note: str) -> str:
    """Return a table that needs the package booktabs."""
    lines = [" & ".join(map(_escaped, row.values())) + r" \\" for row in rows]
    head = " & ".join(rows[0]) + r" \\"
    inside = [r"\toprule", head, r"\midrule", *lines, r"\bottomrule"]
    return "\n".join([f"% {note}", rf"\begin{{tabular}}{{{'l' * len(rows[0])}}}", *inside, r"\end{tabular}"])


def _escaped(text: str) -> str:
    return "".join(LATEX.get(letter, letter) for letter in text)
