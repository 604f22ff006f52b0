"""Kinematics of every recorded state, by MuJoCo: poses of all bodies, cameras and sites, and the forces that act."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np

from aerial_il.core.errors import DemoError, InvalidValueError
from aerial_il.core.scene_gate import compiled
from aerial_il.core.specs import EnvSpec
from aerial_il.data.episode import Episode
from aerial_il.suite.episode.disturbances import effects_of
from aerial_il.suite.physics.physics_batch import STATE
from aerial_il.suite.physics.rotors import knows_thrusts, rotor_sites, thrusts_of

LEAST_FORCE_N = 0.05  # contacts that press less are not shown
ROBOT = "base"  # first body of every robot of ours
INSTEAD = "Its signals can be shown all the same."


@dataclass(frozen=True, eq=False)
class Contacts:
    """Forces at the K contacts of N states, of all states one after the other.

    Attributes:
        counts: (N,) contacts of each state. points: (K, 3) world, m. forces: (K, 3) world, N: on the robot where it
            takes part, else on the second body. on_robot: (K,) bool, the robot takes part.
    """

    counts: np.ndarray
    points: np.ndarray
    forces: np.ndarray
    on_robot: np.ndarray

    @property
    def on_robot_n(self) -> np.ndarray:
        """(N,) sum of the magnitudes of the contact forces on the robot, N."""
        size = np.linalg.norm(self.forces, axis=1) * self.on_robot
        return np.bincount(np.repeat(np.arange(len(self.counts)), self.counts), size, len(self.counts))


@dataclass(frozen=True, eq=False)
class Motion:
    """A scene in N states.

    Attributes:
        model: the compiled scene. body_pos: (N, B, 3) m, body_quat: (N, B, 4) wxyz, world from body.
        site_pos: (N, S, 3) m. camera_pos: (N, C, 3) m, camera_mat: (N, C, 3, 3) world from camera.
        thrust_pos, thrust: (N, R, 3) points and forces of the rotors, world, m and N.
        contacts: what presses on what. wind: (N, 3) m/s, world; None where none is known.
    """

    model: mujoco.MjModel
    body_pos: np.ndarray
    body_quat: np.ndarray
    site_pos: np.ndarray
    camera_pos: np.ndarray
    camera_mat: np.ndarray
    thrust_pos: np.ndarray
    thrust: np.ndarray
    contacts: Contacts
    wind: np.ndarray | None

    def __len__(self) -> int:
        """Return the number of states N."""
        return len(self.body_pos)

    @cached_property
    def moving(self) -> np.ndarray:
        """(B,) bool: the body can move, by joints or because it is placed anew in every episode."""
        root = self.model.body_weldid
        return (root != 0) | (self.model.body_mocapid[root] >= 0) | (self.model.body_mocapid >= 0)

    @cached_property
    def robot(self) -> np.ndarray:
        """(B,) bool: the body belongs to the robot; everything that has joints where no body is called ``base``."""
        return robot_bodies(self.model)

    @property
    def tool(self) -> np.ndarray | None:
        """(N, 3) path of the tool, m; None in scenes that name none."""
        site = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_SITE, "tool")
        return self.site_pos[:, site] if site >= 0 else None

    @property
    def objects(self) -> dict[str, np.ndarray]:
        """Name -> path (N, 3) m of every body beside the robot that flies freely."""
        model = self.model
        free = model.jnt_bodyid[model.jnt_type == mujoco.mjtJoint.mjJNT_FREE]
        return {model.body(body).name: self.body_pos[:, body] for body in free if not self.robot[body]}


def robot_bodies(model: mujoco.MjModel) -> np.ndarray:
    """(B,) bool: bodies of the robot."""
    base = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, ROBOT)
    return model.body_rootid == model.body_rootid[base] if base >= 0 else model.body_weldid != 0


def recorded_cameras(episode: Episode, model: mujoco.MjModel) -> Iterator[tuple[str, int, float]]:
    """Yield of every recorded picture whose camera the scene has: its field, the camera, the focal length in pixels."""
    for field in (field.name for field in episode.spec.observation.of_group("image") if field.name in episode.obs):
        camera = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, field.rpartition("_")[0])
        if camera >= 0:
            height = episode.obs[field].shape[1]
            yield field, camera, 0.5 * height / float(np.tan(0.5 * np.deg2rad(model.cam_fovy[camera])))


def compile_scene(episode: Episode) -> mujoco.MjModel:
    """Return the compiled scene of a recording.

    Raises:
        DemoError: it holds no scene or no states, or they do not belong together.
    """
    if not episode.model_xml or not episode.states.shape[1]:
        missing = "simulator states" if episode.model_xml else "scene"
        raise DemoError(episode.uid, f"holds no {missing}: nothing can be drawn in 3-D.", hint=INSTEAD)
    try:
        model = compiled(episode.model_xml)
    except InvalidValueError as error:
        raise DemoError(episode.uid, f"its scene cannot be drawn: {error}.", hint=INSTEAD) from error
    needed = mujoco.mj_stateSize(model, STATE)
    if episode.states.shape[1] < needed:
        size = episode.states.shape[1]
        raise DemoError(episode.uid, "its states are not its scene's.", expected=needed, got=size, hint=INSTEAD)
    return model


def move(model: mujoco.MjModel, states: np.ndarray, spec: EnvSpec | None = None) -> Motion:
    """Put the scene into every state (N, S) and keep what is to be seen; numbers beyond MuJoCo's state are left out.

    Args:
        spec: of the environment, which knows the wind.
    """
    data, size = mujoco.MjData(model), mujoco.mj_stateSize(model, STATE)
    seen: list[dict[str, np.ndarray]] = []
    contacts: list[tuple[np.ndarray, ...]] = []
    for state in np.ascontiguousarray(states[:, :size]):
        mujoco.mj_setState(model, data, state, STATE)
        mujoco.mj_forward(model, data)
        seen.append({name: np.copy(part) for name, part in _seen(model, data).items()})
        contacts.append(_contacts(model, data))
    wind = effects_of(spec, model, states)["wind"] if spec else np.zeros((len(states), 3))
    counts, *each = zip(*contacts, strict=True)
    return Motion(
        model=model,
        contacts=Contacts(np.array(counts), *map(np.concatenate, each)),
        wind=wind if wind.any() else None,
        **{name: np.stack([parts[name] for parts in seen]) for name in seen[0]},
    )


def _seen(model: mujoco.MjModel, data: mujoco.MjData) -> dict[str, np.ndarray]:
    """Return views of what is kept of one state; see :class:`Motion`."""
    poses = {"body_pos": data.xpos, "body_quat": data.xquat, "site_pos": data.site_xpos, "camera_pos": data.cam_xpos}
    thrust_pos, thrust = _thrusts(model, data)
    return {**poses, "camera_mat": data.cam_xmat.reshape(-1, 3, 3), "thrust_pos": thrust_pos, "thrust": thrust}


def _thrusts(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[np.ndarray, np.ndarray]:
    """Return points and forces (R, 3) of what pushes at sites: actuators, as rotors were until engine 3, or rotors."""
    pushing = np.flatnonzero(model.actuator_trntype == mujoco.mjtTrn.mjTRN_SITE)
    sites, along = model.actuator_trnid[pushing, 0], model.actuator_gear[pushing, :3]
    size = data.actuator_force[pushing]
    if not pushing.size and knows_thrusts(model):
        sites = np.array(rotor_sites(model), int)
        along, size = np.tile([0.0, 0.0, 1.0], (len(sites), 1)), thrusts_of(data)[: len(sites)]
    axes = np.einsum("rij,rj->ri", data.site_xmat[sites].reshape(-1, 3, 3), along)
    return data.site_xpos[sites], axes * size[:, None]


def _contacts(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[np.ndarray, ...]:
    """Return count, points (k, 3), forces (k, 3) and whether the robot takes part (k,), of one state."""
    robot, kept, wrench = robot_bodies(model), [], np.zeros(6)
    for i, contact in enumerate(data.contact):
        mujoco.mj_contactForce(model, data, i, wrench)
        force = contact.frame.reshape(3, 3).T @ wrench[:3]
        if np.linalg.norm(force) < LEAST_FORCE_N:
            continue
        first, second = robot[model.geom_bodyid[contact.geom]]
        kept.append((contact.pos.copy(), -force if first and not second else force, first or second))
    points, forces, on_robot = zip(*kept, strict=True) if kept else ((), (), ())
    return len(kept), np.reshape(points, (-1, 3)), np.reshape(forces, (-1, 3)), np.array(on_robot, bool)  # type: ignore[return-value]
