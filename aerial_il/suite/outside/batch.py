"""n worlds of an environment from outside behind the suite's batch interface, flown one after the other.

What a world does depends on its seed and its actions alone, not on how many others there are. Rewards are passed on as
they are. An episode flies over its whole horizon, for it is the return over it that others publish, unless the caller
asks for an end at the first success.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from aerial_il.core.checks import require_integer
from aerial_il.core.contracts import BatchEnvBase, StepResult
from aerial_il.core.errors import InvalidValueError, SimulationDivergedError
from aerial_il.core.seeding import seeds_of
from aerial_il.core.specs import NO_CONTROLLER, EnvSpec
from aerial_il.suite.outside.mujoco_state import MujocoState, editable
from aerial_il.suite.outside.success import REPORTED, SURVIVED, SuccessRule
from aerial_il.suite.outside.world import Outcome, World

TIER = "plain"
PROBED_SEEDS = (0, 1, 2)  # resets compared to find what they write into a model
COUNTERS = 3  # of the state: steps, successful steps, sum of rewards


@dataclass(frozen=True)
class ActuatorCount:
    """As much of a model as a recording asks for.

    Attributes:
        nu: number of actuator controls; 0 for an environment that is not MuJoCo's.
    """

    nu: int


class OutsideBatch(BatchEnvBase):
    """n worlds; see :class:`aerial_il.suite.batch.BatchEnvironment` for what they are asked.

    Attributes:
        ends_at_success: whether who flies it ends an episode at its first success.
        seeds: (n,) of the running episodes.

    Args:
        make_world: makes one. num_envs: worlds. source, name: what a recording calls robot and task, e.g. ``gymnasium``
            and ``Pendulum-v1``. success: rule, see :class:`SuccessRule`; None for what the environment itself reports,
            and ``survived`` where it reports nothing. max_steps: time limit; None for the environment's own.
        ends_at_success: end an episode at its first success. options: plain values that make the environment again.
    """

    def __init__(
        self,
        make_world: Callable[[], World],
        num_envs: int,
        *,
        source: str,
        name: str,
        success: str | None = None,
        max_steps: int | None = None,
        ends_at_success: bool = False,
        options: Mapping[str, Any] | None = None,
    ) -> None:
        if num_envs < 1:
            raise InvalidValueError(f"num_envs must be at least 1, got {num_envs}.")
        self.num_envs, self.ends_at_success = num_envs, ends_at_success
        self._worlds = [make_world() for _ in range(num_envs)]
        first = self._worlds[0]
        if max_steps is not None:
            require_integer("max_steps", max_steps, 1)
        steps = first.max_steps if max_steps is None else max_steps
        if steps is None or steps < 1:
            raise InvalidValueError(f"{source}:{name} has no time limit of its own; give max_steps=N.")
        self._states = _states_of(first)
        self.rule = SuccessRule.of(success) if success else _rule_of(first)
        self.model, self.goal_spec = ActuatorCount(_controls(first)), first.goal_spec
        self.spec = EnvSpec(
            robot=source,
            task=name,
            tier=TIER,
            observation=first.observation,
            action=first.action,
            control_dt_s=first.control_dt_s,
            max_steps=steps,
            instruction=f"Solve {name}.",
            subtasks=(),
            state_size=self._states.size + COUNTERS if self._states else 0,
            controller=NO_CONTROLLER,
            options={**(options or {}), "success": self.rule.text, "ends_at_success": ends_at_success},
        )
        self.seeds = np.zeros(num_envs, np.int64)
        self._steps = np.zeros(num_envs, np.int64)
        self._counts = np.zeros(num_envs, np.int64)
        self._returns = np.zeros(num_envs)
        self._obs = {f.name: np.zeros((num_envs, *f.shape), f.dtype) for f in first.observation.fields}
        self._last = _nothing_yet(self._obs, num_envs, first.action.size)

    def __repr__(self) -> str:
        return f"OutsideBatch({self.spec.robot}:{self.spec.task}, {self.num_envs} worlds)"

    @property
    def model_xml(self) -> str:
        """Note that a recording keeps in place of a scene, which belongs to the environment and is not ours to copy."""
        return f"<!-- {self.spec.robot}:{self.spec.task} brings its own scene. -->\n"

    @property
    def ctrl(self) -> np.ndarray:
        """(n, nu) actuator controls, where the environment is MuJoCo's."""
        rows = [world.physics() for world in self._worlds]
        return np.array([physics[1].ctrl if physics else () for physics in rows], float).reshape(self.num_envs, -1)

    @property
    def sim_time(self) -> np.ndarray:
        """(n,) seconds since the start of each episode."""
        return self._steps * self.spec.control_dt_s

    def reset(self, seeds: np.ndarray | int, mask: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """Start episodes in all worlds, or in those of ``mask`` (n,) bool; return what all worlds show.

        Args:
            seeds: (n,) integers, or one integer s for s, s + 1, …; entries outside ``mask`` are ignored.
        """
        each = seeds_of(seeds, self.num_envs)
        worlds = self._chosen(mask)
        for i in worlds:
            self.seeds[i], self._steps[i], self._counts[i], self._returns[i] = each[i], 0, 0, 0.0
            self._show(i, self._worlds[i].reset(int(each[i])))
        self._forget(worlds)
        self._check(worlds)
        return self.observe()

    def _forget(self, worlds: Sequence[int]) -> None:
        """Have worlds that begin an episode answer nothing of the one before; who was told that keeps it."""
        last = self._last
        reward, terminated, truncated = (each.copy() for each in (last.reward, last.terminated, last.truncated))
        info = {name: values.copy() for name, values in last.info.items()}
        for values in (reward, terminated, truncated, *info.values()):
            values[worlds] = 0
        self._last = StepResult(self._obs, reward, terminated, truncated, info)

    def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> StepResult:
        """Take one step; worlds outside ``mask`` (n,) bool stand still and answer what they last answered.

        Args:
            actions: (n, Da) in the units of ``spec.action``; clipped to its bounds.

        Raises:
            SimulationDivergedError: an observation or a reward is not finite; names seed and step.
        """
        before = self._last
        reward, terminated, truncated = before.reward.copy(), before.terminated.copy(), before.truncated.copy()
        info = {name: values.copy() for name, values in before.info.items()}
        clipped = self.spec.action.clip(np.asarray(actions, float))
        worlds = self._chosen(mask)
        for i in worlds:
            world = self._worlds[i]
            executed = world.executed(clipped[i])
            outcome = world.step(executed)
            self._show(i, outcome)
            self._steps[i] += 1
            self._counts[i] += bool(self.rule.reported and outcome.info.get(self.rule.reported, False))
            self._returns[i] += outcome.reward
            reward[i], terminated[i] = outcome.reward, outcome.terminated
            truncated[i] = not outcome.terminated and (outcome.truncated or self._steps[i] >= self.spec.max_steps)
            info["executed_action"][i] = executed
            info["success"][i] = self.rule.holds(
                count=int(self._counts[i]), total_reward=float(self._returns[i]), survived=bool(truncated[i])
            )
        self._check(worlds, reward)
        self._last = StepResult(self._obs, reward, terminated, truncated, info)
        return StepResult(self.observe(), reward, terminated, truncated, self._info(info, terminated))

    def observe(self) -> dict[str, np.ndarray]:
        """Last observations of all worlds, ``name -> (n, ...)``."""
        return {name: values.copy() for name, values in self._obs.items()}

    def get_state(self) -> np.ndarray:
        """(n, S) full states of MuJoCo environments and the counters of the episode; S = 0 for all others."""
        if self._states is None:
            return np.zeros((self.num_envs, 0))
        inner = [self._states.get(*physics) for world in self._worlds if (physics := world.physics())]
        return np.column_stack([np.array(inner), self._steps, self._counts, self._returns])

    def set_state(self, states: np.ndarray, mask: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """Continue from states (n, S) that :meth:`get_state` returned; return what the worlds show.

        Raises:
            InvalidValueError: the environment is not MuJoCo's, or cannot say what it shows without a step.
        """
        if self._states is None:
            raise InvalidValueError(f"{self.spec.robot}:{self.spec.task} is no MuJoCo environment: it has no state.")
        worlds = self._chosen(mask)
        for i in worlds:
            physics = self._worlds[i].physics()
            assert physics is not None
            self._states.set(*physics, states[i, : self._states.size])
            self._steps[i], self._counts[i] = np.round(states[i, -COUNTERS:-1]).astype(int)
            self._returns[i] = states[i, -1]
            self._show(i, Outcome(self._worlds[i].observe()))
        self._check(worlds)
        return self.observe()

    def close(self) -> None:
        """Close all environments."""
        for world in self._worlds:
            world.close()

    def _info(self, info: dict[str, np.ndarray], terminated: np.ndarray) -> dict[str, np.ndarray]:
        """Complete the measurements of a step to what the suite's batch reports; what does not exist is NaN or zero."""
        unknown = np.full(self.num_envs, np.nan)
        return {
            **info,
            "crash": terminated & ~info["success"],
            "dropped": np.zeros(self.num_envs, bool),
            "sparse_reward": info["success"].astype(float),
            "subtasks": np.zeros((self.num_envs, 0), bool),
            "ee_error_m": unknown,
            "effort": unknown.copy(),
            "contacts": np.zeros(self.num_envs, np.int32),
            "force_in_band_raw": unknown.copy(),
        }

    def _show(self, i: int, outcome: Outcome) -> None:
        for name, value in outcome.obs.items():
            self._obs[name][i] = value

    def _check(self, worlds: list[int], reward: np.ndarray | None = None) -> None:
        """Refuse what ``worlds`` show, and are paid, where it is not finite."""
        answers = {f"Observation {name!r}": values for name, values in self._obs.items()}
        for what, values in (answers | ({} if reward is None else {"The reward": reward})).items():
            if not np.isfinite(values[worlds]).all():
                i = next(i for i in worlds if not np.isfinite(values[i]).all())
                raise SimulationDivergedError(
                    f"{what} of {self.spec.task} became non-finite", seed=int(self.seeds[i]), step=int(self._steps[i])
                )

    def _chosen(self, mask: np.ndarray | None) -> list[int]:
        return list(range(self.num_envs)) if mask is None else np.flatnonzero(mask).tolist()


def _rule_of(world: World) -> SuccessRule:
    """Return the rule for what a world reports after one step."""
    world.reset(PROBED_SEEDS[0])
    middle = 0.5 * (world.action.low + world.action.high)
    info = world.step(world.executed(middle)).info
    reported = next((key for key in REPORTED if key in info), None)
    return SuccessRule.of(f"{reported}:0" if reported else SURVIVED)


def _states_of(world: World) -> MujocoState | None:
    """Return what reads the states of a world that runs on MuJoCo, or None."""
    resets = []
    for seed in PROBED_SEEDS:
        world.reset(seed)
        physics = world.physics()
        if physics is None:
            return None
        resets.append((physics[0], editable(physics[0])))
    return MujocoState.of(resets)


def _controls(world: World) -> int:
    physics = world.physics()
    return int(physics[0].nu) if physics else 0


def _nothing_yet(obs: dict[str, np.ndarray], num_envs: int, action_size: int) -> StepResult:
    """Return the result of a step before any was taken: no reward, no end, no success."""
    return StepResult(
        obs,
        np.zeros(num_envs),
        np.zeros(num_envs, bool),
        np.zeros(num_envs, bool),
        {"success": np.zeros(num_envs, bool), "executed_action": np.zeros((num_envs, action_size))},
    )
