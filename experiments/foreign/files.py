"""The same flights of one arm, each time as another tool keeps them, and people's flights of a hand."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from experiments.adroit.tasks import TASKS
from experiments.foreign import layouts
from experiments.foreign.arm import PERIOD_S, PICTURES, VECTOR, Flown

RATE = round(1 / PERIOD_S)
REACHED = "return:-8"
TASK = "Reach for the point."
ENV, SEEN = f"env=gymnasium:{VECTOR}", f"env=gymnasium:{PICTURES}"
DOOR = TASKS["door"]
PEOPLE = f"{DOOR.name}_human_demos.npz"
GYM = {"env_name": VECTOR, "type": 2, "env_kwargs": {}}  # as robomimic says it of Gym's environments
Flights = Sequence[Flown]


@dataclass(frozen=True, kw_only=True)
class ForeignFile:
    """A file of others.

    Attributes:
        name: for people. form: the format. write: writes it below a folder, and returns it.
        flown: words that its flights need, as the file does not say where. success: rule of the flights.
        pictures: the field of pictures that it is learned from; None for numbers alone.
    """

    name: str
    form: str
    write: Callable[[Path], Path]
    flown: tuple[str, ...] = ()
    success: str = REACHED
    pictures: str | None = None


def of_the_arm(flights: Flights, pictured: Flights) -> list[ForeignFile]:
    """Return the files that hold these flights, and those with pictures if there are any ``pictured`` by a camera."""
    named, typed, seen = {}, {"flown": (ENV,)}, {"flown": (SEEN,)}  # by the file, or by who types
    kinds = [
        ("transitions", "npz", partial(_npz, transitions(flights)), typed),
        ("transitions without ends", "npz", partial(_npz, without_ends(flights)), typed),
        ("D4RL", "D4RL", partial(_d4rl, flights), typed),
        ("robomimic, of its converter", "robomimic", partial(_robomimic, flights), named),
        ("MimicGen", "robomimic", partial(_mimicgen, flights), named),
        ("Minari", "Minari", partial(_minari, flights), named),
        ("LeRobot", "LeRobot v3", partial(_lerobot, flights), typed),
        ("ALOHA", "ALOHA HDF5", partial(_aloha, flights), typed),
        ("robomimic, pictures", "robomimic", partial(_seen, pictured), {**seen, "pictures": "agentview_image"}),
        ("LeRobot, video", "LeRobot v3", partial(_filmed, pictured), {**seen, "pictures": "agentview_rgb"}),
    ]
    files = [ForeignFile(name=name, form=form, write=write, **more) for name, form, write, more in kinds]
    return [file for file in files if pictured or file.pictures is None]


def of_people(data: Path) -> list[ForeignFile]:
    """Return people's flights of ``data`` as D4RL keeps them."""
    where = (f"env=gymnasium:{DOOR.env}",)
    door = partial(_door, data / PEOPLE)
    return [ForeignFile(name="people's door", form="D4RL", write=door, flown=where, success="success:25")]


def transitions(flights: Flights) -> dict[str, np.ndarray]:
    """Return arrays under the names of ``imitation``."""
    return {
        "obs": np.concatenate([flight.obs["observation"][:-1] for flight in flights]),
        "acts": np.concatenate([flight.actions for flight in flights]),
        "next_obs": np.concatenate([flight.obs["observation"][1:] for flight in flights]),
        "rews": np.concatenate([flight.rewards for flight in flights]),
        "dones": np.concatenate([flight.terminated | flight.truncated for flight in flights]),
    }


def without_ends(flights: Flights) -> dict[str, np.ndarray]:
    """Return what a script keeps that does not write down where an episode ends."""
    return {name: values for name, values in transitions(flights).items() if name in ("obs", "acts", "next_obs")}


def _npz(columns: dict[str, np.ndarray], at: Path) -> Path:
    return layouts.npz(at / "rollouts.npz", columns)


