"""The folder of a training run, read without torch: settings, metrics, rollouts on the way, provenance."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from aerial_il.core.bounded import read_json, read_yaml
from aerial_il.core.composition import dotted
from aerial_il.core.errors import InvalidValueError
from aerial_il.evaluation.curves import read_rows
from aerial_il.evaluation.result import FILE_NAME, EvaluationResult, load_result
from aerial_il.evaluation.statistics import wilson

CONFIG, METRICS, FINAL = "config.yaml", "metrics.jsonl", "policy"
BEST = "best"  # folder of the policy that rollouts chose
PROVENANCE, COMMAND = "provenance.json", "command.json"
SUCCESS, EPISODES, REWARD = "evaluate/success", "evaluate/episodes", "evaluate/mean_reward"
FLOWN = "flight_steps"  # of a round
SETTLING = 0.02  # share of a run's steps before it is expected to hold what its prior could
BY_CHANCE = ("seed", "dataset.digest", "dataset.frames", "dataset.transitions")  # what a seed changes
PLACES = ("path", "others")  # of the datasets, as they were typed
LEARNED_FROM = (*PLACES, "weights", "latency_ms", "language")  # what a command says of them that no config does
ON_THE_WAY = ("evaluate_tier", "evaluate_seed", "evaluate_episodes")  # what rollouts differ in, and no weight


@dataclass(frozen=True)
class Rollouts:
    """One evaluation on the way.

    Attributes:
        step: where, in the run's unit. rate: success. episodes: how many were flown; 0 where the run does not say.
    """

    step: int
    rate: float
    episodes: int

    @property
    def ci95(self) -> tuple[float, float]:
        """Wilson's interval; the rate alone where the number of episodes is unknown."""
        if not self.episodes:
            return self.rate, self.rate
        low, high = wilson(round(self.rate * self.episodes), self.episodes)
        return low, high


@dataclass(frozen=True, eq=False)
class TrainingRun:
    """A run folder.

    Attributes:
        path: the folder. config: what determined the run. rows: of its metrics. provenance: code, packages, machine.
        command: what was typed, and the dataset; empty if the run was not started from the command line.
        finished: whether it has its final policy.
        judged: evaluations that lie below the folder, by the name of theirs.
    """

    path: Path
    config: Mapping[str, Any]
    rows: list[dict[str, Any]]
    provenance: Mapping[str, Any]
    command: Mapping[str, Any]
    finished: bool
    judged: Mapping[str, EvaluationResult] = field(default_factory=dict, repr=False)

    def __repr__(self) -> str:
        state = f"{self.steps} steps, {'finished' if self.finished else 'not finished'}"
        return f"TrainingRun({self.path}: {self.policy} by {self.algorithm}, seed {self.seed}, {state})"

    @property
    def seed(self) -> int:
        return int(self.config.get("seed", 0))

    @property
    def policy(self) -> str:
        logged = self.config.get("policy", {})
        return str(logged.get("name", "policy") if isinstance(logged, Mapping) else logged)

    @property
    def algorithm(self) -> str:
        return str(self.config.get("algorithm", "training"))

    @property
    def unit(self) -> str:
        """The unit of its steps: rounds, steps flown in the environment, or steps of the optimiser."""
        if "rounds" in self.config.get("settings", {}):
            return "round"
        return "environment step" if "environment" in self.config else "training step"

    @property
    def steps(self) -> int:
        return int(self.rows[-1]["step"]) if self.rows else 0

    @property
    def seconds(self) -> float | None:
        """Wall time of the training, s; None where nothing was logged."""
        return next((float(row["elapsed_s"]) for row in reversed(self.rows) if "elapsed_s" in row), None)

    @property
    def flown(self) -> int:
        """Control steps flown while it learned, rollouts on the way not counted; 0 for one that flies none."""
        if self.unit == "environment step":
            return self.steps
        return round(sum(row.get(FLOWN, 0) for row in self.rows))

    @cached_property
    def rollouts(self) -> list[Rollouts]:
        """Evaluations on the way, in the order of the steps."""
        return rollouts_of(self.rows)

    @property
    def largest_dip(self) -> float | None:
        """See :func:`largest_dip_of`."""
        return largest_dip_of(self.rows)

    @cached_property
    def rewards(self) -> list[tuple[int, float]]:
        """Steps, and the mean reward of the rollouts there."""
        logged = ((int(row["step"]), row.get(REWARD)) for row in self.rows)
        return [(step, float(reward)) for step, reward in logged if reward is not None and np.isfinite(reward)]

    @cached_property
    def settings(self) -> dict[str, Any]:
        """Dotted settings -> values, without those that a seed changes."""
        said = self.command.get("dataset", {})
        taken = {**{name: said.get(name) for name in LEARNED_FROM}, **(said.get("reading") or {})}
        learned_from = {f"dataset.{name}": value for name, value in taken.items() if value}
        return {key: value for key, value in (dotted(self.config) | learned_from).items() if key not in BY_CHANCE}

    @cached_property
    def setup(self) -> dict[str, Any]:
        """All but chance that runs are told apart by: settings, and how they were evaluated on the way."""
        said = self.command.get("settings", {}) if self.rollouts else {}
        return {**self.settings, **{name: said[name] for name in ON_THE_WAY if said.get(name) is not None}}


