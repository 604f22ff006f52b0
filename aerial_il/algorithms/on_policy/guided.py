"""Episodes that a guide starts: for how many steps it flies, and the pilot that lets a learner take over then."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from aerial_il.algorithms.on_policy.chunk_actor import ChunkPilot
from aerial_il.algorithms.on_policy.cut_short import uncut
from aerial_il.algorithms.on_policy.decisions import Acted, Pilot
from aerial_il.algorithms.online.collector import Collector, Transition
from aerial_il.algorithms.run.state import Snapshot
from aerial_il.core.contracts import Policy, SeededPolicy, attach

Schedule = Literal["curriculum", "random"]


@dataclass(frozen=True, kw_only=True)
class Curriculum:
    """How the guide's part shrinks.

    Attributes:
        schedule: ``curriculum``, stage by stage; or ``random``, a number of steps sampled for each episode.
        horizon: the guide's steps at first, and at most. stages: in which they shrink to none.
        window: episodes that decide whether a stage is passed. tolerance: share of the best window's return that may
            be missing.
    """

    schedule: Schedule
    horizon: int
    stages: int
    window: int
    tolerance: float

    def steps(self, stage: int) -> int:
        """Return the guide's steps in a stage, counted from 0; none from stage ``stages`` on."""
        return round(self.horizon * max(0.0, 1.0 - stage / self.stages))


class GuidedPilot(Pilot):
    """A guide flies the first steps of each episode, a learner the others.

    Stages are passed as in algorithm 1 of the source: when the last ``window`` episodes of a stage return on average
    at least what the best such window has returned, but for the tolerance. Of a sparse reward some has to have come.

    Args:
        learner: decides where the guide does not fly. guide: any policy, such as an expert; it is attached and reset.
        collector: whose worlds these are. curriculum: for how long the guide flies. rng: samples it if random.

    Attributes:
        stage: how many times the guide's part has shrunk.

    Source: I. Uchendu et al., "Jump-Start Reinforcement Learning", 2023, algorithm 1.
    """

    changing = ("_left", "_stages", "_paid", "_learner", "stage", "_flown", "_best", "_returns", "_rng")

    def __init__(
        self, learner: ChunkPilot, guide: Policy, collector: Collector, curriculum: Curriculum, rng: np.random.Generator
    ) -> None:
        super().__init__(collector)
        self._learner, self._guide, self._curriculum, self._rng = learner, guide, curriculum, rng
        self.stage, self._flown, self._returns = 0, 0, list[float]()
        self._best: float | None = None  # return of a window
        n = collector.n
        self._left, self._stages, self._paid = np.zeros(n, np.int64), np.zeros(n, np.int64), np.zeros(n)
        attach(guide, uncut(collector.env))
        self._start_guide(np.ones(n, bool))
        self._start(np.ones(n, bool))

    @property
    def flown(self) -> int:
        return self._flown

    @property
    def steps(self) -> int:
        """The guide's steps in episodes that start now; where they are sampled, at most."""
        chosen = self._curriculum
        return chosen.horizon if chosen.schedule == "random" else chosen.steps(self.stage)

    def cut(self) -> None:
        self._learner.cut()

    def act(self) -> Acted:
        self._learner.look()
        guided = self._left > 0
        self._flown += int((~guided).sum())
        acted = self._learner.decide(~guided)
        if not guided.any():
            return acted
        led = np.where(guided[:, None], self._guide.act(self._collector.obs), acted.actions)
        self._left -= guided
        return acted._replace(actions=led, learner=~guided)

    def after(self, step: Transition) -> np.ndarray:
        seen, ended = self._learner.after(step), step.terminal | step.truncated
        self._paid += step.rewards
        if ended.any():
            self._returns += self._paid[ended & (self._stages == self.stage)].tolist()
            self._pass()
            self._start_guide(ended)
            self._start(ended)
        return seen

    def _pass(self) -> None:
        """Go on to the next stage where the episodes of this one allow it."""
        curriculum, returns = self._curriculum, self._returns[-self._curriculum.window :]
        if curriculum.schedule == "random" or self.stage == curriculum.stages or len(returns) < curriculum.window:
            return
        mean = float(np.mean(returns))
        if self._collector.scheme.sparse and max(returns) <= 0.0:
            return
        best = mean if self._best is None else self._best
        if mean >= best - curriculum.tolerance * abs(best):
            self.stage, self._best, self._returns = self.stage + 1, max(best, mean), []

    def _start(self, worlds: np.ndarray) -> None:
        """Count anew in the ``worlds`` (n,) bool whose episodes start."""
        count, chosen = int(worlds.sum()), self._curriculum
        drawn = self._rng.integers(0, chosen.horizon + 1, count) if chosen.schedule == "random" else self.steps
        self._left[worlds], self._stages[worlds], self._paid[worlds] = drawn, self.stage, 0.0

    def _start_guide(self, worlds: np.ndarray) -> None:
        """Let the guide start in the ``worlds`` (n,) bool."""
        if not worlds.any():
            return
        if isinstance(self._guide, SeededPolicy):
            self._guide.begin(self._collector.env.seeds, worlds)
        self._guide.reset(worlds)

    def restore(self, saved: Snapshot) -> None:
        """Go back, after the collector has: what the guide remembers is what it is shown once more."""
        super().restore(saved)
        now, env, worlds = self._collector.snapshot().arrays, self._collector.env, np.arange(self._collector.n)
        ages = now["ages"]
        late = ages.max(initial=0) - ages
        obs = env.reset(now["seeds"])
        for step in range(int(ages.max(initial=0))):
            self._start_guide(late == step)
            self._guide.act(obs)
            obs = env.step(now["flown"][worlds, np.maximum(step - late, 0)], step >= late).obs
        self._start_guide(ages == 0)
