"""MLflow: one run there each time the run is opened; in ``mlruns/`` of the run's folder unless configured otherwise."""

import importlib
import logging
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from aerial_il.core.errors import InvalidValueError

FOLDER = "mlruns"
EXPERIMENT = "aerial_il"
ADDRESS = "MLFLOW_TRACKING_URI"
_log = logging.getLogger(__name__)


class MLflow:
    """A run named after the run's folder, in the experiment ``aerial_il`` (or ``MLFLOW_EXPERIMENT_NAME``)."""

    def __init__(self, run: Path) -> None:
        mlflow = importlib.import_module("mlflow")
        self._failure: type[Exception] = mlflow.exceptions.MlflowException
        address = os.environ.get(ADDRESS) or _own_store(run)
        try:
            self._client = mlflow.MlflowClient(tracking_uri=address)
            self._id = self._client.create_run(self._experiment(), run_name=run.name).info.run_id
        except self._failure as error:
            hint = f"Check {ADDRESS}, or leave out tracker=mlflow."
            raise InvalidValueError(f"tracker=mlflow could not start at {address} ({error}). {hint}") from error

    def _experiment(self) -> str:
        name = os.environ.get("MLFLOW_EXPERIMENT_NAME", EXPERIMENT)
        experiment = self._client.get_experiment_by_name(name)
        return experiment.experiment_id if experiment else self._client.create_experiment(name)

    def write(self, row: Mapping[str, float]) -> None:
        with self._warning():
            for name, value in row.items():
                if name != "step":
                    self._client.log_metric(self._id, name, value, step=int(row["step"]))

    def close(self) -> None:
        with self._warning():
            self._client.set_terminated(self._id)

    @contextmanager
    def _warning(self) -> Iterator[None]:
        """Say that MLflow does not answer, and let the training go on: metrics.jsonl has it all."""
        try:
            yield
        except self._failure as error:
            _log.warning("tracker=mlflow: %s", error)


def _own_store(run: Path) -> str:
    """Return the address of files in the run's folder, a store that MLflow keeps but wants to be asked for."""
    os.environ.setdefault("MLFLOW_ALLOW_FILE_STORE", "true")
    return (run / FOLDER).resolve().as_uri()
