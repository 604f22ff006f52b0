"""What flies chunks of actions in n worlds, whoever computes them: memory, anchoring, normalisation, limits.

Nothing here needs more than NumPy, so that an exported policy flies where neither torch nor MuJoCo is installed.
"""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Protocol, Self

import numpy as np

from aerial_il.core.contracts import BatchEnv, Observation
from aerial_il.core.errors import InvalidValueError, NonFiniteActionError
from aerial_il.core.latency import NO_LATENCY, Latency, whole_steps
from aerial_il.core.specs import CONDITIONS, EnvSpec, Observations, ObservationSpec
from aerial_il.policies.parts.assignment import Assignment
from aerial_il.policies.parts.chunking import ActionPlan, ObservationHistory
from aerial_il.policies.parts.execution import AS_TRAINED, Execution
from aerial_il.policies.parts.foreign_fields import shown_for, under_their_names
from aerial_il.policies.parts.layout import Interface, check_cameras
from aerial_il.policies.parts.noise import EpisodeNoise, glimpses
from aerial_il.policies.parts.prefixed import below, under
from aerial_il.policies.parts.tasks import as_one_of

log = logging.getLogger(__name__)
UNIMPORTANT = (*CONDITIONS, "max_steps", "instruction", "subtasks", "state_size")  # what a policy may fly across
UNTOLD = ("robot", "task", "action", "control_dt_s")  # by foreign data; a policy of theirs flies where its sizes fit


class ChunkSettings(Protocol):
    """How chunks are flown; see :class:`~aerial_il.policies.parts.network.PolicySettings`."""

    @property
    def name(self) -> str: ...
    @property
    def history(self) -> int: ...
    @property
    def chunk(self) -> int: ...
    @property
    def execute(self) -> int: ...
    @property
    def ensemble(self) -> float | None: ...


OF_THE_TOOL = ("ee_pos", "ee_rot6d", "gripper", "wrist_force")  # what robots tell that is alike on all of them
ANY_ROBOT = " A policy that sees the tool alone flies other robots too: train one with policy=diffusion_umi."


@dataclass(frozen=True, eq=False)
class Question:
    """What the m worlds whose next chunk is due show a network.

    Attributes:
        history: (m, To, Do) frames, a view of the memory. due: (n,) bool, which worlds these are.
        images: by name, each (m, To, H, W, 3) uint8. noise: (m, S), see :meth:`FlyingPolicy.predict`.
        guide: what leads the answer, see :mod:`.guiding`; None for nothing.
    """

    history: np.ndarray
    due: np.ndarray
    images: Mapping[str, np.ndarray]
    noise: np.ndarray | None
    guide: Any = None


