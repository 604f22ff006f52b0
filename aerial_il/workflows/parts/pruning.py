"""Put away a training run that nobody wants any more; nothing but a run, and none that is being trained."""

import fcntl
import os
import shutil
from pathlib import Path

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.files import open_own
from aerial_il.evaluation.run_collection import TRASH, inner_runs
from aerial_il.evaluation.training_run import TrainingRun, is_run

OWN = {"prior", "reward"}  # folders of a run that are runs themselves, and its own


def prune(run: TrainingRun, folder: Path, *, delete: bool) -> str:
    """Move a run below ``folder`` into its trash, or remove it; return a line that says what was done.

    Raises:
        InvalidValueError: it is a link, is ``folder`` itself, or lies elsewhere, as the trash does.
    """
    inside = folder.resolve() in run.path.resolve().parents
    if run.path.is_symlink() or not inside or not is_run(run.path):
        raise InvalidValueError(f"{run.path} is not pruned: it is a link, or not a run below {folder}.")
    if others := [place for place in inner_runs(run.path) if place.name not in OWN]:
        return f"{run.path}: left alone, another run lies in it: {others[0]}"
    with open_own(run.path / ".lock") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return f"{run.path}: left alone, it is being trained"
        if delete:
            shutil.rmtree(run.path)
            return f"{run.path}: deleted"
        place = _free(folder / TRASH / os.path.relpath(run.path, folder))
        if Path(os.path.realpath(place.parent)) != folder.resolve() / place.parent.relative_to(folder):
            raise InvalidValueError(f"{run.path} is not moved: {place.parent} is, or lies behind, a link.")
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.move(run.path, place)
        return f"{run.path}: moved to {place}"


def _free(place: Path) -> Path:
    """Return ``place``, or the first of its name with a number that is not there yet."""
    names = (place, *(place.with_name(f"{place.name}.{k}") for k in range(1, 10_000)))
    return next(name for name in names if not name.exists())
