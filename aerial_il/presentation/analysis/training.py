"""Training runs as frames: one row per run, and what each logged."""

import os
import warnings
from collections.abc import Mapping
from typing import Any

import pandas as pd

from aerial_il.core.bounded import read_yaml
from aerial_il.evaluation.run_collection import read_runs
from aerial_il.evaluation.training_run import CONFIG, FINAL, TrainingRun, read_run

COLUMNS = (
    *("run", "algorithm", "policy", "environment", "robot", "task", "tier", "seed"),
    *("episodes", "steps", "unit", "flown", "success", "low", "high", "flights", "finished", "folder"),
)


def runs(folder: str | os.PathLike[str]) -> pd.DataFrame:
    """Return one row per training run below ``folder``; what is none, or half written, is named in a warning.

    Returns:
        Columns: ``run`` (path below the folder), ``algorithm``, ``policy``, ``environment`` (``suite``, or
        ``gymnasium:ID``), ``robot``, ``task``, ``tier``, ``seed``, ``episodes`` (demonstrations that it learned from),
        ``steps`` with their ``unit``, ``flown`` (control steps flown while it learned), ``success`` of the last
        rollouts on the way with Wilson's 95 % interval ``low`` to ``high`` and the number of ``flights`` behind it,
        ``finished``, ``folder``. Missing where it does not say.

    Raises:
        InvalidValueError: there is no such folder.
    """
    collection = read_runs(folder)
    for place, why in collection.refused.items():
        warnings.warn(f"{place} is left out: {why}.", stacklevel=2)
    rows = [{"run": collection.name(run), **_row(run)} for run in collection.runs]
    return pd.DataFrame(rows, columns=pd.Index(COLUMNS))


def metrics(run: str | os.PathLike[str]) -> pd.DataFrame:
    """Return what a run logged in ``metrics.jsonl``: one row per line, by ``step``; NaN where it was not logged.

    A last line that was cut short by a kill is left out.

    Raises:
        InvalidValueError: ``run`` is no training run, or a line of it is no row of metrics; names file and line.
    """
    rows = read_run(run).rows
    columns = dict.fromkeys(["step", *(name for row in rows for name in row)])
    return pd.DataFrame(rows, columns=pd.Index(list(columns)))


def _row(run: TrainingRun) -> dict[str, Any]:
    config, last = run.config, run.rollouts[-1] if run.rollouts else None
    low, high = last.ci95 if last else (None, None)
    return {
        "algorithm": run.algorithm,
        "policy": run.policy,
        **_where(run),
        "seed": run.seed,
        "episodes": _part(config, "dataset").get("demonstrations"),
        "steps": run.steps,
        "unit": run.unit,
        "flown": run.flown,
        "success": last.rate if last else None,
        "low": low,
        "high": high,
        "flights": last.episodes if last else None,
        "finished": run.finished,
        "folder": str(run.path),
    }


def _where(run: TrainingRun) -> dict[str, Any]:
    """Return where a run's policy flies: as its configuration says, else its finished policy, else an evaluation."""
    judged = next(iter(run.judged.values()), None)
    place = _part(run.config, "environment") or _spec(run) or (vars(judged) if judged else {})
    robot, task, tier = (place.get(key) for key in ("robot", "task", "tier"))
    outside = robot in ("gymnasium", "dm_env", "dm_control")
    named = f"{robot}:{task}" if outside else "suite" if robot else None
    return {"environment": named, "robot": robot, "task": task, "tier": tier}


def _spec(run: TrainingRun) -> Mapping[str, Any]:
    """Return the environment's specification that lies with the finished policy; empty where it cannot be read."""
    try:
        config = read_yaml(run.path / FINAL / CONFIG)
    except (OSError, ValueError):
        return {}
    return _part(config, "spec") if isinstance(config, Mapping) else {}


def _part(config: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """Return a part of a run's configuration, empty where it has none."""
    part = config.get(name)
    return part if isinstance(part, Mapping) else {}
