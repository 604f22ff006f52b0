"""How hard a tool presses, so that flights that press much harder than their sources do not count."""

from collections.abc import Iterable, Sequence

import mujoco
import numpy as np

from aerial_il.data.episode import Episode
from aerial_il.suite.physics.contact_sensors import GRIPPER, add_force_sensor
from aerial_il.suite.physics.physics_batch import SIGNATURE

SENSOR, PERCENTILE = "pressing", 95.0


class ToolForce:
    """A sensor of the net contact force of the gripper on other things, in a scene of its own.

    Args:
        model_xml: of the scene in which flights are.
    """

    def __init__(self, model_xml: str) -> None:
        spec = mujoco.MjSpec.from_string(model_xml)
        add_force_sensor(spec, SENSOR, GRIPPER)
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)

    def at(self, state: np.ndarray) -> float:
        """Return the force, N, in a full state (S,)."""
        mujoco.mj_setState(self._model, self._data, state, SIGNATURE)
        mujoco.mj_forward(self._model, self._data)
        return float(np.linalg.norm(self._data.sensor(SENSOR).data))


def pressing(forces: Sequence[float]) -> float:
    """Return what a tool presses with, N: the 95th percentile of its ``forces`` while it touches anything."""
    touching = [force for force in forces if force > 0.0]
    return float(np.percentile(touching, PERCENTILE)) if touching else 0.0


def pressing_in(episodes: Iterable[Episode]) -> float:
    """Return what tools press with in flights, N."""
    forces, sensors = list[float](), dict[str, ToolForce]()
    for episode in episodes:
        if (sensor := sensors.get(episode.model_xml)) is None:
            sensor = sensors[episode.model_xml] = ToolForce(episode.model_xml)
        forces += map(sensor.at, episode.states)
    return pressing(forces)
