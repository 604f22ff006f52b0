"""Compare evaluations: two in all their numbers, paired by seed where possible; several in one ranking.

Each success rate stands with its 95 % interval; of several, each is tested against the best, adjusted by Holm's method.

Example: aerial-il compare runs/one/evaluation runs/two/evaluation
Example: aerial-il compare runs/a/evaluation runs/b/evaluation runs/c/evaluation
Example: aerial-il compare runs/sweep format=latex
"""

from dataclasses import dataclass
from typing import Literal

from aerial_il.cli.as_json import AsJson
from aerial_il.cli.tables import as_csv, as_latex, ranked, wrapped
from aerial_il.core.errors import InvalidValueError
from aerial_il.workflows.compare import Compare, compare


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
        settings.show(made.to_dict(), lambda: wrapped(made.summary()))
        return
    writers = {
        "text": lambda: ranked(made),
        "csv": lambda: as_csv(made.rows()),
        "latex": lambda: as_latex(made.rows(), made.note),
    }
    settings.show(made.to_dict(), writers[settings.format])
