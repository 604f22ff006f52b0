"""An off-policy learner's own flights: its replay buffer, goals relabelled in hindsight, and moments of what it saw."""

from collections.abc import Mapping

import numpy as np

from aerial_il.algorithms.off_policy.exploration import Explorer
from aerial_il.algorithms.off_policy.hindsight import Relabeller, goal_columns
from aerial_il.algorithms.off_policy.settings import Hindsight
from aerial_il.algorithms.online.interface import decode, encode, standardised
from aerial_il.algorithms.online.moments import RunningMoments
from aerial_il.algorithms.online.replay_buffer import ReplayBuffer, rows_of
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.run.state import Snapshot, Stateful


class ExperienceReplay:
    """The replay buffer of a run, and all that is done to its flights before they are stored.

    Args:
        run: whose flights these are. capacity: transitions kept. added: columns of an observation besides its own.
        hindsight: the other goals that episodes are relabelled with; None for none.
        obs_norm: standardise observations by their moments in the warm-up.
        absorbing: whether success that ends an episode leads to an absorbing state. With hindsight it ends nothing.
        rewarded: whether rewards are stored; otherwise zeros in their place, and ``absorbing`` is for all ends.

    Attributes:
        buffer: the transitions.
    """

    def __init__(
        self,
        run: OnlineRun,
        capacity: int,
        *,
        added: int = 0,
        hindsight: Hindsight | None = None,
        obs_norm: bool = False,
        absorbing: bool = False,
        rewarded: bool = True,
    ) -> None:
        self._run, self._absorbing, self._rewarded = run, absorbing, rewarded
        self.buffer = ReplayBuffer(capacity, run.sizes[0] + added, run.sizes[1], run.rng("minibatches"))
        self._norm = WarmupNorm(run) if obs_norm else None
        self._relabeller = None
        if hindsight and hindsight.goals:
            goal = goal_columns(run.collector.env, run.interface.layout)
            self._relabeller = Relabeller(hindsight, goal, run.collector.n, run.rng("hindsight"))

    @property
    def parts(self) -> Mapping[str, Stateful]:
        """What of it changes while the run goes on."""
        parts = {"replay_buffer": self.buffer, "obs_norm": self._norm, "hindsight": self._relabeller}
        return {name: part for name, part in parts.items() if part is not None}

    def step(self, explorer: Explorer) -> None:
        """Take one step in all worlds with actions sampled by ``explorer``, and add it to the replay buffer."""
        run = self._run
        frames = run.collector.frames
        actions = np.asarray(explorer.explore(encode(run.interface, frames)), np.float32)
        step = run.collector.step(decode(run.interface, actions, frames))
        if self._norm:
            self._norm.take(step.frames)
        if not self._rewarded:
            flown = (frames, actions, np.zeros(len(frames)), step.next_frames, step.terminal)
            self._keep(*flown, absorbing=self._absorbing)
            return
        if self._relabeller is None:
            flown = (frames, actions, step.rewards, step.next_frames, step.terminal)
            self._keep(*flown, absorbing=self._absorbing & step.success, penalties=step.penalties)
            return
        rewards = self._relabeller.rewards(step)
        self._keep(frames, actions, rewards, step.next_frames, step.terminal & ~step.success)
        for episode in self._relabeller.add(step, actions):
            self._keep(*episode)

    def finish_warmup(self) -> None:
        """End the warm-up: where observations are to be standardised they are from now on, those in the buffer too."""
        if self._norm and not self._norm.settled:
            self._norm.settle()
            self.buffer.standardise(self._run.interface)

    def _keep(
        self,
        frames: np.ndarray,
        actions: np.ndarray,
        rewards: np.ndarray,
        next_frames: np.ndarray,
        terminal: np.ndarray,
        *,
        absorbing: bool | np.ndarray = False,
        penalties: np.ndarray | float = 0.0,
    ) -> None:
        obs, next_obs = (encode(self._run.interface, seen) for seen in (frames, next_frames))
        self.buffer.add(rows_of(obs, actions, rewards, next_obs, terminal, absorbing=absorbing, penalties=penalties))


class WarmupNorm(RunningMoments):
    """Moments of what a run saw in its warm-up, which standardise what it sees from then on.

    Args:
        run: whose interface changes.
    """

    changing = (*RunningMoments.changing, "settled")

    def __init__(self, run: OnlineRun) -> None:
        super().__init__(run.sizes[0])
        self._run, self.settled = run, False

    def take(self, frames: np.ndarray) -> None:
        """Take frames (n, Do) in, while they still count."""
        if not self.settled:
            self.add(self._run.interface.layout.relate(frames))

    def settle(self) -> None:
        """Standardise from now on."""
        self._run.interface, self.settled = standardised(self._run.interface, self), True

    def restore(self, saved: Snapshot) -> None:
        super().restore(saved)
        if self.settled:
            self.settle()
