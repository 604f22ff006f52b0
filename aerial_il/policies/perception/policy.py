"""A policy of the state that flies on what its cameras show: estimates stand where it was shown the truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any
from zlib import crc32

import numpy as np
import torch
from torch import Tensor

from aerial_il.core.checkpoint import Checkpoint
from aerial_il.core.contracts import BatchEnv, Observation
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import Field
from aerial_il.policies.parts.building import built_for
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.flying import Question
from aerial_il.policies.parts.layout import Layout
from aerial_il.policies.parts.network import ChunkNetwork, Shown, state_of
from aerial_il.policies.parts.noise import glimpses
from aerial_il.policies.parts.prefixed import below, under
from aerial_il.policies.perception.cameras import Camera
from aerial_il.policies.perception.eyes import Carried, Eyes
from aerial_il.policies.perception.tracker import Tracker

PERCEPTION, PILOT, EYES, TRACKER, PAST = "perception", "pilot", "eyes", "tracker", "past"


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
        self._tracker = Tracker(eyes.targets.estimated, forget, eyes.targets.rates)
        self._steps, self._past = np.zeros(0, int), dict[str, np.ndarray]()
        self._looks = {camera.image: Looks(self._taken(camera.image), every) for camera in eyes.cameras}

    def look(self, obs: Observation) -> Question | None:
        return super().look({**obs, **self.estimate(obs)})

    def _first_seen(self, frame: np.ndarray, images: Mapping[str, np.ndarray]) -> np.ndarray:
        """Not the estimates, whose last bits depend on how many worlds a network is asked of at once."""
        return glimpses(tuple(images.values())) if self._noise.size else frame

    def estimate(self, obs: Observation) -> dict[str, np.ndarray]:
        """Take in what n worlds show; return ``field -> (n, D)`` of all that has to be seen."""
        n = len(obs["ee_pos"])
        if len(self._steps) != n:
            self._steps, self._past = np.zeros(n, int), {}
        begins = self._steps == 0
        self._remember(obs, begins)
        self._tracker.begin(begins)
        self._tracker.move(*Carried.between(self._knew(1), obs))
        due = [self._looks[camera.image].due(obs[camera.image], self._steps) for camera in self.eyes.cameras]
        self._tracker.fade(np.any(due, axis=0))
        for k, (camera, mask) in enumerate(zip(self.eyes.cameras, due, strict=True)):
            if mask.any():
                delay = self._taken(camera.image).delay
                self.eyes.tell(self._tracker, k, obs, self._knew(delay), np.minimum(delay, self._steps), mask)
        self._steps = self._steps + 1
        return self.eyes.complete(obs, self._tracker.estimates())

    def _taken(self, image: str) -> Field:
        return self.spec.observation[image]

    def _remember(self, obs: Observation, begins: np.ndarray) -> None:
        """Keep what the robots know of themselves for as long as images are late, at least for a step."""
        kept = 1 + max(1, *(self._taken(camera.image).delay for camera in self.eyes.cameras))
        for name in {*self.eyes.poses, *self.eyes.own}:
            now = np.asarray(obs[name], float)[None]
            past = self._past.get(name, np.repeat(now, kept, axis=0))
            past = np.concatenate([past[1:], now])
            self._past[name] = np.where(begins[:, None], now, past)

    def _knew(self, steps: int) -> dict[str, np.ndarray]:
        """Return what the robots knew of themselves so many steps ago, or when they began."""
        return {name: past[-1 - steps] for name, past in self._past.items()}

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
            self._steps, self._past = np.zeros(0, int), {}
        elif len(self._steps):
            self._steps[mask] = 0

    def fresh(self) -> PerceivingPolicy:
        again = PerceivingPolicy(self.pilot, self.eyes, every=self.every, forget=self.forget, origin=self.origin)
        return again._as(self)

    def memory(self) -> dict[str, np.ndarray]:
        own = {"steps": self._steps.copy(), **under(TRACKER, self._tracker.memory())}
        own |= under(PAST, {name: past.copy() for name, past in self._past.items()})
        for image, looks in self._looks.items():
            own |= under(image, looks.memory())
        return {**super().memory(), **under(EYES, own)}

    def recall(self, memory: Mapping[str, np.ndarray]) -> None:
        super().recall(memory)
        own = below(EYES, memory)
        self._steps = own["steps"].copy()
        self._past = {name: past.copy() for name, past in below(PAST, own).items()}
        self._tracker.recall(below(TRACKER, own))
        for image, looks in self._looks.items():
            looks.recall(below(image, own))

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
        found = {each.field for each in (*targets.estimated, *targets.sums, *targets.rates)} | {*targets.constant}
        return tuple(name for name in super()._seen if name not in found)


class Looks:
    """When a camera's image is to be looked at, in n worlds: at first, and then whenever it is due and a new one.

    New ones of a camera that takes one in each control step come by the clock. Those of a slower one are known by being
    others than before: who takes over in the middle of a flight does not know when it takes them.

    Args:
        taken: the field of its images. every: control steps from one look to the next, at least.
    """

    def __init__(self, taken: Field, every: int) -> None:
        self._taken, self._every = taken, every
        self._marks, self._since = np.zeros(0, np.int64), np.zeros(0, np.int64)

    def due(self, images: np.ndarray, steps: np.ndarray) -> np.ndarray:
        """Return in which worlds (n,) bool the images (n, H, W, 3) are to be looked at, so many ``steps`` (n,) on."""
        if self._taken.every == 1:
            age = steps - self._taken.delay
            return (steps == 0) | ((age > 0 if self._taken.delay else age >= 0) & (age % self._every == 0))
        marks = np.array([crc32(np.ascontiguousarray(image)) for image in images])
        if len(self._marks) != len(marks):
            self._marks, self._since = marks, np.zeros_like(marks)
        due = (steps == 0) | ((marks != self._marks) & (self._since >= self._every))
        self._marks, self._since = np.where(due, marks, self._marks), np.where(due, 1, self._since + 1)
        return due

    def memory(self) -> dict[str, np.ndarray]:
        """Return what it remembers."""
        return {"marks": self._marks.copy(), "since": self._since.copy()}

    def recall(self, memory: Mapping[str, np.ndarray]) -> None:
        """Go on from what :meth:`memory` returned."""
        self._marks, self._since = memory["marks"].copy(), memory["since"].copy()


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
