"""A flight to generate from: where the tool was sent, and where things were meanwhile."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.rotations import mat_from_rot6d
from aerial_il.core.specs import EnvSpec
from aerial_il.data.dataset import Dataset
from aerial_il.data.episode import Episode
from aerial_il.data.waypoints import LEVEL
from aerial_il.generation.cuts import Cut, cuts_by_hand
from aerial_il.generation.things import Poses, Scene, Thing
from aerial_il.suite.scenario import Scenario

GRIPPER = "gripper"
AHEAD_S = 0.2  # how far behind its command a tool flies, for flights whose actions command no pose


@dataclass(frozen=True, eq=False)
class Source:
    """What a flight of T steps shows of how its task is done.

    Attributes:
        uid: of the episode. spec: of its environment. things: of its scene. poses: (T + 1) where they were.
        pos: (T, 3) m, where the tool was sent, world. mat: (T, 3, 3) likewise, world from tool.
        gripper: (T,) opening that was commanded; 1 without a gripper.
        phases: name of the phase that begins at a step; empty where none were recorded.
        cuts: those that a person has said; None for those that are found.
    """

    uid: str
    spec: EnvSpec
    things: tuple[Thing, ...]
    poses: Poses
    pos: np.ndarray
    mat: np.ndarray
    gripper: np.ndarray
    phases: Mapping[int, str]
    cuts: tuple[Cut, ...] | None = None

    def __len__(self) -> int:
        return len(self.pos)

    @property
    def names(self) -> list[str]:
        """Names of the things."""
        return [thing.name for thing in self.things]


def read_source(episode: Episode) -> Source:
    """Take from a recorded flight what generation needs.

    Raises:
        InvalidValueError: it is no success, not of the suite, or recorded with states of another engine.
    """
    spec = episode.spec
    if spec.is_outside or spec.is_foreign:
        raise InvalidValueError(f"{episode.uid} is not of the suite: {spec.robot}:{spec.task} has no scene to move in.")
    if not episode.success:
        raise InvalidValueError(f"{episode.uid} is no success: nothing can be generated from it.")
    if not episode.states.size:
        raise InvalidValueError(f"{episode.uid} holds no simulator states: generate from the recordings themselves.")
    scene = Scene(Scenario(spec.robot, spec.task).compile())
    if episode.states.shape[1] != (size := scene.state_size):
        raise InvalidValueError(
            f"{episode.uid} has states of {episode.states.shape[1]} numbers where this version has {size}: it was "
            "recorded by another engine. Record it anew with aerial-il collect or aerial-il teleop."
        )
    poses, actions = scene.at(episode.states), episode.done
    gripper = actions[:, -1] if GRIPPER in spec.action.labels else np.ones(len(episode))
    if spec.action.level == LEVEL:
        pos, mat = actions[:, :3], mat_from_rot6d(actions[:, 3:9])
    else:
        reached = np.minimum(np.arange(len(episode)) + 1 + round(AHEAD_S / spec.control_dt_s), len(episode))
        pos, mat = poses.tool_pos[reached], poses.tool_mat[reached]
    return Source(episode.uid, spec, scene.things, poses, pos, mat, gripper, _phases(episode))


def read_sources(episodes: Iterable[Episode]) -> list[Source]:
    """Return the successes among ``episodes`` as sources.

    Raises:
        InvalidValueError: there is none, or they are of several tasks.
    """
    sources = [read_source(episode) for episode in episodes if episode.success]
    if not sources:
        raise InvalidValueError("There is no successful flight to generate from.")
    tasks = sorted({source.spec.task for source in sources})
    if len(tasks) > 1:
        raise InvalidValueError(f"Sources are of several tasks: {', '.join(tasks)}. Take those of one.")
    return sources


def source_of(dataset: Dataset, uid: str) -> Source:
    """Return a flight of a dataset as a source, cut by hand where it is.

    Raises:
        UnknownNameError: there is none of that name. InvalidValueError: nothing can be generated from it.
        DemoError: it cannot be read, or its cuts.
    """
    if uid not in dataset.uids:
        raise UnknownNameError("successful flight", uid, dataset.uids[:10])
    (source,) = with_cuts([read_source(dataset[uid])], dataset.files)
    return source


def with_cuts(sources: Sequence[Source], files: Mapping[str, Path]) -> list[Source]:
    """Return sources with the cuts by hand that lie beside their recordings.

    Args:
        files: uid -> recording, in a folder of a dataset's.

    Raises:
        DemoError: what lies there are no cuts.
    """
    places = {source.uid: files.get(source.uid) for source in sources}
    said = {folder: cuts_by_hand(folder) for folder in {file.parent.parent for file in places.values() if file}}
    return [
        replace(source, cuts=said[file.parent.parent].get(file.stem) if (file := places[source.uid]) else None)
        for source in sources
    ]


def _phases(episode: Episode) -> dict[int, str]:
    names, phase = episode.provenance.get("phases", ()), episode.phase
    begun = [0, *(np.flatnonzero(np.diff(phase)) + 1).tolist()]
    return {step: names[phase[step]] for step in begun if 0 <= phase[step] < len(names)}
