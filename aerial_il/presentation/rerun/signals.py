"""Everything recorded that is no picture, as curves, and what is one of a few things as lanes of states."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr

from aerial_il.core.contracts import NO_PHASE
from aerial_il.core.specs import ActionSpec
from aerial_il.data.episode import Episode
from aerial_il.presentation.rerun import palette
from aerial_il.presentation.rerun.geometry import plain
from aerial_il.presentation.rerun.log import Log
from aerial_il.presentation.rerun.motion import Motion
from aerial_il.presentation.rerun.palette import Colour

ACTIONS = {"commanded": 2.5, "executed": 1.2, "expert": 1.0}  # width of each kind of action's curve
LARGEST_FIELD = 12  # numbers of an observation that are drawn as curves


@dataclass(frozen=True)
class ActionGroup:
    """Elements of an action that belong in one plot.

    Attributes:
        name: of the group. columns: which elements. labels: of each.
    """

    name: str
    columns: tuple[int, ...]
    labels: tuple[str, ...]


def groups_of(action: ActionSpec) -> list[ActionGroup]:
    """Return an action's elements by the stem of their labels: ``ee_x`` and ``ee_rot6d_0`` are in different plots."""
    stems: dict[str, list[int]] = {}
    for i, label in enumerate(action.labels):
        stem = label.rstrip("0123456789").rstrip("_") or "action"
        head, _, tail = stem.rpartition("_")
        stems.setdefault(f"{head}_xyz" if tail in ("x", "y", "z") and head else stem, []).append(i)
    return [
        ActionGroup(plain(stem), tuple(columns), tuple(action.labels[i] for i in columns))
        for stem, columns in stems.items()
    ]


def log_actions(log: Log, episode: Episode) -> None:
    """Log commanded, executed and, where asked for, the expert's actions."""
    kinds = {"commanded": episode.actions, "executed": episode.executed_actions}
    if episode.asked.any():
        kinds["expert"] = episode.expert_actions
    for kind, values in kinds.items():
        log_action(log, episode.spec.action, values, kind=kind, width=ACTIONS[kind])


def log_action(log: Log, action: ActionSpec, values: np.ndarray, *, kind: str, width: float = 1.5) -> None:
    """Log actions (T, Da) of one kind, group by group; what was only commanded is drawn broad and pale."""
    for group in groups_of(action):
        colours = palette.series(len(group.columns))
        colours = palette.paler(colours) if kind == "commanded" else colours
        curves = {f"{label} {kind}": colour for label, colour in zip(group.labels, colours, strict=True)}
        log_curves(log, f"action/{group.name}/{kind}", values[:, group.columns], curves, width=width)


def log_observations(log: Log, episode: Episode) -> None:
    """Log every observed field that is no picture."""
    for field in episode.spec.observation.fields:
        if field.group == "image" or field.name not in episode.obs or field.size > LARGEST_FIELD:
            continue
        values = episode.obs[field.name].reshape(len(log.clock.sim_time), -1)
        names = [label.replace(".", " ") for label in field.element_labels()]
        log_curves(
            log, f"observation/{plain(field.name)}", values, dict(zip(names, palette.series(field.size), strict=True))
        )


def log_forces(log: Log, motion: Motion) -> None:
    """Log the magnitude of all contacts of the robot, each rotor's thrust, and the wind's speed."""
    pressed = motion.contacts.on_robot_n[:, None]
    log_curves(log, "forces/contact", pressed, {"contacts, N": palette.CONTACT}, width=2.0)
    if motion.thrust.size:
        size = np.linalg.norm(motion.thrust, axis=2)
        colours = palette.series(size.shape[1])
        log_curves(log, "forces/thrust", size, {f"rotor {i}, N": colour for i, colour in enumerate(colours)})
    if motion.wind is not None:
        speed = np.linalg.norm(motion.wind, axis=1, keepdims=True)
        log_curves(log, "wind", speed, {"wind, m/s": palette.WIND}, width=2.0)


def log_states(log: Log, episode: Episode, flags: np.ndarray | None) -> None:
    """Log phase, sub-tasks, interventions and the outcome, each time they change.

    Args:
        flags: (T, K) sub-task flags after each step, None where nobody can say.
    """
    if (phases := phase_names(episode)) is not None:
        log_lane(log, "0_phase", phases)  # lanes stand in the order of their names
    if episode.is_intervention.any():
        log_lane(log, "8_intervention", np.where(episode.is_intervention, "taken over", "alone"))
    if flags is not None:
        for i, (name, done) in enumerate(zip(episode.spec.subtasks, flags.T, strict=True), 1):
            values = np.concatenate([["no"], np.where(done > 0, "yes", "no")])
            log_lane(log, f"{i}_{plain(name)}", values, yes_no=True)
    over = np.full(len(episode) + 1, "flying", dtype=object)
    over[-1] = "success" if episode.success else ("crash or loss" if episode.terminated[-1:].any() else "no success")
    log_lane(log, "9_outcome", over)


def phase_names(episode: Episode) -> np.ndarray | None:
    """Return the name (T,) of every step's phase, None for a flight without phases."""
    phases = [str(name) for name in episode.provenance.get("phases", ())]
    if not phases or not (episode.phase != NO_PHASE).any() or episode.phase.max() >= len(phases):
        return None
    return np.where(episode.phase == NO_PHASE, "none", np.array(phases)[np.maximum(episode.phase, 0)])


def log_lane(log: Log, entity: str, values: np.ndarray, *, yes_no: bool = False) -> None:
    """Log which of a few things (N,) holds, whenever it changes."""
    values = np.asarray(values, dtype=str)
    known = sorted({"no", "yes"}) if yes_no else list(dict.fromkeys(values.tolist()))
    colours: Sequence[Colour] = (palette.UNDONE, palette.DONE) if yes_no else _lane_colours(known)
    log.static(entity, rr.StateConfiguration(values=known, labels=known, colors=list(colours)))
    changed = np.flatnonzero(np.r_[True, values[1:] != values[:-1]])
    log.send(entity, rr.StateChange.columns(state=values[changed].tolist()), changed)


def _lane_colours(known: Sequence[str]) -> list[Colour]:
    meant: Mapping[str, Colour] = {
        "success": palette.DONE, "no success": palette.CONTACT, "crash or loss": palette.CONTACT,
        "flying": palette.UNDONE, "alone": palette.UNDONE, "taken over": palette.COMMAND, "none": palette.UNDONE,
    }  # fmt: skip
    return [meant.get(name, palette.MANY[i % len(palette.MANY)]) for i, name in enumerate(known)]


def log_curves(log: Log, entity: str, values: np.ndarray, curves: Mapping[str, Colour], *, width: float = 1.2) -> None:
    """Log k curves (n, k), their names and colours in ``curves``, over the first n times of the clock."""
    flight = log.root.partition("signals")[0].strip("/")
    shown, colours = [f"{flight} {name}".strip() for name in curves], list(curves.values())
    tints = palette.paler(colours) if log.second else colours
    log.static(entity, rr.SeriesLines(names=shown, colors=tints, widths=[width] * len(curves)))
    columns = rr.Scalars.columns(scalars=np.asarray(values, float).reshape(-1))
    log.send(entity, columns.partition(np.full(len(values), values.shape[1])), np.arange(len(values)))
