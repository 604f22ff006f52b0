"""A report as it stands in the repository: a page, the numbers and the figures of a study."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.files import write_atomic
from experiments.common.columns import markdown
from experiments.common.report import Report, Row, Target

PAGE, NUMBERS = "README.md", "results.json"
LARGEST_BYTES = 200_000
TITLES = {  # others: the name, capitalised
    "adroit_rl": "Adroit by reinforcement learning",
    "beyond_teacher": "Beyond the teacher",
    "dagger": "DAgger",
    "from_prior": "From a prior",
    "from_prior_big_four": "From a prior, on a heavy vehicle",
    "practice": "Practice, by the shipped commands",
    "foreign": "Files of other tools",
    "gail": "GAIL",
    "hg_dagger": "HG-DAgger",
    "lerobot": "LeRobot",
    "rl_speed": "Speed of reinforcement learning",
    "sb3": "Beside Stable-Baselines3",
    "z1_reach": "Reaching with Z1",
}


def save_study(report: Report, experiments: Path, *, command: str) -> Path:
    """Write the page, the numbers and the figures of a study below ``experiments/NAME``; return the page.

    Args:
        report: what was measured. experiments: the folder of all studies. command: what measures it again.

    Raises:
        InvalidValueError: a file would be too large for a repository.
    """
    folder = experiments / report.study.name
    found = {**report.to_dict(), "command": command}
    numbers = json.dumps(found, indent=1, allow_nan=False) + "\n"
    files = {NUMBERS: numbers, PAGE: page_of(found, tuple(report.figures)), **report.figures}
    for name, text in files.items():
        if len(text) > LARGEST_BYTES:
            raise InvalidValueError(f"{folder / name} has {len(text)} bytes; a study keeps {LARGEST_BYTES} at most.")
    for name, text in files.items():
        write_atomic(folder / name, text)
    return folder / PAGE


def page_of(study: Mapping[str, Any], figures: Sequence[str]) -> str:
    """Return the page of one study: question, answer, tables, figures, how and where it was measured."""
    targets = ["## Targets", markdown(_target_rows(study))] if study["targets"] else []
    tables = [part for title, rows in study["tables"].items() for part in (f"## {title}", markdown(rows))]
    parts = [
        f"# {_title(study)}",
        *_superseded(study),
        study["question"],
        f"**{_capital(study['verdict'])}.** Measured with",
        f"```bash\n{study['command']}\n```",
        f"{_origin(study)}. All numbers: [{NUMBERS}]({NUMBERS}).",
        *targets,
        *(f"![{_title(study)}]({name})" for name in figures),
        *tables,
        "## How it was measured",
        "\n".join(f"- {note}" for note in study["notes"]),
    ]
    return "\n\n".join(parts) + "\n"


def _superseded(study: Mapping[str, Any]) -> list[str]:
    """Return the warning that a study carries whose figures no longer stand; measuring anew takes it away."""
    return [f"> **Superseded.** {study['superseded']}"] if "superseded" in study else []


def _target_rows(study: Mapping[str, Any]) -> list[Row]:
    targets = [{key: value for key, value in target.items() if key != "met"} for target in study["targets"]]
    return [Target(**target).to_row() for target in targets]


def _title(study: Mapping[str, Any]) -> str:
    name = str(study["benchmark"])
    return TITLES.get(name, name.replace("_", " ").capitalize())


def _origin(study: Mapping[str, Any]) -> str:
    """Return commit, machine, its load and the time taken in words."""
    git, machine = study["provenance"]["git"], study["machine"]
    commit = (
        "an installed package"
        if git is None
        else f"commit `{git['sha'][:10]}`{' with uncommitted changes' * git['dirty']}"
    )
    where = f"{machine['cores']} cores of {machine['cpu']}, load {machine['load_average']:g} at the end"
    return f"{_capital(commit)}, {where}, {study['wall_time_s']:.0f} s"


def _capital(words: str) -> str:
    return words[0].upper() + words[1:]
