"""Pilots, policies with the environments they fly, from ``policy=...``, ``robot=...`` and ``task=...``."""

from __future__ import annotations

import logging
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from aerial_il import experts
from aerial_il.core.contracts import BatchEnv, Policy
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.rendering import require_rendering
from aerial_il.core.specs import EnvSpec, camera_name
from aerial_il.data.episode import Episode
from aerial_il.evaluation.baselines import BASELINES
from aerial_il.evaluation.outcome import subtask_flags
from aerial_il.experts.outside import load_expert
from aerial_il.policies import find_lerobot, load_policy
from aerial_il.policies.parts import sb3_checkpoint
from aerial_il.policies.parts.tasks import tasks_of
from aerial_il.suite import outside
from aerial_il.suite.changes import tier_note
from aerial_il.workflows import spelling
from aerial_il.workflows.parts import typed_code
from aerial_il.workflows.parts.environments import (
    DEFAULT_ACTION,
    DEFAULT_CONTROLLER,
    IMAGE_SIZE,
    EnvironmentReference,
    key_of,
    reference_of,
)

if TYPE_CHECKING:
    from aerial_il.policies.parts.chunk_policy import ChunkPolicy

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
    if source.endswith(".npz") or (env is not None and source in BASELINES):
        return _outsider(source, env, dict(options or {}), noise)
    if made := _brought(source):
        return _in_what_was_said(made, source, robot, task, action, env, dict(options or {}))
    if source == EXPERT or source in BASELINES:
        if robot is None or task is None:
            raise InvalidValueError(f"policy={source} needs robot=... and task=... too. See: aerial-il list")
        policy = experts.make(robot, task) if source == EXPERT else BASELINES[source]()
        said = _cell_overrides(source, robot, task, action)
        return Pilot(policy, robot, task, said, _cell(robot, task, action))
    if found := find_lerobot(Path(source)):
        return _from_lerobot(source, found, robot=robot, task=task, action=action)
    policy = load_policy(source)
    spec = policy.spec
    if note := tier_note(spec):
        log.warning("%s: %s It was trained under the older one.", source, note)
    if env is not None or (spec.is_outside and robot is None):
        key, chosen = env or key_of(spec), {**outside.checked_options(spec), **(options or {})}
        where = EnvironmentReference(env=key, options=chosen)
        return Pilot(policy, spec.robot, spec.task, _overrides(source, key, options), where)
    if task is None and len(known := tasks_of(spec)) > 1:
        raise InvalidValueError(f"{source} flies several tasks: choose one with task=... Valid: {', '.join(known)}.")
    robot, task, action = robot or spec.robot, task or spec.task, action or spec.action.level
    said = _cell_overrides(source, robot, task, action)
    return Pilot(policy, robot, task, said, _cell(robot, task, action, *_sight(policy)))


def pilots_of(
    policy: ChunkPolicy, source: str = "a policy in training", *, typed: str | None = None
) -> tuple[Pilot, ...]:
    """Return a policy with the environment that it was trained in, once for each of its tasks.

    Args:
        policy: what flies. source: its name in errors. typed: ``env=`` as the user typed it.
    """
    specs = (replace(policy.spec, task=task) for task in tasks_of(policy.spec))
    return tuple(_pilot_in(spec, policy, source, typed) for spec in specs)


def _pilot_in(spec: EnvSpec, policy: ChunkPolicy, source: str, typed: str | None) -> Pilot:
    if spec.is_outside:
        where = reference_of(spec, typed=typed)
        return Pilot(policy, spec.robot, spec.task, _overrides(source, str(where.env), None), where)
    where = _cell(spec.robot, spec.task, spec.action.level, *_sight(policy))
    return Pilot(policy, spec.robot, spec.task, (), where)


def _from_lerobot(source: str, folder: Path, *, robot: str | None, task: str | None, action: str | None) -> Pilot:
    """Return a policy that lerobot has trained; its files tell the cell only if its dataset had our name for it."""
    from aerial_il.policies.parts.lerobot_checkpoint import LerobotPolicy

    policy = LerobotPolicy(folder)
    told_robot, told_task = policy.cell or (None, None)
    robot, task, action = robot or told_robot, task or told_task, action or DEFAULT_ACTION
    if robot is None or task is None:
        raise InvalidValueError(f"{source} does not state what it was trained on: set robot=... and task=... too.")
    if policy.cameras:
        require_rendering(f"a policy that sees {', '.join(policy.cameras)}")
    where = _cell(robot, task, action, policy.cameras, policy.image_size or IMAGE_SIZE)
    return Pilot(policy, robot, task, _cell_overrides(source, robot, task, action), where)