class FlyingPolicy(ABC):
    """Flies chunks of actions, which :meth:`answer` gives, in n worlds at once.

    Args:
        config: how chunks are flown.
        interface: what the network is wired to.
        noise_size, redraws: of the network, see :class:`~aerial_il.policies.parts.network.ChunkNetwork`.
        origin: where the policy comes from (run, step, provenance), kept with it.
    """

    def __init__(
        self,
        config: ChunkSettings,
        interface: Interface,
        *,
        noise_size: int,
        redraws: bool,
        origin: Mapping[str, Any] | None = None,
    ) -> None:
        self.config, self.interface, self.origin = config, interface, dict(origin or {})
        self._history = ObservationHistory(config.history)
        self._sights = {name: ObservationHistory(config.history) for name in interface.layout.images}
        self._plan = ActionPlan(config.chunk, config.execute, config.ensemble)
        self._noise = EpisodeNoise(noise_size, redraw=redraws)
        self._worlds: int | None = None
        self.assignment, self.execution = Assignment(self.spec), AS_TRAINED
        self._shown_for: dict[str, str] = {}  # field -> its name in the environment, where data of others differ

    @abstractmethod
    def answer(
        self, state: np.ndarray, images: Mapping[str, np.ndarray], noise: np.ndarray | None, guide: Any = None
    ) -> np.ndarray:
        """Return normalised chunks (B, Ta, Da) float32.

        Args:
            state: (B, To, Do) float32, normalised. images: by name, each (B, To, H, W, 3) uint8.
            noise: (B, S) float32; None for a network without chance, or for its most ordinary answer.
            guide: what leads the answer, of a network that can be led; None for nothing.
        """

    @abstractmethod
    def fresh(self) -> Self:
        """Return the same policy, networks shared, with a memory of its own that is empty."""

    def _as(self, other: FlyingPolicy) -> Self:
        """Fly as ``other`` does, with the task that it has, and remember nothing."""
        self.assignment.as_in(other.assignment)
        self.execution, self._shown_for, self._plan = other.execution, other._shown_for, other._plan.empty()
        return self

    def __repr__(self) -> str:
        flown = f"{self.spec.robot}/{self.spec.task}"
        return f"{type(self).__name__}({self.config.name} of {flown}, {', '.join(self.spec.observation.names)})"

    @property
    def spec(self) -> EnvSpec:
        return self.interface.layout.spec

    def act(self, obs: Observation) -> np.ndarray:
        """Return actions (n, Da) within their bounds for observations ``name -> (n, ...)``.

        Raises:
            UnknownNameError: an observation field is missing.
            InvalidValueError: n changed without a :meth:`reset`, or an image has another size.
            NonFiniteActionError: NaN or infinity in an observation or in the network's output.
        """
        self.advance(obs)
        return self.next()

    def advance(self, obs: Observation) -> bool:
        """Look, and where a chunk is due, think and plan; return whether one was, in any world."""
        question = self.look(obs)
        if question is not None:
            self.plan(question, self.think(question))
        return question is not None

    def look(self, obs: Observation) -> Question | None:
        """Remember what n worlds show, as :meth:`act` does first; return what those ask whose next chunk is due."""
        obs = self.assignment.shown({**obs, **{own: obs[name] for own, name in self._shown_for.items()}})
        frame, images = self.interface.layout.flatten(obs), self.interface.layout.look(obs)
        self._count(len(frame))
        history = self._history.push(frame)
        seen = {name: sight.push(images[name]) for name, sight in self._sights.items()}
        due = self._plan.due(len(frame))
        if not due.any():
            return None
        rows = slice(None) if due.all() else due
        noise = self._noise.take(self._first_seen(frame, images), due)
        pictures = {name: stack[rows] for name, stack in seen.items()}
        return Question(history[rows], due, pictures, noise, self._guide(history[rows], obs, due))

    def _first_seen(self, frame: np.ndarray, images: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return numbers (n, C) by which worlds are told from each other: of what they show, (n, Do) or pictures."""
        return frame if frame.shape[1] or not self._noise.size else glimpses(tuple(images.values()))

    def think(self, question: Question) -> np.ndarray:
        """Return chunks (m, Ta, Da) that answer a question; touches no memory, so another thread may think."""
        worlds = np.flatnonzero(question.due)
        return self.predict(
            question.history, worlds, images=question.images, noise=question.noise, guide=question.guide
        )

    def plan(self, question: Question, chunks: np.ndarray) -> None:
        """Fly chunks (m, Ta, Da) from the next action on."""
        self._plan.add(chunks, question.due)

    @property
    def planned(self) -> bool:
        """Whether there is a next action in every world."""
        return self._plan.ready

    def next(self) -> np.ndarray:
        """Return the next actions (n, Da) of what is planned, within their bounds."""
        actions = self.interface.switches.snap(self._plan.pop())
        return self.spec.action.clip(actions.astype(np.float64))

    def _guide(self, history: np.ndarray, obs: Observation, due: np.ndarray) -> Any:
        """Return what leads the chunks of the m worlds in ``due`` (n,), which see ``history`` (m, To, Do)."""
        return None

    def executing(self, execution: Execution, latency: Latency = NO_LATENCY, *, thinking: int = 0) -> Self:
        """Return the same policy, network shared, whose chunks are flown as ``execution`` says.

        Args:
            execution: see there. latency: of the robot.
            thinking: control steps from :meth:`look` to :meth:`plan`, in which it goes on as it had planned.

        Raises:
            InvalidValueError: the delay is no whole number of control steps or leaves too little of a chunk, a chunk
                is shorter than what is to be flown of it, or the network does not denoise, where it is to be led.
        """
        config, again = self.config, self.fresh()
        delay_ms = latency.total_ms if execution.delay_ms is None else execution.delay_ms
        steps = whole_steps("execution.delay_ms", delay_ms, self.spec.control_dt_s)
        realtime, led = execution.chunks == "realtime", execution.guidance > 0
        if (realtime or led) and not self.can_be_led:
            asked = "execution.chunks=realtime" if realtime else f"execution.guidance={execution.guidance:g}"
            raise InvalidValueError(f"{asked} needs a policy that denoises (diffusion, flow); this is {config.name}.")
        newest = config.chunk // 2 if realtime else execution.newest
        execute, ensemble = (newest, None) if newest else (config.execute, config.ensemble)
        delay = 0 if execution.chunks == "plain" else steps + thinking
        spare = config.chunk - delay - max(1, execute)
        if thinking > max(0, spare):
            raise InvalidValueError(
                f"Of a chunk of {config.chunk} actions, {max(0, spare)} are left to fly while {config.name} thinks for "
                f"{thinking} steps. Train with a longer policy.chunk, or a shorter policy.execute."
            )
        again._plan = ActionPlan(config.chunk, max(1, execute), ensemble, delay=delay, thinking=min(thinking, delay))
        again.execution = execution
        return again

    @property
    def can_be_led(self) -> bool:
        """Whether something may lead its answers while they are denoised."""
        return False

    def predict(
        self,
        history: np.ndarray,
        worlds: np.ndarray | None = None,
        *,
        images: Mapping[str, np.ndarray] | None = None,
        noise: np.ndarray | None = None,
        guide: Any = None,
    ) -> np.ndarray:
        """Return chunks of actions (B, Ta, Da) in the environment's units.

        Args:
            history: frames (B, To, Do). worlds: (B,) whose they are, for errors.
            images: of the layout's cameras by name, each (B, To, H, W, 3) uint8.
            noise: (B, S) what a network with chance draws from; None for its most ordinary answer.
            guide: see :meth:`answer`.
        """
        drawn = noise if self._noise.size else None
        outputs = self.answer(self.interface.encode_obs(history), images or {}, drawn, guide)
        if not np.isfinite(outputs).all():
            bad = np.flatnonzero(~np.isfinite(outputs).all(axis=(1, 2)))
            raise NonFiniteActionError("network output", bad if worlds is None else worlds[bad])
        return self.interface.decode_actions(outputs, history)

    def reset(self, mask: np.ndarray | None = None) -> None:
        """Forget the memory of the worlds in ``mask`` (n,) bool, or of all of them and their number."""
        if mask is None:
            self._worlds = None
        for memory in self._memories.values():
            memory.reset(mask)

    def memory(self) -> dict[str, np.ndarray]:
        """Return copies of what is remembered of all worlds: with it :meth:`recall` acts on as if nothing had been."""
        arrays: dict[str, np.ndarray] = {}
        for name, part in self._memories.items():
            arrays |= under(name, part.memory())
        return {**arrays, "worlds": np.array(-1 if self._worlds is None else self._worlds)}

    def recall(self, memory: Mapping[str, np.ndarray]) -> None:
        """Remember what :meth:`memory` returned."""
        for name, part in self._memories.items():
            part.recall(below(name, memory))
        worlds = int(memory["worlds"])
        self._worlds = None if worlds < 0 else worlds

    def attach(self, env: BatchEnv) -> None:
        """Refuse an environment that differs from those the policy was trained in, and take its task as one's own."""
        self.check(env.spec)
        self.take_on(env.spec)
        if env.spec.robot != self.spec.robot and not self.spec.is_foreign:
            flown = self.spec.robot, env.spec.robot
            log.warning("Trained on %s, it flies %s: all it knows of a robot is its tool.", *flown)
        for own, name in self._shown_for.items():
            log.warning("The policy's %s is the environment's %s, the only field of its shape.", own, name)

    def take_on(self, spec: EnvSpec) -> None:
        """Take the task, the instruction and the fields' names of a specification that was checked as one's own."""
        self.assignment.take_on(spec)
        self._shown_for = self._shown_in(spec)

    def check(self, spec: EnvSpec) -> None:
        """Raise :class:`InvalidValueError`, naming each differing key, unless the policy can fly under ``spec``."""
        spec = under_their_names(spec, self._shown_in(spec))
        check_cameras(self.interface.layout, spec)
        spec = as_one_of(self.spec, spec)
        untold = UNTOLD if self.spec.is_foreign and self.spec.action.size == spec.action.size else ()
        of_the_tool = self.interface.layout.relative and suits_other_robots(self.spec, self._seen)
        across = ("robot",) if of_the_tool else ()
        differing = _restrict(self.spec, self._seen).differences(
            _restrict(spec, self._seen), ignore=(*UNIMPORTANT, *untold, *across)
        )
        of_another_task = spec.task != self.spec.task and spec.robot == self.spec.robot and not spec.is_outside
        if differing and of_another_task:
            flown, record = self.spec.task, f"collect robot={spec.robot} task={spec.task} out=datasets/{spec.task}"
            raise InvalidValueError(
                f"The policy was trained for {flown} on {spec.robot}. It differs in: {differing[0]}. Leave out "
                f"task={spec.task}, or begin with: aerial-il {record}"
            )
        if differing:
            made = f"{self.spec.task} on {self.spec.robot} with {self.spec.action.level} actions"
            hint = ANY_ROBOT if spec.robot != self.spec.robot and spec.action == self.spec.action else ""
            raise InvalidValueError(f"The policy was trained for {made}. It differs in: {'; '.join(differing)}.{hint}")

    @property
    def observations(self) -> Observations:
        """``onboard`` if it acts on nothing that a robot does not have by itself, else ``truth``.

        So it is of environments and data from outside the suite, which do not say what has to be seen.
        """
        told = self.spec.is_outside or self.spec.is_foreign or {*self._seen} & {*self.spec.observation.to_be_seen}
        return "truth" if told else "onboard"

    @property
    def task(self) -> str:
        """Which of the tasks that it knows it flies; :meth:`attach` takes the environment's."""
        return self.assignment.task

    @task.setter
    def task(self, task: str) -> None:
        self.assignment.task = task

    @property
    def told(self) -> str | None:
        """What it is told in words to do; see :class:`~aerial_il.policies.parts.assignment.Assignment`."""
        return self.assignment.told

    @told.setter
    def told(self, text: str | None) -> None:
        self.assignment.told = text

    @property
    def understood(self) -> str | None:
        """The wording that it knows and takes its instruction for; None where it is told nothing in words."""
        return self.assignment.understood

    @property
    def _memories(self) -> dict[str, ObservationHistory | ActionPlan | EpisodeNoise]:
        """All that changes while it flies, by name."""
        sights = {f"sight.{name}": sight for name, sight in self._sights.items()}
        return {"history": self._history, **sights, "plan": self._plan, "noise": self._noise}

    @property
    def _seen(self) -> tuple[str, ...]:
        return (*self.interface.layout.names, *self.interface.layout.images)

    def _shown_in(self, spec: EnvSpec) -> dict[str, str]:
        """Return field -> what ``spec`` calls it, for a policy that learned from data of others."""
        return shown_for(self.spec, self._seen, spec) if self.spec.is_foreign else {}

    def _count(self, n: int) -> None:
        if self._worlds not in (None, n):
            raise InvalidValueError(f"The policy flies {self._worlds} worlds and was shown {n}: call reset() between.")
        self._worlds = n


def _restrict(spec: EnvSpec, names: tuple[str, ...]) -> EnvSpec:
    return replace(spec, observation=ObservationSpec(tuple(f for f in spec.observation.fields if f.name in names)))


def suits_other_robots(spec: EnvSpec, seen: tuple[str, ...]) -> bool:
    """Whether a policy in the tool's own frame sees, of the robot in ``spec``, no more than its tool."""
    told = {field.name for field in spec.observation.of_group("proprio")}
    return told & {*seen} <= {*OF_THE_TOOL}
