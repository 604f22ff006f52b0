"""The settings of an earlier training, for one that is to be like it; its folder may be anybody's."""

from collections.abc import Container, Mapping
from pathlib import Path
from typing import Any

from aerial_il.core.composition import build
from aerial_il.core.errors import AerialError, InvalidValueError
from aerial_il.evaluation.training_run import TrainingRun, find_runs, is_run, read_run
from aerial_il.workflows.parts.typed_code import refuse_code


def settings_of[S](kind: type[S], place: str, typed: Container[str]) -> S:
    """Return the settings, of this ``kind``, of the run in the folder ``place``.

    Args:
        typed: keys that the user sets beside it.

    Raises:
        InvalidValueError: there is no run, there are several, its settings are of another version, or name code that
            the user has not typed.
    """
    _require_one(Path(place))
    recorded = _recorded(read_run(place))
    untyped = {name: value for name, value in recorded.items() if name not in typed}
    refuse_code(f"from={place}: the run was trained with", untyped)
    try:
        return build(kind, {"run": place, **recorded})
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
    learned_from = _mapping(run, "dataset", run.command)
    earlier = {"dataset": {**_mapping(run, "reading", learned_from), **learned_from}}
    earlier["dataset"].pop("reading", None)
    return {
        **(_mapping(run, "settings", run.command) or earlier),
        "seed": run.config.get("seed", 0),
        "algorithm": {"name": run.algorithm, **_mapping(run, "settings", run.config)},
        "policy": _mapping(run, "policy", run.config),
    }


def _mapping(run: TrainingRun, name: str, content: Mapping[str, Any]) -> dict[str, Any]:
    if not isinstance(found := content.get(name, {}), dict):
        raise InvalidValueError(f"from={run.path}: its {name} is {str(found)[:40]!r}, and no settings by name.")
    return found
