"""Marks in pictures of a recorded flight: where tool and base have been, the wind, the force on the robot."""

from dataclasses import dataclass

import mujoco
import numpy as np

from aerial_il.data.episode import Episode
from aerial_il.presentation.films.scene_renderer import SceneRenderer
from aerial_il.presentation.studio.marks import Arrow, Mark, Trail
from aerial_il.suite.episode.disturbances import effects_of

TOOL, BASE, WIND_BLUE, FORCE_RED = (0.93, 0.42, 0.08), (0.20, 0.45, 0.75), (0.16, 0.55, 0.80), (0.85, 0.12, 0.15)
M_PER_N, M_PER_M_S, LONGEST_M = 0.03, 0.10, 0.5  # length of arrows
LEAST_FORCE_N, LEAST_WIND_M_S = 0.5, 0.3
ABOVE_M = 0.16  # height of the wind's arrow over the base
TRAIL_S = 4.0  # how long a trail is in a film


@dataclass(frozen=True, eq=False)
class Traces:
    """Of a flight's N states, world frame.

    Attributes:
        tool, base: (N, 3) m; ``tool`` is ``base`` where the scene names none. wind: (N, 3) m/s. force: (N, 3) N, sum
            of the contact forces on the robot. place: (N, 3) m, where they act.
        dt: seconds between two states.
    """

    tool: np.ndarray
    base: np.ndarray
    wind: np.ndarray
    force: np.ndarray
    place: np.ndarray
    dt: float

    def marks(self, step: int, *, since_s: float = TRAIL_S, scale: float = 1.0) -> list[Mark]:
        """Return the trails up to the state ``step`` and the arrows at it.

        Args:
            step: number of a state. since_s: length of the trails. scale: of their thickness.
        """
        first = max(0, step - round(since_s / self.dt))
        marks: list[Mark] = [
            Trail(path[first : step + 1], colour, 0.003 * scale)
            for path, colour in ((self.base, BASE), (self.tool, TOOL))
            if step > first
        ]
        if float(np.linalg.norm(self.wind[step])) > LEAST_WIND_M_S:
            start = self.base[step] + [0.0, 0.0, ABOVE_M]
            marks.append(Arrow(start, _short(M_PER_M_S * self.wind[step]), WIND_BLUE, 0.006 * scale))
        if float(np.linalg.norm(self.force[step])) > LEAST_FORCE_N:
            marks.append(Arrow(self.place[step], _short(M_PER_N * self.force[step]), FORCE_RED, 0.006 * scale))
        return marks


def traces_of(episode: Episode, scene: SceneRenderer) -> Traces:
    """Read the traces of a recording from its states."""
    model, rows = scene.model, []
    base, winds = model.body("base").id, effects_of(episode.spec, model, episode.states)["wind"]
    tool = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, "tool")
    for state, wind in zip(episode.states, winds, strict=True):
        data = scene.pose(state)
        at = data.xpos[base].copy()
        rows.append((data.site_xpos[tool].copy() if tool >= 0 else at, at, wind, *_contact(model, data, base)))
    return Traces(*(np.array(column) for column in zip(*rows, strict=True)), dt=episode.spec.control_dt_s)


def _contact(model: mujoco.MjModel, data: mujoco.MjData, base: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the sum of the forces on the robot from outside and the mean point where they act."""
    robot, wrench = model.body_rootid[model.geom_bodyid] == model.body_rootid[base], np.zeros(6)
    total, place, weight = np.zeros(3), np.zeros(3), 0.0
    for i, contact in enumerate(data.contact):
        first, second = robot[contact.geom]
        if first == second:
            continue
        mujoco.mj_contactForce(model, data, i, wrench)
        force = contact.frame.reshape(3, 3).T @ wrench[:3] * (-1.0 if first else 1.0)
        size = float(np.linalg.norm(force))
        total, place, weight = total + force, place + size * contact.pos, weight + size
    return total, place / weight if weight > 0.0 else data.xpos[base].copy()


def _short(vector: np.ndarray) -> np.ndarray:
    length = float(np.linalg.norm(vector))
    return vector * min(1.0, LONGEST_M / length)
