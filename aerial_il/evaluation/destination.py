"""The folder of a result: never inside a dataset, never over a result of something else, and not flown twice."""

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.places import claim_folder
from aerial_il.data.folder import INDEX
from aerial_il.evaluation.journal import FOLDER, Journal
from aerial_il.evaluation.result import FILE_NAME, EvaluationResult, load_result

CONDITIONS = (
    "instruction",
    "action_level",
    "controller",
    "control_dt_s",
    "max_steps",
    "disturbances",
    "options",
    "latency",
    "execution",
)
CALLED = "called"  # key beside a subject: the folder or name of the policy, which decides nothing
DATASETS = (INDEX, "meta/info.json")  # files by which a folder is a dataset


def subject_of(
    *, robot: str, task: str, tier: str, policy: str, seeds: Sequence[int], provenance: Mapping[str, Any]
) -> dict[str, Any]:
    """Return all that decides a result, as JSON values: equal subjects have equal results.

    A policy with weights is known by them, whatever its folder is called. Numbers of worlds and threads do not count.
    """
    weights, environment = provenance.get("policy_sha256"), provenance.get("environment", {})
    subject = {"robot": robot, "task": task, "tier": tier, "policy": weights or policy, "seeds": list(seeds)}
    subject |= {name: environment.get(name) for name in CONDITIONS}
    subject |= {name: provenance.get(name) for name in ("engine", "packages", "git")}
    return json.loads(json.dumps(subject))


def subject_of_result(result: EvaluationResult) -> dict[str, Any]:
    """Return what ``result`` is a result of."""
    names = ("robot", "task", "tier", "policy", "seeds", "provenance")
    return subject_of(**{name: getattr(result, name) for name in names})


def finished(
    out: str | os.PathLike[str], subject: Mapping[str, Any], *, called: str = "", overwrite: bool
) -> EvaluationResult | None:
    """Return the result of ``subject`` if it lies in ``out``, or None once it may be flown into it.

    Args:
        out: the folder. subject: see :func:`subject_of`.
        called: what the policy is called by who asks, for the words of a refusal.
        overwrite: clear away a result of something else, finished or not.

    Raises:
        InvalidValueError: ``out`` is a file, is or lies in a dataset, or holds a result of something else, or one that
            cannot be read, which may not be overwritten.
    """
    _refuse_files(Path(out))
    _refuse_datasets(Path(out))
    journal = Journal(out)
    started, result = journal.subject(), _result(out, overwrite)
    if result is not None and started is None:
        differing = _differences({**subject_of_result(result), CALLED: result.policy}, subject, called)
        if not differing:
            return result
        _refuse(out, "the result of another evaluation", differing, overwrite)
    if started is None:
        if result is None and not (Path(out) / FOLDER).is_dir():
            claim_folder(out, (FILE_NAME,) if overwrite else ())
        journal.close()  # flights of nobody knows what: a folder that was being cleared away
    if started is not None and (differing := _differences(started, subject, called)):
        _refuse(out, "the flights of another evaluation that was interrupted", differing, overwrite)
        journal.close()
    return None


def _result(out: str | os.PathLike[str], overwrite: bool) -> EvaluationResult | None:
    if not (Path(out) / FILE_NAME).exists():
        return None
    try:
        return load_result(out)
    except InvalidValueError as error:
        if overwrite:
            return None
        raise InvalidValueError(f"{error} Choose another out=FOLDER, or set overwrite=true.") from error


def _refuse_files(out: Path) -> None:
    """Refuse what no folder can be made of: a file, a device, or links that lead back to themselves."""
    if os.path.lexists(out) and not out.is_dir():
        raise InvalidValueError(f"out={out} exists and is not a folder. Choose another out=FOLDER.")


def _refuse_datasets(out: Path) -> None:
    where = out.resolve()
    for folder in (where, *where.parents):
        if any((folder / name).is_file() for name in DATASETS):
            raise InvalidValueError(f"out={out} would write into the dataset {folder}. Choose another out=FOLDER.")


def _refuse(out: str | os.PathLike[str], what: str, differing: Sequence[str], overwrite: bool) -> None:
    if not overwrite:
        raise InvalidValueError(
            f"{out} holds {what}: {'; '.join(differing)} (existing != requested). "
            "Choose another out=FOLDER, or set overwrite=true to replace it."
        )


def _differences(there: Mapping[str, Any], asked: Mapping[str, Any], called: str) -> list[str]:
    """Name every key in which two subjects differ, and both values."""
    keys = [key for key in asked if there.get(key) != asked[key]]
    shown = {key: (_short(there.get(key), asked[key]), _short(asked[key], there.get(key))) for key in keys}
    if "policy" in shown:
        shown["policy"] = _policies(there.get(CALLED) or shown["policy"][0], called or shown["policy"][1])
    return [f"{key} {old} != {new}" for key, (old, new) in shown.items()]


def _policies(old: str, new: str) -> tuple[str, str]:
    """Return names that tell two policies apart; weights are known by their digest, which says nothing to anybody."""
    return (f"{old} as it was then", f"{new} as it is now, with other weights") if old == new else (old, new)


def _short(value: Any, other: Any) -> str:
    """Return a value in few words: of a mapping what ``other`` has not, of seeds how many from where."""
    if isinstance(value, Mapping):
        rest = other if isinstance(other, Mapping) else {}
        return json.dumps({key: each for key, each in value.items() if rest.get(key, ...) != each})
    if isinstance(value, list) and value and value == list(range(value[0], value[0] + len(value))):
        return f"{value[0]} to {value[-1]}"
    return str(value)
