"""Goals that can be exchanged: of the mass on a line, and of one in space that hardly ever meets its own by chance."""

from dataclasses import replace

import numpy as np

from aerial_il.core.goals import GoalSpec
from aerial_il.core.seeding import named_rng
from aerial_il.core.specs import ActionSpec, EnvSpec, Field, ObservationSpec
from tests.algorithms.drift import MAX_STEPS, Drift
from tests.algorithms.point_mass import StepResult
from tests.algorithms.stateless_batch import StatelessBatch

NEAR, CLOSE = 0.2, 0.1


def near(achieved: np.ndarray, desired: np.ndarray, share: float = 1.0) -> np.ndarray:
    return (np.abs(achieved - desired)[:, 0] <= NEAR * share).astype(float)


def close(achieved: np.ndarray, desired: np.ndarray) -> np.ndarray:
    return (np.abs(achieved - desired).max(axis=1) <= CLOSE).astype(float)


GOAL = GoalSpec(("position",), ("goal",), near, within=near)


class Sought(Drift):
    """Tells its goal, and pays 1 for every step that ends near it."""

    goal_spec = GOAL

    def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> StepResult:
        result = super().step(actions, mask)
        return replace(result, reward=GOAL.reward(result.obs["position"], result.obs["goal"]))


class Hidden(StatelessBatch):
    """n masses in space; one step in a thousand of a random flight ends close to its goal and is paid 1."""

    spec = EnvSpec(
        robot="mass",
        task="find",
        tier="calm",
        observation=ObservationSpec((Field("position", (3,)), Field("goal", (3,), "task"))),
        action=ActionSpec("velocity", tuple("xyz"), ("m/s",) * 3, -np.ones(3), np.ones(3)),
        control_dt_s=0.1,
        max_steps=MAX_STEPS,
        instruction="Find it.",
        subtasks=(),
        state_size=0,
    )
    goal_spec = GoalSpec(("position",), ("goal",), close)
    ends_at_success = False

    def __init__(self, num_envs: int) -> None:
        self.num_envs, self.steps = num_envs, np.zeros(num_envs, int)
        self.position, self.goal = np.zeros((2, num_envs, 3))

    def reset(self, seeds: np.ndarray | int, mask: np.ndarray | None = None) -> dict[str, np.ndarray]:
        for i, seed in self.restarted(seeds, mask):
            self.position[i], self.goal[i] = named_rng(seed, "hidden").uniform(-1, 1, (2, 3))
        return self._observe()

    def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> StepResult:
        live = np.ones(self.num_envs, bool) if mask is None else mask
        executed = self.spec.action.clip(actions)
        moved = np.clip(self.position + 0.5 * executed, -1.5, 1.5)
        self.position = np.where(live[:, None], moved, self.position)
        self.steps += live
        paid, never = close(self.position, self.goal), np.zeros(self.num_envs, bool)
        info = {"success": paid > 0, "executed_action": executed}
        return StepResult(self._observe(), paid, never, self.steps >= MAX_STEPS, info)

    def _observe(self) -> dict[str, np.ndarray]:
        return {"position": self.position.copy(), "goal": self.goal.copy()}
