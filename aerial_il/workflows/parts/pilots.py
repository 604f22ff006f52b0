"""Pilots, policies with the environments they fly, from ``policy=...``, ``robot=...`` and ``task=...``."""

from __future__ import annotations

import logging
import shutil
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from aerial_il import experts
from aerial_il.core.contracts import BatchEnv, Policy
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.rendering import require_rendering
from aerial_il.core.specs import EnvSpec, camera_text
from aerial_il.data.episode import Episode
from aerial_il.evaluation.baselines import BASELINES
from aerial_il.evaluation.outcome import subtask_flags
from aerial_il.experts.outside import load_expert
from aerial_il.policies import find_lerobot, load_flying
from aerial_il.policies.parts import sb3_checkpoint
from aerial_il.policies.parts.tasks import tasks_of
from aerial_il.suite import outside
from aerial_il.suite.changes import tier_note
from aerial_il.workflows import spelling
from aerial_il.workflows.parts import typed_code
from aerial_il.workflows.parts.environments import (
    DEFAULT_ACTION,
    DEFAULT_CONTROLLER,
    EnvironmentReference,
    key_of,
    reference_of,
)

if TYPE_CHECKING:
    from aerial_il.policies.parts.flying import FlyingPolicy

log = logging.getLogger(__name__)
EXPERT = "expert"
SEEDS_TRIED = 3


@dataclass(frozen=True)
class Pilot:
    """A policy with the environment that it flies.

    Attributes:
        policy: what flies.
        robot, task: of the environment, as a specification names them.
        overrides: what leads to this pilot on the command line.
        reference: the environment.
    """

    policy: Policy
    robot: str
    task: str
    overrides: tuple[str, ...]
    reference: EnvironmentReference

    def environment(self, tier: str, *, num_envs: int, threads: int, controller: str = DEFAULT_CONTROLLER) -> Any:
        """Return its batch environment; one from outside knows no tier or flight law, and processes for threads."""
        return self.reference.load(num_envs=num_envs, threads=threads, tier=tier, controller=controller)


def pilot(
    source: str,
    *,
    robot: str | None,
    task: str | None,
    action: str | None,
    env: str | None = None,
    options: Mapping[str, Any] | None = None,
    noise: float = 0.0,
) -> Pilot:
    """Return the expert of a cell, a baseline, or a trained policy with what it was trained on where nothing is said.

    Args:
        source: ``expert``, ``random``, ``hover``, the folder of a run or a policy, or an expert's file.
        robot, task, action: registry names; None for the policy's own.
        env: key of an environment from outside, e.g. ``gymnasium:Pendulum-v1``; None for the policy's own.
        options: of that environment, where they are to differ from those the policy was trained with.
        noise: of an expert from a file, as a share of what it was trained with.
    """
    chosen = dict(options or {})
    if made := _stating_nothing(source, robot, task, env, noise):
        return _pilot(made, source, _place(source, robot, task, action, env, chosen), chosen)
    if folder := find_lerobot(Path(source)):
        return _from_lerobot(source, folder, robot=robot, task=task, action=action)
    known = (EXPERT, *BASELINES)
    if not Path(source).exists() and get_close_matches(source, known):
        raise UnknownNameError("policy", source, known, "Else it is the folder of a run.")
    policy = load_flying(source)
    spec = policy.spec
    if note := tier_note(spec):
        log.warning("%s: %s It was trained under the older one.", source, note)
    if env is not None or (spec.is_outside and robot is None):
        ways = {**outside.checked_options(spec), **chosen}
        where = EnvironmentReference(env=env or key_of(spec), options=ways, robot=robot, task=task, action=action)
        return _pilot(policy, source, where, chosen, None if env else spec)
    if task is None and len(known := tasks_of(spec)) > 1:
        raise InvalidValueError(f"{source} flies several tasks: choose one with task=... Valid: {', '.join(known)}.")
    return _pilot(policy, source, _cell(policy, robot or spec.robot, task or spec.task, action or spec.action.level))


def pilots_of(
    policy: FlyingPolicy, source: str = "a policy in training", *, typed: str | None = None
) -> tuple[Pilot, ...]:
    """Return a policy with the environment that it was trained in, once for each of its tasks.

    Args:
        policy: what flies. source: its name in errors. typed: ``env=`` as the user typed it.
    """
    specs = [replace(policy.spec, task=task) for task in tasks_of(policy.spec)]
    if policy.spec.is_outside:
        return tuple(_pilot(policy, source, reference_of(spec, typed=typed), spec=spec) for spec in specs)
    return tuple(_pilot(policy, source, _cell(policy, each.robot, each.task, each.action.level)) for each in specs)


