"""robomimic's HDF5 layout: derived from recordings without loss, and read back, also when it comes from others.

``data/demo_<i>`` holds ``states``, ``actions``, ``rewards``, ``dones``, ``obs/<field>`` and ``next_obs/<field>``, which
any reader of robomimic files knows. The group ``aerial_il`` beside them keeps what the layout has no place for, and is
preferred on import, so that nothing is lost on the way.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from aerial_il.core.bounded import MAX_UNPACKED_BYTES, parse_json
from aerial_il.core.errors import AerialError, DemoError
from aerial_il.core.files import sync_folder
from aerial_il.core.specs import UNKNOWN, EnvSpec
from aerial_il.data.episode import Episode
from aerial_il.data.formats import transitions
from aerial_il.data.formats.content_digest import content_digest
from aerial_il.data.formats.foreign import foreign_episode, foreign_spec
from aerial_il.data.formats.hdf5_probe import require_readable
from aerial_il.data.recording.writer import storing

PRIVATE = "aerial_il"
COLUMNS = ("states", "actions", "rewards", "dones")
EXTRA = (
    ["executed_actions", "expert_actions", "is_intervention", "phase", "terminated", "truncated", "ctrl", "sim_time"]
)  # fmt: skip
GYM = 2  # robomimic's number for environments of Gym
DIGEST = "digest"  # attribute of our group; files of earlier versions have none
MAX_BYTES = 160 << 20  # of one demonstration; what is not stored, HDF5 would fill in

FAULTS = (
    OSError,
    LookupError,
    ArithmeticError,
    RuntimeError,
    ValueError,
    TypeError,
    AttributeError,
    MemoryError,
    AerialError,
)


def convert_to_hdf5(episodes: Sequence[Episode], out: str | os.PathLike[str]) -> Path:
    """Write episodes of one environment as one robomimic file, which appears whole or not at all.

    Raises:
        StorageError: the disk is full or the folder not writable.
    """
    out = Path(out)
    temporary = out.with_name(f".{out.name}.{os.getpid()}.tmp")
    try:
        with storing(out):
            out.parent.mkdir(parents=True, exist_ok=True)
            with h5py.File(temporary, "w") as file:
                _write(file, episodes)
            os.replace(temporary, out)
            sync_folder(out.parent)
    finally:
        temporary.unlink(missing_ok=True)
    return out


def open_hdf5(path: Path) -> dict[str, Callable[[], Episode]]:
    """Return uid -> function that reads the episode from a file of robomimic's layout, or of D4RL's.

    A foreign file, without our group, has neither an environment's bounds nor a terminal observation's state: bounds
    are those seen in the whole file. Success is a last reward or ``done`` above zero; where that holds for no
    demonstration, nobody has said, and all were meant to be imitated.

    Raises:
        DemoError: it is no such file, or refers to data outside itself.
    """
    require_readable(path)
    try:
        with h5py.File(path, "r") as file:
            if "data" not in file and "actions" in file:
                return transitions.episodes_of(path, _flat(path, file))
            group = child(path, file, "data", h5py.Group)
            names = sorted(group, key=lambda name: (len(name), name))  # demo_10 comes after demo_9
            uids = [str(child(path, group, name, h5py.Group).attrs.get("uid", name)) for name in names]
    except DemoError:
        raise
    except FAULTS as error:
        raise DemoError(path, f"cannot be read as HDF5 ({error}).") from error
    if not names:
        raise DemoError(path, "holds no demonstrations.")
    whole = cache(lambda: _survey(path, names))
    return {uid: lambda name=name: _read(path, name, whole) for uid, name in zip(uids, names, strict=True)}


def _flat(path: Path, file: h5py.File) -> dict[str, np.ndarray]:
    """Return the arrays of a file of D4RL's that are used, after checking what they take together."""
    known = [name for names in transitions.NAMES.values() for name in names if name in file]
    size = sum(8 * child(path, file, name, h5py.Dataset).size for name in known)  # as float64
    if size > MAX_UNPACKED_BYTES:
        raise DemoError(path, "is too large.", expected=f"at most {MAX_UNPACKED_BYTES} bytes", got=size)
    return {name: array(path, file, name) for name in known}


