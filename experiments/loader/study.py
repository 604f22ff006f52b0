"""The speed and the memory of training data: windows per second from every format, and sets that are large."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import h5py
import numpy as np

import aerial_il
from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.run.folder import read_metrics
from aerial_il.algorithms.supervised.training_set import Shuffle, TrainingSet, cut_windows, fit_interface, read_demos
from aerial_il.collection.collect import collect
from aerial_il.core import registry
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.dataset import open_dataset
from aerial_il.data.folder import link
from aerial_il.data.windows import Windows
from aerial_il.policies.mlp import MLP
from experiments.common.report import Report, Row, Target
from experiments.common.stopwatch import Arm, interleave

WINDOWS_PER_S, PEAK_MB, WAITED = 1e6, 2000.0, 5.0
IMAGES, SIDE = ("wrist_rgb", "base_rgb"), 64
PLAIN = MLP()
SEEING = BC(steps=60, batch_size=64, mixed_precision=True, validation=0.0)
ROBOT, TASK, ALOHA_FILES = "fa_hexa_arm4", "pick_place", 100
WRITTEN = {"lerobot": "data", "robomimic": "data.hdf5", "d4rl": "flat.hdf5"}
LARGE = """
import json, sys, time
started = time.perf_counter()
from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.supervised.training_set import prepare
from aerial_il.data.dataset import open_dataset
from aerial_il.policies.mlp import MLP
demos = BC().divide(open_dataset(sys.argv[1], states=False), MLP(), seed=0)
ready = prepare(demos, MLP(), batch_size=256, device="cpu", seed=0, initial=None)
for step in range(200):
    ready.training.gather(ready.order[step])
taken = time.perf_counter() - started
lines = dict(line.split(":", 1) for line in open("/proc/self/status"))
own, peak = (int(lines[name].split()[0]) / 1024 for name in ("RssAnon", "VmHWM"))
print(json.dumps({"windows": len(ready.training), "start_s": taken, "own_mb": own, "peak_mb": peak}))
"""
NOTES = (
    "Windows: minibatches of 256 in the order of training, with history, chunk and mask. Cut: as they were recorded. "
    "Normalised: as tensors, as training takes them. Processor time of one thread. All formats hold the same flights, "
    "ALOHA's a hundred of them with other fields; all take turns, and ratios to our own recordings are medians over "
    "turns, with the smallest and largest.",
    "Images: two cameras of 64 x 64. Decoded: once, while a dataset is opened, and kept; handed out: in minibatches of "
    "64, as they are learned from; both by processor time. Learned: by a policy end to end, on one thread, wall time; "
    "waited: share of it in which no minibatch was ready.",
    "Opened: wall time of opening and of reading all episodes once, in one turn.",
    "Large sets: a fresh process from its first import to its 200th minibatch of behaviour cloning. Own: memory at "
    "the end that is not backed by a file. Peak: the most memory at any time, torch's libraries and pages of files "
    "that the system may take back included. Flights of hover, of which many are links to the same files.",
)


@dataclass(frozen=True, kw_only=True)
class Loader:
    """Settings.

    Attributes:
        demonstrations: flights in each format. seen: flights with images. steps: minibatches of one turn.
        repetitions: turns.
        sizes: episodes of the large sets. seed: the first one flown. threads: of the simulation; 0 for all cores.
    """

    name: ClassVar[str] = "loader"
    question: ClassVar[str] = "How fast is training data handed out, and how much memory do large sets take?"

    demonstrations: int = 100
    seen: int = 20
    steps: int = 200
    repetitions: int = 5
    sizes: tuple[int, ...] = (1000, 5000, 20_000)
    seed: int = 0
    threads: int = 0

    def __post_init__(self) -> None:
        if min(self.demonstrations, self.seen, self.steps, self.repetitions, *self.sizes) < 1:
            raise InvalidValueError("loader needs demonstrations, seen, steps, repetitions and sizes of at least 1.")

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Time every format, and learn from large sets; see :class:`Study`."""
        started = time.perf_counter()
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix="aerial_il-", dir=folder) as scratch:
            formats, images = self._formats(Path(scratch)), self._images(Path(scratch))
            large = [{"episodes": size, **_learned_from(self._large(Path(scratch), size))} for size in self.sizes]
        return Report(
            study=self,
            targets=tuple(_targets(formats, images, large)),
            tables={"Windows per second": formats, "Images": [images], "Large sets": large},
            notes=NOTES,
            wall_time_s=time.perf_counter() - started,
        )

    def _formats(self, scratch: Path) -> list[Row]:
        own = self._flown(ROBOT, TASK, self.demonstrations, scratch / "own")
        places = {"mcap": own, "aloha": _aloha(own, scratch / "aloha"), "npz": _npz(own, scratch / "flat.npz")}
        for name, place in WRITTEN.items():
            places[name] = registry.module("format", name).write(open_dataset(own), scratch / place)
        arms, opened = dict[str, Arm](), dict[str, float]()
        for name, place in places.items():
            before = time.perf_counter()
            training, cut = _prepared(place)
            opened[name] = time.perf_counter() - before
            order = Shuffle(len(training), 256, seed=self.seed)
            batches = [order[step] for step in range(self.steps)]
            for what, take in (("cut", cut.__getitem__), ("normalised", training.gather)):
                arms[f"{name} {what}"] = Arm(
                    partial(_take, take, batches), units=256 * self.steps, clock=time.process_time
                )
        rates = interleave(arms, self.repetitions)
        return [_row(name, opened[name], rates) for name in places]

    def _images(self, scratch: Path) -> Row:
        """Return how fast images are decoded once, handed out, and learned from, and how long training waits."""
        seeing = MLP(images=IMAGES)
        place = self._flown(
            ROBOT, TASK, self.seen, scratch / "seen", cameras=("wrist", "base"), image_size=(SIDE, SIDE)
        )
        before, waited = time.process_time(), time.perf_counter()
        training, _ = _prepared(place, seeing)
        opened, wall = time.process_time() - before, time.perf_counter() - waited
        shuffle = Shuffle(len(training), SEEING.batch_size, seed=self.seed)
        batches, run = [shuffle[step] for step in range(self.steps)], scratch / "seeing"
        handed = Arm(
            partial(_take, training.gather, batches), units=SEEING.batch_size * self.steps, clock=time.process_time
        )
        SEEING.train(open_dataset(place, cameras=IMAGES, states=False), seeing, run=run, progress=False)
        learned = read_metrics(run)[-1]
        return {
            "images": len(IMAGES) * len(training),
            "opened_s": round(wall, 2),
            "decoded_per_s": round(len(IMAGES) * len(training) / opened),
            "handed_per_s": round(len(IMAGES) * float(np.median(interleave({"": handed}, self.repetitions)[""]))),
            "learned_per_s": round(len(IMAGES) * SEEING.batch_size * SEEING.steps / learned["elapsed_s"]),
            "waited_percent": round(100 * learned["wait_share"], 2),
        }

    def _flown(self, robot: str, task: str, count: int, out: Path, **rig: Any) -> Path:
        env = aerial_il.load_batch(robot, task, num_envs=min(count, 128), num_threads=self.threads, **rig)
        try:
            seeds = range(self.seed, self.seed + count)
            return collect(env, aerial_il.expert(robot, task), seeds, out, progress=False).folder.path
        finally:
            env.close()

    def _large(self, scratch: Path, size: int) -> Path:
        hover, out = scratch / "hover", scratch / f"hover_{size}"
        files = sorted((hover if hover.exists() else self._flown("quad", "hover", 128, hover)).glob("demos/*.mcap"))
        (out / "demos").mkdir(parents=True)
        for number in range(size):
            file = files[number % len(files)]
            link(file, out / "demos" / f"{number:06d}-{file.name}")
        return out


