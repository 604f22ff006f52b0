"""Gusts, pushes and slipping fingers at a person's word, for demonstrations of recovery.

They happen at a tick, like everything that the frames of a device ask for, and are recorded step by step in the topic
``/perturbation``, so that a replay of the actions and one of the log both meet them again.
"""

import math
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from aerial_il.core.seeding import episode_rng
from aerial_il.data.episode import PERTURBATION
from aerial_il.suite.batch import BatchEnvironment

KINDS = ("gust", "push", "drop")
TOPIC = PERTURBATION
LABELS = ("velocity_x", "velocity_y", "velocity_z", "fingers_open")
PUSH_MPS, GUST_MPS = 0.5, 0.9  # what base and arm gain by a push at once, and by a gust from beginning to end
GUST_TICKS, OPEN_TICKS = 50, 20  # 1 s, as long as the gust of aviation's rules: one minus a cosine; 0.4 s


@dataclass(frozen=True)
class Disturbance:
    """What meets the vehicle in one step.

    Attributes:
        velocity: (3,) m/s, world, that the base gains before the step. open: whether the fingers slip open in it.
    """

    velocity: np.ndarray
    open: bool = False

    def to_row(self) -> np.ndarray:
        """Return it as numbers named by ``LABELS``."""
        return np.array([*self.velocity, float(self.open)])

    def meet(self, env: BatchEnvironment, action: np.ndarray) -> np.ndarray:
        """Let it happen to an environment of one world; return the action (Da,) as it is carried out."""
        if self.velocity.any():
            env.push(self.velocity[None])
        return np.append(action[:-1], 1.0) if self.open else action


def possible(env: BatchEnvironment) -> tuple[str, ...]:
    """Return the kinds that can happen: a fixed base feels no push, and only an object that is held can slip."""
    flies = env.scenario.robot.vehicle.base_mobility > 0.0
    slips = "grasped" in env.spec.subtasks and env.spec.action.labels[-1:] == ("gripper",)
    return (*(KINDS[:2] if flies else ()), *(KINDS[2:] if slips else ()))


def refusal(env: BatchEnvironment, kind: str) -> str:
    """Return why a kind cannot happen here."""
    if kind == "drop":
        return f"No slip: in {env.spec.task} {env.spec.robot} holds nothing that could fall."
    return f"No {kind}: the base of {env.spec.robot} stands fixed."


class Perturber:
    """Turns what is pressed into disturbances; each comes from a direction that the episode's seed draws.

    Args:
        env: what is disturbed, for its names. seed: of the episode.
    """

    def __init__(self, env: BatchEnvironment, seed: int) -> None:
        self._possible = possible(env)
        self._rng = episode_rng(env.spec.robot, env.spec.task, "perturb", seed)
        self._gust, self._gust_left, self._open_left = np.zeros(3), 0, 0

    def step(self, pressed: Collection[str]) -> Disturbance:
        """Return what meets the vehicle in the coming step."""
        velocity = np.zeros(3)
        for kind in (kind for kind in self._possible if kind in pressed):
            if kind == "push":
                velocity = PUSH_MPS * self._direction()
            elif kind == "gust":
                self._gust, self._gust_left = GUST_MPS * self._direction(), GUST_TICKS
            else:
                self._open_left = OPEN_TICKS
        velocity = velocity + self._blowing()
        slips, self._open_left = self._open_left > 0, max(0, self._open_left - 1)
        return Disturbance(velocity, slips)

    def _blowing(self) -> np.ndarray:
        """Return the gust's share of this step."""
        if not self._gust_left:
            return np.zeros(3)
        done = GUST_TICKS - self._gust_left
        self._gust_left -= 1
        return self._gust * (1.0 - math.cos(2.0 * math.pi * (done + 0.5) / GUST_TICKS)) / GUST_TICKS

    def _direction(self) -> np.ndarray:
        angle = self._rng.uniform(0.0, 2.0 * math.pi)
        return np.array([math.cos(angle), math.sin(angle), 0.0])
