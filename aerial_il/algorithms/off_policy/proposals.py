"""Actions that a prior proposes for each observation: stored with each transition, so that no backup has to ask again.

A policy that plans in chunks answers by what it saw before, not by an observation alone. It therefore flies along in
every world, whichever action is taken, and its answers are kept as further columns of the observation: the proposed
action, and whether there is one. There is none after the last step of an episode that was cut. In demonstrations the
demonstrated action counts as the proposed one.
"""

from collections.abc import Mapping

import numpy as np

from aerial_il.algorithms.off_policy.experience_replay import ExperienceReplay
from aerial_il.algorithms.off_policy.exploration import Explorer
from aerial_il.algorithms.online.collector import Collector, Transition
from aerial_il.algorithms.online.interface import decode, encode, encode_actions
from aerial_il.algorithms.online.replay_buffer import ReplayBuffer, rows_of
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.run.state import Part, Stateful
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.layout import Interface


class Proposals(Part):
    """A prior that flies along in the worlds of a collector.

    Args:
        prior: of any class; its memory is taken. collector: whose worlds these are. interface: of the learner.

    Attributes:
        now: (n, Da) normalised actions that it proposes for what the worlds show.
    """

    changing = ("now", "_prior")

    def __init__(self, prior: ChunkPolicy, collector: Collector, interface: Interface) -> None:
        self._prior, self._collector, self._interface = prior, collector, interface
        prior.attach(collector.env)
        prior.reset()
        self.now = self._ask()

    def after(self, step: Transition) -> np.ndarray:
        """Follow one step of all worlds; return the columns (n, Da + 1) of what it led to."""
        ended = step.terminal | step.truncated
        if ended.any():
            self._prior.reset(ended)
        self.now = self._ask()
        return columns(self.now, ~ended)

    def _ask(self) -> np.ndarray:
        return encode_actions(self._interface, self._prior.act(self._collector.obs), self._collector.frames)


class ProposedFlights(ExperienceReplay):
    """An off-policy learner's flights with proposals: who explores sees them, and takes them all in the warm-up.

    Args:
        run: whose flights these are. capacity: transitions kept. proposals: of the prior. warmup: environment steps.
        absorbing: whether success that ends an episode leads to an absorbing state.

    Attributes:
        buffer: the transitions; their observations carry proposals.
    """

    def __init__(self, run: OnlineRun, capacity: int, proposals: Proposals, *, warmup: int, absorbing: bool) -> None:
        super().__init__(run, capacity, added=run.sizes[1] + 1, absorbing=absorbing)
        self._proposals, self._warmup = proposals, warmup

    @property
    def parts(self) -> Mapping[str, Stateful]:
        return {**super().parts, "proposals": self._proposals}

    def step(self, explorer: Explorer) -> None:
        """Take one step in all worlds, and add it to the buffer."""
        run, proposed = self._run, self._proposals.now
        warming_up, frames = run.collector.steps < self._warmup, run.collector.frames
        seen = np.concatenate([encode(run.interface, frames), columns(proposed, np.ones(len(frames), bool))], axis=1)
        actions = proposed if warming_up else explorer.explore(seen)
        step = run.collector.step(decode(run.interface, actions.astype(np.float32), frames))
        led = np.concatenate([encode(run.interface, step.next_frames), self._proposals.after(step)], axis=1)
        ends = {"absorbing": self._absorbing & step.success, "penalties": step.penalties}
        self.buffer.add(rows_of(seen, actions, step.rewards, led, step.terminal, **ends))


def columns(proposed: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Return the columns (T, Da + 1) of actions (T, Da), of which only those ``known`` (T,) are proposals."""
    return np.concatenate([np.where(known[:, None], proposed, 0.0), known[:, None]], axis=1)


def proposed_demos(
    demos: Transition, interface: Interface, rng: np.random.Generator, *, absorbing: bool
) -> ReplayBuffer:
    """Return demonstrations as a buffer, sampled by ``rng``, whose observations carry proposals."""
    obs_size, action_size = interface.layout.size, demos.actions.shape[1]
    buffer = ReplayBuffer(2 * len(demos.frames), obs_size + action_size + 1, action_size, rng)
    buffer.add(demonstrated_rows(demos, interface, absorbing=absorbing))
    return buffer


def demonstrated_rows(demos: Transition, interface: Interface, *, absorbing: bool) -> np.ndarray:
    """Return demonstrations as rows of a replay buffer whose observations carry proposals."""
    actions = encode_actions(interface, demos.actions, demos.frames)
    follows = np.append((demos.next_frames[:-1] == demos.frames[1:]).all(axis=1), False)
    proposed, following = columns(actions, np.ones(len(actions), bool)), columns(np.roll(actions, -1, axis=0), follows)
    return rows_of(
        np.concatenate([encode(interface, demos.frames), proposed], axis=1),
        actions,
        demos.rewards,
        np.concatenate([encode(interface, demos.next_frames), following], axis=1),
        demos.terminal,
        absorbing=absorbing & demos.success,
        penalties=demos.penalties,
    )
