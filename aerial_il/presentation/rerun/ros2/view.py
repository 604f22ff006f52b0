"""A flight for ROS 2's viewers: the robot's description, every frame at every step, pictures, and the signals.

==========================  ====================  ==================================================================
topic                       type                  content
==========================  ====================  ==================================================================
``/robot_description``      String                the robot as URDF, attached as ``robot.urdf`` too
``/tf``                     TFMessage             every frame that moves: links in their parents, others in ``world``
``/tf_static``              TFMessage             every frame that does not: of links, props, cameras and the tool
``/joint_states``           JointState            the joints of the URDF, rad and rad/s, m and m/s
``/pose/<body>``            PoseStamped           robot, objects and goals in ``world``
``/scene``                  MarkerArray           what stands about, each in the frame of its body
``/camera/<field>/...``     CompressedImage, ...  ``image`` and ``camera_info``, of every picture that was recorded
``/action``                 JointState            the action as commanded, named
``/observation``            JointState            every state observation, element by element
``/reward``                 Float64MultiArray     of the step
==========================  ====================  ==================================================================
"""

import os
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np

from aerial_il.data.episode import Episode
from aerial_il.data.recording.encoding.messages import FLOAT_ARRAY, POSE_STAMPED
from aerial_il.presentation.rerun.geometry import plain
from aerial_il.presentation.rerun.motion import compile_scene, move, recorded_cameras
from aerial_il.presentation.rerun.ros2.bag import CAMERA_INFO, MARKERS, STRING, Bag, Frame, Values, header, vector
from aerial_il.presentation.rerun.ros2.kinematics import WORLD, Tree, body_name, tree_of
from aerial_il.presentation.rerun.ros2.shapes import BOX, CYLINDER, SPHERE, shapes_of
from aerial_il.presentation.rerun.ros2.tracks import Track, body_pose, optical, tracks_of
from aerial_il.presentation.rerun.ros2.urdf import urdf_of
from aerial_il.suite.physics.physics_batch import SIGNATURE

URDF = "robot.urdf"
MARKER_TYPES = {BOX: 1, SPHERE: 2, CYLINDER: 3}  # of visualization_msgs/msg/Marker


def write_view(episode: Episode, path: str | os.PathLike[str]) -> Path:
    """Write a flight as an MCAP file for viewers.

    Args:
        episode: with its states and its scene, and those of its pictures that are to be shown.
        path: the file.

    Raises:
        DemoError: it holds no scene or no states.
        StorageError: the file cannot be written.
    """
    model = compile_scene(episode)
    motion, tree = move(model, episode.states, episode.spec), tree_of(model)
    qpos, qvel = (_part(model, episode.states, part) for part in ("qpos", "qvel"))
    tracks = tracks_of(motion, tree, qpos)
    free = [body for body in np.flatnonzero(motion.moving).tolist() if model.body_parentid[body] == 0]
    placed = [Track(WORLD, body_name(model, body), body_pose(motion, body)) for body in free]
    joints, cameras = _values(model, tree, qpos, qvel), list(recorded_cameras(episode, model))
    bag = Bag()
    _add_lasting(bag, episode, model, tree, [track for track in tracks if not track.moves])
    for step, time_s in enumerate(episode.sim_time.tolist()):
        bag.frames("/tf", time_s, [track.at(step) for track in tracks if track.moves])
        for track in placed:
            frame = track.at(step)
            posed = {"header": header(time_s, frame.parent), "pose": frame.pose}
            bag.add(f"/pose/{track.name}", time_s, POSE_STAMPED, posed)
        if tree.moving:
            bag.named("/joint_states", time_s, [joint.name for joint in tree.moving], *(part[step] for part in joints))
        _add_pictures(bag, episode, cameras, step)
        _add_signals(bag, episode, step)
    return bag.save(path)


