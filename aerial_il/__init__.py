"""aerial_il: imitation learning on aerial manipulators, from demonstrations to policies that fly."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from aerial_il.core.rendering import choose_backend
from aerial_il.suite.faces import gymnasium_ids

if TYPE_CHECKING:
    from aerial_il.core.contracts import Policy
    from aerial_il.data.dataset import Dataset
    from aerial_il.evaluation.result import EvaluationResult
    from aerial_il.experts.expert import Expert
    from aerial_il.links.vehicle import Vehicle
    from aerial_il.suite.batch import BatchEnvironment
    from aerial_il.suite.environment import AerialEnvironment
    from aerial_il.suite.outside.batch import OutsideBatch
    from aerial_il.suite.outside.processes import SharedBatch

__version__ = "0.2.0"

choose_backend()  # MuJoCo reads MUJOCO_GL when it is first imported
gymnasium_ids.register_when_imported()


def load(
    robot: str,
    task: str,
    *,
    tier: str = "calm",
    action: str = "ee_pose",
    cameras: Sequence[str] = (),
    image_size: tuple[int, int] = (240, 320),
    seed: int = 0,
    controller: str = "geometric_observer",
) -> AerialEnvironment:
    """Return one world as a ``dm_control.rl.control.Environment``.

    Args:
        robot, task: registry names, see :func:`list_cells`.
        tier: disturbance tier, e.g. ``gusts``, ``hard-payload`` or ``calm+latency``; see ``docs/tiers.md``.
        action: action level, e.g. ``ee_pose``, ``velocity``, ``ctbr`` or ``rotor``.
        cameras: images among the observations: ``"wrist"``, ``"scene"``, ``"base"``, ``"wrist:depth"`` and the like;
            with a size, a rate and a delay of their own ``"wrist@64x64@25Hz@40ms"``.
        image_size: (height, width) of images that say none.
        seed: seed of the first episode; each reset takes the next.
        controller: flight law: ``geometric_observer``, ``geometric``, ``pid`` or ``lqr``.

    Raises:
        UnknownNameError: a name no registry knows. InvalidValueError: a tier's component is added or removed in vain.
        CellError: the robot cannot do the task.
    """
    from aerial_il.suite.environment import AerialEnvironment
    from aerial_il.suite.scenario import Scenario

    return AerialEnvironment(Scenario(robot, task, tier, action, cameras, image_size, controller), seed)


def load_batch(
    robot: str,
    task: str,
    *,
    num_envs: int = 64,
    tier: str = "calm",
    action: str = "ee_pose",
    cameras: Sequence[str] = (),
    image_size: tuple[int, int] = (240, 320),
    seed: int = 0,
    num_threads: int = 0,
    controller: str = "geometric_observer",
    horizon: int | None = None,
) -> BatchEnvironment:
    """Return ``num_envs`` worlds on MuJoCo's batch engine, started with seeds ``seed``, ``seed + 1``, ….

    Args:
        num_envs: number of worlds. num_threads: threads of the engine, 0 for all cores.
        horizon: episodes of so many steps of 20 ms, which success does not end; None for the task's time limit, and an
            end at success. The rest: see :func:`load`.
    """
    from aerial_il.suite.batch import BatchEnvironment
    from aerial_il.suite.scenario import Scenario

    scenario = Scenario(robot, task, tier, action, cameras, image_size, controller, horizon)
    env = BatchEnvironment(scenario, num_envs, num_threads)
    env.reset(seed)
    return env


def load_gymnasium(
    name: str,
    *,
    num_envs: int = 1,
    processes: int = 1,
    success: str | None = None,
    max_steps: int | None = None,
    ends_at_success: bool = False,
    **settings: Any,
) -> OutsideBatch | SharedBatch:
    """Return ``num_envs`` worlds of a Gymnasium environment behind the interface of :func:`load_batch`.

    Args:
        name: Gymnasium id, e.g. ``AdroitHandDoor-v1``. num_envs: worlds.
        processes: among which the worlds are shared, this one included; in each they are stepped one after the other.
            A script that asks for more than one does so below ``if __name__ == "__main__":``.
        success: when an episode succeeded: ``KEY:N`` (``info[KEY]`` was true in more than N steps), ``return:R`` (at
            least R) or ``survived`` (flew to the time limit); None for what the environment reports, and ``survived``
            where it reports nothing.
        max_steps: time limit; None for the registered one. ends_at_success: end an episode at its first success.
        settings: keyword arguments of ``gymnasium.make``.

    Raises:
        InvalidValueError: Gymnasium cannot make it, it has no time limit, or its spaces have no vector form.
    """
    from aerial_il.suite import outside

    return outside.load_gymnasium(
        name,
        num_envs=num_envs,
        processes=processes,
        success=success,
        max_steps=max_steps,
        ends_at_success=ends_at_success,
        **settings,
    )


def load_dm_env(
    make: Callable[[int], Any],
    *,
    num_envs: int = 1,
    processes: int = 1,
    name: str = "environment",
    success: str | None = None,
    max_steps: int | None = None,
    ends_at_success: bool = False,
) -> OutsideBatch | SharedBatch:
    """Return ``num_envs`` worlds of a dm_env environment behind the interface of :func:`load_batch`.

    Args:
        make: ``seed -> dm_env.Environment``; called for every episode, so that nothing outlives it; a
            function of a module where there are several ``processes``.
        name: what recordings call it. The rest: see :func:`load_gymnasium`.
    """
    from aerial_il.suite import outside

    return outside.load_dm_env(
        make,
        num_envs=num_envs,
        processes=processes,
        name=name,
        success=success,
        max_steps=max_steps,
        ends_at_success=ends_at_success,
    )


def expert(robot: str, task: str, **options: Any) -> Expert:
    """Return the scripted expert for a cell: a policy that sees the simulator's state.

    Args:
        robot, task: registry names.
        options: ``noise`` (0 to 1, recoverable perturbation of its commands), ``seed`` of that noise, and ``look``, so
            that the robot's cameras see what comes next.
    """
    from aerial_il.experts import make

    return make(robot, task, **options)


def load_policy(path: str) -> Policy:
    """Return the policy stored in a policy or run folder, ours or one of lerobot's, ready to act."""
    from aerial_il.policies import load_any_policy

    return load_any_policy(path)


