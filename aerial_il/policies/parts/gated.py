"""A policy beside its prior: both propose an action, and critics choose.

Source: H. Hu, S. Mirchandani, D. Sadigh, "Imitation Bootstrapped Reinforcement Learning", 2023, equation 1.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from aerial_il.core.checkpoint import Checkpoint
from aerial_il.core.contracts import BatchEnv, Observation
from aerial_il.core.specs import EnvSpec
from aerial_il.core.tensors import tensor
from aerial_il.policies.parts.building import built_for
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.critics import Critics
from aerial_il.policies.parts.prefixed import below, under

GATE, PRIOR, CRITICS = "gate", "prior", "critics"


def prefers_own(critics: Critics, obs: Tensor, own: Tensor, proposed: Tensor, *, caution: float) -> Tensor:
    """Return where (B,) an actor's own action is to be taken rather than the one that its prior proposed.

    Its value must be higher on average over the critics, by ``caution`` standard deviations of the difference.

    Args:
        critics: E of them. obs: (B, Do + 1), the mark of the absorbing state last. own, proposed: (B, Da).
    """
    gain = critics(obs, own) - critics(obs, proposed)
    return gain.mean(0) > caution * gain.std(0, correction=0)


class GatedPolicy(ChunkPolicy):
    """A policy of single steps that flies its own action where critics prefer it to its prior's.

    Args:
        own: what proposes beside the prior; its interface is the critics' too.
        prior: a policy of any class, which plans on whichever action is taken.
        critics: what chooses. hidden: their widths. caution: see :func:`prefers_own`.
    """

    def __init__(
        self, own: ChunkPolicy, prior: ChunkPolicy, critics: Critics, *, hidden: Sequence[int], caution: float
    ) -> None:
        super().__init__(own.config, own.interface, own.network, own.origin)
        self.prior, self.critics, self.hidden, self.caution = prior, critics, tuple(hidden), caution

    def act(self, obs: Observation) -> np.ndarray:
        proposed, own = self.prior.act(obs), super().act(obs)
        frames = self.interface.layout.flatten(obs)
        seen = tensor(self.interface.encode_obs(frames[:, None])[:, 0])
        marked = torch.cat([seen, torch.zeros(len(seen), 1)], dim=1)
        with torch.inference_mode():
            actions = (self._encoded(each, frames) for each in (own, proposed))
            chosen = prefers_own(self.critics, marked, *actions, caution=self.caution).numpy()
        return np.where(chosen[:, None], own, proposed)

    def _encoded(self, actions: np.ndarray, frames: np.ndarray) -> Tensor:
        encoded = self.interface.encode_actions(actions[:, None].astype(np.float32), frames[:, None].astype(np.float32))
        return tensor(np.clip(encoded[:, 0], -1.0, 1.0))

    def reset(self, mask: np.ndarray | None = None) -> None:
        super().reset(mask)
        self.prior.reset(mask)

    def fresh(self) -> GatedPolicy:
        own, prior = super().fresh(), self.prior.fresh()
        return GatedPolicy(own, prior, self.critics, hidden=self.hidden, caution=self.caution)

    def memory(self) -> dict[str, np.ndarray]:
        return {**super().memory(), **under(PRIOR, self.prior.memory())}

    def recall(self, memory: Mapping[str, np.ndarray]) -> None:
        super().recall(memory)
        self.prior.recall(below(PRIOR, memory))

    def attach(self, env: BatchEnv) -> None:
        super().attach(env)
        self.prior.attach(env)

    def check(self, spec: EnvSpec) -> None:
        super().check(spec)
        self.prior.check(spec)

    def to_checkpoint(self) -> Checkpoint:
        own, prior = super().to_checkpoint(), self.prior.to_checkpoint()
        weights = {name: weight.detach().cpu().numpy() for name, weight in self.critics.state_dict().items()}
        arrays = {**own.arrays, **under(PRIOR, prior.arrays), **under(CRITICS, weights)}
        critics = {"hidden": list(self.hidden), "count": self.critics.count, "layer_norm": bool(self.critics.gains)}
        gate = {"caution": self.caution, "critics": critics, "prior": dict(prior.config)}
        return Checkpoint(arrays, {**own.state, PRIOR: dict(prior.state)}, {**own.config, GATE: gate})

    @staticmethod
    def around(own: ChunkPolicy, saved: Checkpoint, rebuilt: Callable[[Checkpoint], ChunkPolicy]) -> GatedPolicy:
        """Return ``own`` beside the prior and behind the critics that were saved with it."""
        gate: Mapping[str, Any] = saved.config[GATE]
        prior = rebuilt(Checkpoint(below(PRIOR, saved.arrays), saved.state[PRIOR], gate["prior"]))
        layout, sizes, weights = own.interface.layout, gate["critics"], below(CRITICS, saved.arrays)
        inputs, hidden = layout.size + 1 + layout.spec.action.size, sizes["hidden"]
        critics = built_for(
            weights, lambda: Critics(inputs, hidden, sizes["count"], layer_norm=bool(sizes["layer_norm"]))
        )
        critics.load_state_dict({name: torch.from_numpy(weight.copy()) for name, weight in weights.items()})
        return GatedPolicy(own, prior, critics, hidden=hidden, caution=float(gate["caution"]))