def _add_lasting(bag: Bag, episode: Episode, model: mujoco.MjModel, tree: Tree, static: list[Track]) -> None:
    """Add what lasts."""
    start, urdf = float(episode.sim_time[0]), urdf_of(model, tree, plain(episode.spec.robot))
    bag.add_metadata("aerial_il.view", {"uid": episode.uid, "success": str(episode.success).lower()})
    bag.attach(URDF, "application/xml", urdf.encode())
    bag.add("/robot_description", start, STRING, {"data": urdf}, lasting=True)
    bag.frames("/tf_static", start, [track.at() for track in static], lasting=True)
    markers = [{"id": i, "header": header(start, m["ns"]), **m} for i, m in enumerate(_scenery(model, tree))]
    bag.add("/scene", start, MARKERS, {"markers": markers}, lasting=True)


def _scenery(model: mujoco.MjModel, tree: Tree) -> Iterator[Values]:
    """Yield what is to be seen beside the robot: solids that stay in the frames of their bodies."""
    for body in range(model.nbody):
        name = body_name(model, body)
        for shape in shapes_of(model, body) if name not in tree.bodies else ():
            yield {
                "ns": name,
                "type": MARKER_TYPES[shape.kind],
                "pose": Frame(name, name, shape.pose.pos, shape.pose.xyzw).pose,
                "scale": vector(shape.size),
                "color": vector(shape.colour, "rgba"),
                "frame_locked": True,
            }


def _add_signals(bag: Bag, episode: Episode, step: int) -> None:
    spec, time_s = episode.spec, float(episode.sim_time[step])
    names = spec.observation.state_names
    labels = [label for name in names for label in spec.observation[name].element_labels()]
    bag.named("/observation", time_s, labels, np.concatenate([episode.obs[name][step].reshape(-1) for name in names]))
    if step < len(episode):
        bag.named("/action", time_s, spec.action.labels, episode.actions[step])
        bag.add("/reward", time_s, FLOAT_ARRAY, {"data": [episode.rewards[step]]})


def _add_pictures(bag: Bag, episode: Episode, cameras: list[tuple[str, int, float]], step: int) -> None:
    for field, _, focal in cameras:
        topic, frame, time_s = f"/camera/{field}", optical(field.rpartition("_")[0]), float(episode.sim_time[step])
        picture = episode.obs[field][step]
        sight = {"header": header(time_s, frame), **_sight(picture.shape[0], picture.shape[1], focal)}
        bag.add(f"{topic}/camera_info", time_s, CAMERA_INFO, sight)
        bag.picture(f"{topic}/image", time_s, frame, picture)


def _sight(height: int, width: int, focal: float) -> Values:
    """Return how a camera without distortion sees, all in pixels: its frame has x to the right, y down, z ahead."""
    projection = np.array([[focal, 0, width / 2, 0], [0, focal, height / 2, 0], [0, 0, 1, 0]])
    matrices = {"d": np.zeros(5), "k": projection[:, :3].ravel(), "r": np.eye(3).ravel(), "p": projection.ravel()}
    return {"height": height, "width": width, "distortion_model": "plumb_bob", **matrices}


def _values(model: mujoco.MjModel, tree: Tree, qpos: np.ndarray, qvel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and speeds (N, J) of the robot's joints."""
    indices = [joint.index for joint in tree.moving]
    return qpos[:, model.jnt_qposadr[indices]], qvel[:, model.jnt_dofadr[indices]]


def _part(model: mujoco.MjModel, states: np.ndarray, name: str) -> np.ndarray:
    """Return a part of MuJoCo's states (N, S): ``qpos`` (N, nq) or ``qvel`` (N, nv)."""
    part = getattr(mujoco.mjtState, f"mjSTATE_{name.upper()}")
    size, parts = mujoco.mj_stateSize(model, SIGNATURE), np.zeros((len(states), mujoco.mj_stateSize(model, part)))
    for values, state in zip(parts, np.ascontiguousarray(states[:, :size]), strict=True):
        mujoco.mj_extractState(model, state, SIGNATURE, values, int(part))
    return parts
