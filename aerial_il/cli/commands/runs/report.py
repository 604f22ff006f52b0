"""Write one HTML page that opens offline, about an evaluation, a training run, or several runs side by side.

Of an evaluation: success, metrics, videos, provenance. Of a run: success and loss over training, error by action
element, whatever else was logged, predictions beside demonstrations, a learned reward, films. Several runs, or the
folder of a sweep, are grouped by settings, the seeds of each group together. Of a folder of recordings: every episode
with pictures, its length and smoothness, by who flew it.

format=csv and format=latex (booktabs) print its numbers instead: of runs a row for each of their evaluations, of an
evaluation one for each number, all with 95 % intervals.

Example: aerial-il report runs/pick_bc/evaluation run=runs/pick_bc dataset=datasets/pick
Example: aerial-il report runs/pick_bc
Example: aerial-il report datasets/pick_by_hand
Example: aerial-il report runs/pick_mlp runs/pick_act out=runs/classes.html
Example: aerial-il report runs/sweep format=latex > sweep.tex
"""

from dataclasses import dataclass
from typing import Literal

from aerial_il.cli.tables import as_csv, as_latex
from aerial_il.core.errors import InvalidValueError
from aerial_il.workflows.report import Report, report, rows


@dataclass(frozen=True, kw_only=True)
class Shown(Report):
    """What is made.

    Attributes:
        format: html, a page; or a table that is printed: csv or latex (booktabs).
    """

    format: Literal["html", "csv", "latex"] = "html"


SETTINGS, BARE = Shown, ("result",)


def run(settings: Shown) -> None:
    """Write the page and say where, or print the numbers."""
    if settings.format == "html":
        print(f"Report: {report(settings)}")
        return
    if settings.out is not None:
        raise InvalidValueError(f"format={settings.format} is printed: leave out out=, and add > {settings.out}")
    print({"csv": as_csv, "latex": as_latex}[settings.format](rows(settings)))
