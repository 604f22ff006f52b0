"""The settings of an earlier training, for one that is to be like it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from aerial_il.core.composition import build
from aerial_il.core.errors import AerialError, InvalidValueError
from aerial_il.evaluation.training_run import TrainingRun, find_runs, is_run, read_run


def settings_of[S](kind: type[S], place: str) -> S:
    """Return the settings, of this ``kind``, of the run in the folder ``place``.

    Raises:
        InvalidValueError: there is no run, there are several, or its settings are of another version.
    """
    _require_one(Path(place))
    try:
        return build(kind, {"run": place, **_recorded(read_run(place))})
    except AerialError as error:
        raise InvalidValueError(
            f"from={place}: its settings do not fit this version of aerial_il. {error} Its policy can be flown; to "
            "train like it, give the settings themselves."
        ) from error


def _require_one(place: Path) -> None:
    if is_run(place):
        return
    several = ", ".join(run.name for run in find_runs(place))
    why = (
        f"is a sweep; name one of its runs: {several}" if several
        else "is no training run" if place.exists() else "does not exist"
    )  # fmt: skip
    raise InvalidValueError(f"from={place} {why}. To see what runs there are: aerial-il runs FOLDER")


def _recorded(run: TrainingRun) -> dict[str, Any]:
    """Return what a run's folder says of how it was trained, as plain values.

    What it learned from and how it was evaluated stands beside the command; a training by an algorithm's own ``train``
    has none of that.
    """
    algorithm = {"name": run.algorithm, **run.config.get("settings", {})}
    learned_from = run.command.get("dataset", {})
    dataset = {**learned_from.pop("reading", {}), **learned_from}
    return {
        **run.command.get("settings", {"dataset": dataset}),
        "seed": run.seed,
        "algorithm": algorithm,
        "policy": run.config.get("policy", {}),
    }
