"""The risk that a learner fails from here, learned from flights that it made alone.

The outcome of a flight is known, so the probability is learned by classification rather than by bootstrapping: every
state of a failed flight counts as one from which it fails.
"""

from collections.abc import Sequence

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from aerial_il.core.contracts import Observation
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.seeding import named_rng, torch_rng
from aerial_il.core.tensors import tensor
from aerial_il.data.episode import Episode
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.layout import Interface

WIDTH, STEPS, BATCH, RATE, DECAY = 128, 600, 256, 1e-3, 1e-3


class RiskModel:
    """Probability of failure from a state and an action.

    Args:
        interface: how states and actions are normalised.
        network: maps (B, Do + Da) to (B, 1) log odds of failing.
    """

    def __init__(self, interface: Interface, network: nn.Module) -> None:
        self._interface, self._network = interface, network.eval()

    def of(self, obs: Observation, actions: np.ndarray) -> np.ndarray:
        """Risk (n,) of taking ``actions`` (n, Da) where ``obs`` is seen."""
        frames = self._interface.layout.flatten(obs)
        with torch.inference_mode():
            odds = self._network(tensor(inputs_of(self._interface, frames, actions)))
        return torch.sigmoid(odds[:, 0]).numpy().astype(float)

    def of_episodes(self, episodes: Sequence[Episode], actions: np.ndarray) -> np.ndarray:
        """Risk (N,) of ``actions`` (N, Da) along the episodes, one after the other."""
        return self.of(seen_in(episodes, self._interface.layout.names), actions)


def fit_risk(flights: Sequence[Episode], learner: ChunkPolicy, *, seed: int) -> RiskModel:
    """Learn the risk from flights made alone; it is a function of them, of the learner's normalisers and of ``seed``.

    Raises:
        InvalidValueError: there are no flights, or the learner sees no state.
    """
    if not flights:
        raise InvalidValueError(
            "Risk is learned from flights of the learner alone; there is none. Raise algorithm.gate.alone."
        )
    interface = learner.interface
    if not interface.layout.names:
        raise InvalidValueError(
            "Risk is learned from state fields; the policy sees images alone. Set algorithm.gate.risk=false."
        )
    frames = interface.layout.flatten(seen_in(flights, interface.layout.names))
    inputs = tensor(inputs_of(interface, frames, np.concatenate([f.actions for f in flights])))
    failed = torch.from_numpy(np.repeat([float(not f.success) for f in flights], [len(f) for f in flights])).float()
    with torch_rng(seed, "risk"):
        network = nn.Sequential(nn.Linear(inputs.shape[1], WIDTH), nn.GELU(), nn.Linear(WIDTH, 1))
        optimizer = torch.optim.AdamW(network.parameters(), lr=RATE, weight_decay=DECAY)
        order = named_rng(seed, "risk minibatches")
        for _ in range(STEPS):
            rows = torch.from_numpy(order.integers(len(inputs), size=BATCH))
            loss = functional.binary_cross_entropy_with_logits(network(inputs[rows])[:, 0], failed[rows])
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
    return RiskModel(interface, network)


def inputs_of(interface: Interface, frames: np.ndarray, actions: np.ndarray) -> np.ndarray:
    """Return the network's input (N, Do + Da) for frames (N, Do) in the world and actions (N, Da)."""
    history = frames[:, None].astype(np.float32)
    chunk = interface.encode_actions(actions[:, None].astype(np.float32), history)
    return np.concatenate([interface.encode_obs(history)[:, 0], chunk[:, 0]], axis=1)


def seen_in(episodes: Sequence[Episode], names: Sequence[str]) -> dict[str, np.ndarray]:
    """Return what was seen before each step of the episodes, ``name -> (N, ...)``."""
    return {name: np.concatenate([e.obs[name][: len(e)] for e in episodes]) for name in names}