def open_dataset(path: str, *, cameras: bool | Sequence[str] = False, **answers: Any) -> Dataset:
    """Open demonstrations in any format: ours, LeRobot, Minari, robomimic, D4RL, ``.npz`` or one of your own.

    Args:
        path: where they lie. cameras: True to decode all images, or the names of some, such as ``wrist_rgb``.
        answers: to what the format cannot say, ``success, control_dt, filter_key, terminals, strict, memory_mb``, and
            the rest of what :func:`aerial_il.data.dataset.open_dataset` takes.

    Raises:
        DemoError: there is nothing that can be used.
    """
    from aerial_il.data.dataset import open_dataset

    return open_dataset(path, cameras=cameras, **answers)


def collect(robot: str | None = None, task: str | None = None, *, out: str | os.PathLike[str], **keys: Any) -> Dataset:
    """Record demonstrations, as ``aerial-il collect`` does, and return them.

    Args:
        robot, task: registry names; None for the defaults, or where ``env`` names another environment.
        out: folder of the dataset. What it holds already is not flown again.
        keys: the other settings of :class:`aerial_il.workflows.collect.Collect`, e.g. ``episodes=100, tier="gusts",
            expert={"noise": 0.3}``.

    Raises:
        AerialError: for every mistake, in the words of the command line.
    """
    from aerial_il.core.composition import build
    from aerial_il.workflows.collect import Collect
    from aerial_il.workflows.collect import collect as record

    cell = {name: value for name, value in (("robot", robot), ("task", task)) if value is not None}
    return open_dataset(record(build(Collect, {**cell, "out": out, **keys})))


def generate(dataset: str | os.PathLike[str], *, out: str | os.PathLike[str], **keys: Any) -> Dataset:
    """Make many demonstrations of few, as ``aerial-il generate`` does, and return the successes.

    Args:
        dataset: recordings to generate from. out: folder of the new dataset; what it holds already is not flown again.
        keys: the other settings of :class:`aerial_il.workflows.generate.Generate`, e.g. ``episodes=400, tier="gusts"``.
    """
    from aerial_il.core.composition import build
    from aerial_il.workflows.generate import Generate
    from aerial_il.workflows.generate import generate as fly

    return open_dataset(fly(build(Generate, {"dataset": dataset, "out": out, **keys})))


