"""Contracts between the packages: what an environment offers, what who acts in it does, and what an algorithm is.

They are structural: a class fulfils one by having its attributes, whether it names it or not. What only some policies
have, phases for example, is a contract of its own, which ``isinstance`` asks for.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.goals import GoalSpec
from aerial_il.core.specs import EnvSpec

if TYPE_CHECKING:
    from aerial_il.core.checkpoint import Checkpoint

Observation = Mapping[str, np.ndarray]
NO_PHASE = -1


@dataclass(frozen=True)
class StepResult:
    """Answer of n worlds to an action.

    Attributes:
        obs: ``name -> (n, ...)``. reward: (n,), of the suite's tasks in [0, 1]. terminated: (n,) bool, crashed or
            dropped its object. truncated: (n,) bool, time is up. info: ``success``, ``crash``, ``dropped``,
            ``sparse_reward``, ``ee_error_m``, ``effort``, ``contacts``, ``force_in_band_raw`` (each (n,)), ``subtasks``
            (n, K), ``executed_action`` (n, Da).
    """

    obs: dict[str, np.ndarray]
    reward: np.ndarray
    terminated: np.ndarray
    truncated: np.ndarray
    info: dict[str, np.ndarray]

    @property
    def observation(self) -> dict[str, np.ndarray]:
        """The observations by the name that they have in dm_env's ``TimeStep``."""
        return self.obs


class Actuated(Protocol):
    """A model as far as a recording asks for it: ``mujoco.MjModel`` is one."""

    @property
    def nu(self) -> int:
        """Number of actuator controls."""
        ...


