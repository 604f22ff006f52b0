"""A run's folder: its configuration, metrics, checkpoints and finished policy, and its trackers.

``metrics.jsonl`` is the truth: one row per report, in order of steps. A resumed run cuts it back to where its
checkpoint was taken, so no step is missing or logged twice; the trackers are sent all of it anew.
"""

from __future__ import annotations

import fcntl
import json
import math
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from aerial_il.algorithms.run.differences import differences
from aerial_il.algorithms.run.trackers import FOLDERS as TRACKER_FOLDERS
from aerial_il.algorithms.run.trackers import open_trackers
from aerial_il.core import checkpoint
from aerial_il.core.bounded import parse_json, parse_yaml, read_json, read_text, read_yaml
from aerial_il.core.checkpoint import Checkpoint
from aerial_il.core.composition import dotted
from aerial_il.core.errors import CheckpointError, InvalidValueError
from aerial_il.core.files import PlainDumper, open_own, write_atomic, write_json
from aerial_il.core.places import claim_folder
from aerial_il.core.provenance import provenance
from aerial_il.core.renamed import moved
from aerial_il.policies import FINAL

if TYPE_CHECKING:
    from aerial_il.core.contracts import BatchEnv
    from aerial_il.policies.parts.chunk_policy import ChunkPolicy

CONFIG, PROVENANCE, METRICS = "config.yaml", "provenance.json", "metrics.jsonl"
COMMAND = "command.json"  # what was typed, and the dataset; whoever trains from the command line writes it
BEST = "best"  # folder of the policy that did best in rollouts on the way; the finished one is never replaced by it
START_AGAIN = "Put it back, start again with resume=false, or choose another run=NAME."
NEWER = ("environment.", "policy.name")  # of which earlier versions kept less; that is not compared
PRIOR = "prior"  # folder of the clone that a run goes on from, which is trained before the run is opened
REWARD = "reward"  # folder of the reward that a run has learned, where it learns one


class RunFolder:
    """Where one training run keeps everything; open it with :meth:`open`.

    Attributes:
        path: the folder.
        finished: whether the run has saved its policy.
        resumed: newest valid checkpoint of an earlier call, or None.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.finished = _is_valid(path / FINAL)
        self.resumed = found[1] if (found := checkpoint.latest(path)) else None
        if not self.finished:
            _cut(path / METRICS, _reported(path, self.resumed.state) if self.resumed else 0)
        with _writing(path / METRICS):
            self._metrics = open_own(path / METRICS)  # closed by close()
        self._trackers = open_trackers(path, read_metrics(path))

    @staticmethod
    @contextmanager
    def open(
        path: str | os.PathLike[str], config: Mapping[str, Any], *, cadence: tuple[str, ...] = (), resume: bool = True
    ) -> Iterator[RunFolder]:
        """Lock the folder, check or write its configuration, and find where to go on.

        Args:
            path: the folder; made if missing.
            config: plain values that determine the run.
            cadence: keys (of any depth) that may change between calls, since no weight depends on them.
            resume: go on from the newest checkpoint; otherwise earlier results of the folder are deleted.

        Raises:
            InvalidValueError: another process uses the folder, or it belongs to another configuration.
            CheckpointError: all its checkpoints are damaged, or it cannot be written.
        """
        path = claim_folder(path, (PROVENANCE, COMMAND, f"{PRIOR}/{PROVENANCE}", f"{checkpoint.FOLDER}/*/*"), key="run")
        with _writing(path):
            path.mkdir(parents=True, exist_ok=True)
        with _locked(path):
            if not resume:
                _clear(path)
            _claim(path, config, cadence)
            run = RunFolder(path)
            try:
                yield run
            finally:
                run.close()

    def log(self, step: int, values: Mapping[str, float]) -> None:
        """Append one row for ``step``; numbers that are not finite, such as a mean of nothing, are left out."""
        row = {"step": step, **{k: float(v) for k, v in values.items() if math.isfinite(v)}}
        with _writing(self.path / METRICS):
            self._metrics.write((json.dumps(row, allow_nan=False) + "\n").encode())
            self._metrics.flush()
            for tracker in self._trackers:
                tracker.write(row)

    def save(self, step: int, saved: Checkpoint, *, keep: int) -> None:
        """Take a checkpoint after ``step`` steps, remember the length of the metrics, delete the oldest ones."""
        with _writing(self.path / METRICS):
            os.fsync(self._metrics.fileno())
        state = {**saved.state, "metrics_bytes": self._metrics.tell()}
        checkpoint.save(checkpoint.step_folder(self.path, step), Checkpoint(saved.arrays, state, saved.config))
        checkpoint.prune(self.path, keep)

    def finish(self, policy: ChunkPolicy) -> None:
        """Save the trained policy; from now on the run is finished."""
        with _writing(self.path / METRICS):
            os.fsync(self._metrics.fileno())
        policy.save(self.path / FINAL)

    def close(self) -> None:
        self._metrics.close()
        for tracker in self._trackers:
            tracker.close()


def read_metrics(run: str | os.PathLike[str]) -> list[dict[str, float]]:
    """Return the rows of a run's metrics; a last row cut short by a kill is left out."""
    file = Path(run) / METRICS
    try:
        lines = read_text(file).splitlines(keepends=True)
        rows = [parse_json(line) for line in lines if line.endswith("\n")]
        for row in rows:
            if not math.isfinite(row["step"]) or not all(isinstance(value, int | float) for value in row.values()):
                raise ValueError(f"a row is not one of metrics: {row}")
        return rows
    except FileNotFoundError:
        return []
    except (OSError, ValueError, AttributeError, LookupError, TypeError) as error:
        raise CheckpointError(file, f"is damaged ({error}).", START_AGAIN) from error


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        hint = "Earlier checkpoints are intact: free some space and run the same command again."
        raise CheckpointError(path, f"cannot be written ({error.strerror}).", hint) from error


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    with _writing(path / ".lock"), open_own(path / ".lock") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise InvalidValueError(f"{path} is being trained by another process. Choose another run=NAME.") from error
        yield


