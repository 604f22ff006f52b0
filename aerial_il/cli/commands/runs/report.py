"""Write one HTML page that opens offline, about an evaluation, a training run, or several runs side by side.

Of an evaluation: success, metrics, videos, provenance. Of a run: success and loss over training, error by action
element, whatever else was logged, predictions beside demonstrations, a learned reward, films. Several runs, or the
folder of a sweep, are grouped by settings, the seeds of each group together. Of a folder of recordings: every episode
with pictures, its length and smoothness, by who flew it.

Example: aerial-il report runs/pick_bc/evaluation run=runs/pick_bc dataset=datasets/pick
Example: aerial-il report runs/pick_bc
Example: aerial-il report datasets/pick_by_hand
Example: aerial-il report runs/pick_mlp runs/pick_act out=runs/classes.html
"""

from __future__ import annotations

from aerial_il.workflows.report import Report, report

SETTINGS, BARE = Report, ("result",)


def run(settings: Report) -> None:
    """Write the page and say where."""
    print(f"Report: {report(settings)}")
