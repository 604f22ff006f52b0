"""Weights & Biases: one run there each time the run is opened; ``WANDB_MODE=offline`` stays on this machine."""

import importlib
from collections.abc import Mapping
from pathlib import Path

from aerial_il.core.errors import InvalidValueError

FOLDER = "wandb"
PROJECT = "aerial_il"


class WeightsAndBiases:
    """A run of the project ``aerial_il`` (or ``WANDB_PROJECT``), named and grouped after the run's folder."""

    def __init__(self, run: Path) -> None:
        wandb = importlib.import_module("wandb")
        try:
            project = wandb.setup().settings.project or PROJECT
            self._run = wandb.init(dir=str(run), name=run.name, group=run.name, project=project)
        except wandb.errors.Error as error:
            hint = "Log in with: wandb login; or set WANDB_MODE=offline, or leave out tracker=wandb."
            raise InvalidValueError(f"tracker=wandb could not start ({error}). {hint}") from error

    def write(self, row: Mapping[str, float]) -> None:
        self._run.log({name: value for name, value in row.items() if name != "step"}, step=int(row["step"]))

    def close(self) -> None:
        self._run.finish()
