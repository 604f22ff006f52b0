"""Speed of reinforcement learning: environment steps per second of each algorithm, and where its time goes.

Every algorithm that flies while it learns trains on the same task, with its shipped settings and worlds, on one core.
The first stretch of a training, in which buffers fill and critics warm up, is left out. What begins with a policy
begins with the same clone. The algorithms take turns, so that a slow moment of the machine slows them all.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np

import aerial_il
from aerial_il import algorithms
from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.online.algorithm import Algorithm
from aerial_il.algorithms.run.folder import read_metrics
from aerial_il.collection.collect import collect
from aerial_il.core.composition import changed
from aerial_il.core.contracts import Policy
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.data.dataset import Dataset
from aerial_il.policies.categorical import Categorical
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.network import PolicySettings
from aerial_il.policies.squashed_gaussian import SquashedGaussian
from experiments.common.figures import time_shares
from experiments.common.notes import demonstrator
from experiments.common.report import Report, Row, bar
from experiments.rl_speed.sampling import Place, Sampler

SIMULATION, ACTING, REPLAY, SAVING, LEARNING = "simulation", "acting", "replay", "saving", "learning"
SHOWN = (SIMULATION, ACTING, REPLAY, LEARNING)
SECTIONS = {
    SIMULATION: [Place("aerial_il.suite")],
    REPLAY: [Place("aerial_il.algorithms.online.replay_buffer"), Place("aerial_il.algorithms.off_policy.hindsight")],
    ACTING: [
        Place("aerial_il.algorithms.online.collector"),
        Place("aerial_il.algorithms.off_policy.experience_replay", "step"),
        Place("aerial_il.algorithms.on_policy.decisions", "collect"),
        Place("aerial_il.algorithms.off_policy.proposals"),
    ],
    SAVING: [
        Place("aerial_il.algorithms.online.run", "end_turn"),
        Place("aerial_il.algorithms.online.run", "goes_on"),
    ],
}
FEW = 100  # minibatches where what was learned before the flights does not matter
KINDS: tuple[PolicySettings, ...] = (SquashedGaussian(), Categorical(choices="bounds"), MLP())
NOTES = (
    "Shipped settings, worlds included, on one core; weights do not matter and what comes before the flights is kept "
    "short. Measured is the second of two stretches; the critics warm up in the first.",
    "Steps per second: environment steps of all worlds together, metrics and checkpoints left out. Median over the "
    "repetitions, with the slowest and the fastest.",
    "Shares of the time by samples of the call stack. Simulation: the suite, resets included. Acting: policy, prior "
    "and guide, and the collection of what they flew. Replay: storing and drawing transitions. Learning: the rest.",
    "Updates: minibatches of the critics for each environment step of those with a replay buffer.",
)


class Shown(NamedTuple):
    """What algorithms are shown: demonstrations, the run of a clone of them, and an expert."""

    demos: Dataset
    clone: Path
    expert: Policy


@dataclass(frozen=True, kw_only=True)
class RlSpeed:
    """Settings.

    Attributes:
        algorithms: names; empty for all that fly while they learn. robot, task: what is flown.
        demonstrations: that are shown to those that want any.
        steps: environment steps of a stretch of those with a replay buffer, and the least of others, whose stretch is
            at least a rollout.
        repetitions: turns of each. seed: of the trainings.
    """

    name: ClassVar[str] = "rl_speed"
    question: ClassVar[str] = (
        "How many steps per second does each reinforcement learning algorithm take, and where does the time go?"
    )

    algorithms: tuple[str, ...] = ()
    robot: str = "fa_hexa_arm4"
    task: str = "pick_place"
    demonstrations: int = 20
    steps: int = 500
    repetitions: int = 3
    seed: int = 0

    def __post_init__(self) -> None:
        if min(self.demonstrations, self.steps, self.repetitions) < 1:
            raise InvalidValueError("demonstrations, steps and repetitions start at 1.")
        for name in self.algorithms:
            if name not in online_algorithms():
                raise UnknownNameError("algorithm that flies while it learns", name, online_algorithms())

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Time every algorithm; see :class:`Study`."""
        started = time.perf_counter()
        names = self.algorithms or online_algorithms()
        turns = [name for _ in range(self.repetitions) for name in names]
        timed: dict[str, list[Row]] = {name: [] for name in names}
        with tempfile.TemporaryDirectory(prefix="aerial_il-") as scratch:
            shown = self._shown(Path(scratch))
            for number, name in enumerate(bar(turns, self.name, progress)):
                timed[name].append(self._timed(name, shown, Path(scratch) / f"{number}"))
        rows = [self._row(name, found) for name, found in timed.items()]
        rows.sort(key=lambda row: -row["steps_per_s"])
        return Report(
            study=self,
            tables={"Speed": rows},
            notes=(self._flown(), *NOTES),
            figures={"rl_speed.svg": _shares(rows)},
            details={"repetitions": timed},
            wall_time_s=time.perf_counter() - started,
        )

    def _flown(self) -> str:
        """Return a note that tells what flew, and what was shown to those that want any demonstrations."""
        shown = f"{demonstrator(self.robot, 0.0)} {self.demonstrations} times, and a hasty clone of these flights"
        return f"Robot: {shown}. Task: {self.task}."

    def _shown(self, folder: Path) -> Shown:
        """Fly demonstrations and clone them, hastily."""
        env = aerial_il.load_batch(self.robot, self.task, num_envs=self.demonstrations, num_threads=1)
        expert = aerial_il.expert(self.robot, self.task)
        try:
            collect(env, expert, range(self.demonstrations), folder / "demos", progress=False)
        finally:
            env.close()
        demos, clone = aerial_il.open_dataset(str(folder / "demos")), folder / "clone"
        BC(steps=FEW, warmup_steps=0).train(demos, MLP(), run=clone, progress=False)
        return Shown(demos, clone, expert)

    def settings(self, name: str, clone: Path) -> Algorithm:
        """Return an algorithm as it ships, but for how long it trains and for what it begins with."""
        usual: Any = algorithms.get(name)()
        stretch = max(self.steps, usual.rollout.steps if hasattr(usual, "rollout") else 0)
        wanted = {
            "steps": 2 * stretch,
            "warmup": stretch // 2 if hasattr(usual, "replay") else 1,
            "offline_steps": FEW,
            "bc_pretrain_steps": FEW,
            "prior": str(clone) if _takes_any_prior(usual) else None,
            "cadence": {"log_every": stretch, "evaluate_every": stretch, "checkpoint_every": 0},
        }
        return changed(usual, {key: value for key, value in wanted.items() if hasattr(usual, key)})

    def _timed(self, name: str, shown: Shown, run: Path) -> Row:
        """Train once; return the steps per second of the second stretch, and the seconds of each section."""
        settings = self.settings(name, shown.clone)
        env = aerial_il.load_batch(self.robot, self.task, num_envs=settings.worlds, num_threads=1)
        options: dict[str, Any] = {"expert": shown.expert} if "expert" in settings.needs else {}
        sampler = Sampler(SECTIONS, rest=LEARNING)
        found: dict[str, float] = {}

        def turned(policy: Policy, step: int) -> Mapping[str, float]:
            found.update(sampler.seconds)
            sampler.clear()
            return {}

        demos = shown.demos if settings.demonstrated else None
        try:
            with sampler:
                settings.train(
                    demos,
                    _policy_of(settings),
                    env=env,
                    run=run,
                    seed=self.seed,
                    evaluate=turned,
                    progress=False,
                    **options,
                )
        finally:
            env.close()
        first, last = [row for row in read_metrics(run) if "elapsed_s" in row and row["step"] > 0][-2:]
        rate = (last["step"] - first["step"]) / (last["elapsed_s"] - first["elapsed_s"])
        return {"steps_per_s": rate, "seconds": found}

    def _row(self, name: str, found: Sequence[Row]) -> Row:
        rates = np.array([row["steps_per_s"] for row in found])
        seconds = {section: sum(row["seconds"][section] for row in found) for section in SHOWN}
        usual: Any = algorithms.get(name)()
        return {
            "algorithm": name,
            "worlds": usual.worlds,
            "updates": usual.replay.updates_per_step if hasattr(usual, "replay") else None,
            "steps_per_s": round(float(np.median(rates))),
            "slowest": round(float(rates.min())),
            "fastest": round(float(rates.max())),
            **{f"{section}_percent": round(100 * s / sum(seconds.values()), 1) for section, s in seconds.items()},
        }


def online_algorithms() -> list[str]:
    """Return the names of all algorithms that fly while they learn, by reward or imitation."""
    return [name for name in algorithms.names() if issubclass(algorithms.get(name), Algorithm)]


def _shares(rows: Sequence[Row]) -> str:
    return time_shares(
        rows,
        {f"{name}_percent": name for name in SHOWN},
        named_by=("algorithm",),
        title="Where the time goes, from the fastest to the slowest",
        unit="% of the time",
    )


def _takes_any_prior(settings: Any) -> bool:
    """Whether it begins with a policy of any class, and would otherwise clone its own."""
    return settings.demonstrated and any(field.name == "prior" for field in fields(settings))


def _policy_of(settings: Algorithm) -> PolicySettings:
    """Return what it trains: the first kind that suits it."""
    return next(kind for kind in KINDS if isinstance(kind, settings.trains))
