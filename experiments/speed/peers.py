"""A hovering quadrotor in other packages' simulators and in ours, on one thread of the same processor.

    python experiments/speed/peers.py PYTHON

``PYTHON`` is the interpreter of an environment with ``crazyflow``, ``rotorpy``, ``torch``, ``torchdiffeq`` and
``roma``. Each simulator runs in a process of its own, on one core; they take turns, and ratios are formed within a
turn. All hold their position by a controller that runs at every step of the physics, 20 ms of flight in five steps,
and say at the end how far they are from where they should be. What is not alike: theirs is one free rigid body, ours
MuJoCo's, with contacts, observations, reward, success and time limit in each control step.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType

import numpy as np

HERE = Path(__file__).parents[2]
WORLDS, STEPS, ROUNDS, SEED, SUBSTEPS, DT = (1, 256, 4096), 50, 7, 900_000, 5, 0.004
Fly = Callable[[], float]  # flies STEPS control steps, returns the mean distance from the set point, m


def ours(worlds: int) -> Fly:
    """``quad``, ``hover``: the expert's own actions are flown again."""
    import aerial_il

    env = aerial_il.load_batch("quad", "hover", num_envs=worlds, num_threads=1)
    expert = aerial_il.expert("quad", "hover")
    expert.attach(env)
    obs, actions = env.reset(SEED), []
    for _ in range(STEPS):
        actions.append(expert.act(obs))
        obs = env.step(actions[-1]).obs
    env.reset(SEED)
    start = env.get_state()

    def fly() -> float:
        env.set_state(start)
        away = np.zeros((worlds, 3))
        for action in actions:
            away = env.step(action).obs["base_to_target"]
        return float(np.linalg.norm(away, axis=-1).mean())

    return fly


def crazyflow(worlds: int) -> Fly:
    """First-principles rigid body, explicit Euler, Mellinger's controller: the package's defaults, at 250 Hz."""
    import jax  # pyright: ignore[reportMissingImports]
    from crazyflow.control import Control  # pyright: ignore[reportMissingImports]
    from crazyflow.sim import Sim  # pyright: ignore[reportMissingImports]

    rate = round(1 / DT)
    sim = Sim(n_worlds=worlds, control=Control.state, freq=rate, state_freq=rate, attitude_freq=rate,
              body_rate_freq=rate, force_torque_freq=rate)  # fmt: skip
    goal = np.zeros((worlds, 1, 16), np.float32)
    goal[..., 2], goal[..., 12] = 1.0, 1.0

    def fly() -> float:
        sim.reset()
        state = sim.data.states.pos
        for _ in range(STEPS):
            sim.state_control(goal)
            sim.step(SUBSTEPS)
            state = jax.block_until_ready(sim.data.states.pos)  # a policy must see each control step
        return float(np.linalg.norm(np.asarray(state) - goal[..., :3], axis=-1).mean())

    return fly


def rotorpy(worlds: int) -> Fly:
    """Batched rigid body with rotor lag and drag, Runge-Kutta 4, geometric SE(3) controller, in torch."""
    import torch
    from rotorpy.controllers.quadrotor_control import BatchedSE3Control  # pyright: ignore[reportMissingImports]
    from rotorpy.vehicles.crazyflie_params import quad_params  # pyright: ignore[reportMissingImports]
    from rotorpy.vehicles.multirotor import (  # pyright: ignore[reportMissingImports]
        BatchedMultirotor,
        BatchedMultirotorParams,
    )

    torch.set_num_threads(1)
    device = torch.device("cpu")
    params = BatchedMultirotorParams([quad_params] * worlds, worlds, device)
    zeros = torch.zeros(worlds, 3, dtype=torch.double)
    start = {
        "x": zeros.clone(), "v": zeros.clone(), "w": zeros.clone(), "wind": zeros.clone(),
        "q": torch.tensor([0.0, 0, 0, 1]).double().repeat(worlds, 1),
        "rotor_speeds": torch.full((worlds, 4), 1788.53).double(),
    }  # fmt: skip
    vehicle = BatchedMultirotor(params, worlds, start, device, integrator="rk4")
    control = BatchedSE3Control(params, worlds, device)
    goal = dict.fromkeys(("x_dot", "x_ddot", "x_dddot", "x_ddddot"), zeros)
    goal |= {"x": zeros + torch.tensor([0.0, 0, 0.2]), "yaw": zeros[:, 0], "yaw_dot": zeros[:, 0]}

    @torch.no_grad()
    def fly() -> float:
        state = {name: value.clone() for name, value in start.items()}
        for i in range(STEPS * SUBSTEPS):
            state = vehicle.step(state, control.update(DT * i, state, goal), DT)
        return float((state["x"] - goal["x"]).norm(dim=-1).mean())

    return fly


SIMULATORS = {simulator.__name__: simulator for simulator in (ours, crazyflow, rotorpy)}


class Simulator:
    """A process that flies one simulator on one core whenever it is asked; a context."""

    def __init__(self, name: str, worlds: int, python: str) -> None:
        environment = {**os.environ, "PYTHONPATH": str(HERE) if name == "ours" else "", "OMP_NUM_THREADS": "1"}
        command = [sys.executable if name == "ours" else python, __file__, "--fly", name, str(worlds)]
        self._process = subprocess.Popen(command, env=environment, stdin=-1, stdout=-1, stderr=-3, text=True)

    def fly(self) -> tuple[float, float]:
        """Return the seconds of processor time that a flight took, and its distance from the set point."""
        assert self._process.stdin
        assert self._process.stdout
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        seconds, distance = map(float, self._process.stdout.readline().split())
        return seconds, distance

    def __enter__(self) -> Simulator:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        self._process.communicate()


def serve(name: str, worlds: int) -> None:
    """Fly once for each line that comes, and answer with :meth:`Simulator.fly`'s two numbers."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {0})
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what packages print as they are imported is no answer
    fly = SIMULATORS[name](worlds)
    for _ in sys.stdin:
        began = time.process_time()
        distance = fly()
        print(time.process_time() - began, distance, file=answers, flush=True)


def main(python: str) -> None:
    """Print the table."""
    print("| worlds | simulator | µs a world and control step | times ours | range | from the set point, m |")
    print("|--:|---|--:|--:|---|--:|", flush=True)
    for worlds in WORLDS:
        processes = {name: Simulator(name, worlds, python) for name in SIMULATORS}
        rounds = [{name: process.fly() for name, process in processes.items()} for _ in range(ROUNDS + 1)][1:]
        for name, process in processes.items():
            with process:
                seconds = np.array([one[name][0] for one in rounds])
            ratio = seconds / np.array([one["ours"][0] for one in rounds])
            each = 1e6 * np.median(seconds) / (worlds * STEPS)
            print(
                f"| {worlds} | {name} | {each:.2f} | {np.median(ratio):.2f} | {ratio.min():.2f}-{ratio.max():.2f} | "
                f"{rounds[-1][name][1]:.3f} |",
                flush=True,
            )


if __name__ == "__main__":
    serve(sys.argv[2], int(sys.argv[3])) if sys.argv[1] == "--fly" else main(sys.argv[1])
