"""What tests fly by: the shipped mappings, and a script at the controls."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import aerial_il
from aerial_il.core import presets
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.teleop.devices import bindings_of
from aerial_il.teleop.input.mapping import Bindings


def shipped(*names: str) -> Bindings:
    """Return the bindings of shipped devices."""
    return bindings_of({name: presets.read("device", name) for name in names})


def world(robot: str = "fa_hexa_arm4", task: str = "reach", **settings: Any) -> BatchEnvironment:
    """Return an environment of one world."""
    return aerial_il.load_batch(robot, task, num_envs=1, num_threads=1, **settings)


def first(obs: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return what world 0 shows."""
    return {name: values[0] for name, values in obs.items()}


def schedule(*parts: tuple[int, int, Sequence[str]]):
    """Return a script that holds controls from a tick up to another one."""
    return lambda tick: [name for begin, end, names in parts if begin <= tick < end for name in names]
