"""A policy that flies with some of its state fields hidden, others from time to time.

Hidden, a field reads as its mean. What a policy does then is what it would do everywhere if it had never looked there:
where it has learned to look at something that only went along with what it was shown, that does better. Which field
misleads it when is not known, so they are drawn at random and kept for a while.

Source: P. de Haan, D. Jayaraman, S. Levine, "Causal Confusion in Imitation Learning", 2019, section 4: one policy for
all masks, flown with one of them for an episode, judged by the reward.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from torch import Tensor

from aerial_il.core.contracts import Observation
from aerial_il.core.seeding import restarted
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.layout import Layout
from aerial_il.policies.parts.network import ChunkNetwork, Shown, state_of, with_state


class MaskedPolicy(ChunkPolicy):
    """``policy`` with a share of its fields hidden; which ones, each world draws anew every so often.

    Args:
        policy: trained with fields hidden now and then; its network is shared, not copied.
        most: largest chance with which a field is hidden; the chance itself is drawn with them, from 0 on.
        hold: mean number of steps between two draws. stream: another number draws others in the same episodes.
    """

    def __init__(self, policy: ChunkPolicy, *, most: float, hold: float, stream: int = 0) -> None:
        self._hiding = Hiding(policy.network, policy.interface.layout.size)
        super().__init__(policy.config, policy.interface, self._hiding)
        self.task, self.most, self.hold, self._stream, self._policy = policy.task, most, hold, stream, policy
        self._rngs: list[np.random.Generator] = []
        self._shown = np.ones((0, policy.interface.layout.size), np.float32)

    def fresh(self) -> MaskedPolicy:
        again = MaskedPolicy(self._policy, most=self.most, hold=self.hold, stream=self._stream)
        return again._as(self)

    def begin(self, seeds: np.ndarray, mask: np.ndarray | None = None) -> None:
        """Draw what is hidden in the episodes ``seeds`` (n,) that begin in the worlds of ``mask`` (n,), or in all."""
        self._rngs, begins = restarted(self._rngs, seeds, mask, "partly blind", str(self._stream))
        if len(self._shown) != len(seeds):
            self._shown = np.ones((len(seeds), self._shown.shape[1]), np.float32)
        for world in np.flatnonzero(begins):
            self._shown[world] = self._drawn(self._rngs[world])

    def act(self, obs: Observation) -> np.ndarray:
        for world, rng in enumerate(self._rngs):
            if rng.random() * self.hold < 1.0:
                self._shown[world] = self._drawn(rng)
        return super().act(obs)

    def predict(
        self,
        history: np.ndarray,
        worlds: np.ndarray | None = None,
        *,
        images: Mapping[str, np.ndarray] | None = None,
        noise: np.ndarray | None = None,
        guide: Any = None,
    ) -> np.ndarray:
        rows = self._shown if worlds is None else self._shown[worlds]
        self._hiding.shown = torch.from_numpy(rows[:, None])
        return super().predict(history, worlds, images=images, noise=noise, guide=guide)

    def _drawn(self, rng: np.random.Generator) -> np.ndarray:
        layout = self.interface.layout
        return columns_of(layout, rng.random(len(layout.names)) >= self.most * rng.random()).astype(np.float32)


class Hiding(ChunkNetwork):
    """A network that sees zeros, which are means, in the columns of its state where ``shown`` is 0.

    Attributes:
        shown: (B, 1, Do), 1 or 0.
    """

    def __init__(self, network: ChunkNetwork, size: int) -> None:
        super().__init__()
        self.network, self.shown = network, torch.ones(1, 1, size)
        self.noise_size, self.redraws = network.noise_size, network.redraws

    def forward(self, obs: Shown, *noise: Tensor) -> Tensor:
        state = state_of(obs)
        return self.network(with_state(obs, state * self.shown.to(state)), *noise)

    def loss(self, obs: Shown, actions: Tensor, valid: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
        return self.network.loss(obs, actions, valid)


def columns_of[Array: (np.ndarray, Tensor)](layout: Layout, fields: Array) -> Array:
    """Return (..., Do) what is said of each state field (..., F), said of each of its columns."""
    sizes = [layout.spec.observation[name].size for name in layout.names]
    return fields[..., np.repeat(np.arange(len(sizes)), sizes)]
