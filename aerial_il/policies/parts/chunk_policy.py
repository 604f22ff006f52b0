"""A network that flies: it carries its specification and normalisers, and keeps the memory of n worlds."""

from __future__ import annotations

import logging
import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from aerial_il.core import checkpoint
from aerial_il.core.checkpoint import Checkpoint
from aerial_il.core.contracts import BatchEnv, Observation
from aerial_il.core.errors import InvalidValueError, NonFiniteActionError, UnknownNameError
from aerial_il.core.latency import NO_LATENCY, Latency, whole_steps
from aerial_il.core.specs import CONDITIONS, EnvSpec, ObservationSpec
from aerial_il.core.tensors import tensor
from aerial_il.policies.parts import constant, embodiment
from aerial_il.policies.parts.building import built_for
from aerial_il.policies.parts.chunking import ActionPlan, ObservationHistory
from aerial_il.policies.parts.egocentric import suits_other_robots
from aerial_il.policies.parts.execution import AS_TRAINED, Execution
from aerial_il.policies.parts.foreign_fields import shown_for, under_their_names
from aerial_il.policies.parts.guiding import Guide, joining
from aerial_il.policies.parts.layout import Interface, Layout, check_cameras
from aerial_il.policies.parts.network import ChunkNetwork, PolicySettings, shown
from aerial_il.policies.parts.noise import EpisodeNoise, glimpses
from aerial_il.policies.parts.normaliser import Normaliser
from aerial_il.policies.parts.prefixed import below, under
from aerial_il.policies.parts.switches import Switches
from aerial_il.policies.parts.tasks import as_one_of, completed, tasks_of
from aerial_il.policies.parts.vision import build_network
from aerial_il.robots import get as robot_of

log = logging.getLogger(__name__)
UNIMPORTANT = (*CONDITIONS, "max_steps", "instruction", "subtasks", "state_size")  # what a policy may fly across
UNTOLD = ("robot", "task", "action", "control_dt_s")  # by foreign data; a policy of theirs flies where its sizes fit
ANY_ROBOT = " A policy that sees the tool alone flies other robots too: train one with policy=diffusion_umi."