def _d4rl(flights: Flights, at: Path) -> Path:
    told = transitions(flights)
    columns = {
        "observations": told["obs"],
        "actions": told["acts"],
        "next_observations": told["next_obs"],
        "rewards": told["rews"],
        "terminals": np.concatenate([flight.terminated for flight in flights]),
        "timeouts": np.concatenate([flight.truncated for flight in flights]),
    }
    return layouts.d4rl(at / "reacher.hdf5", columns)


def robomimic_demo(flight: Flown) -> dict[str, Any]:
    """Return a demonstration as robomimic's ``convert_d4rl.py`` writes it: one field ``flat``, an end of any reason."""
    return {
        "obs": {"flat": flight.obs["observation"][:-1]},
        "next_obs": {"flat": flight.obs["observation"][1:]},
        "actions": flight.actions,
        "rewards": flight.rewards,
        "dones": (flight.terminated | flight.truncated).astype(np.int32),
    }


def _robomimic(flights: Flights, at: Path) -> Path:
    return layouts.robomimic(at / "low_dim.hdf5", *map(robomimic_demo, flights), env=GYM)


def _mimicgen(flights: Flights, at: Path) -> Path:
    """As MimicGen 1.0.1 writes: neither rewards nor ends nor what was seen after an action, but how it came about."""
    demos = [
        {
            "obs": {"flat": flight.obs["observation"][:-1]},
            "actions": flight.actions,
            "states": np.zeros((len(flight.actions), 7)),
            "datagen_info": {"gripper_action": np.zeros((len(flight.actions), 1))},
            "src_demo_inds": np.zeros(2, int),
        }
        for flight in flights
    ]
    return layouts.robomimic(at / "demo.hdf5", *demos, env=GYM)


def _minari(flights: Flights, at: Path) -> Path:
    episodes = [
        {
            "observations": flight.obs["observation"],
            "actions": flight.actions,
            "rewards": flight.rewards,
            "terminations": flight.terminated,
            "truncations": flight.truncated,
        }
        for flight in flights
    ]
    return layouts.minari(at / "reacher-v0", *episodes, env_spec=gymnasium.spec(VECTOR).to_json())


def _lerobot(flights: Flights, at: Path) -> Path:
    episodes = [{"observation.state": f.obs["observation"][:-1], "action": f.actions} for f in flights]
    return layouts.lerobot(at / "lerobot", *episodes, fps=RATE, robot_type="reacher", task=TASK)


def _aloha(flights: Flights, at: Path) -> Path:
    episodes = [{"observations/qpos": f.obs["observation"][:-1], "action": f.actions} for f in flights]
    return layouts.aloha(at / "aloha", *episodes)


def _seen(flights: Flights, at: Path) -> Path:
    demos = [
        {"obs": {name: values[:-1] for name, values in flight.obs.items()}, "actions": flight.actions}
        for flight in flights
    ]
    return layouts.robomimic(at / "image.hdf5", *demos, env={"env_name": "Reacher", "type": 1, "env_kwargs": {}})


def _filmed(flights: Flights, at: Path) -> Path:
    episodes = [
        {
            "observation.state": flight.obs["joints"][:-1],
            "observation.images.agentview": flight.obs["agentview_image"][:-1],
            "action": flight.actions,
        }
        for flight in flights
    ]
    return layouts.lerobot(at / "lerobot_video", *episodes, fps=RATE, robot_type="reacher", task=TASK)


def _door(file: Path, at: Path) -> Path:
    """As D4RL keeps ``door-human``: no episode is terminal, all end by their time."""
    with np.load(file) as arrays:
        names = sorted({name.partition("/")[0] for name in arrays})
        column = lambda kind: np.concatenate([arrays[f"{name}/{kind}"] for name in names])  # noqa: E731
        lengths = [len(arrays[f"{name}/actions"]) for name in names]
        told = {name: column(name) for name in ("observations", "actions", "rewards")}
    ends = np.zeros(sum(lengths), bool)
    ends[np.cumsum(lengths) - 1] = True
    return layouts.d4rl(at / "door_human.hdf5", {**told, "terminals": np.zeros_like(ends), "timeouts": ends})