def _is_valid(folder: Path) -> bool:
    try:
        return checkpoint.is_sealed(folder) and checkpoint.load(folder) is not None
    except CheckpointError as error:
        checkpoint.log.warning("Finished policy refused, taking it from the last checkpoint. %s", error)
        return False


def _reported(path: Path, state: Mapping[str, Any]) -> int:
    """Return how long the metrics were when a checkpoint was taken."""
    length = state.get("metrics_bytes")
    if not isinstance(length, int) or length < 0:
        raise CheckpointError(path / checkpoint.FOLDER, "does not say how long the metrics were.", START_AGAIN)
    return length


def _cut(path: Path, length: int) -> None:
    """Shorten a file, which may not exist yet, to ``length`` bytes."""
    with _writing(path), open_own(path) as file:
        file.truncate(min(length, file.tell()))


def _clear(path: Path) -> None:
    for name in (checkpoint.FOLDER, *TRACKER_FOLDERS, FINAL, BEST, REWARD):
        shutil.rmtree(path / name, ignore_errors=True)
    for name in (CONFIG, METRICS, PROVENANCE):
        (path / name).unlink(missing_ok=True)


def flown_in(env: BatchEnv) -> dict[str, Any]:
    """Return what decides a run of the environment that it flies in, as plain values."""
    of_spec = {key: getattr(env.spec, key) for key in ("robot", "task", "tier", "controller", "max_steps")}
    return {**of_spec, "ends_at_success": bool(env.ends_at_success)}


def _claim(path: Path, config: Mapping[str, Any], cadence: tuple[str, ...]) -> None:
    """Write the configuration of a new run; refuse another one where there are results already."""
    text = yaml.dump(dict(config), Dumper=PlainDumper, sort_keys=False)
    if (path / checkpoint.FOLDER).exists() and (path / CONFIG).exists():
        before, now = _flat(_settings(path), cadence), _flat(parse_yaml(CONFIG, text), cadence)
        if old := [key for key in before if _has_moved(key, now)]:
            raise InvalidValueError(
                f"{path} was started by an earlier version, which called settings otherwise ({', '.join(old)}). Its "
                "policy can be flown; to train on, choose another run=NAME, or start again with resume=false."
            )
        now = {key: value for key, value in now.items() if key in before or not key.startswith(NEWER)}
        if differing := differences(before, now, dataset=_dataset(path)):
            changes = "; ".join(differing)
            raise InvalidValueError(f"{path} holds another run ({changes}). Choose another run=NAME or resume=false.")
    with _writing(path / CONFIG):
        write_atomic(path / CONFIG, text)
        write_json(path / PROVENANCE, provenance())


def _dataset(path: Path) -> str | None:
    """Return where the demonstrations of a run lay, if it was started on the command line."""
    try:
        found = read_json(path / COMMAND)["dataset"]["path"]
    except (OSError, ValueError, LookupError, TypeError):
        return None
    return found if isinstance(found, str) else None


def _settings(path: Path) -> dict[str, Any]:
    """Return the configuration that a run was started with."""
    try:
        settings = read_yaml(path / CONFIG)
        if not isinstance(settings, dict):
            raise ValueError("it holds no settings")
        return settings
    except (OSError, ValueError) as error:
        raise CheckpointError(path / CONFIG, f"is damaged ({error}).", START_AGAIN) from error


def _has_moved(key: str, now: Mapping[str, Any]) -> bool:
    """Whether ``key`` is what an earlier version called a setting that is among those of ``now`` by another name."""
    known = {each.removeprefix("settings.") for each in now}
    return key not in now and moved(key.removeprefix("settings."), known) is not None


def _flat(tree: Mapping[str, Any], cadence: tuple[str, ...]) -> dict[str, Any]:
    """Return dotted keys -> values, without empty groups and what may change between calls."""
    leaves = dotted(tree).items()
    return {key: value for key, value in leaves if value != {} and not {*key.split(".")} & {*cadence}}