class ChunkPolicy:
    """Predicts chunks of actions from observation histories and flies them, in n worlds at once.

    Args:
        config: sizes of the network and how its chunks are flown.
        interface: what the network is wired to.
        network: maps normalised (B, To, Do), or these and images, to normalised (B, Ta, Da).
        origin: where the policy comes from (run, step, provenance), kept with it.
    """

    def __init__(
        self,
        config: PolicySettings,
        interface: Interface,
        network: ChunkNetwork,
        origin: Mapping[str, Any] | None = None,
    ) -> None:
        self.config, self.interface, self.origin = config, interface, dict(origin or {})
        self.network = network.eval()
        self._history = ObservationHistory(config.history)
        self._sights = {name: ObservationHistory(config.history) for name in interface.layout.images}
        self._plan = ActionPlan(config.chunk, config.execute, config.ensemble)
        self._noise = EpisodeNoise(network.noise_size, redraw=network.redraws)
        self._worlds: int | None = None
        self.execution, self._followers = AS_TRAINED, None
        self.task = self.spec.task
        self._shown_for: dict[str, str] = {}  # field -> its name in the environment, where data of others differ

    def __repr__(self) -> str:
        flown = f"{self.spec.robot}/{self.spec.task}"
        return f"{type(self).__name__}({self.config.name} of {flown}, {', '.join(self.spec.observation.names)})"

    @property
    def spec(self) -> EnvSpec:
        return self.interface.layout.spec

    def act(self, obs: Observation) -> np.ndarray:
        """Return actions (n, Da) within their bounds for observations ``name -> (n, ...)``.

        Raises:
            UnknownNameError: an observation field is missing.
            InvalidValueError: n changed without a :meth:`reset`, or an image has another size.
            NonFiniteActionError: NaN or infinity in an observation or in the network's output.
        """
        obs = self._with_task({**obs, **{own: obs[name] for own, name in self._shown_for.items()}})
        frame, images = self.interface.layout.flatten(obs), self.interface.layout.look(obs)
        self._count(len(frame))
        history = self._history.push(frame)
        seen = {name: sight.push(images[name]) for name, sight in self._sights.items()}
        due = self._plan.due(len(frame))
        if due.any():
            rows, worlds = slice(None) if due.all() else due, np.flatnonzero(due)
            first_seen = frame if frame.shape[1] or not self._noise.size else glimpses(tuple(images.values()))
            noise, pictures = self._noise.take(first_seen, due), {name: stack[rows] for name, stack in seen.items()}
            guided = {"guide": guide} if (guide := self._guide(history[rows], obs, due)) else {}
            self._plan.add(self.predict(history[rows], worlds, images=pictures, noise=noise, **guided), due)
        planned = self.interface.switches.snap(self._plan.pop())
        return self.spec.action.clip(planned.astype(np.float64))

    def predict(
        self,
        history: np.ndarray,
        worlds: np.ndarray | None = None,
        *,
        images: Mapping[str, np.ndarray] | None = None,
        noise: np.ndarray | None = None,
        guide: Guide | None = None,
    ) -> np.ndarray:
        """Return chunks of actions (B, Ta, Da) in the environment's units.

        Args:
            history: frames (B, To, Do). worlds: (B,) whose they are, for errors.
            images: of the layout's cameras by name, each (B, To, H, W, 3) uint8.
            noise: (B, S) what a network with chance draws from; None for its most ordinary answer.
            guide: what leads the denoising of a network that is guided.
        """
        encoded = tensor(self.interface.encode_obs(history)).to(self._device)
        pictures = {name: tensor(image).to(self._device) for name, image in (images or {}).items()}
        drawn = () if noise is None or not self.network.noise_size else (tensor(noise).to(self._device),)
        led = {"guide": guide} if guide else {}
        with torch.no_grad() if guide else torch.inference_mode():
            outputs = self.network(shown(encoded, pictures), *drawn, **led).cpu().numpy()
        if not np.isfinite(outputs).all():
            bad = np.flatnonzero(~np.isfinite(outputs).all(axis=(1, 2)))
            raise NonFiniteActionError("network output", bad if worlds is None else worlds[bad])
        return self.interface.decode_actions(outputs, history)

    def reset(self, mask: np.ndarray | None = None) -> None:
        """Forget the memory of the worlds in ``mask`` (n,) bool, or of all of them and their number."""
        if mask is None:
            self._worlds = None
        for memory in self._memories.values():
            memory.reset(mask)

    def fresh(self) -> ChunkPolicy:
        """Return the same policy, networks shared, with a memory of its own that is empty."""
        again = ChunkPolicy(self.config, self.interface, self.network, self.origin)
        again._shown_for, again.execution, again._followers = self._shown_for, self.execution, self._followers
        again._plan = self._plan.empty()
        return again

    def executing(self, execution: Execution, latency: Latency = NO_LATENCY) -> ChunkPolicy:
        """Return the same policy, network shared, whose chunks are flown as ``execution`` says.

        Args:
            execution: see there. latency: of the robot.

        Raises:
            InvalidValueError: the delay is no whole number of control steps or leaves too little of a chunk, or the
                network does not denoise, where it is to be led.
        """
        if type(self) is not ChunkPolicy:
            raise InvalidValueError("execution: a policy around another one flies its chunks as it was trained.")
        config, again = self.config, self.fresh()
        delay_ms = latency.total_ms if execution.delay_ms is None else execution.delay_ms
        steps = whole_steps("execution.delay_ms", delay_ms, self.spec.control_dt_s)
        realtime, led = execution.chunks == "realtime", execution.guidance > 0
        if (realtime or led) and not self.network.guided:
            asked = "execution.chunks=realtime" if realtime else f"execution.guidance={execution.guidance:g}"
            raise InvalidValueError(f"{asked} needs a policy that denoises (diffusion, flow); this is {config.name}.")
        execute, ensemble = (config.chunk // 2, None) if realtime else (config.execute, config.ensemble)
        delay = 0 if execution.chunks == "plain" else steps
        again._plan = ActionPlan(config.chunk, max(1, execute), ensemble, delay=delay)
        again.execution = execution
        return again

    def memory(self) -> dict[str, np.ndarray]:
        """Return copies of what is remembered of all worlds: with it :meth:`recall` acts on as if nothing had been."""
        arrays: dict[str, np.ndarray] = {}
        for name, part in self._memories.items():
            arrays |= under(name, part.memory())
        return {**arrays, "worlds": np.array(-1 if self._worlds is None else self._worlds)}

    def recall(self, memory: Mapping[str, np.ndarray]) -> None:
        """Remember what :meth:`memory` returned."""
        for name, part in self._memories.items():
            part.recall(below(name, memory))
        worlds = int(memory["worlds"])
        self._worlds = None if worlds < 0 else worlds

    def attach(self, env: BatchEnv) -> None:
        """Refuse an environment that differs from those the policy was trained in, and take its task as one's own."""
        self.check(env.spec)
        self.task, self._shown_for = env.spec.task, self._shown_in(env.spec)
        if self.execution.guidance:
            embodiment.check_steerable(self.interface, env.spec.observation.names)
            flown, learned = (embodiment.Follower.of(robot_of(each.robot)) for each in (env.spec, self.spec))
            self._followers = None if flown == learned else (flown, learned)
            if self._followers is None:
                log.warning("%s follows as %s does: guidance changes nothing.", env.spec.robot, self.spec.robot)
        if env.spec.robot != self.spec.robot and not self.spec.is_foreign:
            log.warning(
                "Trained on %s, it flies %s: all it knows of a robot is its tool.", self.spec.robot, env.spec.robot
            )
        for own, name in self._shown_for.items():
            log.warning("The policy's %s is the environment's %s, the only field of its shape.", own, name)

    def check(self, spec: EnvSpec) -> None:
        """Raise :class:`InvalidValueError`, naming each differing key, unless the policy can fly under ``spec``."""
        spec = under_their_names(spec, self._shown_in(spec))
        check_cameras(self.interface.layout, spec)
        spec = as_one_of(self.spec, spec)
        untold = UNTOLD if self.spec.is_foreign and self.spec.action.size == spec.action.size else ()
        of_the_tool = self.interface.layout.relative and suits_other_robots(self.spec, self._seen)
        across = ("robot",) if of_the_tool else ()
        differing = _restrict(self.spec, self._seen).differences(
            _restrict(spec, self._seen), ignore=(*UNIMPORTANT, *untold, *across)
        )
        if differing:
            made = f"{self.spec.task} on {self.spec.robot} with {self.spec.action.level} actions"
            hint = ANY_ROBOT if spec.robot != self.spec.robot and spec.action == self.spec.action else ""
            raise InvalidValueError(f"The policy was trained for {made}. It differs in: {'; '.join(differing)}.{hint}")

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
        """Return what leads the chunks of the m worlds in ``due`` (n,), which see ``history`` (m, To, Do), if any."""
        guide = None
        if self.execution.chunks == "realtime" and (committed := self._plan.committed(due)) is not None:
            guide = joining(self.interface, history, *committed, self._plan.delay)
        if self._followers:
            velocity, guidance = obs[embodiment.VELOCITY][due], self.execution.guidance
            steer = embodiment.steering(self._followers, self.interface, history, velocity, guidance)
            guide = replace(guide or Guide(), steer=steer)
        return guide

    @property
    def _memories(self) -> dict[str, ObservationHistory | ActionPlan | EpisodeNoise]:
        """All that changes while it flies, by name."""
        sights = {f"sight.{name}": sight for name, sight in self._sights.items()}
        return {"history": self._history, **sights, "plan": self._plan, "noise": self._noise}

    @property
    def _seen(self) -> tuple[str, ...]:
        return (*self.interface.layout.names, *self.interface.layout.images)

    def _shown_in(self, spec: EnvSpec) -> dict[str, str]:
        """Return field -> what ``spec`` calls it, for a policy that learned from data of others."""
        return shown_for(self.spec, self._seen, spec) if self.spec.is_foreign else {}

    @property
    def _device(self) -> torch.device:
        return next(self.network.parameters()).device

    def _with_task(self, obs: Observation) -> Observation:
        """Return ``obs`` with the task that is flown, where the policy knows several."""
        tasks = tasks_of(self.spec)
        if tasks == (self.spec.task,):
            return obs
        if self.task not in tasks:
            hint = "Attach it to an environment first, or set its task."
            raise UnknownNameError("task of the policy", self.task, tasks, hint)
        return completed(obs, self.spec, self.task)

    def _count(self, n: int) -> None:
        if self._worlds not in (None, n):
            raise InvalidValueError(f"The policy flies {self._worlds} worlds and was shown {n}: call reset() between.")
        self._worlds = n


def _restrict(spec: EnvSpec, names: tuple[str, ...]) -> EnvSpec:
    return replace(spec, observation=ObservationSpec(tuple(f for f in spec.observation.fields if f.name in names)))