def _take(take: Callable[[np.ndarray], object], batches: Sequence[np.ndarray]) -> None:
    for batch in batches:
        take(batch)


def _prepared(place: Path, policy: MLP = PLAIN) -> tuple[TrainingSet, Windows]:
    layout, kept = read_demos(open_dataset(place, states=False, cameras=policy.images), policy)
    windows = cut_windows(kept, layout, policy)
    return TrainingSet(windows, fit_interface(layout, windows, policy)), windows


def _aloha(own: Path, out: Path) -> Path:
    """Write flights as ALOHA's recordings, a hundred of them, and return their folder."""
    out.mkdir()
    flights = list(open_dataset(own))
    for number in range(ALOHA_FILES):
        flight = flights[number % len(flights)]
        with h5py.File(out / f"episode_{number}.hdf5", "w") as file:
            file["observations/qpos"] = flight.flat_obs(flight.spec.observation.state_names)[:-1]
            file["action"] = flight.actions
    return out


def _npz(own: Path, out: Path) -> Path:
    """Write flights as transitions, and return the file."""
    flights = list(open_dataset(own))
    names = flights[0].spec.observation.state_names
    np.savez(
        out,
        obs=np.concatenate([f.flat_obs(names)[:-1] for f in flights]),
        acts=np.concatenate([f.actions for f in flights]),
        dones=np.concatenate([np.arange(len(f)) == len(f) - 1 for f in flights]),
    )
    return out


def _learned_from(place: Path) -> Row:
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-c", LARGE, str(place)]
    ended = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    return {name: round(value, 1) for name, value in json.loads(ended.stdout.splitlines()[-1]).items()}


def _row(name: str, opened_s: float, rates: dict[str, np.ndarray]) -> Row:
    normalised, own = rates[f"{name} normalised"], rates["mcap normalised"]
    ratio = normalised / own
    return {
        "format": name,
        "opened_s": round(opened_s, 2),
        "cut_per_s": round(float(np.median(rates[f"{name} cut"]))),
        "normalised_per_s": round(float(np.median(normalised))),
        "ratio_own": round(float(np.median(ratio)), 2),
        "range_own": f"{ratio.min():.2f}-{ratio.max():.2f}",
    }


def _targets(formats: list[Row], images: Row, large: list[Row]) -> Iterator[Target]:
    for row in formats:
        what = f"{row['format']}: normalised windows per second"
        yield Target(what, "at least", WINDOWS_PER_S, row["normalised_per_s"], "")
    yield Target("images decoded a second", "at least", images["learned_per_s"], images["decoded_per_s"], "")
    yield Target("training that waits for images", "at most", WAITED, images["waited_percent"], "%")
    for row in large:
        yield Target(f"{row['episodes']} episodes: peak memory", "at most", PEAK_MB, row["peak_mb"], "MB")
