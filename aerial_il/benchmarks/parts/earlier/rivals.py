"""This engine beside that of an earlier commit: each flies the same in a process of its own, turn by turn."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aerial_il.benchmarks.parts.earlier import flown
from aerial_il.benchmarks.parts.earlier.checkout import Checkout, Peer, turns
from aerial_il.benchmarks.parts.reporting.report import Row
from aerial_il.benchmarks.parts.timing.ceiling import physics_alone

SCRIPT = Path(flown.__file__).read_text(encoding="utf-8")
OURS, THEIRS = "ours", "parent"
FLIGHT_STEPS = 300  # control steps of each world: whole flights, for contacts are what they cost most in


@dataclass(frozen=True)
class Rivals:
    """Both processes.

    Attributes:
        peers: name -> process. repetitions: turns of each. num_envs: worlds of a batch. threads: of the simulation.
    """

    peers: Mapping[str, Peer]
    repetitions: int
    num_envs: int
    threads: int

    def know(self, robot: str, task: str) -> bool:
        """Whether both have a cell: the earlier commit lacks those that came later."""
        return all(peer.ask("knows", robot=robot, task=task) for peer in self.peers.values())

    def flights(self, robot: str, task: str, *, seed: int) -> Row:
        """Return how fast both fly a cell, many worlds and one alone, the ratios, and the latter's ceiling."""
        cell = {"robot": robot, "task": task, "threads": self.threads, "seed": seed, "steps": FLIGHT_STEPS}
        many = turns(self.peers, self.repetitions, "flight", num_envs=self.num_envs, **cell)
        alone = turns(self.peers, self.repetitions, "flight", num_envs=1, **cell)
        for peer in self.peers.values():
            peer.ask("done", robot=robot, task=task)
        physics = physics_alone(robot, task, seed=seed, steps=FLIGHT_STEPS, repetitions=self.repetitions)
        return {
            **_compared("flights", many, "flights"),
            **_compared("env", many, "env"),
            **(single := _compared("alone", alone, "env")),
            "physics_alone": round(physics),
            "ceiling": round(physics / single["parent_alone"], 2),
        }

    def collecting(self, robot: str, task: str, *, seed: int, episodes: int) -> Row:
        """Return how many demonstrations a minute both record, and the ratio."""
        cell = {"robot": robot, "task": task, "threads": self.threads, "seed": seed}
        found = turns(self.peers, 2, "collected", num_envs=self.num_envs, episodes=episodes, **cell)
        return _compared("collected", {name: [{"": rate} for rate in rates] for name, rates in found.items()}, "")


@contextmanager
def rivals(parent: Path, *, repetitions: int, num_envs: int, threads: int) -> Iterator[Rivals]:
    """Keep both processes up as long as the context lasts."""
    with Checkout.here().serve(SCRIPT) as ours, Checkout(parent).serve(SCRIPT) as theirs:
        yield Rivals({OURS: ours, THEIRS: theirs}, repetitions, num_envs, threads)


def first_flights(parent: Path | None, robot: str, task: str, *, num_envs: int, threads: int, times: int) -> Row:
    """Return how long a first control step takes in a fresh process, median; one before compiles what is missing."""
    sides = {OURS: Checkout.here()} | ({THEIRS: Checkout(parent)} if parent else {})
    row: Row = {"robot": robot, "task": task}
    for name, checkout in sides.items():
        taken = []
        for _ in range(times + 1):
            with checkout.serve(SCRIPT) as peer:
                taken.append(peer.ask("first", robot=robot, task=task, num_envs=num_envs, threads=threads))
        row[f"{name}_s"] = round(float(np.median(taken[1:])), 2)
        row[f"{name}_largest_s"] = round(max(taken[1:]), 2)
    return row


def _compared(name: str, found: Mapping[str, list[Any]], key: str) -> Row:
    """Return both medians, the median ratio of the turns and its range."""
    ours, theirs = (np.array([turn[key] for turn in found[side]]) for side in (OURS, THEIRS))
    ratio = ours / theirs
    return {
        f"{name}_per_{'min' if name == 'collected' else 's'}": round(float(np.median(ours))),
        f"parent_{name}": round(float(np.median(theirs))),
        f"ratio_{name}": round(float(np.median(ratio)), 3),
        f"range_{name}": f"{ratio.min():.2f}-{ratio.max():.2f}",
    }
