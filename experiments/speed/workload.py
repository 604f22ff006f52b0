"""A flight kept in memory, flown again by everything whose speed is compared: the same work, contacts included."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import batch as mujoco_batch

from aerial_il import experts
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.physics.physics_batch import STATE
from aerial_il.suite.timing import SUBSTEPS

INPUTS = mujoco.mjtState.mjSTATE_CTRL | mujoco.mjtState.mjSTATE_QFRC_APPLIED


@dataclass(frozen=True, eq=False)
class Workload:
    """The flight of an expert in n worlds over T control steps.

    Attributes:
        start: (n, S) states before the first step. actions: (T, n, Da) commanded.
        inputs: (n, 5 T, nu + nv) what entered the physics before each of its steps: actuator commands, the air's force.
        end: (n, nq) positions after the last step.
    """

    start: np.ndarray
    actions: np.ndarray
    inputs: np.ndarray
    end: np.ndarray

    @property
    def world_steps(self) -> int:
        """Control steps of all worlds together."""
        return self.actions.shape[0] * self.actions.shape[1]


def record(env: BatchEnvironment, seeds: np.ndarray, steps: int) -> Workload:
    """Let the cell's expert fly the worlds of ``env`` from ``seeds`` (n,) on, and keep everything."""
    simulation, expert = env.simulation, experts.make(env.spec.robot, env.spec.task)
    ctrl, wrench = simulation.worlds.bind("ctrl"), simulation.worlds.bind("qfrc_applied")
    expert.attach(env)
    obs, start = env.reset(seeds), env.get_state()
    actions, inputs = [], []
    for _ in range(steps):
        actions.append(expert.act(obs))
        simulation.receive(actions[-1])
        for _ in range(SUBSTEPS):
            simulation.fly(1)
            inputs.append(np.concatenate([ctrl, wrench.reshape(env.num_envs, -1)], axis=1))
        simulation.settle()
        obs = env.observe()
    return Workload(start, np.stack(actions), np.stack(inputs, axis=1), simulation.view.qpos.copy())


def fly_again(env: BatchEnvironment, work: Workload) -> None:
    """Repeat the flight through the batch environment: controllers, physics, observations, rewards, success."""
    for actions in work.actions:
        env.step(actions)


class RawPhysics:
    """The same physics steps without anything of ours: MuJoCo's batch engine as it comes, fed with the recorded inputs.

    MuJoCo's timers are off, as in our flights.

    Args:
        model: the scene. work: the flight. num_threads: 0 for all cores.
    """

    def __init__(self, model: mujoco.MjModel, work: Workload, num_threads: int = 0) -> None:
        self.work = work
        self._batch = mujoco_batch.Batch(model, len(work.start), num_threads)
        rows = np.empty((len(work.start), SUBSTEPS, self._batch.nstate))
        self.table_rows = {int(STATE): rows}

    @property
    def qpos(self) -> np.ndarray:
        """(n, nq) positions as they stand."""
        return self._batch.bind("qpos")

    @property
    def seen(self) -> np.ndarray:
        """(n, S) states after the last control step of :meth:`step_recorded`."""
        return self.table_rows[int(STATE)][:, -1]

    def rewind(self) -> None:
        """Go back to the beginning of the flight."""
        self._batch.state[:] = self.work.start

    def step(self) -> None:
        """Fly on by control steps, as a policy must that looks at all worlds: one call per control step."""
        for inputs in self._control_steps():
            self._batch.rollout(SUBSTEPS, inputs, int(INPUTS), record=())

    def step_recorded(self) -> None:
        """The same with each world's state handed out, so that a policy could see it: a row after each physics step."""
        for inputs in self._control_steps():
            self._batch.rollout(SUBSTEPS, inputs, int(INPUTS), record=(int(STATE),), out=self.table_rows)

    def roll_out(self) -> None:
        """Fly on in one call: each thread takes a world from its first step to its last, the fastest there is."""
        self._batch.rollout(self.work.inputs.shape[1], self.work.inputs, int(INPUTS), record=())

    def _control_steps(self) -> Iterator[np.ndarray]:
        for k in range(0, self.work.inputs.shape[1], SUBSTEPS):
            yield self.work.inputs[:, k : k + SUBSTEPS]