def _cell(
    robot: str,
    task: str,
    action: str | None,
    cameras: tuple[str, ...] = (),
    image_size: tuple[int, int] = IMAGE_SIZE,
) -> EnvironmentReference:
    level = action or DEFAULT_ACTION
    return EnvironmentReference(robot=robot, task=task, action=level, cameras=cameras, image_size=image_size)


def _sight(policy: ChunkPolicy) -> tuple[tuple[str, ...], tuple[int, int]]:
    """Return the cameras that ``policy`` looks through and the size of their images, all of them alike."""
    layout = policy.interface.layout
    if not layout.images:
        return (), IMAGE_SIZE
    require_rendering(f"a policy that sees {layout.cameras}")
    height, width = layout.image_shapes[0][:2]
    return tuple(map(camera_name, layout.images)), (height, width)


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
        (flown,) = (found for kind in KINDS for found in made.files(kind))
        file.parent.mkdir(parents=True, exist_ok=True)
        shutil.move(flown, file)
    return read_episode(file)


def expert_flight(robot: str, task: str, tier: str = "calm") -> tuple[Episode, np.ndarray]:
    """Return the expert's flight of the first of a few seeds that it solves, and its sub-tasks (T, K)."""
    expert = pilot(EXPERT, robot=robot, task=task, action=None)
    env = expert.environment(tier, num_envs=1, threads=1)
    try:
        with TemporaryDirectory() as folder:
            flights = (
                record(env, expert.policy, seed, Path(folder) / f"{seed}.mcap", name=EXPERT)
                for seed in range(SEEDS_TRIED)
            )
            first = next(flights)
            episode = first if first.success else next((flight for flight in flights if flight.success), first)
        return episode, subtask_flags(env, episode)
    finally:
        env.close()


def _brought(source: str) -> Policy | None:
    """Return a policy of the user's own code, or of Stable-Baselines3; None if ``source`` is neither."""
    if typed_code.names_code(source):
        return typed_code.policy_of(source)
    if source.endswith(sb3_checkpoint.ENDING):
        return sb3_checkpoint.Sb3Policy(source)
    return None


def _in_what_was_said(
    policy: Policy,
    source: str,
    robot: str | None,
    task: str | None,
    action: str | None,
    env: str | None,
    options: dict[str, Any],
) -> Pilot:
    """Return a policy that says nothing of an environment in the one that was named."""
    if env is not None:
        name, _, inside = env.partition(":")
        return Pilot(
            policy, name, inside, _overrides(source, env, options), EnvironmentReference(env=env, options=options)
        )
    if robot is None or task is None:
        raise InvalidValueError(
            f"policy={source} does not state its environment: set robot=... and task=..., or env=..."
        )
    return Pilot(policy, robot, task, _cell_overrides(source, robot, task, action), _cell(robot, task, action))


def _outsider(source: str, env: str | None, options: dict[str, Any], noise: float) -> Pilot:
    """Return an expert from a file, or a baseline, in an environment from outside."""
    if env is None:
        raise InvalidValueError(f"policy={source} needs env=... too, e.g. env=gymnasium:AdroitHandDoor-v1.")
    robot, _, task = env.partition(":")
    policy = BASELINES[source]() if source in BASELINES else load_expert(source, env, noise=noise)
    where = EnvironmentReference(env=env, options=options)
    return Pilot(policy, robot, task, _overrides(source, env, options), where)


def _overrides(source: str, env: str, options: Mapping[str, Any] | None) -> tuple[str, ...]:
    chosen = (f"{name}={value}" for name, value in (options or {}).items())
    return (spelling.path("policy", source), f"env={env}", *chosen)


def _cell_overrides(source: str, robot: str, task: str, action: str | None) -> tuple[str, ...]:
    chosen = (f"action={action}",) if action else ()
    return (spelling.path("policy", source), f"robot={robot}", f"task={task}", *chosen)
