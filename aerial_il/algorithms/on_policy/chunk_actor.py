"""A clone that explores: its own network is the mean of the sampled chunks, and the pilot that flies them.

Noise that differs from step to step is averaged out by whatever follows the actions. Within a chunk it is therefore
correlated, as a first-order autoregressive process whose standard deviation is the same at every step:

    ``e_k = rho e_{k-1} + sqrt(1 - rho^2) sigma eps_k``,    ``e_0 = sigma eps_0``.
"""

import math

import numpy as np
import torch
from torch import Tensor, nn

from aerial_il.algorithms.on_policy.decisions import Acted, Pilot
from aerial_il.algorithms.online.collector import Collector, Transition
from aerial_il.core.tensors import tensor
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.chunking import ObservationHistory
from aerial_il.policies.parts.network import ChunkNetwork, StochasticNetwork
from aerial_il.policies.squashed_gaussian import LOG_STD_HIGH, LOG_STD_LOW


class ChunkActor(StochasticNetwork):
    """A deterministic network, and one learned standard deviation for each action element that is explored.

    Sampled are the first E actions of a chunk, normalised, in the elements that the demonstrations varied:
    R = E * Dm numbers. Observation histories come flattened, (B, 1, To * Do).

    Args:
        network: maps (B, To, Do) to (B, Ta, Da). history: To. execute: E, at most Ta. explored: (Da,) bool.
        deviation: standard deviation sigma at the start, in the network's units.
        correlation: rho, from one step of a chunk to the next.
    """

    def __init__(
        self,
        network: ChunkNetwork,
        *,
        history: int,
        execute: int,
        explored: np.ndarray,
        deviation: float,
        correlation: float,
    ) -> None:
        super().__init__()
        self.network, self._history, self.execute = network, history, execute
        self._explored, self._correlation = torch.from_numpy(np.flatnonzero(explored)), correlation
        self.log_std = nn.Parameter(torch.full((len(self._explored),), math.log(deviation)))

    @property
    def drawn_size(self) -> int:
        """Numbers R that a decision samples."""
        return self.execute * len(self._explored)

    def drawn_of(self, actions: Tensor) -> Tensor:
        """Return the samples (B, R) that would have made chunks (B, Ta, Da)."""
        return actions[:, : self.execute, self._explored].flatten(1)

    def forward(self, obs: Tensor) -> Tensor:
        return self.network(obs.unflatten(-1, (self._history, -1))[:, 0])

    def distribution(self, obs: Tensor) -> tuple[Tensor, ...]:
        """Return means (B, E, Dm) and log standard deviations (Dm,)."""
        return self(obs)[:, : self.execute, self._explored], self.log_std.clamp(LOG_STD_LOW, LOG_STD_HIGH)

    def sample(self, obs: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        mean, log_std = self.distribution(obs)
        raw = mean + log_std.exp() * self._coloured(torch.randn_like(mean))
        actions = self(obs)[:, : self.execute].clone()
        actions[..., self._explored] = raw
        return actions.flatten(1), raw.flatten(1), self._density(raw, mean, log_std)

    def judge(self, obs: Tensor, drawn: Tensor) -> tuple[Tensor, Tensor]:
        mean, log_std = self.distribution(obs)
        entropy = (self.execute * log_std.sum()).expand(len(mean))
        return self._density(drawn.unflatten(-1, mean.shape[1:]), mean, log_std), entropy

    def divergence(self, of: tuple[Tensor, ...], against: tuple[Tensor, ...]) -> Tensor:
        (mean, log_std), (other, other_log_std) = of, against
        apart = self._white((mean - other) / other_log_std.exp())
        wider = other_log_std - log_std + 0.5 * (2 * (log_std - other_log_std)).exp() - 0.5
        return 0.5 * (apart**2).sum((1, 2)) + self.execute * wider.sum()

    def loss(self, obs: Tensor, actions: Tensor, valid: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
        return self.network.loss(obs, actions, valid)

    def _density(self, raw: Tensor, mean: Tensor, log_std: Tensor) -> Tensor:
        """Return the log density (B,) of sampled chunks ``raw`` (B, E, Dm)."""
        white = self._white((raw - mean) / log_std.exp())
        fixed = log_std.sum() + 0.5 * len(log_std) * math.log(2 * math.pi)
        drawn_anew = len(log_std) * 0.5 * math.log(1.0 - self._correlation**2)
        return -0.5 * (white**2).sum((1, 2)) - self.execute * fixed - (self.execute - 1) * drawn_anew

    def _coloured(self, white: Tensor) -> Tensor:
        """Return correlated noise (B, E, Dm) of standard deviation 1 made of independent noise."""
        steps, share = [white[:, 0]], math.sqrt(1.0 - self._correlation**2)
        for k in range(1, self.execute):
            steps.append(self._correlation * steps[-1] + share * white[:, k])
        return torch.stack(steps, 1)

    def _white(self, coloured: Tensor) -> Tensor:
        """Return the independent noise (B, E, Dm) that :meth:`_coloured` made ``coloured`` of."""
        anew = (coloured[:, 1:] - self._correlation * coloured[:, :-1]) / math.sqrt(1.0 - self._correlation**2)
        return torch.cat([coloured[:, :1], anew], 1)


class ChunkPilot(Pilot):
    """Samples a chunk in each world, flies it, and samples the next.

    Args:
        actor: samples. policy: whose network that is. collector: whose worlds these are.
    """

    changing = ("_history",)

    def __init__(self, actor: ChunkActor, policy: ChunkPolicy, collector: Collector) -> None:
        super().__init__(collector)
        self._actor, self._interface = actor, policy.interface
        self._history = ObservationHistory(policy.config.history)
        self._seen = np.zeros((collector.n, policy.config.history, policy.interface.layout.size))
        self._plan = np.zeros((collector.n, actor.execute, policy.spec.action.size), np.float32)
        self._at = np.full(collector.n, actor.execute)

    def cut(self) -> None:
        self._at[:] = self._actor.execute

    def act(self) -> Acted:
        self.look()
        return self.decide(np.ones(self._collector.n, bool))

    def look(self) -> None:
        """Take in what the worlds show; once in every step."""
        self._seen = self._history.push(self._collector.frames)

    @torch.no_grad()
    def decide(self, free: np.ndarray) -> Acted:
        """Fly the worlds that are ``free`` (n,) bool; the others decide when they come to be, and are not moved."""
        due = (self._at >= self._actor.execute) & free
        obs = np.zeros((len(due), self._seen[0].size), np.float32)
        raw = np.zeros((len(due), self._actor.drawn_size), np.float32)
        if due.any():
            obs[due] = self._encoded(self._seen[due])
            chunks, drawn, _ = self._actor.sample(tensor(obs[due])[:, None])
            outputs = chunks.unflatten(-1, (self._actor.execute, -1)).numpy()
            self._plan[due] = self._interface.decode_actions(outputs, self._seen[due])
            raw[due], self._at[due] = drawn.numpy(), 0
        step = np.minimum(self._at, self._actor.execute - 1)
        actions = self._interface.switches.snap(self._plan[np.arange(len(due)), step])
        self._at += free
        return Acted(obs, due, raw, actions.astype(np.float64))

    def after(self, step: Transition) -> np.ndarray:
        ended = step.terminal | step.truncated
        led = np.concatenate([self._seen[:, 1:], step.next_frames[:, None]], axis=1)
        if ended.any():
            self._history.reset(ended)
            self._at[ended] = self._actor.execute
        return self._encoded(led)

    def _encoded(self, history: np.ndarray) -> np.ndarray:
        return self._interface.encode_obs(history).reshape(len(history), -1)
