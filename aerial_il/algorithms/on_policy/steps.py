"""A pilot of single steps: every step is a decision, sampled from the actor's answer to one observation."""

import numpy as np
import torch

from aerial_il.algorithms.on_policy.decisions import Acted, Pilot
from aerial_il.algorithms.online.collector import Transition
from aerial_il.algorithms.online.interface import decode, encode, standardised
from aerial_il.algorithms.online.moments import RunningMoments
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.core.tensors import tensor
from aerial_il.policies.parts.network import StochasticNetwork


class StepPilot(Pilot):
    """Flies the worlds of a run step by step, with what an actor samples.

    Args:
        run: whose worlds these are. actor: samples.
        obs_norm: whether observations are standardised by the moments of all that was seen.
    """

    changing = ("_obs_norm",)

    def __init__(self, run: OnlineRun, actor: StochasticNetwork, *, obs_norm: bool) -> None:
        super().__init__(run.collector)
        self._run, self._actor = run, actor
        self._obs_norm, self._seen = RunningMoments(run.sizes[0]) if obs_norm else None, list[np.ndarray]()

    def cut(self) -> None:
        self._seen = []

    @torch.no_grad()
    def act(self) -> Acted:
        frames, interface = self._collector.frames, self._run.interface
        self._seen.append(frames)
        obs = encode(interface, frames)
        normalised, raw, _ = (drawn.numpy() for drawn in self._actor.sample(tensor(obs)[:, None]))
        every = np.ones(len(obs), bool)
        return Acted(obs, every, raw, decode(interface, normalised, frames), normalised=normalised)

    def after(self, step: Transition) -> np.ndarray:
        return encode(self._run.interface, step.next_frames)

    def standardise(self) -> None:
        run = self._run
        if self._obs_norm is None:
            return
        if self._seen:
            self._obs_norm.add(run.interface.layout.relate(np.concatenate(self._seen)))
        run.interface = standardised(run.interface, self._obs_norm)
