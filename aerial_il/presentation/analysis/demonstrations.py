"""Datasets as frames: one row per episode, or one per control step."""

import os
import warnings
from typing import Any

import numpy as np
import pandas as pd

from aerial_il.core.errors import DemoError
from aerial_il.data.dataset import open_dataset
from aerial_il.data.episode import Episode


def dataset(folder: str | os.PathLike[str], *, failures: bool = True) -> pd.DataFrame:
    """Return one row per episode of a dataset in any form that ``aerial_il.open_dataset`` reads.

    An episode that is damaged is named in a warning and left out.

    Args:
        folder: where it lies. failures: also the failed episodes of a folder of recordings.

    Returns:
        Columns: ``uid``, ``robot``, ``task``, ``tier``, ``seed`` (missing where unknown), ``success``, ``steps``,
        ``duration_s``, ``return``, ``interventions`` (share of the steps in which someone had taken over).

    Raises:
        DemoError: there is nothing to open.
    """
    opened, rows = open_dataset(folder, failures=failures), []
    for uid in opened.uids:
        try:
            rows.append(_row(opened[uid]))
        except DemoError as error:
            warnings.warn(f"{uid} is left out: {error}", stacklevel=2)
    columns = ["uid", "robot", "task", "tier", "seed", "success", "steps", "duration_s", "return", "interventions"]
    return pd.DataFrame(rows, columns=pd.Index(columns)).astype({"seed": "Int64"})


def steps(folder: str | os.PathLike[str], episode: int | str | None = None, *, failures: bool = False) -> pd.DataFrame:
    """Return one row per control step of a dataset, or of one ``episode`` by index or uid.

    Returns:
        Columns: ``uid``, ``step``, ``time_s`` since the start, ``reward``, ``phase``, ``intervention``, then every
        element of each observation before the step and of the executed action: ``ee_pos[0]``, ``action[ee_x]``.

    Raises:
        DemoError: there is nothing to open, no such episode, or one is damaged.
    """
    opened = open_dataset(folder, failures=failures)
    chosen = opened if episode is None else [opened[episode]]
    return pd.concat([_steps(one) for one in chosen], ignore_index=True)


def _row(episode: Episode) -> dict[str, Any]:
    spec = episode.spec
    return {
        "uid": episode.uid,
        "robot": spec.robot,
        "task": spec.task,
        "tier": spec.tier,
        "seed": episode.provenance.get("seed"),
        "success": episode.success,
        "steps": len(episode),
        "duration_s": len(episode) * spec.control_dt_s,
        "return": episode.total_reward,
        "interventions": float(np.mean(episode.is_intervention)) if len(episode) else 0.0,
    }


def _steps(episode: Episode) -> pd.DataFrame:
    count = len(episode)
    columns: dict[str, Any] = {
        "uid": episode.uid,
        "step": np.arange(count),
        "time_s": episode.sim_time[:-1] - episode.sim_time[0],
        "reward": episode.rewards,
        "phase": episode.phase,
        "intervention": episode.is_intervention,
    }
    for name, values in episode.obs.items():
        flat = np.asarray(values)[:count].reshape(count, -1)
        one = flat.shape[1] == 1
        columns |= {name if one else f"{name}[{k}]": flat[:, k] for k in range(flat.shape[1])}
    labels = episode.spec.action.labels
    columns |= {f"action[{label}]": episode.executed_actions[:, k] for k, label in enumerate(labels)}
    return pd.DataFrame(columns)