def merge(*datasets: str | os.PathLike[str], out: str | os.PathLike[str], **keys: Any) -> Dataset:
    """Put datasets of one environment together, as ``aerial-il merge`` does.

    Args:
        datasets: their folders. out: folder of the new one; sources stay as they are.
        keys: the other settings of :class:`aerial_il.workflows.derive.Merge`, e.g. ``mix=True``.
    """
    from aerial_il.core.composition import build
    from aerial_il.workflows.derive import Merge
    from aerial_il.workflows.derive import merge as put

    put(build(Merge, {"datasets": [os.fspath(each) for each in datasets], "out": out, **keys}))
    return open_dataset(os.fspath(out))


def filter(dataset: str | os.PathLike[str], where: str, *, out: str | os.PathLike[str], **keys: Any) -> Dataset:
    """Make a dataset of the episodes for which a condition holds, as ``aerial-il filter`` does.

    Args:
        dataset: its folder, which stays as it is. where: the condition, e.g. ``"success and seconds < 12"``.
        out: folder of the new one. keys: the other settings of :class:`aerial_il.workflows.derive.Filter`.
    """
    from aerial_il.core.composition import build
    from aerial_il.workflows.derive import Filter
    from aerial_il.workflows.derive import filter as choose

    choose(build(Filter, {"dataset": dataset, "where": where, "out": out, **keys}))
    return open_dataset(os.fspath(out))


def split(dataset: str | os.PathLike[str], *, out: str | os.PathLike[str], **keys: Any) -> dict[str, Dataset]:
    """Split a dataset by episode into parts that are alike, as ``aerial-il split`` does: name -> dataset.

    Args:
        dataset: its folder, which stays as it is. out: folder of the parts.
        keys: the other settings of :class:`aerial_il.workflows.derive.Split`, e.g. ``parts=["train=0.8", "test=0.2"]``.
    """
    from aerial_il.core.composition import build
    from aerial_il.workflows.derive import Split
    from aerial_il.workflows.derive import split as divide

    made = divide(build(Split, {"dataset": dataset, "out": out, **keys}))
    return {part.path.name: open_dataset(str(part.path)) for part in made}


def train(
    dataset: str | os.PathLike[str] | None = None,
    *,
    run: str | os.PathLike[str],
    from_run: str | os.PathLike[str] | None = None,
    **keys: Any,
) -> Policy:
    """Train a policy, as ``aerial-il train`` does, and return it; a run that was stopped goes on.

    Args:
        dataset: demonstrations; None for algorithms that learn without. run: folder of the run.
        from_run: an earlier run, whose settings hold where nothing else is given; ``from=`` of the command.
        keys: the other settings of :class:`aerial_il.workflows.train.Train`. A policy or an algorithm is given by its
            settings, its name, or a mapping: ``algorithm=SAC(lr=1e-4)``, ``"sac"``, ``{"name": "sac", "lr": 1e-4}``.
    """
    from aerial_il.core.composition import build
    from aerial_il.workflows.train import Train
    from aerial_il.workflows.train import train as learn

    given = {name: value for name, value in (("dataset", dataset), ("from", from_run)) if value is not None}
    return learn(build(Train, {**given, "run": run, **keys}))


def evaluate(policy: str | os.PathLike[str], *, out: str | os.PathLike[str], **keys: Any) -> EvaluationResult:
    """Fly a policy over fixed seeds, as ``aerial-il evaluate`` does, and return what came of it.

    Args:
        policy: folder of a run or a policy, or whatever else the command takes. out: folder of the results.
        keys: the other settings of :class:`aerial_il.workflows.evaluate.Evaluate`, e.g. ``tier="gusts", episodes=100``.
    """
    from aerial_il.core.composition import build
    from aerial_il.workflows.evaluate import Evaluate
    from aerial_il.workflows.evaluate import evaluate as fly

    return fly(build(Evaluate, {"policy": policy, "out": out, **keys})).result


def vehicle(link: str = "simulated", **settings: Any) -> Vehicle:
    """Return a robot for a script to fly: arm, take off, go somewhere, move the arm, land; the same over every link.

    Args:
        link: ``simulated``, ``ros2`` or ``mavlink``. settings: see :func:`aerial_il.links.vehicle.connect`.
    """
    from aerial_il.links.vehicle import connect

    return connect(link, **settings)


def list_robots() -> tuple[str, ...]:
    """Names of all robots."""
    from aerial_il import robots

    return robots.names()


def list_tasks() -> tuple[str, ...]:
    """Names of all tasks."""
    from aerial_il.suite import tasks

    return tasks.names()


def list_cells() -> tuple[tuple[str, str], ...]:
    """All supported (robot, task) pairs, each solved by its expert."""
    from aerial_il.suite import tasks

    return tasks.cells()
