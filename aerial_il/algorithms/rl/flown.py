"""One off-policy step of n worlds: what was seen, done and paid, as a memory keeps it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aerial_il.algorithms.rl.collector import EndlessFlight
from aerial_il.algorithms.rl.demonstrations import decode, encode
from aerial_il.algorithms.rl.soft_actor_critic import SoftActorCritic
from aerial_il.algorithms.run.state import Generator
from aerial_il.policies.parts.layout import Interface


class Flown(NamedTuple):
    """One step of n worlds, in the order that :func:`aerial_il.algorithms.rl.replay_buffer.rows_of` takes.

    Attributes:
        obs, next_obs: (n, Do) encoded; ``next_obs`` was seen before any reset.
        actions: (n, Da) normalised.
        rewards: (n,) of the environment.
        terminal: (n,) bool, the episode ended because of what happened.
    """

    obs: np.ndarray
    actions: np.ndarray
    rewards: np.ndarray
    next_obs: np.ndarray
    terminal: np.ndarray


def fly_step(
    flight: EndlessFlight, agent: SoftActorCritic, interface: Interface, *, blind: Generator | None = None
) -> Flown:
    """Fly one step of all worlds with actions drawn by ``agent``, or uniformly at random by ``blind``."""
    obs = encode(interface, flight.frames)
    size = (flight.n, flight.env.spec.action.size)
    actions = blind.rng.uniform(-1, 1, size) if blind else agent.explore(obs)
    step = flight.step(decode(interface, np.asarray(actions, np.float32), flight.frames))
    return Flown(obs, actions, step.rewards, encode(interface, step.next_frames), step.terminal)
