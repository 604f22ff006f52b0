"""A mass on a line that is told its velocity, and where to go: solved in a second by anything that learns at all.

It ends when it leaves the line, and, if so made, when it has arrived. It cannot save its state.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from aerial_il.core.seeding import named_rng
from aerial_il.core.specs import ActionSpec, EnvSpec, Field, ObservationSpec
from aerial_il.data.episode import Episode
from tests.algorithms.point_mass import StepResult
from tests.algorithms.stateless_batch import StatelessBatch, episode_of

SPEED, EDGE, NEAR, MAX_STEPS = 0.5, 1.5, 0.2, 12
SPEC = EnvSpec(
    robot="mass",
    task="go",
    tier="calm",
    observation=ObservationSpec((Field("position", (1,)), Field("goal", (1,), "task"))),
    action=ActionSpec("velocity", ("x",), ("m/s",), np.array([-0.5]), np.array([1.0])),
    control_dt_s=0.1,
    max_steps=MAX_STEPS,
    instruction="Go there.",
    subtasks=(),
    state_size=0,
)


class Drift(StatelessBatch):
    """n masses."""

    spec = SPEC

    def __init__(self, num_envs: int, *, ends_at_success: bool = False) -> None:
        self.num_envs, self.ends_at_success = num_envs, ends_at_success
        self.position, self.goal = np.zeros((num_envs, 1)), np.zeros((num_envs, 1))
        self.steps = np.zeros(num_envs, int)

    def reset(self, seeds: np.ndarray | int, mask: np.ndarray | None = None) -> dict[str, np.ndarray]:
        for i, seed in self.restarted(seeds, mask):
            self.position[i], self.goal[i] = named_rng(seed, "drift").uniform(-1, 1, (2, 1))
        return self._observe()

    def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> StepResult:
        live = np.ones(self.num_envs, bool) if mask is None else mask
        executed = self.spec.action.clip(actions)
        self.position = np.where(live[:, None], self.position + SPEED * executed, self.position)
        self.steps += live
        distance = np.abs(self.position - self.goal).max(1)
        out = np.abs(self.position).max(1) > EDGE
        info = {"success": distance < NEAR, "executed_action": executed}
        return StepResult(self._observe(), 1.0 - distance / 2.5, out, (self.steps >= MAX_STEPS) & ~out, info)

    def _observe(self) -> dict[str, np.ndarray]:
        return {"position": self.position.copy(), "goal": self.goal.copy()}


class Silent(Drift):
    """Pays nothing and is never solved, whatever is done."""

    def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> StepResult:
        result, nothing = super().step(actions, mask), np.zeros(self.num_envs)
        return replace(result, reward=nothing, info={**result.info, "success": nothing.astype(bool)})


def guide(obs: Any) -> np.ndarray:
    """Go straight to the goal, and stay."""
    return np.clip((obs["goal"] - obs["position"]) / SPEED, SPEC.action.low, SPEC.action.high)


def demonstrations(count: int, *, ends_at_success: bool = False) -> list[Episode]:
    """Record ``count`` flights of the guide, over the whole time, or until it arrives."""
    env = Drift(count, ends_at_success=ends_at_success)
    seen, flown, paid, arrived = [env.reset(0)], [], [], []
    for _ in range(MAX_STEPS):
        result = env.step(guide(seen[-1]))
        seen.append(result.obs)
        flown.append(result.info["executed_action"])
        paid.append(result.reward)
        arrived.append(result.info["success"])
    when = np.argmax(np.stack(arrived), axis=0) + 1
    lengths = when if ends_at_success else np.full(count, MAX_STEPS)
    return [
        episode_of(
            SPEC,
            i,
            {k: np.stack([o[k][i] for o in seen[: t + 1]]) for k in seen[0]},
            np.stack(flown)[:t, i],
            rewards=np.stack(paid)[:t, i],
        )
        for i, t in enumerate(lengths)
    ]


def mean_reward(policy: Any, *, episodes: int = 100) -> float:
    """Fly unseen seeds and return what a step of the whole time is paid, nothing after an end."""
    env, total = Drift(episodes), 0.0
    obs, lost = env.reset(10_000), np.zeros(episodes, bool)
    policy.reset()
    for _ in range(MAX_STEPS):
        result = env.step(policy.act(obs), ~lost)
        total += float(result.reward[~lost].sum())
        obs, lost = result.obs, lost | result.terminated
    return total / (episodes * MAX_STEPS)


class Guide:
    """:func:`guide` as a policy."""

    def act(self, obs: Any) -> np.ndarray:
        return guide(obs)

    def reset(self, mask: np.ndarray | None = None) -> None:
        """There is nothing to forget."""