def rollouts_of(rows: Sequence[Mapping[str, Any]]) -> list[Rollouts]:
    """Return the evaluations on the way in rows of metrics."""
    logged = (row for row in rows if SUCCESS in row)
    return [Rollouts(int(row["step"]), row[SUCCESS], int(row.get(EPISODES, 0))) for row in logged]


def largest_dip_of(rows: Sequence[Mapping[str, Any]]) -> float | None:
    """Return the most by which success fell below the prior's, that of the rollouts at step 0; None without those.

    What the first 2 % of the steps did is not counted; 0 where it never fell below.
    """
    logged, steps = rollouts_of(rows), int(rows[-1]["step"]) if rows else 0
    later = [rollouts.rate for rollouts in logged[1:] if rollouts.step > SETTLING * steps]
    return max(0.0, logged[0].rate - min(later)) if later and logged[0].step == 0 else None


def is_run(path: str | os.PathLike[str]) -> bool:
    """Whether ``path`` is the folder of a training run."""
    return (Path(path) / CONFIG).is_file() and (Path(path) / METRICS).is_file()


def find_runs(path: str | os.PathLike[str]) -> list[Path]:
    """Return ``path`` if it is a run, else the runs of the sweep that it holds, by name."""
    if is_run(path):
        return [Path(path)]
    return sorted({config.parent for config in Path(path).glob(f"*/{CONFIG}") if is_run(config.parent)})


def read_run(path: str | os.PathLike[str]) -> TrainingRun:
    """Read a run folder.

    Raises:
        InvalidValueError: it is none, or one of its files is not what it should be.
    """
    path = Path(path)
    if not is_run(path):
        hint = "Train one: aerial-il train dataset=PATH run=runs/NAME"
        raise InvalidValueError(f"{path} is not a training run: it lacks {CONFIG} or {METRICS}. {hint}")
    try:
        config = read_yaml(path / CONFIG)
        provenance, command = (_json(path / name) for name in (PROVENANCE, COMMAND))
    except (OSError, ValueError) as error:
        raise InvalidValueError(f"{path} cannot be read as a training run: {error}.") from error
    if not isinstance(config, dict):
        raise InvalidValueError(f"{path / CONFIG} holds no settings.")
    judged = {file.parent.name: load_result(file) for file in sorted(path.glob(f"*/{FILE_NAME}"))}
    finished = (path / FINAL).is_dir()
    return TrainingRun(path, config, list(read_rows(path / METRICS)), provenance, command, finished, judged)


def _json(path: Path) -> dict[str, Any]:
    content = read_json(path) if path.exists() else {}
    if not isinstance(content, dict):
        raise ValueError(f"{path.name} is not a JSON object")
    return content
