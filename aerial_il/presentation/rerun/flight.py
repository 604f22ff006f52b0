"""One flight in rerun: its scene, its signals, and what is to be known about both."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import rerun as rr

from aerial_il.core.errors import DemoError
from aerial_il.data.episode import Episode
from aerial_il.evaluation.predictions import Prediction
from aerial_il.presentation.markdown import table
from aerial_il.presentation.rerun import palette, signals
from aerial_il.presentation.rerun.cameras import log_cameras, log_pictures
from aerial_il.presentation.rerun.log import Clock, Log
from aerial_il.presentation.rerun.motion import Motion, compile_scene, move
from aerial_il.presentation.rerun.scene import (
    M_PER_M_S,
    M_PER_N,
    log_chunks,
    log_command,
    log_goal,
    log_motion,
    log_scene,
    log_trails,
)

TOOL_LABELS = ("ee_x", "ee_y", "ee_z")  # of an action that says where the tool is to be
NO_FLAGS = (
    "The sub-tasks are not shown: this version of the suite builds another scene, or the world is not the suite's."
)


@dataclass(frozen=True, eq=False)
class Flight:
    """A recording and what could be made of it.

    Attributes:
        episode: the recording. motion: its scene in all of its states, None where that cannot be had.
        flags: (T, K) sub-task flags after each step, None where nobody can say. notes: what is not shown, and why.
        prediction: of a policy along it; None if nobody asked.
    """

    episode: Episode
    motion: Motion | None
    flags: np.ndarray | None = None
    notes: tuple[str, ...] = ()
    prediction: Prediction | None = None

    @staticmethod
    def of(episode: Episode, flags: np.ndarray | None = None, prediction: Prediction | None = None) -> Flight:
        """Pose the scene in every state, or note why it cannot be."""
        try:
            model = compile_scene(episode)
        except DemoError as error:
            return Flight(episode, None, None, (str(error),), prediction)
        notes = () if flags is not None else (NO_FLAGS,)
        return Flight(episode, move(model, episode.states, episode.spec), flags, notes, prediction)

    @cached_property
    def cameras(self) -> tuple[str, ...]:
        """Names of the recorded pictures."""
        fields = self.episode.spec.observation.of_group("image")
        return tuple(field.name for field in fields if field.name in self.episode.obs)


def log_flight(
    stream: rr.RecordingStream, flight: Flight, root: str = "", clock: Clock | None = None, *, second: bool = False
) -> None:
    """Log a flight below ``root``, which is empty or ends in a slash: ``scene``, ``signals``, ``states``, ``about``.

    Args:
        clock: its times; None for those that were recorded. second: draw its curves paler, beside those of another.
    """
    episode = flight.episode
    clock = clock or Clock(episode.sim_time)
    scene, curves, states = (Log(stream, f"{root}{name}", clock, second) for name in ("scene", "signals", "states"))
    stream.log(f"{root}about", rr.TextDocument(about(flight), media_type="text/markdown"), static=True)
    if flight.motion is not None:
        _log_scene(scene, flight, flight.motion)
        signals.log_forces(curves, flight.motion)
    else:
        for name in flight.cameras:
            log_pictures(Log(stream, f"{root}pictures", clock), name, episode.obs[name])
    signals.log_actions(curves, episode)
    signals.log_observations(curves, episode)
    signals.log_curves(curves, "reward", episode.rewards[:, None], {"reward": palette.REWARD}, width=2.0)
    signals.log_states(states, episode, flight.flags)
    if flight.prediction is not None:
        first = replace(curves, second=False)  # as bright for both flights
        signals.log_action(first, episode.spec.action, flight.prediction.predicted, kind="predicted", width=1.8)


def _log_scene(log: Log, flight: Flight, motion: Motion) -> None:
    episode = flight.episode
    log_scene(log, motion)
    log_motion(log, motion)
    log_trails(log, motion)
    log_cameras(log, episode, motion)
    if (columns := tool_columns(episode)) is not None:
        log_command(log, episode.executed_actions[:, columns], motion)
        if flight.prediction is not None:
            log_chunks(log, flight.prediction.predicted[:, columns], flight.prediction.starts)
    if (goal := goal_of(episode)) is not None:
        log_goal(log, goal)


def tool_columns(episode: Episode) -> list[int] | None:
    """Return which elements of an action are the tool's position in the world, None where none are."""
    labels = episode.spec.action.labels
    return [labels.index(label) for label in TOOL_LABELS] if set(TOOL_LABELS) <= {*labels} else None


def goal_of(episode: Episode) -> np.ndarray | None:
    """Return where something is to be brought (N, 3), world, m, by the last observation ``A_to_B`` that allows it."""
    for name in reversed(episode.spec.observation.names):
        start, _, end = name.partition("_to_")
        if end and f"{end}_pos" in episode.obs:
            return episode.obs[f"{end}_pos"]
        if end and f"{start}_pos" in episode.obs:
            return episode.obs[f"{start}_pos"] + episode.obs[name]
    return None


def about(flight: Flight) -> str:
    """Return what is to be known of a flight, in Markdown."""
    episode, origin = flight.episode, flight.episode.provenance
    spec = episode.spec
    end = "success" if episode.success else "no success"
    rows = {
        "robot": spec.robot, "task": spec.task, "tier": spec.tier, "flown by": origin.get("policy", "unknown"),
        "seed": origin.get("seed", "unknown"), "steps": len(episode), "seconds": f"{episode.sim_time[-1]:.2f}",
        "end": end, "return": f"{episode.total_reward:.2f}", "action": spec.action.level,
    }  # fmt: skip
    scales = f"Arrows: {100 * M_PER_N:g} cm per N of force, {100 * M_PER_M_S:g} cm per m/s of wind."
    notes = "\n\n".join([scales, *flight.notes] if flight.motion is not None else flight.notes)
    return f"# {spec.task} on {spec.robot}\n\n{spec.instruction}\n\n{table(('', ''), rows.items())}\n\n{notes}\n"
