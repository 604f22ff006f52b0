"""A search by Optuna: each trial is a run; its rollouts on the way (evaluate_every=) tell which are stopped early.

The space is written as Hydra writes it: ``interval(0,1)``, ``tag(log,interval(1e-4,1e-2))``, ``range(5,50,5)``,
``choice(a,b)`` or ``a,b``. What was tried is kept in the sweep's folder; the same command goes on where it was killed.
"""

import fcntl
import math
import subprocess
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from aerial_il.cli.sweeps.board import Board
from aerial_il.cli.sweeps.job import Job, start, stop
from aerial_il.cli.sweeps.optional import require
from aerial_il.core.errors import AerialError, InvalidValueError
from aerial_il.core.files import open_own
from aerial_il.evaluation.curves import read_rows
from aerial_il.evaluation.training_run import METRICS
from aerial_il.workflows.parts.names import at_least
from aerial_il.workflows.spelling import literal

STUDY, JOURNAL, LOCK = "search", "search.journal", "search.lock"
ASKED = "asked"  # of a study: what was searched for
POLL_S = 0.2
_MOST_TRIALS = 100_003  # seeds of searches lie so far apart


@dataclass(frozen=True)
class Optuna:
    """How a search goes.

    Attributes:
        trials: in all, those of earlier calls among them.
        jobs: at a time; with more than one, what is tried next depends on which ends first.
        metric: a number of the run's metrics; its last value judges a trial.
        minimize: whether less of it is better.
        startup: trials drawn at random, and evaluations compared with, before any is stopped early.
        seed: of what is drawn.
        threads: of torch and BLAS in each job.
        cores: for the flights of each.
    """

    trials: int = 20
    jobs: int = 1
    metric: str = "evaluate/success"
    minimize: bool = False
    startup: int = 5
    seed: int = 0
    threads: int = 1
    cores: int = 1

    def __post_init__(self) -> None:
        at_least(self, trials=1, jobs=1, startup=0, seed=0, threads=1, cores=1)

    def search(self, command: str, space: Mapping[str, Any], fixed: Sequence[str], target: str, folder: str) -> Board:
        """Try points of ``space`` until there are enough, and print the best one.

        Args:
            command: what a trial runs. space: key -> Hydra's sweep over its values. fixed: its other words.
            target: the key that takes a trial's folder. folder: of the search.

        Returns:
            How the jobs ended; a trial that was stopped early counts as one that did its work.
        """
        require("optuna", extra="search")
        import optuna

        optuna.logging.set_verbosity(optuna.logging.WARNING)
        asked = {
            "command": command, "words": [*map(str, fixed)], "space": {key: str(value) for key, value in space.items()},
            "metric": self.metric, "minimize": self.minimize,
        }  # fmt: skip
        with _alone(Path(folder)):
            return self._searched(asked, command, space, fixed, target, folder)

    def _searched(
        self, asked: Mapping[str, Any], command: str, space: Mapping[str, Any], fixed: Sequence[str], target: str,
        folder: str,
    ) -> Board:  # fmt: skip
        study = self._study(Path(folder))
        _check(study, asked, folder)
        search = _Search(study, self, command, {k: distribution(k, v) for k, v in space.items()}, fixed, target, folder)
        search.run()
        finished = [trial for trial in study.trials if trial.value is not None]
        if finished:
            words = " ".join(f"{key}={value}" for key, value in study.best_trial.params.items())
            best = f"trial={study.best_trial.number}, {self.metric} {study.best_value:g}"
            print(f"Best of {len(finished)}: {best}: {words}")
        return search.board

    def sampler(self, number: int) -> Any:
        """Return what draws the trial of that number: seeded anew, so that a search that was killed draws the same."""
        from optuna.samplers import TPESampler

        seed = (self.seed * _MOST_TRIALS + number) % 2**32  # the largest that it takes
        return TPESampler(seed=seed, n_startup_trials=self.startup)

    def _study(self, folder: Path) -> Any:
        import optuna
        from optuna.storages import JournalStorage
        from optuna.storages.journal import JournalFileBackend

        folder.mkdir(parents=True, exist_ok=True)
        return optuna.create_study(
            study_name=STUDY,
            storage=JournalStorage(JournalFileBackend(str(folder / JOURNAL))),
            pruner=optuna.pruners.MedianPruner(n_startup_trials=self.startup),
            direction="minimize" if self.minimize else "maximize",
            load_if_exists=True,
        )