@dataclass(frozen=True)
class _Survey:
    """What all demonstrations of a foreign file have in common.

    Attributes:
        bounds: least and greatest action (Da,). max_steps: of the longest. env: what ``env_args`` says of it.
        judged: whether any is marked as a success.
    """

    bounds: tuple[np.ndarray, np.ndarray]
    max_steps: int
    env: Mapping[str, Any]
    judged: bool


def _survey(path: Path, names: Sequence[str]) -> _Survey:
    with h5py.File(path, "r") as file:
        data = child(path, file, "data", h5py.Group)
        lows, highs, steps, judged = [], [], 0, False
        for name in names:
            demo = child(path, data, name, h5py.Group)
            if PRIVATE in demo:
                continue
            _check_size(path, demo)
            actions = array(path, demo, "actions").astype(float)
            lows.append(actions.min(0))
            highs.append(actions.max(0))
            steps, judged = max(steps, len(actions)), judged or _marked(path, demo)
        return _Survey((np.min(lows, 0), np.max(highs, 0)), steps, _env_args(data), judged)


def _env_args(data: h5py.Group) -> dict[str, Any]:
    """Return what a file says of its environment; names in it are only ever compared with lists."""
    try:
        said = parse_json(data.attrs.get("env_args", "{}"))
    except FAULTS:
        return {}
    return said if isinstance(said, dict) else {}


def _marked(path: Path, demo: h5py.Group) -> bool:
    """Whether a foreign demonstration ends with a reward, or as done."""
    ends = (array(path, demo, name, last=True) for name in ("rewards", "dones") if name in demo)
    return any(bool(end.size and end.ravel()[-1] > 0) for end in ends)


def _write(file: h5py.File, episodes: Sequence[Episode]) -> None:
    data = file.create_group("data")
    spec = episodes[0].spec
    data.attrs["total"] = sum(map(len, episodes))
    names = {"env_name": f"{spec.robot}/{spec.task}", "type": "aerial_il", "env_kwargs": {"tier": spec.tier}}
    data.attrs["env_args"] = json.dumps(names)
    for i, episode in enumerate(episodes):
        demo = data.create_group(f"demo_{i}")
        demo.attrs.update(num_samples=len(episode), model_file=episode.model_xml, uid=episode.uid)
        dones = np.zeros(len(episode), np.int64)
        dones[-1] = 1
        columns = {
            "states": episode.states[:-1],
            "actions": episode.actions,
            "rewards": episode.rewards,
            "dones": dones,
        }
        for name, values in columns.items():
            demo[name] = values
        for name, values in episode.obs.items():
            demo[f"obs/{name}"], demo[f"next_obs/{name}"] = values[:-1], values[1:]
        private = demo.create_group(PRIVATE)
        private.attrs.update(success=episode.success, provenance=json.dumps(dict(episode.provenance)))
        private.attrs["spec"] = json.dumps(episode.spec.to_dict())
        private["final_state"] = episode.states[-1]
        for name in EXTRA:
            private[name] = getattr(episode, name)
        private.attrs[DIGEST] = content_digest(episode)


def _read(path: Path, name: str, whole: Callable[[], _Survey]) -> Episode:
    try:
        with h5py.File(path, "r") as file:
            demo = child(path, child(path, file, "data", h5py.Group), name, h5py.Group)
            _check_size(path, demo)
            return _ours(path, demo) if PRIVATE in demo else _foreign(path, demo, name, whole())
    except DemoError:
        raise
    except FAULTS as error:
        raise DemoError(path, f"holds a malformed demonstration {name!r} ({error}).") from error


def _ours(path: Path, demo: h5py.Group) -> Episode:
    private = child(path, demo, PRIVATE, h5py.Group)
    spec = EnvSpec.from_dict(parse_json(private.attrs["spec"]))
    states = np.concatenate([array(path, demo, "states"), array(path, private, "final_state")[None]])
    kept: dict[str, Any] = {name: array(path, private, name) for name in EXTRA}
    episode = Episode(
        uid=str(demo.attrs["uid"]),
        spec=spec,
        provenance=parse_json(private.attrs["provenance"]),
        obs=_observations(path, demo),
        actions=array(path, demo, "actions"),
        rewards=array(path, demo, "rewards"),
        states=states,
        success=bool(private.attrs["success"]),
        model_xml=str(demo.attrs["model_file"]),
        **kept,
    )
    if DIGEST in private.attrs and private.attrs[DIGEST] != content_digest(episode):
        raise DemoError(path, f"was changed after it was written: the digest of {demo.name} differs.")
    return episode


