"""A policy whose network is torch's: trained here, saved as a sealed folder, flown by :class:`FlyingPolicy`."""

from __future__ import annotations

import logging
import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

import numpy as np
import torch

from aerial_il.core import checkpoint
from aerial_il.core.checkpoint import Checkpoint
from aerial_il.core.contracts import BatchEnv, Observation
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.latency import NO_LATENCY, Latency
from aerial_il.core.specs import EnvSpec
from aerial_il.core.tensors import tensor
from aerial_il.policies.parts import constant, embodiment
from aerial_il.policies.parts.building import built_for
from aerial_il.policies.parts.execution import Execution
from aerial_il.policies.parts.flying import FlyingPolicy
from aerial_il.policies.parts.guiding import Guide, joining
from aerial_il.policies.parts.layout import Interface, Layout
from aerial_il.policies.parts.network import ChunkNetwork, PolicySettings, shown
from aerial_il.policies.parts.normaliser import Normaliser
from aerial_il.policies.parts.switches import Switches
from aerial_il.policies.parts.vision import build_network
from aerial_il.robots import get as robot_of

log = logging.getLogger(__name__)


class ChunkPolicy(FlyingPolicy):
    """Predicts chunks of actions from observation histories and flies them, in n worlds at once.

    Args:
        config: sizes of the network and how its chunks are flown.
        interface: what the network is wired to.
        network: maps normalised (B, To, Do), or these and images, to normalised (B, Ta, Da).
        origin: where the policy comes from (run, step, provenance), kept with it.
    """

    config: PolicySettings

    def __init__(
        self,
        config: PolicySettings,
        interface: Interface,
        network: ChunkNetwork,
        origin: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__(config, interface, noise_size=network.noise_size, redraws=network.redraws, origin=origin)
        self.network = network.eval()
        self._followers: tuple[embodiment.Follower, embodiment.Follower] | None = None

    def answer(
        self, state: np.ndarray, images: Mapping[str, np.ndarray], noise: np.ndarray | None, guide: Any = None
    ) -> np.ndarray:
        encoded = tensor(state).to(self._device)
        pictures = {name: tensor(image).to(self._device) for name, image in images.items()}
        drawn = () if noise is None else (tensor(noise).to(self._device),)
        led = {"guide": guide} if guide else {}
        with torch.no_grad() if led else torch.inference_mode():
            return self.network(shown(encoded, pictures), *drawn, **led).cpu().numpy()

    def fresh(self) -> ChunkPolicy:
        again = ChunkPolicy(self.config, self.interface, self.network, self.origin)
        again._followers = self._followers
        return again._as(self)

    def executing(self, execution: Execution, latency: Latency = NO_LATENCY, *, thinking: int = 0) -> Self:
        if type(self) is not ChunkPolicy:
            raise InvalidValueError("execution: a policy around another one flies its chunks as it was trained.")
        return super().executing(execution, latency, thinking=thinking)

    @property
    def can_be_led(self) -> bool:
        return self.network.guided

    def attach(self, env: BatchEnv) -> None:
        super().attach(env)
        if self.execution.guidance:
            embodiment.check_steerable(self.interface, env.spec.observation.names)
            flown, learned = (embodiment.Follower.of(robot_of(each.robot)) for each in (env.spec, self.spec))
            self._followers = None if flown == learned else (flown, learned)
            if self._followers is None:
                log.warning("%s follows as %s does: guidance changes nothing.", env.spec.robot, self.spec.robot)

    def save(self, folder: str | os.PathLike[str]) -> Path:
        """Write the policy as a sealed folder that can be flown by itself."""
        return checkpoint.save(folder, self.to_checkpoint())

    def to_checkpoint(self) -> Checkpoint:
        """Return everything that rebuilds the policy."""
        weights = {f"network.{k}": v.detach().cpu().numpy() for k, v in self.network.state_dict().items()}
        wiring = self.interface
        arrays = {**weights, **wiring.obs.arrays("obs"), **wiring.action.arrays("action"), **wiring.switches.arrays()}
        arrays |= constant.saved(wiring, self.config.action_scaling)
        config = {"policy": self.config.name, "settings": self.config.to_dict(), "spec": self.spec.to_dict()}
        return Checkpoint(arrays, {"origin": self.origin}, config)

    @staticmethod
    def from_checkpoint(saved: Checkpoint, config: PolicySettings) -> ChunkPolicy:
        """Rebuild a policy whose settings were read as ``config``."""
        spec = EnvSpec.from_dict(saved.config["spec"])
        layout = Layout.of(spec, config)
        obs, action = (Normaliser.from_arrays(saved.arrays, prefix) for prefix in ("obs", "action"))
        action = constant.restored(saved.arrays, action, layout, config.action_scaling)
        network = built_for(saved.arrays, lambda: build_network(config, layout))
        network.load_state_dict(
            {k: torch.from_numpy(saved.arrays[f"network.{k}"].copy()) for k in network.state_dict()}
        )
        interface = Interface(layout, obs, action, config.obs_clip, Switches.from_arrays(saved.arrays))
        return ChunkPolicy(config, interface, network, saved.state.get("origin"))

    def _guide(self, history: np.ndarray, obs: Observation, due: np.ndarray) -> Guide | None:
        guide = None
        if self.execution.chunks == "realtime" and (committed := self._plan.committed(due)) is not None:
            guide = joining(self.interface, history, *committed, self._plan.delay)
        if self._followers:
            velocity, guidance = obs[embodiment.VELOCITY][due], self.execution.guidance
            steer = embodiment.steering(self._followers, self.interface, history, velocity, guidance)
            guide = replace(guide or Guide(), steer=steer)
        return guide

    @property
    def _device(self) -> torch.device:
        return next(self.network.parameters()).device
