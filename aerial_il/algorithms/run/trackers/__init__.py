"""Trackers to which the metrics of a run go as well: TensorBoard, Weights & Biases, MLflow; one file each.

Which of them is said once, around a training run, since no weight depends on it::

    with track_with(["tensorboard", "wandb"]):
        algorithm.train(...)
"""

import importlib.util
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Protocol

from aerial_il.algorithms.run.trackers import mlflow, tensorboard, wandb
from aerial_il.core.errors import InvalidValueError, UnknownNameError


class Tracker(Protocol):
    """Receives the rows of a run's metrics, from the first one each time the run is opened."""

    def write(self, row: Mapping[str, float]) -> None:
        """Take one row: ``step`` and named finite numbers."""
        ...

    def close(self) -> None:
        """Write what is pending and let go."""
        ...


TRACKERS: Mapping[str, Callable[[Path], Tracker]] = {
    "tensorboard": tensorboard.TensorBoard,
    "wandb": wandb.WeightsAndBiases,
    "mlflow": mlflow.MLflow,
}
EXTRAS = ("wandb", "mlflow")  # optional extras of the package, called as what they install
FOLDERS = (tensorboard.FOLDER, wandb.FOLDER, mlflow.FOLDER)  # of a run's folder, which its trackers may write
DEFAULT = ("tensorboard",)

_chosen: ContextVar[tuple[str, ...]] = ContextVar("trackers", default=DEFAULT)


@contextmanager
def track_with(names: Sequence[str]) -> Iterator[None]:
    """Let the runs that are opened in the ``with`` block be followed by the trackers ``names``.

    Raises:
        UnknownNameError: there is no such tracker.
        InvalidValueError: its package is not installed.
    """
    for name in names:
        _require(name)
    token = _chosen.set(tuple(dict.fromkeys(names)))
    try:
        yield
    finally:
        _chosen.reset(token)


def open_trackers(run: Path, rows: Sequence[Mapping[str, float]]) -> tuple[Tracker, ...]:
    """Open the chosen trackers on the folder of a run, and tell them what it has reported so far."""
    opened = tuple(TRACKERS[name](run) for name in _chosen.get())
    for tracker in opened:
        for row in rows:
            tracker.write(row)
    return opened


def _require(name: str) -> None:
    if name not in TRACKERS:
        raise UnknownNameError("tracker", name, TRACKERS)
    if name in EXTRAS and not _installed(name):
        others = ", ".join(other for other in TRACKERS if other != name)
        raise InvalidValueError(
            f"tracker={name} needs a package that is not installed. Install it: pip install 'aerial-il[{name}]'; "
            f"or choose another tracker: {others}."
        )


def _installed(name: str) -> bool:
    """Whether a package is there; a folder of that name, as trackers leave them, is none."""
    spec = importlib.util.find_spec(name)
    return spec is not None and spec.origin is not None