def _pilot(
    policy: Policy,
    source: str,
    where: EnvironmentReference,
    options: Mapping[str, Any] | None = None,
    spec: EnvSpec | None = None,
) -> Pilot:
    """Return a policy where it flies.

    Args:
        policy: what flies. source: as it was typed. where: the environment. options: those of it that were typed.
        spec: of an environment from outside, where the policy has it.
    """
    robot, _, task = where.env.partition(":") if where.env else (str(where.robot), "", str(where.task))
    said = (spelling.path("policy", source), *replace(where, options=options or {}).overrides)
    return Pilot(policy, spec.robot if spec else robot, spec.task if spec else task, said, where)


def _stating_nothing(source: str, robot: str | None, task: str | None, env: str | None, noise: float) -> Policy | None:
    """Return a policy that says nothing of its environment: an expert, a baseline, or one of the user's own code."""
    if typed_code.names_code(source):
        return typed_code.policy_of(source)
    if source.endswith(sb3_checkpoint.ENDING):
        return sb3_checkpoint.Sb3Policy(source)
    if source.endswith(".npz"):
        if env is None:
            raise InvalidValueError(f"policy={source} needs env=... too, e.g. env=gymnasium:AdroitHandDoor-v1.")
        return load_expert(source, env, noise=noise)
    if source == EXPERT:
        if robot is None or task is None:
            raise InvalidValueError(f"policy={source} needs robot=... and task=... too. See: aerial-il list")
        return experts.make(robot, task)
    return BASELINES[source]() if source in BASELINES else None


def _place(
    source: str, robot: str | None, task: str | None, action: str | None, env: str | None, options: Mapping[str, Any]
) -> EnvironmentReference:
    """Return the environment that was named for a policy that says nothing of one."""
    if env is not None and source == EXPERT:
        raise InvalidValueError(f"env={env} has no expert of its own: leave out env=..., or fly another policy=...")
    if env is not None:
        return EnvironmentReference(env=env, options=options, robot=robot, task=task, action=action)
    if robot is None or task is None:
        raise InvalidValueError(
            f"policy={source} needs robot=... and task=..., or env=...: it does not state where it flies. "
            "See: aerial-il list"
        )
    return EnvironmentReference(robot=robot, task=task, action=action)


def _from_lerobot(source: str, folder: Path, *, robot: str | None, task: str | None, action: str | None) -> Pilot:
    """Return a policy that lerobot has trained; its files tell the cell only if its dataset had our name for it."""
    from aerial_il.policies.parts.lerobot_checkpoint import LerobotPolicy

    policy = LerobotPolicy(folder)
    stated_robot, stated_task = policy.cell or (None, None)
    robot, task = robot or stated_robot, task or stated_task
    if robot is None or task is None:
        raise InvalidValueError(f"{source} does not state what it was trained on: set robot=... and task=... too.")
    if policy.cameras:
        require_rendering(f"a policy that sees {', '.join(policy.cameras)}")
    where = EnvironmentReference(robot=robot, task=task, action=action or DEFAULT_ACTION, cameras=policy.cameras)
    return _pilot(policy, source, where)


def _cell(policy: FlyingPolicy, robot: str, task: str, action: str) -> EnvironmentReference:
    """Return a cell with the cameras that ``policy`` looks through, and their images as it was trained with."""
    layout = policy.interface.layout
    if not layout.images:
        return EnvironmentReference(robot=robot, task=task, action=action)
    require_rendering(f"a policy that sees {layout.cameras}")
    fields = (layout.spec.observation[name] for name in layout.images)
    cameras = tuple(camera_text(field, layout.spec.control_dt_s) for field in fields)
    return EnvironmentReference(robot=robot, task=task, action=action, cameras=cameras)


def record(env: BatchEnv, policy: Policy, seed: int, file: Path, *, name: str) -> Episode:
    """Fly one episode, keep its recording as ``file`` and return it.

    Args:
        env: a batch environment of one world. policy: what flies. seed: of the episode. name: who flies.
    """
    from aerial_il.collection.collect import collect
    from aerial_il.data.folder import KINDS
    from aerial_il.data.recording.reader import read_episode

    with TemporaryDirectory() as folder:
        made = collect(env, policy, [seed], folder, policy_name=name, progress=False).folder
        (flown,) = (recording for kind in KINDS for recording in made.files(kind))
        file.parent.mkdir(parents=True, exist_ok=True)
        shutil.move(flown, file)
    return read_episode(file)


def expert_flight(robot: str, task: str, tier: str = "calm") -> tuple[Episode, np.ndarray]:
    """Return the expert's flight of the first of a few seeds that it solves, and its sub-tasks (T, K)."""
    expert = pilot(EXPERT, robot=robot, task=task, action=None)
    with closing(expert.environment(tier, num_envs=1, threads=1)) as env, TemporaryDirectory() as folder:
        flights = (
            record(env, expert.policy, seed, Path(folder) / f"{seed}.mcap", name=EXPERT) for seed in range(SEEDS_TRIED)
        )
        first = next(flights)
        episode = first if first.success else next((flight for flight in flights if flight.success), first)
        return episode, subtask_flags(env, episode)
