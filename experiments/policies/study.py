"""Time that each policy takes to act, against the tick of the control loop, and to learn, against a DataLoader.

The expert's demonstrations give the observations and the minibatches; weights are random, for time does not depend on
them. In learning, all arms take the same optimisation step of the same network and differ in who gathers the
minibatch. The arms take turns, and ratios are formed within a turn.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import ClassVar, cast

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

import aerial_il
from aerial_il import policies
from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.supervised.learner import Learner
from aerial_il.algorithms.supervised.training_set import Shuffle, TrainingSet, cut_windows, fit_interface, read_demos
from aerial_il.collection.collect import collect
from aerial_il.core import registry
from aerial_il.core.contracts import Observation
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.seeding import torch_rng, torch_threads
from aerial_il.data.episode import Episode
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.layout import Interface
from aerial_il.policies.parts.network import ChunkNetwork, PolicySettings
from experiments.common.report import Report, Row, Target, bar
from experiments.common.stopwatch import Arm, interleave

Minibatch = tuple[Tensor, Tensor, Tensor]
TICK_MS, WORLDS_LIMIT_MS, LOADER_RATIO = 20.0, 2.0, 2.0
CHUNKED_MLP = "mlp"
NOTES = (
    "Each policy has its default settings and plans at every step. Act: from observations to actions, including the "
    "policy's own normalisation, network and ensembling. A control step lasts 20 ms.",
    "Learning: optimisation steps per second of behaviour cloning (loss, gradient, clipping, AdamW, averaged "
    "weights) on minibatches gathered from windows in memory, as in `aerial-il train`.",
    "Loader: the same, with minibatches from torch's DataLoader over a map-style dataset that cuts and normalises "
    "one window at a time in this process; workers: with that many loader processes. Ready: the loader over a "
    "TensorDataset of windows cut and normalised beforehand, which needs memory for every window.",
    "bfloat16, two_threads: ours, computed in lower precision and by two threads of torch.",
    "Ratios are medians over repetitions, with the smallest and largest; above 1 our minibatches are faster.",
)


@dataclass(frozen=True, kw_only=True)
class Policies:
    """Settings.

    Attributes:
        policies: names; empty for all. robot, task: whose demonstrations. demonstrations: how many of them.
        calls: timed calls of act in one world, and a tenth of it in all of them. num_envs: worlds flown at once.
        batch_size: windows in a minibatch. steps: optimisation steps of one turn. repetitions: turns of each arm.
        workers: processes of the DataLoader; 0 leaves that arm out. seed: the first one flown. threads: of torch.
    """

    name: ClassVar[str] = "policies"
    question: ClassVar[str] = "How long do the policies take to act, and to train?"

    policies: tuple[str, ...] = ()
    robot: str = "fa_hexa_arm4"
    task: str = "pick_place"
    demonstrations: int = 20
    calls: int = 1000
    num_envs: int = 256
    batch_size: int = 256
    steps: int = 20
    repetitions: int = 5
    workers: int = 1
    seed: int = 0
    threads: int = 1

    def __post_init__(self) -> None:
        counts = ("demonstrations", "calls", "num_envs", "batch_size", "steps", "repetitions", "threads")
        for name in counts:
            if getattr(self, name) < 1:
                raise InvalidValueError(f"{name} is {getattr(self, name)}; it must be at least 1.")
        for name in self.policies:
            if name not in policies.names():
                raise UnknownNameError("policy", name, policies.names())

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Time every policy; see :class:`Study`."""
        started = time.perf_counter()
        demos = self._demonstrations()
        acting, learning, details = [], [], []
        with torch_threads(self.threads), torch_rng(self.seed, "policies"):
            for name in bar(self.policies or policies.names(), self.name, progress):
                config: PolicySettings = registry.get("policy", name)()
                policy, training, interface = prepared_for(config, demos)
                times = self._act_times(policy, demos)
                acting.append({"policy": name, **_acting_row(policy.network, times)})
                rates = interleave(
                    self._learning_arms(config, policy.network, training, interface, demos), self.repetitions
                )
                learning.append({"policy": name, **_learning_row(rates)})
                details.append({"policy": name, "rates": {k: v.round(2).tolist() for k, v in rates.items()}})
        return Report(
            study=self,
            targets=tuple(targets_of(acting, learning, self.num_envs)),
            tables={"Time to act": acting, "Optimisation steps per second": learning},
            notes=NOTES,
            details={"repetitions": details},
            wall_time_s=time.perf_counter() - started,
        )

    def _demonstrations(self) -> list[Episode]:
        env = aerial_il.load_batch(self.robot, self.task, num_envs=self.demonstrations)
        try:
            with tempfile.TemporaryDirectory(prefix="aerial_il-") as folder:
                seeds = range(self.seed, self.seed + self.demonstrations)
                collect(env, aerial_il.expert(self.robot, self.task), seeds, folder, progress=False)
                return list(aerial_il.open_dataset(folder))
        finally:
            env.close()

    def _act_times(self, policy: ChunkPolicy, demos: list[Episode]) -> dict[str, np.ndarray]:
        """Milliseconds of each call of act, alone and with all worlds."""
        few = max(10, self.calls // 10)
        return {
            "alone": _timed(policy, _flown(demos, 1, self.calls + few))[few:],
            "together": _timed(policy, _flown(demos, self.num_envs, few + 3))[3:],
        }

    def _learning_arms(
        self,
        config: PolicySettings,
        network: ChunkNetwork,
        training: TrainingSet,
        interface: Interface,
        demos: list[Episode],
    ) -> dict[str, Arm]:
        order = Shuffle(len(training), self.batch_size, seed=self.seed)
        windows = OneByOne(demos, interface, config)
        everything = torch.utils.data.TensorDataset(*cast(Minibatch, training.gather(np.arange(len(training)))))
        own = (cast(Minibatch, training.gather(order[step])) for step in count())
        feeds: dict[str, Iterator[Minibatch]] = {
            "own": own,
            "loader": self._loaded(windows, 0),
            "ready": self._loaded(everything, 0),
        }
        if self.workers:
            feeds["workers"] = self._loaded(windows, self.workers)
        return {
            **{name: self._arm(network, feed) for name, feed in feeds.items()},
            "bfloat16": self._arm(network, own, mixed=True),
            "two_threads": self._arm(network, own, threads=2),
        }

    def _loaded(self, dataset: Dataset, workers: int) -> Iterator[Minibatch]:
        """Minibatches without end."""
        loader = DataLoader(
            dataset,
            self.batch_size,
            sampler=torch.utils.data.RandomSampler(dataset, replacement=True, num_samples=10**7),  # pyright: ignore[reportArgumentType]
            num_workers=workers,
        )
        return iter(loader)

    def _arm(self, network: ChunkNetwork, feed: Iterator[Minibatch], *, mixed: bool = False, threads: int = 0) -> Arm:
        usual = BC()
        learner = Learner(network, weight_decay=usual.weight_decay, ema=usual.ema, clip_norm=usual.clip_norm)

        def learn() -> None:
            with torch_threads(threads or torch.get_num_threads()):
                for _ in range(self.steps):
                    with torch.autocast("cpu", dtype=torch.bfloat16, enabled=mixed):
                        loss, logged = network.loss(*next(feed))
                    learner.descend(loss, lr=1e-4, logged=logged)

        return Arm(learn, units=self.steps)


class OneByOne(Dataset):
    """Windows as a map-style dataset has them: one at a time, cut out of its episode and normalised when asked for.

    Args:
        demos: episodes. interface: how they are normalised. config: history and chunk of the windows.
    """

    def __init__(self, demos: Iterable[Episode], interface: Interface, config: PolicySettings) -> None:
        self._interface, self._history, self._chunk = interface, config.history, config.chunk
        names = interface.layout.names
        self._episodes = [
            (e.flat_obs(names)[: len(e)].astype(np.float32), e.expert_actions.astype(np.float32)) for e in demos
        ]
        self._places = [(i, t) for i, (_, actions) in enumerate(self._episodes) for t in range(len(actions))]

    def __len__(self) -> int:
        return len(self._places)

    def __getitem__(self, index: int) -> Minibatch:
        episode, step = self._places[index]
        obs, actions = self._episodes[episode]
        behind = np.maximum(np.arange(step - self._history + 1, step + 1), 0)
        ahead = np.arange(step, step + self._chunk)
        history, chunk = obs[behind][None], actions[np.minimum(ahead, len(actions) - 1)][None]
        seen, answer = self._interface.encode_obs(history)[0], self._interface.encode_actions(chunk, history)[0]
        return (
            torch.from_numpy(seen),
            torch.from_numpy(answer),
            torch.from_numpy((ahead < len(actions)).astype(np.float32)),
        )


def prepared_for(config: PolicySettings, demos: list[Episode]) -> tuple[ChunkPolicy, TrainingSet, Interface]:
    layout, kept = read_demos(demos, config)
    windows = cut_windows(kept, layout, config)
    interface = fit_interface(layout, windows, config)
    network = config.build(layout.size, layout.spec.action.size)
    return ChunkPolicy(config, interface, network), TrainingSet(windows, interface), interface


def _flown(demos: list[Episode], worlds: int, steps: int) -> Iterator[Observation]:
    """Observations of ``worlds`` worlds over ``steps`` steps, along the demonstrations, each world elsewhere."""
    names = demos[0].spec.observation.state_names
    frames = {name: np.concatenate([d.obs[name] for d in demos]) for name in names}
    total = len(frames[names[0]])
    start = np.arange(worlds) * total // worlds
    for step in range(steps):
        yield {name: values[(start + step) % total] for name, values in frames.items()}


def _timed(policy: ChunkPolicy, flight: Iterable[Observation]) -> np.ndarray:
    policy.network.eval()
    policy.reset()
    found = []
    for obs in flight:
        started = time.perf_counter()
        policy.act(obs)
        found.append(1e3 * (time.perf_counter() - started))
    return np.array(found)


def _acting_row(network: ChunkNetwork, times: dict[str, np.ndarray]) -> Row:
    return {
        "weights": sum(p.numel() for p in network.parameters()),
        "alone_p50_ms": round(float(np.percentile(times["alone"], 50)), 3),
        "alone_p99_ms": round(float(np.percentile(times["alone"], 99)), 3),
        "together_p50_ms": round(float(np.percentile(times["together"], 50)), 2),
        "together_p99_ms": round(float(np.percentile(times["together"], 99)), 2),
    }


def _learning_row(rates: dict[str, np.ndarray]) -> Row:
    row: Row = {"own_per_s": round(float(np.median(rates["own"])), 1)}
    for name, rate in rates.items():
        if name != "own":
            ratio = rates["own"] / rate
            row[f"{name}_per_s"] = round(float(np.median(rate)), 1)
            row[f"ratio_{name}"] = round(float(np.median(ratio)), 2)
            row[f"range_{name}"] = f"{ratio.min():.2f}-{ratio.max():.2f}"
    return row


def targets_of(acting: list[Row], learning: list[Row], worlds: int) -> Iterator[Target]:
    for row in acting:
        spread = f"median {row['alone_p50_ms']:g} ms"
        yield Target(f"{row['policy']}: act in one world, p99", "at most", TICK_MS, row["alone_p99_ms"], "ms", spread)
    for row in acting:
        if row["policy"] == CHUNKED_MLP:
            spread = f"p99 {row['together_p99_ms']:g} ms"
            what = f"{CHUNKED_MLP}: act in {worlds} worlds"
            yield Target(what, "at most", WORLDS_LIMIT_MS, row["together_p50_ms"], "ms", spread)
    for row in learning:
        if row["policy"] == CHUNKED_MLP:
            what, spread = f"{CHUNKED_MLP}: learning / from a DataLoader", f"{row['range_loader']} over repetitions"
            yield Target(what, "at least", LOADER_RATIO, row["ratio_loader"], "", spread)
