"""A point in the plane that must stay on a curve: small errors add up, and the demonstrations show none of them.

The point moves forward by itself and is steered sideways; its target is a sine. A gust that grows with the distance
from the curve pushes it further off: whoever drifts has to know how to come back, which the demonstrator never had to.
It has the suite's interface and flies hundreds of episodes a second.
"""

import numpy as np

from aerial_il.core.seeding import episode_rng
from aerial_il.core.specs import ActionSpec, EnvSpec, Field, ObservationSpec
from tests.algorithms.point_mass import StepResult
from tests.algorithms.stateless_batch import StatelessBatch, fly

STEPS, LIMIT, PUSH, GAIN = 60, 0.5, 0.3, 0.5

SPEC = EnvSpec(
    robot="point",
    task="corridor",
    tier="calm",
    observation=ObservationSpec((Field("error", (1,)), Field("course", (1,), "task"))),
    action=ActionSpec("steer", ("sideways",), ("m",), np.array([-1.0]), np.array([1.0])),
    control_dt_s=0.02,
    max_steps=STEPS,
    instruction="Stay in the corridor.",
    subtasks=("inside",),
    state_size=0,
)


class Corridor(StatelessBatch):
    """n points; an episode fails as soon as one leaves the corridor, and succeeds at its end."""

    spec = SPEC

    def __init__(self, num_envs: int = 5) -> None:
        self.num_envs = num_envs
        self.y, self.slope, self.shift = np.zeros((3, num_envs))
        self.steps = np.zeros(num_envs, int)

    def reset(self, seeds: np.ndarray | int, mask: np.ndarray | None = None) -> dict[str, np.ndarray]:
        for i, seed in self.restarted(seeds, mask):
            rng = episode_rng("point", "corridor", "start", seed)
            self.slope[i], self.shift[i] = rng.uniform(0.1, 0.2), rng.uniform(0, 2 * np.pi)
            self.y[i] = np.sin(self.shift[i])
        return self._observe()

    def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> StepResult:
        live = np.ones(self.num_envs, bool) if mask is None else mask
        executed = self.spec.action.clip(actions)
        error = self.y - self._course(self.steps)
        self.y = np.where(live, self.y + executed[:, 0] + PUSH * error, self.y)
        self.steps = self.steps + live
        outside = np.abs(self.y - self._course(self.steps)) > LIMIT
        success = (self.steps >= STEPS) & ~outside
        info = {"success": success, "crash": outside, "subtasks": ~outside[:, None], "executed_action": executed}
        return StepResult(self._observe(), success * 1.0, outside, self.steps >= STEPS, info)

    def _course(self, steps: np.ndarray) -> np.ndarray:
        return np.sin(self.slope * steps + self.shift)

    def _observe(self) -> dict[str, np.ndarray]:
        error, ahead = self.y - self._course(self.steps), self._course(self.steps + 1) - self._course(self.steps)
        return {"error": error[:, None], "course": ahead[:, None]}


class Pilot:
    """Steers along the curve and back onto it."""

    def __init__(self) -> None:
        self.shown = 0

    def attach(self, env: Corridor) -> None:
        self.env = env

    def reset(self, mask: np.ndarray | None = None) -> None: ...

    def act(self, obs: dict[str, np.ndarray]) -> np.ndarray:
        self.shown += len(obs["error"])
        return (obs["course"] - (GAIN + PUSH) * obs["error"]).clip(-1.0, 1.0)


def success_rate(policy, *, episodes: int, seed: int) -> float:
    """Fly ``episodes`` seeds at once and return the share that stays inside."""
    outside = [result.terminated for result in fly(Corridor(episodes), policy, seed)]
    return float((~np.any(outside, axis=0)).mean())
