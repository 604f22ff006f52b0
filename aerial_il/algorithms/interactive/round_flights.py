"""Flights of the rounds of an interactive run: recorded all or none, labelled ones gathered in one dataset."""

import math
import os
import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from aerial_il.algorithms.interactive.costs import FlightCosts
from aerial_il.algorithms.interactive.problem import Collected, InteractiveProblem, Operator
from aerial_il.core.bounded import read_json
from aerial_il.core.contracts import Policy
from aerial_il.core.files import sync_folder, write_json
from aerial_il.data.dataset import open_dataset
from aerial_il.data.episode import Episode
from aerial_il.data.folder import FAILURES, KINDS, DatasetFolder
from aerial_il.data.recording.writer import write_episode

ROUNDS, DATASET = "rounds", "dataset"
FLIGHTS, ALONE, TURNS = "flights", "alone", "turns.json"
# seeds of flights are far from those of demonstrations (from 0) and of evaluations (from 10,000)
FIRST_SEED, SEEDS_PER_RUN = 1_000_000, 100_000


class RoundFlights:
    """What a run has flown, round by round, on disk; a round that is there is never flown again.

    Args:
        run: folder of the run. problem: what it learns on. demos: the demonstrations that it began with.
    """

    def __init__(self, run: Path, problem: InteractiveProblem, demos: Sequence[Episode]) -> None:
        self._run, self._problem, self._settings, self._demos = run, problem, problem.settings, demos

    def place(self, number: int) -> Path:
        """Return the folder of a round."""
        return self._run / ROUNDS / f"{number:03d}"

    def labelled(self, number: int, pilot: Callable[[], Policy]) -> None:
        """Have the labelled flights of a round, those that are there, else flown by ``pilot()``, in the dataset."""
        folder = self.place(number) / FLIGHTS
        if not folder.exists():
            self._record(folder, pilot(), range(self._settings.episodes), number=number, name=self._settings.name)
        self._aggregate(number)

    def alone(self, number: int, learner: Policy | None, episodes: int) -> list[Episode]:
        """Return the flights that learners made alone in all rounds up to this one, having this round's made."""
        folder = self.place(number) / ALONE
        if not folder.exists():
            assert learner is not None, "round 0 has none, and asks for none"
            which = range(self._settings.episodes, self._settings.episodes + episodes)
            self._record(folder, learner, which, number=number, name="learner")
        return [flight for k in range(1, number + 1) for flight in self._read(self.place(k) / ALONE)]

    def in_turn(self, number: int, pilots: Iterable[Policy]) -> list[FlightCosts]:
        """Have one pilot after another fly the starts of a round that none has solved; only successes are kept.

        Returns:
            What the flights of each pilot cost; the last ones need not have flown.
        """
        place = self.place(number)
        if not (place / FLIGHTS).exists():
            self._record_in_turn(number, pilots)
        self._aggregate(number)
        return _read_turns(place)

    def read(self, number: int) -> tuple[list[Episode], FlightCosts]:
        """Return the labelled flights of a round that are long enough to learn from, and what all of them cost."""
        place, settings = self.place(number), self._settings
        flights = self._read(place / FLIGHTS)
        turns = _read_turns(place) if (place / TURNS).exists() else [FlightCosts.of(flights)]
        useful = [f for f in flights if settings.learns_from(f) and len(f) >= self._problem.policy.chunk]
        return useful, sum(turns, start=FlightCosts())

    def clear(self) -> None:
        """Remove what an earlier run has flown here."""
        for name in (ROUNDS, DATASET):
            shutil.rmtree(self._run / name, ignore_errors=True)

    def _record(self, folder: Path, pilot: Policy, which: range, *, number: int, name: str) -> None:
        """Record flights, all or none: a kill in between leaves nothing, and the next call flies the same.

        An operator goes on after the flights that were finished.
        """
        aside, expert = folder.with_name(f"{folder.name}.flying"), self._problem.expert
        seeds, tags = self._seeds(number, which), self._tags(number)
        if isinstance(expert, Operator):
            expert.record(self._problem.env, pilot, aside, seeds=seeds, tags=tags)
        else:
            shutil.rmtree(aside, ignore_errors=True)
            self._collect(pilot, list(seeds), aside, tags, name)
        os.replace(aside, folder)
        sync_folder(folder.parent)

    def _record_in_turn(self, number: int, pilots: Iterable[Policy]) -> None:
        """Record the successes of a round, all or none, and what each turn cost."""
        place, left = self.place(number), list(self._seeds(number, range(self._settings.episodes)))
        aside, turns = place / f"{FLIGHTS}.flying", list[FlightCosts]()
        shutil.rmtree(aside, ignore_errors=True)
        kept = DatasetFolder(aside)
        kept.claim(self._problem.env.spec)
        for turn, pilot in enumerate(pilots):
            flown = DatasetFolder(place / "turn.flying")
            shutil.rmtree(flown.path, ignore_errors=True)
            tags = {**self._tags(number), "turn": turn}
            collected = self._collect(pilot, left, flown.path, tags, self._settings.name)
            shutil.rmtree(flown.path / FAILURES, ignore_errors=True)
            kept.adopt(flown)
            shutil.rmtree(flown.path)
            solved = len(collected.demos)
            turns.append(FlightCosts(len(left), solved, collected.steps, solved_alone=solved))
            left = sorted(collected.failures)
            if not left:
                break
        kept.write_index(self._problem.env.spec)
        write_json(place / TURNS, [asdict(costs) for costs in turns])
        os.replace(aside, place / FLIGHTS)
        sync_folder(place)

    def _collect(self, pilot: Policy, seeds: list[int], out: Path, tags: Mapping[str, Any], name: str) -> Collected:
        """Record the flights of ``pilot`` in ``out``; none takes longer than ``patience`` of the demonstrations'."""
        problem, longest = self._problem, math.ceil(self._settings.patience * max(map(len, self._demos))) or None
        options = {"progress": problem.progress, "longest": longest}
        return problem.collect(problem.env, pilot, seeds, out, policy_name=name, settings=tags, **options)

    def _seeds(self, number: int, which: range) -> range:
        """Return the seeds of some flights of a round."""
        first = FIRST_SEED + SEEDS_PER_RUN * self._problem.seed + number * max(1, self._settings.seeds_per_round)
        return range(first + which.start, first + which.stop)

    def _tags(self, number: int) -> dict[str, Any]:
        return {"algorithm": self._settings.name, "run_seed": self._problem.seed, "round": number}

    def _read(self, folder: Path) -> list[Episode]:
        if not any(DatasetFolder(folder).files(kind) for kind in KINDS):
            return []
        return list(open_dataset(folder, cameras=self._problem.policy.images, failures=True, states=False))

    def _aggregate(self, number: int) -> None:
        """Add the flights of a round to the dataset on disk, which starts with the demonstrations."""
        dataset, spec = DatasetFolder(self._run / DATASET), self._problem.env.spec
        dataset.claim(spec)
        for episode in self._demos:
            if dataset.find(episode.uid) is None:
                write_episode(episode, dataset.file(episode.uid))
        dataset.adopt(DatasetFolder(self.place(number) / FLIGHTS))
        dataset.write_index(spec)


def _read_turns(place: Path) -> list[FlightCosts]:
    """Return what each pilot's flights of a round cost."""
    return [FlightCosts(**costs) for costs in read_json(place / TURNS)]
