"""Worlds without a simulator behind them, as a recording asks for them, and demonstrations flown in them."""

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np

from aerial_il.core.contracts import BatchEnvBase, StepResult
from aerial_il.core.specs import EnvSpec
from aerial_il.data.episode import Episode


class StatelessBatch(BatchEnvBase):
    """n worlds of a few numbers each; who inherits it counts ``steps`` (n,) and steps the worlds."""

    spec: EnvSpec
    num_envs: int
    steps: np.ndarray
    model, model_xml = SimpleNamespace(nu=0), "<mujoco/>"

    @property
    def ctrl(self) -> np.ndarray:
        return np.zeros((self.num_envs, 0))

    @property
    def sim_time(self) -> np.ndarray:
        return self.steps * self.spec.control_dt_s

    def get_state(self) -> np.ndarray:
        return np.zeros((self.num_envs, 0))

    def restarted(self, seeds: np.ndarray | int, mask: np.ndarray | None) -> Iterator[tuple[int, int]]:
        """Yield each world that starts anew, its step count at zero, with the seed of its episode."""
        each = seeds + np.arange(self.num_envs) if np.ndim(seeds) == 0 else np.asarray(seeds)
        for world in range(self.num_envs) if mask is None else np.flatnonzero(mask):
            self.steps[world] = 0
            yield int(world), int(each[world])

    def close(self) -> None:
        """There is nothing to free."""


def fly(env: Any, policy: Any, seed: int) -> Iterator[StepResult]:
    """Yield what comes of each step of a policy in all worlds, from ``seed`` on and over the whole time."""
    obs = env.reset(seed)
    policy.reset()
    for _ in range(env.spec.max_steps):
        result = env.step(policy.act(obs))
        obs = result.obs
        yield result


def episode_of(
    spec: EnvSpec,
    index: int,
    obs: dict[str, np.ndarray],
    actions: np.ndarray,
    *,
    labels: np.ndarray | None = None,
    rewards: np.ndarray | None = None,
) -> Episode:
    """Return a successful demonstration of T actions (T, Da); labels and rewards where there are some."""
    steps, no = len(actions), np.zeros(len(actions), bool)
    return Episode(
        uid=f"demo-{index}",
        spec=spec,
        provenance={"seed": index},
        obs=obs,
        actions=actions,
        executed_actions=spec.action.clip(actions),
        expert_actions=np.full_like(actions, np.nan) if labels is None else labels,
        is_intervention=no,
        phase=np.full(steps, -1),
        rewards=np.zeros(steps) if rewards is None else rewards,
        terminated=no,
        truncated=np.arange(steps) == spec.max_steps - 1,
        states=np.zeros((steps + 1, 0)),
        ctrl=np.zeros((steps, 0)),
        sim_time=spec.control_dt_s * np.arange(steps + 1),
        success=True,
        model_xml="",
    )
