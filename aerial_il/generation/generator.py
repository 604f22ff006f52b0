"""The policy that flies what was generated: for each world a source, its segments moved to where things are."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
from scipy.spatial.transform import Rotation

from aerial_il.core.arrays import length
from aerial_il.core.contracts import Observation
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.rotations import rot6d_from_mat
from aerial_il.core.seeding import named_rng
from aerial_il.data.waypoints import LEVEL
from aerial_il.experts.expert import led, turned_towards
from aerial_il.experts.perturbation import Perturbation
from aerial_il.generation.diversion import MOST_DISTURBED_M, Diversion
from aerial_il.generation.force import ToolForce, pressing
from aerial_il.generation.plan import Path, moved
from aerial_il.generation.reach import beyond
from aerial_il.generation.segments import Segment, cut
from aerial_il.generation.source import Source
from aerial_il.generation.things import Poses, Scene
from aerial_il.generation.transit import way
from aerial_il.suite.batch import BatchEnvironment

Select = Literal["random", "nearest"]
TRANSIT = "transit"
NEAR_M = 0.04  # from where a path begins, at which it does
PATIENCE_STEPS = 50  # that commands wait for the tool, in a segment
TURN_RAD = 0.6  # that a tool is turned ahead on its way
HELD_M, ATTEMPTS = 0.03, 3  # a thing that is farther from where it was held has been missed
NOISE_ON_THE_WAY, NOISE_AT_THINGS = 1.0, 0.2  # shares of the perturbation


@dataclass(eq=False)
class _World:
    """What one world flies: a path, once its tool has come to where that begins, and the segments that follow.

    Attributes:
        left: segments to come. flown: the one whose path it is. path: of it. actions: (K, 10) its commands.
        phase: of it. opening: of the gripper on the way. way: points that the tool passes before it begins.
        told: for the provenance, of each segment that was begun.
        arrived: whether the tool has come. step: of the path. waited: steps in which the tool was late.
        attempts: at this segment.
    """

    left: list[Segment]
    flown: Segment
    path: Path
    actions: np.ndarray
    phase: int
    opening: float
    way: list[np.ndarray]
    told: list[dict[str, Any]]
    arrived: bool = False
    step: int = 0
    waited: int = 0
    attempts: int = 1


class Generator:
    """Flies segments of sources, each moved to where its thing is when its turn comes.

    Attributes:
        phase_names: ``transit`` and the names of things. phase: (n,) present ones.
        expert_action: (n, Da) what was meant, before the perturbation: the label to learn from.

    Args:
        sources: flights to take from. select: which of them flies: any at ``random``, or the ``nearest``, whose things
            lay most like those of the episode. noise: strength of the perturbation, 0 to 1. disturbed: m, how far aside
            flights are led as they begin, at most. most_force: N that tools may press with; None for any.
            seed: of all that is drawn.

    Raises:
        InvalidValueError: no such selection, noise or disturbance.
    """

    def __init__(
        self,
        sources: Sequence[Source],
        *,
        select: Select = "random",
        noise: float = 0.0,
        disturbed: float = 0.0,
        most_force: float | None = None,
        seed: int = 0,
    ) -> None:
        if select not in get_args(Select):
            raise InvalidValueError(f"select={select} is not one of {', '.join(get_args(Select))}.")
        if not 0.0 <= noise <= 1.0:
            raise InvalidValueError(f"noise lies between 0 and 1, got {noise}.")
        if not 0.0 <= disturbed <= MOST_DISTURBED_M:
            raise InvalidValueError(f"disturbed lies between 0 and {MOST_DISTURBED_M:g} m, got {disturbed:g}.")
        self.sources, self.select, self.seed = list(sources), select, seed
        self._cut = [cut(source) for source in self.sources]
        names = dict.fromkeys(segment.name for segments in self._cut for segment in segments)
        self.phase_names = (TRANSIT, *names)
        self.noise, self._disturbed, self._most_force = noise, disturbed, most_force
        self.phase = np.zeros(0, int)
        self.expert_action = np.zeros((0, 0))

    def attach(self, env: BatchEnvironment) -> None:
        """Bind to the environment to fly in.

        Raises:
            InvalidValueError: it is of another task, or not flown at level ``ee_pose``.
        """
        spec, source = env.spec, self.sources[0].spec
        if spec.task != source.task:
            raise InvalidValueError(f"The sources fly {source.task}, the environment is of {spec.task}.")
        if spec.action.level != LEVEL:
            raise InvalidValueError(f"Generation flies at level {LEVEL!r}, the environment's is {spec.action.level!r}.")
        self._env, self._spec = env, spec
        self._scene = Scene(env.model)
        self._joints = {t.name: env.model.joint(t.joint).name for t in self._scene.things if t.kind == "free"}
        self._worlds: list[_World | None] = [None] * env.num_envs
        self.phase = np.zeros(env.num_envs, int)
        self._wander = Perturbation(env.num_envs, self.noise, self.seed, name="generation noise")
        self._diversion = Diversion(env.num_envs, self._disturbed, self.seed)
        self._sensor = None if self._most_force is None else ToolForce(env.model_xml)
        self._felt: list[list[float]] = [[] for _ in range(env.num_envs)]

    def reset(self, mask: np.ndarray | None = None) -> None:
        """Forget what the worlds of ``mask`` (n,) bool, or all, were flying."""
        mask = np.ones(len(self._worlds), bool) if mask is None else np.asarray(mask, bool)
        for world in np.flatnonzero(mask):
            self._worlds[world], self._felt[world] = None, []
        self._wander.reset(mask)
        self._diversion.reset(mask)

    def act(self, obs: Observation) -> np.ndarray:
        """Return ``ee_pose`` actions (n, Da); the observation is ignored in favour of the simulator's state."""
        self._plan()
        if self._sensor is not None:
            for felt, state in zip(self._felt, self._env.get_state(), strict=True):
                felt.append(self._sensor.at(state))
        bounds = self._spec.action
        self.expert_action = bounds.clip(self._commands()[:, : bounds.size])
        action = self.expert_action.copy()
        share = np.where(self.phase == 0, NOISE_ON_THE_WAY, NOISE_AT_THINGS)
        action[:, :3] += share[:, None] * self._wander.drawn(self._env.seeds)
        aside = self._diversion.sent(self._env.simulation.view.tool_pos, self._env.seeds)
        action[:, :3] = np.where(np.isnan(aside), action[:, :3], aside)
        return bounds.clip(action)

    def beyond(self) -> list[str | None]:
        """Say of each world, as an episode begins there, why its flight is beyond the robot, or None if it is not."""
        states = self._env.get_state()
        return [self._beyond(int(self._env.seeds[i]), states[i]) for i in range(self._env.num_envs)]

    def _beyond(self, seed: int, state: np.ndarray) -> str | None:
        now, robot = self._scene.at(state[None]), self._env.simulation.view.robot
        paths = (self._moved(segment, now) for segment in self._cut[self._chosen(seed, now)])
        return next((why for path in paths if (why := beyond(robot, self._spec.action, path))), None)

    def made_of(self, world: int) -> dict[str, Any]:
        """Return the source of the flight of a world, and the segments that it began, each with how it was moved."""
        flown = self._worlds[world]
        if flown is None:
            return {}
        source, *segments = flown.told
        return {**source, "segments": segments}

    def objection(self, world: int) -> str:
        """Return why the flight of a world shall not count as a success: its tool pressed too hard; or nothing."""
        pressed, most = pressing(self._felt[world]), self._most_force
        return "" if most is None or pressed <= most else f"pressed with {pressed:.1f} N, more than {most:.1f} N"

    def _commands(self) -> np.ndarray:
        """Return the commands (n, 10): on the way to a path ahead of the tool, of a path its own."""
        worlds = [world for world in self._worlds if world is not None]
        self._arrive(worlds)
        self.phase[:] = [world.phase if world.arrived else 0 for world in worlds]
        actions = np.empty((len(worlds), 10))
        on_the_way = [i for i, world in enumerate(worlds) if not world.arrived]
        if on_the_way:
            actions[on_the_way] = self._ahead(on_the_way, [worlds[i] for i in on_the_way])
        for i, world in enumerate(worlds):
            if world.arrived:
                actions[i] = self._command(i, world)
        return actions

    def _arrive(self, worlds: Sequence[_World]) -> None:
        """Let worlds whose tool has come to the next point of its way go on from there."""
        tool = self._env.simulation.view.tool_pos
        near = (
            length(tool - np.stack([world.way[0] if world.way else world.path.there[0] for world in worlds])) < NEAR_M
        )
        for i in np.flatnonzero(near & (self._diversion.left == 0)):
            world = worlds[i]
            if not world.arrived:
                world.way.pop(0)
                world.arrived = not world.way

    def _ahead(self, indices: Sequence[int], worlds: Sequence[_World]) -> np.ndarray:
        """Return commands (k, 10) ahead of tools, as experts give them: they depend on where the tools are alone."""
        view = self._env.simulation.view
        pos = led(view.tool_pos[indices], np.stack([world.way[0] for world in worlds]))
        faced = rot6d_from_mat(np.stack([world.path.faced[0] for world in worlds]))
        turned = turned_towards(view.tool_mat[indices], faced, TURN_RAD)
        return np.concatenate([pos, turned, [[world.opening] for world in worlds]], axis=1)

    def _command(self, i: int, world: _World) -> np.ndarray:
        """Return the command (10,) of a path, the same until the tool has come to where it belongs."""
        tool = self._env.simulation.view.tool_pos[i]
        step = min(world.step, len(world.path) - 1)
        aside = self._slipped(i, world, step)
        late = math.dist(tool, world.path.there[step] + aside) > world.path.slack[step]
        if late and world.waited < PATIENCE_STEPS:
            world.waited += 1
        else:
            world.step += 1
        action = world.actions[step].copy()
        action[:3] = world.path.sent(step) + aside
        return action

    def _slipped(self, i: int, world: _World, step: int) -> np.ndarray:
        """Return by how much (3,) m a carried thing lies elsewhere in the gripper than in the source."""
        offset, view = world.path.offset[step], self._env.simulation.view
        if np.isnan(offset[0]):
            return np.zeros(3)
        place, _ = view.free_joint(self._joints[world.flown.carried])
        aside = view.tool_pos[i] - view.qpos[i, place][:3] - offset
        return aside if math.hypot(*aside) < HELD_M else np.zeros(3)

    def _plan(self) -> None:
        """Give each world that has flown its path the next one."""
        due = [i for i, world in enumerate(self._worlds) if world is None or _is_done(world)]
        states = self._env.get_state() if due else np.zeros((0, 0))
        for i in due:
            self._worlds[i] = self._next(self._worlds[i], int(self._env.seeds[i]), states[i])

    def _next(self, world: _World | None, seed: int, state: np.ndarray) -> _World:
        """Return a world with its first or its next segment, or with the same one again if its thing was missed."""
        now = self._scene.at(state[None])
        if world is None:
            chosen = self._chosen(seed, now)
            first, *left = self._cut[chosen]
            return self._begun(first, left, now, [{"source": self.sources[chosen].uid}])
        if world.attempts < ATTEMPTS and self._missed(world.flown, now):
            again = self._begun(world.flown, world.left, now, world.told)
            return replace(again, attempts=world.attempts + 1)
        following = self._begun(world.left[0], world.left[1:], now, world.told)
        return replace(following, opening=float(world.path.gripper[-1]))

    def _begun(self, segment: Segment, left: list[Segment], now: Poses, told: list[dict[str, Any]]) -> _World:
        """Return a world that is to fly a segment, moved to where its thing is, with others ``left``."""
        scene, opening = self._scene, float(segment.gripper[0])
        path = self._moved(segment, now)
        there = way(now.tool_pos[0], path.there[0], scene.boxes(), scene.roots(segment.name, segment.carried))
        phase = self.phase_names.index(segment.name)
        return _World(left, segment, path, path.actions, phase, opening, there, [*told, _told(segment, path)])

    def _moved(self, segment: Segment, now: Poses) -> Path:
        k = self._scene.names.index(segment.name)
        return moved(segment, self._scene.things[k], k, now)

    def _missed(self, segment: Segment, now: Poses) -> bool:
        """Return whether a segment should have ended with its thing in the gripper, and did not."""
        if segment.held is None:
            return False
        pos = now.pos[0, self._scene.names.index(segment.name)]
        return bool(np.linalg.norm(now.tool_mat[0].T @ (pos - now.tool_pos[0]) - segment.held) > HELD_M)

    def _chosen(self, seed: int, now: Poses) -> int:
        if self.select == "random" or len(self.sources) == 1:
            return int(named_rng(seed, "source", str(self.seed)).integers(len(self.sources)))
        names = self._scene.names
        return int(np.argmin([_distance(source, names, now) for source in self.sources]))


def _is_done(world: _World) -> bool:
    return world.step >= len(world.path) and bool(world.left)


def _told(segment: Segment, path: Path) -> dict[str, Any]:
    """Return a segment as JSON values: its steps in the source, and the rigid motion from there to here."""
    shift = path.place - path.turn @ segment.thing_pos[0]
    turned = Rotation.from_matrix(path.turn).as_rotvec()
    return {
        "thing": segment.name,
        "source_steps": [segment.first, segment.first + len(segment)],
        "turned_rad": np.round(turned, 6).tolist(),
        "shifted_m": np.round(shift, 6).tolist(),
    }


def _distance(source: Source, names: tuple[str, ...], now: Poses) -> float:
    """Return how far things lie from where they lay in a source, relative to the tool, m."""
    then = source.poses
    order = [names.index(thing.name) for thing in source.things]
    apart = (now.pos[0, order] - now.tool_pos[0]) - (then.pos[0] - then.tool_pos[0])
    return float(np.linalg.norm(apart, axis=1).sum())
