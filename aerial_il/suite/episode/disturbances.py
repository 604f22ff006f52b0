"""A tier at work on n worlds: what it draws for an episode, what it does to models and actions."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import mujoco
import numpy as np

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.seeding import episode_rng
from aerial_il.suite.episode.hold_action import hold_action
from aerial_il.suite.episode.variation import Varied
from aerial_il.suite.physics import episode_state as layout
from aerial_il.suite.physics.latency import MAX_ACTION, MAX_DELAY, exchange
from aerial_il.suite.physics.view import View
from aerial_il.suite.physics.wind import DIRECTION, start_wind
from aerial_il.suite.scenario import Scenario


class Disturbances:
    """Disturb n worlds as the scenario's tier says.

    Args:
        scenario: the environment. view: the worlds, their models still nominal.
    """

    def __init__(self, scenario: Scenario, view: View) -> None:
        self.scenario, self.view, self.tier = scenario, view, scenario.tier
        worlds, size = view.worlds, scenario.spec.action.size
        if self.tier.latency and size > MAX_ACTION:
            raise InvalidValueError(f"Late actions have {MAX_ACTION} numbers at most; {scenario.action} has {size}.")
        self._varied = Varied(worlds.model, scenario.robot, scenario.task_name, self.tier)
        self._model_seeds = np.full(worlds.n, -1, np.int64)  # whose parameters each model holds; no part of the state
        self._workspace = mujoco.MjData(worlds.model) if self._varied.fields else None
        self._queues, self._delays = view.userdata[:, layout.QUEUE], view.userdata[:, layout.DELAY]
        self._due = np.zeros((worlds.n, size))

    def start(self, world: int, seed: int) -> None:
        """Draw what one world's episode starts with; its state has been cleared."""
        userdata = self.view.userdata[world]
        if self.tier.noise:
            userdata[layout.NOISE] = self._rng("noise", seed).standard_normal(12)
        if self.tier.wind:
            userdata[layout.WIND] = start_wind(self._rng("wind", seed))
        if self.tier.estimation:
            userdata[layout.ERRORS] = self._rng("estimation", seed).standard_normal(
                layout.ERRORS.stop - layout.ERRORS.start
            )
        userdata[layout.DELAY] = self._draw_delay(seed)

    def hold(self, mask: np.ndarray) -> None:
        """Let the command before the first action be, in the worlds of ``mask`` (n,), to stay in place."""
        if not self.tier.latency:
            return
        for i in np.flatnonzero(mask):
            stay = hold_action(self.scenario, self.view, int(i))
            for slot in range(MAX_DELAY):
                self._queues[i, slot * MAX_ACTION : slot * MAX_ACTION + stay.size] = stay

    def vary(self, seeds: np.ndarray, mask: np.ndarray) -> None:
        """Give the worlds in ``mask`` (n,) the model parameters of their episodes ``seeds`` (n,)."""
        if self._workspace is None:
            return
        for i in np.flatnonzero(mask & (self._model_seeds != seeds)):
            seed = int(seeds[i])
            model = self.view.worlds.own_model(int(i))
            for name, value in self._varied.values(self._varied.draw(seed)).items():
                getattr(model, name)[:] = value
            mujoco.mj_setConst(model, self._workspace)
            self._model_seeds[i] = seed

    def arriving(self, actions: np.ndarray, mask: np.ndarray) -> np.ndarray:
        """(n, Da) actions that reach the worlds in ``mask`` when ``actions`` (n, Da) are sent."""
        if not self.tier.latency:
            return actions
        exchange(self._delays, self._queues, actions, mask, self._due)
        return self._due

    def drawn(self, seed: int) -> dict[str, Any]:
        """Disturbances drawn for the episode ``seed``, as plain values."""
        found = {name: value for name, value in asdict(self._varied.draw(seed)).items() if name in self._drawn_names}
        if self.tier.wind:
            found["wind_direction_rad"] = float(start_wind(self._rng("wind", seed))[DIRECTION])
        if self.tier.latency:
            found["latency_steps"] = self._draw_delay(seed)
        return found

    @property
    def _drawn_names(self) -> tuple[str, ...]:
        parts = {
            "payload": ("object_mass", "base_mass", "base_offset"),
            "friction": ("contact_friction", "joint_friction"),
            "motors": ("rotor_gain",),
        }
        return tuple(name for component in self.tier.components for name in parts.get(component, ()))

    def _draw_delay(self, seed: int) -> int:
        latency = self.tier.latency
        return int(self._rng("latency", seed).integers(latency.least, latency.most + 1)) if latency else 0

    def _rng(self, purpose: str, seed: int) -> np.random.Generator:
        return episode_rng(self.scenario.robot_name, self.scenario.task_name, purpose, seed)
