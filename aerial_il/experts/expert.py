"""A phase machine over end-effector targets: how every expert works, whatever the task and the robot.

An expert sees the simulator's state and acts through the ``ee_pose`` interface like any policy. In every step it first
moves on to the next phase where that is due, then commands a target that depends on the present state alone. It can
take over from any state: the phase to start with is read off the state.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import ClassVar, Protocol, runtime_checkable

import numpy as np

from aerial_il.core.arrays import length
from aerial_il.core.contracts import BatchEnv
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import EnvSpec
from aerial_il.experts import gaze
from aerial_il.experts.perturbation import Perturbation
from aerial_il.suite.episode.simulation import Simulation
from aerial_il.suite.physics.view import View

UNDECIDED = -1
LEAD_M = 0.15  # of most experts: smooth actions, bounded speed


@runtime_checkable
class HasSimulation(Protocol):
    """The batch or the single environment."""

    @property
    def simulation(self) -> Simulation: ...

    @property
    def spec(self) -> EnvSpec: ...


class Expert(ABC):
    """Scripted expert for one task.

    Attributes:
        phase_names: names of the phases. phase: (n,) index of each world's present phase.
        lead_m: a commanded position is at most this far ahead of the tool.
        travels: phases in which only the position of the tool counts, so that its heading is free.
        expert_action: (n, 10) its last action before the perturbation: the label to learn from.

    Args:
        noise: strength of the perturbation added to commanded positions, 0 to 1. seed: of the perturbation.
        look: fly so that the robot's cameras see what comes next; see :mod:`.gaze`.
    """

    phase_names: tuple[str, ...]
    lead_m: ClassVar[float] = LEAD_M
    travels: ClassVar[tuple[int, ...]] = ()

    def __init__(self, *, noise: float = 0.0, seed: int = 0, look: bool = False) -> None:
        if not 0.0 <= noise <= 1.0:
            raise InvalidValueError(f"noise lies between 0 and 1, got {noise}.")
        if look and not self.travels:
            raise InvalidValueError(
                f"look=true turns towards what comes next, and {type(self).__name__} names no phase in which its "
                "heading is free (travels). Leave it out."
            )
        self.noise, self.seed, self.look = noise, seed, look
        self._env: HasSimulation | None = None
        self.phase = np.zeros(0, int)
        self.expert_action = np.zeros((0, 0))

    def __repr__(self) -> str:
        return f"{type(self).__name__}(noise={self.noise}, seed={self.seed})"

    def attach(self, env: BatchEnv | HasSimulation) -> None:
        """Bind to the environment to act in, with phases yet to be read off its state.

        Raises:
            InvalidValueError: the environment is not the suite's, or not flown at the ``ee_pose`` level.
        """
        if not isinstance(env, HasSimulation):
            raise InvalidValueError(
                f"A scripted expert reads the suite's simulator; {env.spec.robot}:{env.spec.task} is not the suite's."
            )
        if env.spec.action.level != "ee_pose":
            raise InvalidValueError(f"Experts act at level 'ee_pose', the environment takes {env.spec.action.level!r}.")
        self._env = env
        self.phase = np.full(env.simulation.n, UNDECIDED)
        self.timer = np.zeros(env.simulation.n, int)
        self._wander = Perturbation(env.simulation.n, self.noise, self.seed, name="expert noise")

    @property
    def view(self) -> View:
        """The worlds it sees."""
        return self._attached.simulation.view

    def reset(self, mask: np.ndarray | None = None) -> None:
        """Forget the phases of the worlds in ``mask`` (n,) bool, or of all."""
        mask = np.ones(self.view.n, bool) if mask is None else np.asarray(mask, bool)
        self.phase[mask] = UNDECIDED
        self.timer[mask] = 0
        self._wander.reset(mask)

    def act(self, obs: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return ``ee_pose`` actions (n, 10); the observation is ignored in favour of the simulator's state."""
        bounds = self._attached.spec.action
        fresh = self.phase == UNDECIDED
        old = self.phase.copy()
        self.phase = np.where(fresh, self.first_phase(), self.phase)
        self.phase = self.next_phase()
        self.timer = np.where(self.phase == old, self.timer + 1, 0)
        target, rot6d, gripper = self.command()
        lead = self.lead_m
        if self.look:
            rot6d = gaze.turned_to_see(self.view, target, rot6d, np.isin(self.phase, self.travels))
            lead = gaze.lead_of(length(target - self.view.tool_pos), lead)
        action = np.concatenate([led(self.view.tool_pos, target, lead), rot6d, gripper[:, None]], axis=1)
        self.expert_action = bounds.clip(action[:, : bounds.size])  # a robot without a gripper takes no opening
        if self.noise == 0.0:
            return self.expert_action
        action = self.expert_action.copy()
        action[:, :3] += self.noise_share()[:, None] * self._wander.drawn(self._attached.simulation.seeds)
        return bounds.clip(action)

    @abstractmethod
    def first_phase(self) -> np.ndarray:
        """(n,) phase to start with, read off the present state."""

    @abstractmethod
    def next_phase(self) -> np.ndarray:
        """(n,) phase to be in now, given :attr:`phase`, :attr:`timer` (steps in it) and the state."""

    @abstractmethod
    def command(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Target position (n, 3), rot6d (n, 6) and gripper opening (n,) for the present phases."""

    def following(self, rules: Sequence[tuple[int, np.ndarray, int]]) -> np.ndarray:
        """(n,) phases that follow by rules (phase, (n,) bool: it is due, next phase), the first that applies."""
        phases = self.phase.copy()
        for here, due, there in reversed(rules):
            phases = np.where((self.phase == here) & due, there, phases)
        return phases

    def noise_share(self) -> np.ndarray:
        """(n,) share of the perturbation from which the present phase can recover: less where force counts."""
        return np.ones(self.view.n)

    @property
    def _attached(self) -> HasSimulation:
        if self._env is None:
            raise InvalidValueError("The expert is not attached to an environment; call expert.attach(env) first.")
        return self._env


def led(tool: np.ndarray, target: np.ndarray, lead: float | np.ndarray = LEAD_M) -> np.ndarray:
    """Return the points on the way from ``tool`` to ``target`` (n, 3) that are ``lead`` m ahead, or the targets."""
    ahead = target - tool
    return tool + ahead * np.minimum(1.0, lead / np.maximum(length(ahead), 1e-9))[:, None]


def pointing_down(yaw: np.ndarray) -> np.ndarray:
    """rot6d (n, 6) of a tool that points straight down with heading ``yaw`` (n,) rad."""
    zero, one = np.zeros_like(yaw), np.ones_like(yaw)
    return np.stack([zero, zero, -one, -np.sin(yaw), np.cos(yaw), zero], axis=1)


def facing(mat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tool rotation rot6d (n, 6) that looks into a surface, and the surface's outward normal (n, 3).

    Args:
        mat: (n, 9) world from surface, row by row: z is the normal, y is horizontal and becomes the tool's y.
    """
    normal, side = mat[:, [2, 5, 8]], mat[:, [1, 4, 7]]
    return np.concatenate([-normal, side], axis=1), normal


def turned_towards(mat: np.ndarray, rot6d: np.ndarray, most: float) -> np.ndarray:
    """Return the attitude (n, 6) on the way from ``mat`` to ``rot6d`` (n, 6) about ``most`` rad ahead, or its end.

    Both axes are blended in a straight line, which is nearly even for turns well below half a turn.

    Args:
        mat: (n, 9) world from tool, row by row.
    """
    x, y, to_x, to_y = mat[:, 0::3], mat[:, 1::3], rot6d[:, :3], rot6d[:, 3:]
    chord = np.maximum(length(to_x - x), length(to_y - y))
    share = np.minimum(1.0, most / np.maximum(chord, 1e-9))[:, None]
    ahead, side = x + share * (to_x - x), y + share * (to_y - y)
    ahead = ahead / length(ahead)[:, None]
    across = ahead[:, 0] * side[:, 0] + ahead[:, 1] * side[:, 1] + ahead[:, 2] * side[:, 2]
    side = side - across[:, None] * ahead
    return np.concatenate([ahead, side / length(side)[:, None]], axis=1)
