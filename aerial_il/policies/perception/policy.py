"""A policy of the state that flies on what its cameras show: estimates stand where it was shown the truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from aerial_il.core.checkpoint import Checkpoint
from aerial_il.core.contracts import BatchEnv, Observation
from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.parts.building import built_for
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.flying import Question
from aerial_il.policies.parts.layout import Layout
from aerial_il.policies.parts.network import ChunkNetwork, Shown, state_of
from aerial_il.policies.parts.prefixed import below, under
from aerial_il.policies.parts.relative import rotations
from aerial_il.policies.perception.cameras import Camera
from aerial_il.policies.perception.eyes import Eyes
from aerial_il.policies.perception.tracker import Tracker

PERCEPTION, PILOT, EYES, TRACKER = "perception", "pilot", "eyes", "tracker"


class PerceivingPolicy(ChunkPolicy):
    """Looks, estimates, and lets a policy of the state act upon it.

    Args:
        pilot: the policy of the state. eyes: what looks. every: control steps between two looks.
        forget: see :class:`Tracker`.
    """

    def __init__(
        self, pilot: ChunkPolicy, eyes: Eyes, *, every: int, forget: float, origin: Mapping[str, Any] | None = None
    ) -> None:
        config = replace(pilot.config, images=tuple(camera.image for camera in eyes.cameras))
        interface = replace(pilot.interface, layout=Layout.of(pilot.spec, config))
        super().__init__(config, interface, StateOnly(pilot.network), pilot.origin if origin is None else origin)
        self.pilot, self.eyes, self.every, self.forget = pilot, eyes.eval(), every, forget
        self._tracker = Tracker(eyes.targets.estimated, forget)
        self._steps, self._tool = np.zeros(0, int), np.zeros((0, 4, 3))

    def look(self, obs: Observation) -> Question | None:
        return super().look({**obs, **self.estimate(obs)})

    def estimate(self, obs: Observation) -> dict[str, np.ndarray]:
        """Take in what n worlds show; return ``field -> (n, D)`` of all that has to be seen."""
        n = len(obs["ee_pos"])
        if len(self._steps) != n:
            self._steps, self._tool = np.zeros(n, int), np.zeros((n, 4, 3))
        begins, now = self._steps == 0, np.concatenate([rotations(obs["ee_rot6d"]), obs["ee_pos"][:, None]], axis=1)
        self._tracker.begin(begins)
        before = np.where(begins[:, None, None], now, self._tool)
        self._tracker.move(now[:, :3] @ np.swapaxes(before[:, :3], 1, 2), before[:, 3], now[:, 3])
        due = self._steps % self.every == 0
        if due.any():
            self.eyes.tell(self._tracker, obs, due)
        self._steps, self._tool = self._steps + 1, now
        return self.eyes.complete(obs, self._tracker.estimates())

    @property
    def deviations(self) -> dict[str, np.ndarray]:
        """``field -> (n,)``, how sure the newest estimates are."""
        return self._tracker.deviations()

    def attach(self, env: BatchEnv) -> None:
        super().attach(env)
        for camera in self.eyes.cameras:
            if said := camera.differs(Camera.of(env.spec, camera.image)):
                raise InvalidValueError(f"In {env.spec.robot} {said}: what was learned there cannot be measured here.")

    def reset(self, mask: np.ndarray | None = None) -> None:
        super().reset(mask)
        if mask is None:
            self._steps, self._tool = np.zeros(0, int), np.zeros((0, 4, 3))
        elif len(self._steps):
            self._steps[mask] = 0

    def fresh(self) -> PerceivingPolicy:
        again = PerceivingPolicy(self.pilot, self.eyes, every=self.every, forget=self.forget, origin=self.origin)
        again._shown_for, again.execution = self._shown_for, self.execution
        again._plan = self._plan.empty()
        return again

    def memory(self) -> dict[str, np.ndarray]:
        own = {"steps": self._steps.copy(), "tool": self._tool.copy(), **under(TRACKER, self._tracker.memory())}
        return {**super().memory(), **under(EYES, own)}

    def recall(self, memory: Mapping[str, np.ndarray]) -> None:
        super().recall(memory)
        own = below(EYES, memory)
        self._steps, self._tool = own["steps"].copy(), own["tool"].copy()
        self._tracker.recall(below(TRACKER, own))

    def to_checkpoint(self) -> Checkpoint:
        pilot = self.pilot.to_checkpoint()
        weights = {name: weight.detach().cpu().numpy() for name, weight in self.eyes.state_dict().items()}
        seen = {"every": self.every, "forget": self.forget, "eyes": self.eyes.to_dict()}
        config = {**pilot.config, PERCEPTION: seen}
        return Checkpoint(
            {**under(PILOT, pilot.arrays), **under(EYES, weights)}, {**pilot.state, "origin": self.origin}, config
        )

    @staticmethod
    def around(saved: Checkpoint, rebuilt: Callable[[Checkpoint], ChunkPolicy]) -> PerceivingPolicy:
        """Return the policy that was saved with eyes."""
        config = {key: value for key, value in saved.config.items() if key != PERCEPTION}
        pilot = rebuilt(Checkpoint(below(PILOT, saved.arrays), saved.state, config))
        seen, weights = saved.config[PERCEPTION], below(EYES, saved.arrays)
        eyes = built_for(weights, lambda: Eyes.from_dict(seen["eyes"]))
        eyes.load_state_dict({name: torch.from_numpy(weight.copy()) for name, weight in weights.items()})
        return PerceivingPolicy(
            pilot, eyes, every=int(seen["every"]), forget=float(seen["forget"]), origin=saved.state.get("origin")
        )

    @property
    def _seen(self) -> tuple[str, ...]:
        targets = self.eyes.targets
        found = {each.field for each in (*targets.estimated, *targets.sums)} | {*targets.constant}
        return tuple(name for name in super()._seen if name not in found)


class StateOnly(ChunkNetwork):
    """A network of the state, shown images that it does not look at."""

    def __init__(self, network: ChunkNetwork) -> None:
        super().__init__()
        self.network = network
        self.noise_size, self.redraws, self.guided = network.noise_size, network.redraws, network.guided

    def forward(self, obs: Shown, *noise: Tensor, **guide: Any) -> Tensor:
        return self.network(state_of(obs), *noise, **guide)

    def loss(self, obs: Shown, actions: Tensor, valid: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
        return self.network.loss(state_of(obs), actions, valid)
