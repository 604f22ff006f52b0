"""A policy that shifts the actions of another one, which is frozen.

Source: T. Johannink et al., "Residual Reinforcement Learning for Robot Control", 2019, equation 2; L. Ankile et al.,
"From Imitation to Refinement", 2024, section 4, whose residual sees what the policy below it proposes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from aerial_il.core.checkpoint import Checkpoint
from aerial_il.core.contracts import BatchEnv, Observation
from aerial_il.core.specs import EnvSpec
from aerial_il.core.tensors import tensor
from aerial_il.policies.parts.building import built_for
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.layout import Interface
from aerial_il.policies.parts.prefixed import below, under

RESIDUAL, BASE = "residual", "base"


class Shift(nn.Module):
    """A perceptron with tanh to a shift (B, Da) of at most ``reach``, zero at first.

    Args:
        inputs: Do + Da. hidden: widths. moved: (Da,) bool, the elements that it shifts.
    """

    moved: Tensor

    def __init__(self, inputs: int, hidden: Sequence[int], moved: np.ndarray, reach: float) -> None:
        super().__init__()
        widths = (inputs, *hidden)
        layers = [part for a, b in zip(widths[:-1], hidden, strict=True) for part in (nn.Linear(a, b), nn.Tanh())]
        self.trunk, self.head, self.reach = nn.Sequential(*layers), nn.Linear(widths[-1], len(moved)), reach
        self.register_buffer("moved", torch.from_numpy(moved.astype(np.float32)))
        with torch.no_grad():
            self.head.weight.zero_()
            self.head.bias.zero_()

    def forward(self, seen: Tensor) -> Tensor:
        """Return pre-tanh shifts (B, Da) for what is seen (B, Do + Da)."""
        return self.head(self.trunk(seen))

    def bounded(self, raw: Tensor) -> Tensor:
        """Return shifts (B, Da) in normalised actions, none beyond ``reach``."""
        return self.reach * self.moved * torch.tanh(raw)


class ResidualPolicy(ChunkPolicy):
    """``base``, each of its actions shifted by what a network makes of the observation and of that action.

    Args:
        base: a policy of any class, which flies as it would alone. shift: the network. hidden: its widths.
        hold: steps that a shift lasts.
    """

    def __init__(
        self,
        base: ChunkPolicy,
        shift: Shift,
        *,
        hidden: Sequence[int],
        hold: int,
        origin: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__(base.config, base.interface, base.network, base.origin if origin is None else origin)
        self.base, self.shift, self.hidden, self.hold = base, shift, tuple(hidden), hold
        self._held, self._age = np.zeros((0, 0), np.float32), np.zeros(0, np.int64)

    def act(self, obs: Observation) -> np.ndarray:
        frames, actions = self.interface.layout.flatten(obs), self.base.act(obs)
        proposed = normalised(self.interface, actions, frames)
        if len(self._age) != len(frames):
            self._held, self._age = np.zeros_like(proposed), np.full(len(frames), self.hold)
        due = self._age >= self.hold
        if due.any():
            seen = what_is_seen(self.interface, frames[due], proposed[due])
            with torch.inference_mode():
                self._held[due] = self.shift.bounded(self.shift(tensor(seen))).numpy()
            self._age[due] = 0
        self._age += 1
        return shifted(self.interface, proposed, self._held, frames, actions)

    def reset(self, mask: np.ndarray | None = None) -> None:
        super().reset(mask)
        self.base.reset(mask)
        if mask is None:
            self._age = self._age[:0]
        elif len(self._age):
            self._age[mask] = self.hold

    def fresh(self) -> ResidualPolicy:
        return ResidualPolicy(self.base.fresh(), self.shift, hidden=self.hidden, hold=self.hold, origin=self.origin)

    def memory(self) -> dict[str, np.ndarray]:
        return {**under(BASE, self.base.memory()), "held": self._held.copy(), "age": self._age.copy()}

    def recall(self, memory: Mapping[str, np.ndarray]) -> None:
        self.base.recall(below(BASE, memory))
        self._held, self._age = memory["held"].copy(), memory["age"].copy()

    def attach(self, env: BatchEnv) -> None:
        super().attach(env)
        self.base.attach(env)

    def check(self, spec: EnvSpec) -> None:
        super().check(spec)
        self.base.check(spec)

    def to_checkpoint(self) -> Checkpoint:
        base = self.base.to_checkpoint()
        weights = {name: weight.detach().cpu().numpy() for name, weight in self.shift.state_dict().items()}
        settings = {"hidden": list(self.hidden), "hold": self.hold, "reach": self.shift.reach}
        arrays = {**under(BASE, base.arrays), **under(RESIDUAL, weights)}
        state = {"origin": self.origin, BASE: dict(base.state)}
        head = {name: base.config[name] for name in ("policy", "settings", "spec")}
        return Checkpoint(arrays, state, {**head, RESIDUAL: {**settings, BASE: dict(base.config)}})

    @staticmethod
    def around(saved: Checkpoint, rebuilt: Callable[[Checkpoint], ChunkPolicy]) -> ResidualPolicy:
        """Return what was saved, its base made by ``rebuilt``."""
        settings: Mapping[str, Any] = saved.config[RESIDUAL]
        base = rebuilt(Checkpoint(below(BASE, saved.arrays), saved.state[BASE], settings[BASE]))
        weights, hidden = below(RESIDUAL, saved.arrays), settings["hidden"]
        moved, inputs = weights["moved"], base.interface.layout.size + base.spec.action.size
        shift = built_for(weights, lambda: Shift(inputs, hidden, moved, float(settings["reach"])))
        shift.load_state_dict({name: torch.from_numpy(weight.copy()) for name, weight in weights.items()})
        return ResidualPolicy(base, shift, hidden=hidden, hold=int(settings["hold"]), origin=saved.state.get("origin"))


def what_is_seen(interface: Interface, frames: np.ndarray, proposed: np.ndarray) -> np.ndarray:
    """Return what a shift depends on (n, Do + Da): the encoded frames (n, Do) and the proposed actions (n, Da)."""
    seen = interface.encode_obs(frames[:, None])[:, 0]
    return np.concatenate([seen, np.clip(proposed, -interface.obs_clip, interface.obs_clip)], axis=1, dtype=np.float32)


def normalised(interface: Interface, actions: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """Return actions (n, Da) in the environment's units, proposed for frames (n, Do), as a network would answer."""
    return interface.encode_actions(actions[:, None].astype(np.float32), frames[:, None].astype(np.float32))[:, 0]


def shifted(
    interface: Interface, proposed: np.ndarray, shift: np.ndarray, frames: np.ndarray, actions: np.ndarray
) -> np.ndarray:
    """Return actions (n, Da) in the environment's units, those of worlds without a shift exactly as they were.

    Args:
        proposed: (n, Da) ``actions``, normalised. shift: (n, Da) what is added. frames: (n, Do) what is seen.
    """
    moved = interface.decode_actions((proposed + shift)[:, None], frames[:, None])[:, 0]
    moved = interface.layout.spec.action.clip(interface.switches.snap(moved).astype(np.float64))
    return np.where(np.asarray(shift.any(axis=1))[:, None], moved, actions)
