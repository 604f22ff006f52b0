"""A point-mass gripper with the suite's interface: fly to a cube, wait, close, carry it to the goal, open.

It pauses where a real demonstrator pauses, so a policy without action chunks stalls on it, and it flies thousands of
episodes a second.
"""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from aerial_il.core.contracts import StepResult
from aerial_il.core.seeding import episode_rng, named_rng
from aerial_il.core.specs import ActionSpec, EnvSpec, Field, ObservationSpec
from aerial_il.data.episode import Episode
from tests.algorithms.stateless_batch import StatelessBatch, episode_of, fly

LAG, REACH_M, WAIT_STEPS, DWELL_STEPS, LEAD_M = 0.5, 0.03, 8, 10, 0.06
ROT6D = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)


def _vector(name: str, group: Any) -> Field:
    return Field(name, (3,), group, unit="m", labels=("x", "y", "z"))


SPEC = EnvSpec(
    robot="point",
    task="pick",
    tier="calm",
    observation=ObservationSpec(
        (
            _vector("ee_pos", "proprio"),
            Field("ee_rot6d", (6,), "proprio"),
            Field("gripper", (1,), "proprio"),
            _vector("cube_pos", "task"),
            _vector("goal_pos", "task"),
            Field("scene_rgb", (4, 4, 3), "image", dtype="uint8"),
        )
    ),
    action=ActionSpec(
        "ee_pose",
        ("x", "y", "z", "a1", "a2", "a3", "b1", "b2", "b3", "gripper"),
        ("m", "m", "m", "", "", "", "", "", "", ""),
        np.array([-1.0] * 3 + [-1.2] * 6 + [0.0]),
        np.array([1.0] * 3 + [1.2] * 6 + [1.0]),
    ),
    control_dt_s=0.02,
    max_steps=120,
    instruction="Carry the cube to the goal.",
    subtasks=("held", "delivered"),
    state_size=0,
)


class PointMassBatch(StatelessBatch):
    """n point masses that follow commanded positions with a first-order lag."""

    spec = SPEC

    def __init__(self, num_envs: int) -> None:
        self.num_envs = num_envs
        self.ee, self.cube, self.goal = (np.zeros((num_envs, 3)) for _ in range(3))
        self.gripper, self.steps, self.dwell = np.ones((num_envs, 1)), *np.zeros((2, num_envs), int)

    def reset(self, seeds: np.ndarray | int, mask: np.ndarray | None = None) -> dict[str, np.ndarray]:
        for i, seed in self.restarted(seeds, mask):
            rng = episode_rng("point", "pick", "calm", seed)
            self.ee[i], self.cube[i], self.goal[i] = rng.uniform(-0.4, 0.4, (3, 3))
            self.gripper[i], self.dwell[i] = 1.0, 0
        return self._observe()

    def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> StepResult:
        live = (np.ones(self.num_envs, bool) if mask is None else mask)[:, None]
        executed = self.spec.action.clip(actions)
        near = np.abs(self.ee - self.cube).max(1, keepdims=True) < REACH_M
        held = near & (self.gripper < 0.5)
        self.gripper = np.where(live, self.gripper + LAG * (executed[:, 9:] - self.gripper), self.gripper)
        self.ee = np.where(live, self.ee + LAG * (executed[:, :3] - self.ee), self.ee)
        self.cube = np.where(live & held, self.ee, self.cube)
        self.steps += live[:, 0]
        delivered = (np.abs(self.cube - self.goal).max(1) < 2 * REACH_M) & (self.gripper[:, 0] > 0.5)
        self.dwell = np.where(live[:, 0] & ~delivered, 0, self.dwell + live[:, 0])
        success = self.dwell >= DWELL_STEPS
        info = {"success": success, "subtasks": np.stack([held[:, 0], delivered], 1), "executed_action": executed}
        nothing = np.zeros(self.num_envs, bool)
        return StepResult(self._observe(), success * 1.0, nothing, self.steps >= self.spec.max_steps, info)

    def _observe(self) -> dict[str, np.ndarray]:
        rotation = np.tile(ROT6D, (self.num_envs, 1))
        fields = {"ee_pos": self.ee, "ee_rot6d": rotation, "gripper": self.gripper}
        return {k: v.copy() for k, v in (fields | {"cube_pos": self.cube, "goal_pos": self.goal}).items()}


@dataclass
class Courier:
    """The scripted demonstrator; it waits before it closes and before it opens the gripper."""

    n: int
    phase: np.ndarray = field(init=False)
    waited: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self.reset()

    def reset(self, mask: np.ndarray | None = None) -> None:
        if mask is None:
            self.phase, self.waited = np.zeros(self.n, int), np.zeros(self.n, int)
        else:
            self.phase[mask] = self.waited[mask] = 0

    def act(self, obs: Any) -> np.ndarray:
        target = np.where(self.phase[:, None] < 2, obs["cube_pos"], obs["goal_pos"])
        there = np.abs(target - obs["ee_pos"]).max(1) < REACH_M
        self.waited = np.where(there, self.waited + 1, self.waited)
        onward = self.waited >= WAIT_STEPS
        self.phase, self.waited = np.minimum(self.phase + onward, 3), np.where(onward, 0, self.waited)
        step = np.clip(target - obs["ee_pos"], -LEAD_M, LEAD_M)
        gripper = np.isin(self.phase, (0, 3)).astype(float)
        return np.concatenate([obs["ee_pos"] + step, np.tile(ROT6D, (self.n, 1)), gripper[:, None]], axis=1)


def demonstrations(count: int, *, seed: int = 0, noise_m: float = 0.02) -> list[Episode]:
    """Record ``count`` successful flights of the courier, pushed about while it flies, labelled with what it meant."""
    env, courier, rng = PointMassBatch(count), Courier(count), named_rng(seed, "gusts")
    observed, meant, flown = [env.reset(seed)], [], []
    length = np.zeros(count, int)
    for step in range(env.spec.max_steps):
        meant.append(courier.act(observed[-1]))
        push = np.zeros_like(meant[-1])
        push[:, :3] = rng.normal(scale=noise_m, size=(count, 3))
        flown.append(meant[-1] + push)
        result = env.step(flown[-1])
        observed.append(result.obs)
        length[(length == 0) & result.info["success"]] = step + 1
    assert (length > 0).all()
    labels, actions = np.stack(meant, axis=1), np.stack(flown, axis=1)
    obs = {name: np.stack([o[name] for o in observed], axis=1) for name in observed[0]}
    return [
        episode_of(SPEC, i, {k: v[i, : t + 1] for k, v in obs.items()}, actions[i, :t], labels=labels[i, :t])
        for i, t in enumerate(length)
    ]


def success_rate(policy: Any, *, episodes: int, seed: int) -> float:
    """Fly ``episodes`` unseen seeds at once and return the share that is delivered."""
    delivered = [result.info["success"] for result in fly(PointMassBatch(episodes), policy, seed)]
    return float(np.any(delivered, axis=0).mean())


def with_action_level(episode: Episode, level: str) -> Episode:
    """Return ``episode`` as if it had been flown with another action level."""
    return replace(episode, spec=replace(episode.spec, action=replace(episode.spec.action, level=level)))
