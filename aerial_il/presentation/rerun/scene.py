"""The scene in motion: moving bodies, trails, the command, and forces as arrows."""

from collections.abc import Sequence

import mujoco
import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from aerial_il.presentation.rerun import palette
from aerial_il.presentation.rerun.geometry import log_geometry, path_of, plain
from aerial_il.presentation.rerun.log import Log
from aerial_il.presentation.rerun.motion import Motion
from aerial_il.presentation.rerun.palette import Colour

M_PER_N = 0.01  # length of the arrow of a force of 1 N
M_PER_M_S = 0.08  # and of a wind of 1 m/s
WIND_ABOVE_M = 0.35  # where the wind's arrow is seen, above the robot
TAIL = 50  # states by which a trail is bright
ARROW_M, PATH_M, TAIL_M, CHUNK_M, COMMAND_M = 0.006, 0.0015, 0.004, 0.005, 0.012  # radii of what is drawn
ASIDE_RAD, CLOSE = -0.7, 0.95  # the eye stands beside the camera, so far away as a share of what it looks at
LEAST_MOTION_M = 0.02  # an object that moves less leaves no trail


def log_scene(log: Log, motion: Motion) -> None:
    """Log what does not change: all geometry, and the poses of what cannot move."""
    log.stream.log(log.root, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    log_geometry(log, motion.model, motion.robot)
    for body in np.flatnonzero(~motion.moving[1:]) + 1:
        turned = rr.Quaternion(xyzw=xyzw(motion.body_quat[0, body]))
        fixed = rr.Transform3D(translation=motion.body_pos[0, body], quaternion=turned)
        log.static(path_of(motion.model, motion.robot, int(body)), fixed)


def log_motion(log: Log, motion: Motion) -> None:
    """Log what changes: poses of all that can move, forces, wind."""
    for body in np.flatnonzero(motion.moving):
        poses = rr.Transform3D.columns(translation=motion.body_pos[:, body], quaternion=xyzw(motion.body_quat[:, body]))
        log.send(path_of(motion.model, motion.robot, int(body)), poses)
    _log_forces(log, motion)


def _log_forces(log: Log, motion: Motion) -> None:
    contacts, states = motion.contacts, len(motion)
    if motion.thrust.size:
        rotors = np.full(states, motion.thrust.shape[1])
        arrows = motion.thrust_pos.reshape(-1, 3), M_PER_N * motion.thrust.reshape(-1, 3)
        _log_arrows(log, "forces/thrust", rotors, *arrows, colour=palette.THRUST)
    if len(contacts.points) or states == 1:  # live, an arrow stays until it is told that there is none
        arrows = contacts.points, M_PER_N * contacts.forces
        _log_arrows(log, "forces/contact", contacts.counts, *arrows, colour=palette.CONTACT)
    if motion.wind is not None:
        above = motion.body_pos[:, np.flatnonzero(motion.robot)[0]] + [0.0, 0.0, WIND_ABOVE_M]
        arrows = above, M_PER_M_S * motion.wind
        _log_arrows(log, "wind", np.ones(states, int), *arrows, colour=palette.WIND)


def _log_arrows(
    log: Log, entity: str, counts: np.ndarray, origins: np.ndarray, vectors: np.ndarray, *, colour: Colour
) -> None:
    """Log ``counts`` (N,) arrows for each state, all of them one after the other in ``origins`` and ``vectors``."""
    log.static(entity, rr.Arrows3D.from_fields(colors=[colour], radii=[ARROW_M]))
    log.send(entity, rr.Arrows3D.columns(origins=origins, vectors=vectors).partition(counts))


def log_trails(log: Log, motion: Motion) -> None:
    """Log where the tool and free objects have just been, and, thin and pale, all of where they go."""
    paths = {
        name: (path, palette.OBJECT)
        for name, path in motion.objects.items()
        if np.ptp(path, axis=0).max() > LEAST_MOTION_M
    }
    if motion.tool is not None:
        paths["tool"] = (motion.tool, palette.TOOL)
    for name, (path, colour) in paths.items():
        entity = f"trails/{plain(name)}"
        log.static(entity, rr.LineStrips3D.from_fields(colors=[colour], radii=[TAIL_M]))
        tails = [path[max(0, i - TAIL) : i + 1] for i in range(len(path))]
        log.send(entity, rr.LineStrips3D.columns(strips=tails))
        whole = rr.LineStrips3D([path], colors=palette.paler([colour], 0.35), radii=[PATH_M])
        log.static(f"{entity}/whole", whole)


def log_command(log: Log, targets: np.ndarray, motion: Motion) -> None:
    """Log the commanded position of the tool (T, 3), world, m, as a dot with a line from the tool."""
    if motion.tool is None:
        return
    steps = np.arange(len(targets))
    log.static("command", rr.Points3D.from_fields(colors=[palette.COMMAND], radii=[COMMAND_M]))
    log.send("command", rr.Points3D.columns(positions=targets), steps)
    lines = np.stack([motion.tool[: len(targets)], targets], axis=1)
    log.static("command/from_tool", rr.LineStrips3D.from_fields(colors=[palette.COMMAND], radii=[PATH_M]))
    log.send("command/from_tool", rr.LineStrips3D.columns(strips=list(lines)), steps)


def log_chunks(log: Log, targets: np.ndarray, starts: np.ndarray) -> None:
    """Log chunks of predicted positions of the tool (T, 3), each from one of ``starts`` (C,) on, while it lasts."""
    log.static("predicted", rr.LineStrips3D.from_fields(colors=[palette.PREDICTED], radii=[CHUNK_M]))
    log.send("predicted", rr.LineStrips3D.columns(strips=np.split(targets, starts[1:])), starts)


def log_goal(log: Log, goal: np.ndarray) -> None:
    """Log the goal's position (N, 3), world, m, as a dot with its name."""
    look = rr.Points3D.from_fields(colors=[palette.GOAL], radii=[COMMAND_M], labels=["goal"], show_labels=True)
    log.static("goal", look)
    changed = np.flatnonzero(np.r_[True, (np.diff(goal, axis=0) != 0.0).any(axis=1)])
    log.send("goal", rr.Points3D.columns(positions=goal[changed]), changed)


def xyzw(quat_wxyz: np.ndarray) -> np.ndarray:
    """Return quaternions (..., 4) in rerun's order."""
    return np.roll(quat_wxyz, -1, axis=-1)


def eye(motion: Motion) -> tuple[Sequence[float], Sequence[float]]:
    """Return where to look from and at, world, m: on the side of the camera ``scene``, the robot's path in full."""
    low, high = _extent(motion)
    centre, size = 0.5 * (low + high), float(np.linalg.norm(high - low))
    camera = mujoco.mj_name2id(motion.model, mujoco.mjtObj.mjOBJ_CAMERA, "scene")
    side = motion.camera_pos[0, camera] - centre if camera >= 0 else np.array([1.2, -1.4, 0.7])
    c, s = np.cos(ASIDE_RAD), np.sin(ASIDE_RAD)
    aside = np.array([c * side[0] - s * side[1], s * side[0] + c * side[1], 0.8 * side[2]])
    away = aside / np.linalg.norm(aside) * max(0.8, CLOSE * size)
    return (centre + away).tolist(), centre.tolist()


def scene_view(origin: str, motion: Motion, name: str | None = None) -> rrb.Spatial3DView:
    """Return the view of a scene that was logged below ``origin``, from where :func:`eye` looks."""
    position, target = eye(motion)
    look = rrb.EyeControls3D(position=position, look_target=target)
    return rrb.Spatial3DView(
        origin=origin, name=name, background=palette.BACKGROUND, line_grid=False, eye_controls=look
    )


def _extent(motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners (3,) of a box that holds the robot in all states, and what it deals with."""
    robot = motion.body_pos[:, motion.robot]
    margin = max(0.15, float(np.ptp(robot[0], axis=0).max()) / 2)
    points = np.concatenate([robot.reshape(-1, 3), motion.body_pos[:, motion.moving].reshape(-1, 3)])
    return points.min(axis=0) - margin, points.max(axis=0) + margin