@dataclass(eq=False)
class _Search:
    """Trials under way: their runs' metrics are read as they are written, and reported."""

    study: Any
    settings: Optuna
    command: str
    space: Mapping[str, Any]
    fixed: Sequence[str]
    target: str
    folder: str
    board: Board = field(default_factory=lambda: Board([]))
    _running: dict[Job, tuple[Any, subprocess.Popen[bytes]]] = field(default_factory=dict)
    _reported: dict[Job, int] = field(default_factory=dict)  # how many values of a trial

    def run(self) -> None:
        from optuna.trial import Trial, TrialState

        left = [Trial(self.study, t._trial_id) for t in self.study.get_trials(states=[TrialState.RUNNING])]
        try:
            while self._running or left or self._count() < self.settings.trials:
                while len(self._running) < self.settings.jobs and (left or self._count() < self.settings.trials):
                    self._start(left.pop(0) if left else self._ask())
                for job in list(self._running):
                    self._look_at(job)
                time.sleep(POLL_S)
        finally:
            stop(process for _, process in self._running.values())

    def _count(self) -> int:
        return len(self.study.get_trials(deepcopy=False))

    def _ask(self) -> Any:
        self.study.sampler = self.settings.sampler(self._count())
        return self.study.ask(dict(self.space))

    def _start(self, trial: Any) -> None:
        from optuna.trial import TrialState

        folder = f"{self.folder}/trial={trial.number}"
        tried = (f"{key}={'null' if value is None else value}" for key, value in trial.params.items())
        words = (*self.fixed, *tried, f"{self.target}={literal(folder)}")
        job = Job(self.command, words, folder)
        self.board.jobs = (*self.board.jobs, job)
        self.board.started(job)
        try:
            process = start(job, threads=self.settings.threads, cores=self.settings.cores)
        except AerialError as error:
            self.study.tell(trial, state=TrialState.FAIL)
            self.board.ended(job, 1, str(error))
        else:
            reported = self.study.get_trials(deepcopy=False)[trial.number].intermediate_values
            self._running[job], self._reported[job] = (trial, process), len(reported)

    def _look_at(self, job: Job) -> None:
        """Report what a run has reached since; stop it where it falls behind, and tell how it ended."""
        from optuna.trial import TrialState

        trial, process = self._running[job]
        status, values = process.poll(), self._values(job)
        for step, value in values[self._reported[job] :]:
            trial.report(value, step)
        fresh, self._reported[job] = len(values) > self._reported[job], len(values)
        if status is None and not (fresh and trial.should_prune()):
            return
        del self._running[job]
        if status is None:
            stop([process])
            self.study.tell(trial, state=TrialState.PRUNED)
            print(f"{job.name}: stopped early at step {values[-1][0]}, {self.settings.metric} {values[-1][1]:g}")
            status = 0
        elif status == 0 and values:
            self.study.tell(trial, values[-1][1])
        else:
            self.study.tell(trial, state=TrialState.FAIL)
        lacking = "" if values or status else f"no {self.settings.metric} in its metrics: set evaluate_every=STEPS"
        self.board.ended(job, 2 if lacking else status, lacking)

    def _values(self, job: Job) -> list[tuple[int, float]]:
        """Return the steps and values of the metric that a run has written so far."""
        file = Path(job.folder) / METRICS
        rows = read_rows(file) if file.exists() else ()
        return [(int(row["step"]), float(row[self.settings.metric])) for row in rows if self.settings.metric in row]


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Search in a folder in which nobody else does."""
    folder.mkdir(parents=True, exist_ok=True)
    with open_own(folder / LOCK) as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InvalidValueError(
                f"{folder}: another process searches there. Wait for it; sweeper.jobs=N runs several trials at a time."
            ) from None
        yield


def _check(study: Any, asked: Mapping[str, Any], folder: str) -> None:
    """Refuse to go on with a search for something else."""
    before = study.user_attrs.get(ASKED)
    if before is None:
        study.set_user_attr(ASKED, dict(asked))
    elif differing := [key for key in asked if before.get(key) != asked[key]]:
        said = "; ".join(f"{key} {before.get(key)} there, {asked[key]} now" for key in differing)
        raise InvalidValueError(f"{folder} holds another search ({said}): choose another folder for this one.")


def distribution(key: str, sweep: Any) -> Any:
    """Return Optuna's distribution of what Hydra read as a sweep.

    Raises:
        InvalidValueError: it is a sweep of another kind, such as ``glob(...)``.
    """
    from hydra.core.override_parser.types import ChoiceSweep, IntervalSweep, RangeSweep
    from optuna.distributions import CategoricalDistribution, FloatDistribution

    log = "log" in getattr(sweep, "tags", ())
    if isinstance(sweep, ChoiceSweep):
        return CategoricalDistribution([_plain(value) for value in sweep.list])
    if isinstance(sweep, IntervalSweep) and sweep.start is not None and sweep.end is not None:
        return FloatDistribution(float(sweep.start), float(sweep.end), log=log)
    if isinstance(sweep, RangeSweep) and sweep.start is not None and sweep.stop is not None:
        return _of_range(key, sweep.start, sweep.stop, sweep.step, log=log)
    raise InvalidValueError(f"{key}: a search takes interval(A,B), range(A,B,STEP), choice(A,B) or A,B.")


def _of_range(key: str, start: float, stop: float, step: float, *, log: bool) -> Any:
    """Return the distribution of what ``range(start,stop,step)`` lists: ``stop`` is not part of it."""
    from optuna.distributions import FloatDistribution, IntDistribution

    count = math.ceil(round((stop - start) / step, 9)) if step > 0 else 0
    if count < 1:
        raise InvalidValueError(f"{key}: range({start},{stop},{step}) is empty; a search goes up, by a positive step.")
    if all(float(number).is_integer() for number in (start, step)):
        first, by = int(start), int(step)
        return IntDistribution(first, first + (count - 1) * by, step=1 if log else by, log=log)
    if log:
        raise InvalidValueError(
            f"{key}: a logarithmic range has whole numbers; type tag(log,interval({start},{stop}))."
        )
    return FloatDistribution(float(start), round(float(start + (count - 1) * step), 12), step=float(step))


def _plain(value: Any) -> Any:
    """Return a value as it is typed again."""
    from hydra.core.override_parser.types import QuotedString

    if isinstance(value, QuotedString):
        return value.with_quotes()
    return value if isinstance(value, bool | int | float | str) or value is None else str(value).replace(" ", "")