def _foreign(path: Path, demo: h5py.Group, name: str, whole: _Survey) -> Episode:
    actions = array(path, demo, "actions").astype(float)
    obs = {name: v if v.dtype == np.uint8 else v.astype(float) for name, v in _observations(path, demo).items()}
    states = array(path, demo, "states") if "states" in demo else np.zeros((len(actions), 0))
    robot, task, control_dt_s = _named(whole.env)
    spec = foreign_spec(
        obs,
        whole.bounds,
        max_steps=whole.max_steps,
        control_dt_s=control_dt_s,
        robot=robot,
        task=task,
        state_size=states.shape[1],
    )
    return foreign_episode(
        name,
        spec,
        obs=obs,
        actions=actions,
        rewards=array(path, demo, "rewards") if "rewards" in demo else None,
        states=np.concatenate([states, states[-1:]]),
        success=_marked(path, demo) or not whole.judged,
        model_xml=str(demo.attrs.get("model_file", "")),
        source=f"{path.name}, a robomimic file",
    )


def _named(env: Mapping[str, Any]) -> tuple[str, str, float]:
    """Return robot, task and control period (s) as ``env_args`` tell them; robosuite's say the rate."""
    kwargs = env.get("env_kwargs") or {}
    rate, name = kwargs.get("control_freq") if isinstance(kwargs, dict) else None, str(env.get("env_name", UNKNOWN))
    period = 1 / rate if isinstance(rate, (int, float)) and 0 < rate < 1e6 else 1.0
    if env.get("type") == GYM:
        return "gymnasium", name, period
    robots = kwargs.get("robots", UNKNOWN) if isinstance(kwargs, dict) else UNKNOWN
    return str(robots[0] if isinstance(robots, list) and robots else robots), name, period


def _observations(path: Path, demo: h5py.Group) -> dict[str, np.ndarray]:
    """Return (T + 1, ...) observations; without ``next_obs`` the last one stands in for the terminal one."""
    now = child(path, demo, "obs", h5py.Group)
    later = child(path, demo, "next_obs", h5py.Group) if "next_obs" in demo else now
    return {name: np.concatenate([array(path, now, name), array(path, later, name, last=True)]) for name in now}


def array(path: Path, group: h5py.Group, name: str, *, last: bool = False) -> np.ndarray:
    """Return a dataset (T, ...), or of it the ``last`` row alone."""
    dataset = child(path, group, name, h5py.Dataset)
    if dataset.dtype.kind not in "biuf" or dataset.shape is None or not dataset.shape:
        raise DemoError(path, f"has no rows of numbers in {dataset.name}.", got=(dataset.dtype, dataset.shape))
    return dataset[-1:] if last else dataset[()]


def _check_size(path: Path, demo: h5py.Group) -> None:
    """Require that all datasets of a demonstration together can be held, before one of them is read."""
    groups = [child(path, demo, name, h5py.Group) for name in ("obs", "next_obs", PRIVATE) if name in demo]
    names = [
        (group, name) for group in (demo, *groups) for name in map(str, group) if group is not demo or name in COLUMNS
    ]
    size = sum(child.size * child.dtype.itemsize for child in (child(path, *each, h5py.Dataset) for each in names))
    if size > MAX_BYTES:
        problem = f"has an absurdly large demonstration {demo.name}."
        raise DemoError(path, problem, expected=f"at most {MAX_BYTES} bytes", got=size)


def child(path: Path, group: h5py.Group, name: str, kind: type) -> Any:
    """Return a child that lies in the file itself and is no larger than it may be."""
    link = group.get(name, getlink=True)
    if link is None:
        raise DemoError(path, f"lacks {group.name}/{name}.", got=sorted(group))
    if not isinstance(link, h5py.HardLink):
        raise DemoError(path, f"refers to a place outside itself: {group.name}/{name}.")
    child = group[name]
    if not isinstance(child, kind):
        raise DemoError(path, f"has no {kind.__name__.lower()} {child.name}.")
    if isinstance(child, h5py.Dataset) and (child.external or child.is_virtual):
        raise DemoError(path, f"refers to a place outside itself: {child.name}.")
    return child