class BatchEnv(Protocol):
    """n independent worlds of one task that are stepped together and end no episode by themselves.

    Implementations: the suite's ``BatchEnvironment``, and ``OutsideBatch`` for other people's environments.
    """

    @property
    def num_envs(self) -> int:
        """Number of worlds, n."""
        ...

    @property
    def spec(self) -> EnvSpec:
        """Observations and actions with their sizes, units and bounds."""
        ...

    @property
    def ends_at_success(self) -> bool:
        """Whether whoever flies it should end an episode at its first success."""
        ...

    @property
    def engine(self) -> str | None:
        """Version of the suite's simulation; None for an environment that is not the suite's."""
        ...

    @property
    def goal_spec(self) -> GoalSpec | None:
        """Goal that can be exchanged after the fact, None where there is none."""
        ...

    @property
    def camera_names(self) -> tuple[str, ...]:
        """Cameras that :meth:`render` takes."""
        ...

    @property
    def model(self) -> Actuated:
        """Model of the scene."""
        ...

    @property
    def model_xml(self) -> str:
        """Scene as stand-alone MJCF, for recordings."""
        ...

    @property
    def seeds(self) -> np.ndarray:
        """(n,) seeds of the running episodes."""
        ...

    @property
    def ctrl(self) -> np.ndarray:
        """(n, nu) copy of the actuator commands."""
        ...

    @property
    def sim_time(self) -> np.ndarray:
        """(n,) seconds since the start of each episode."""
        ...

    def drawn(self, seed: int) -> dict[str, Any]:
        """Return the disturbances of the episode ``seed`` as plain values."""
        ...

    def reset(self, seeds: np.ndarray | int, mask: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """Start episodes in all worlds, or in those of ``mask`` (n,) bool; return the observations of all.

        Args:
            seeds: (n,) integers, or one integer s for s, s + 1, …; entries outside ``mask`` are ignored.
        """
        ...

    def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> StepResult:
        """Take one step with actions (n, Da), clipped to their bounds; worlds outside ``mask`` (n,) stand still."""
        ...

    def observe(self) -> dict[str, np.ndarray]:
        """Return the observations of all worlds as they stand, ``name -> (n, ...)``."""
        ...

    def get_state(self) -> np.ndarray:
        """Return copies (n, S) of the full states."""
        ...

    def set_state(self, states: np.ndarray, mask: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """Continue from states (n, S) that :meth:`get_state` returned; return the observations."""
        ...

    def render(self, world: int = 0, camera: str = "scene", height: int = 240, width: int = 320) -> np.ndarray:
        """Return a picture (H, W, 3) uint8 of one world."""
        ...

    def close(self) -> None:
        """Free what the environment holds."""
        ...


@runtime_checkable
class Repainted(Protocol):
    """An environment whose scenes can look as in other episodes."""

    def set_state_in_looks(self, states: np.ndarray, seeds: np.ndarray) -> dict[str, np.ndarray]:
        """Continue from states (n, S) with what cameras alone notice as in other episodes, ``seeds`` (n,) int."""
        ...


@runtime_checkable
class Pushable(Protocol):
    """A batch environment whose vehicle can be pushed."""

    def push(self, velocity: np.ndarray, mask: np.ndarray | None = None) -> None:
        """Let the bases gain velocities (n, 3) in m/s, world, at once, in all worlds or in those of ``mask`` (n,)."""
        ...


class BatchEnvBase:
    """Answers of a batch environment without cameras, drawn disturbances, goals and an engine of the suite's."""

    ends_at_success: bool = True
    engine: str | None = None
    goal_spec: GoalSpec | None = None
    camera_names: tuple[str, ...] = ()

    def drawn(self, seed: int) -> dict[str, Any]:
        """Return no disturbances."""
        return {}

    def render(self, world: int = 0, camera: str = "scene", height: int = 240, width: int = 320) -> np.ndarray:
        """Refuse: there are no cameras.

        Raises:
            InvalidValueError: always.
        """
        raise InvalidValueError(f"camera={camera}: this environment has no cameras to render with.")


@runtime_checkable
class Policy(Protocol):
    """Maps observations of n worlds to n actions: an expert, a person, a network or a random one."""

    def act(self, obs: Observation) -> np.ndarray:
        """Return actions (n, Da) in the environment's units for observations ``name -> (n, ...)``."""
        ...

    def reset(self, mask: np.ndarray | None = None) -> None:
        """Forget the history of the worlds in ``mask`` (n,) bool, or of all of them."""
        ...


@runtime_checkable
class PrivilegedPolicy(Policy, Protocol):
    """A policy that also reads the simulator, such as a scripted expert."""

    def attach(self, env: BatchEnv) -> None:
        """Bind to the environment that it will act in."""
        ...


@runtime_checkable
class SeededPolicy(Policy, Protocol):
    """A policy that rolls dice: given the episodes' seeds, what it does in one does not depend on the others."""

    def begin(self, seeds: np.ndarray, mask: np.ndarray | None = None) -> None:
        """Learn the seeds (n,) of the episodes that begin in the worlds of ``mask`` (n,) bool, or in all of them."""
        ...


@runtime_checkable
class PhasedPolicy(Policy, Protocol):
    """A policy that works in phases and names them."""

    @property
    def phase_names(self) -> tuple[str, ...]:
        """Names of the phases."""
        ...

    @property
    def phase(self) -> np.ndarray:
        """(n,) index of each world's present phase, ``NO_PHASE`` for none; empty before the policy is attached."""
        ...


@runtime_checkable
class LabellingPolicy(Policy, Protocol):
    """A policy that tells, beside the action that it flies, the one to learn from."""

    @property
    def expert_action(self) -> np.ndarray:
        """(n, Da) label of the last action, NaN where there is none."""
        ...


@runtime_checkable
class SharedControlPolicy(Policy, Protocol):
    """A policy in which an expert or a person takes over from a learner."""

    @property
    def is_intervention(self) -> np.ndarray:
        """(n,) bool, who took over flew the last action."""
        ...


@runtime_checkable
class TracedPolicy(Policy, Protocol):
    """A policy that tells what each of its flights was made of."""

    def made_of(self, world: int) -> Mapping[str, Any]:
        """Return JSON values for the provenance of the episode that ends in a world."""
        ...


@runtime_checkable
class DemandingPolicy(Policy, Protocol):
    """A policy that asks more of its flights than their task does."""

    def objection(self, world: int) -> str:
        """Return why the episode that succeeds in a world shall not count as a success; nothing if it shall."""
        ...


@runtime_checkable
class Expert(PrivilegedPolicy, PhasedPolicy, LabellingPolicy, Protocol):
    """A demonstrator: it sees the simulator, works in named phases, and labels what it flies with what it meant."""


@runtime_checkable
class StorablePolicy(Policy, Protocol):
    """A policy that can be written to disk."""

    def to_checkpoint(self) -> Checkpoint:
        """Return everything that rebuilds the policy."""
        ...


def attach(policy: Policy, env: BatchEnv) -> Policy:
    """Attach ``policy`` to ``env`` if it reads the simulator; return it either way."""
    if isinstance(policy, PrivilegedPolicy):
        policy.attach(env)
    return policy


def begin_episodes(policy: Policy, seeds: np.ndarray, mask: np.ndarray | None = None) -> None:
    """Make ``policy`` ready for the episodes of ``seeds`` (n,) that begin in the worlds of ``mask`` (n,), or in all."""
    policy.reset(mask)
    if isinstance(policy, SeededPolicy):
        policy.begin(seeds, mask)


def phase_names_of(policy: Policy) -> tuple[str, ...]:
    """Return the names of a policy's phases, none for one without."""
    return tuple(policy.phase_names) if isinstance(policy, PhasedPolicy) else ()


def phase_of(policy: Policy, n: int) -> np.ndarray:
    """Return the phases (n,) of n worlds, ``NO_PHASE`` for a policy without."""
    return np.asarray(policy.phase) if isinstance(policy, PhasedPolicy) else np.full(n, NO_PHASE)


def label_of(policy: Policy, otherwise: np.ndarray) -> np.ndarray:
    """Return the labels (n, Da) of a policy's last actions, or ``otherwise`` for a policy that gives none."""
    return np.asarray(policy.expert_action, float) if isinstance(policy, LabellingPolicy) else otherwise


def intervention_of(policy: Policy, n: int) -> np.ndarray:
    """Return in which of n worlds (n,) bool somebody took over; in none for a policy that flies alone."""
    return np.asarray(policy.is_intervention) if isinstance(policy, SharedControlPolicy) else np.zeros(n, bool)


def made_of(policy: Policy, world: int) -> dict[str, Any]:
    """Return what the flight of a world was made of; nothing for a policy that does not tell."""
    return dict(policy.made_of(world)) if isinstance(policy, TracedPolicy) else {}


def objection_of(policy: Policy, world: int) -> str:
    """Return why a success in a world shall not count; nothing for a policy that asks no more than the task."""
    return policy.objection(world) if isinstance(policy, DemandingPolicy) else ""


@runtime_checkable
class Device[Frame](Protocol):
    """Whatever a person flies with, and whatever stands in for it: asked once a tick, it returns a frame.

    A flight by hand takes devices of ``DeviceFrame`` (``aerial_il/teleop/input/frame.py``).
    """

    def frame(self) -> Frame:
        """Return what has arrived since the last call; never wait for more."""
        ...


@runtime_checkable
class Algorithm(Protocol):
    """Settings of a training, a frozen dataclass that checks itself, and the training itself.

    Each module of ``aerial_il.algorithms`` holds one; its file is all that adding an algorithm takes.
    """

    @property
    def name(self) -> str:
        """Name of its module."""
        ...

    @property
    def needs(self) -> tuple[str, ...]:
        """What :meth:`train` is handed by name besides: any of ``env``, ``expert`` and ``collect``."""
        ...

    @property
    def worlds(self) -> int:
        """How many worlds it acts in at once, if nobody says otherwise."""
        ...

    @property
    def rewarded(self) -> bool:
        """Whether it learns from the environment's reward."""
        ...

    @property
    def demonstrated(self) -> bool:
        """Whether it learns from demonstrations, and so cannot do without."""
        ...

    @property
    def evaluate_every(self) -> int:
        """Steps or rounds between two calls of ``evaluate``; 0 for the last alone, or for none."""
        ...

    def train(self, dataset: Any, policy: Any, *args: Any, **kwargs: Any) -> Policy:
        """Train a policy, or go on where an earlier call was stopped, with the same bytes in the end.

        Args:
            dataset: episodes to learn from; None for an algorithm that is not ``demonstrated``.
            policy: configuration of the policy to train.
            kwargs: ``run`` (the folder), ``seed``, ``evaluate`` (``(policy, step) -> named numbers``), ``resume``,
                ``progress``, and what it ``needs``. There are no more positional arguments.

        Raises:
            InvalidValueError: data or environment do not fit, or ``run`` holds another run.
            SimulationDivergedError, TrainingDivergedError: something is not finite; the last checkpoint is intact.
        """
        ...
