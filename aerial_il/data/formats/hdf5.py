"""robomimic's HDF5 layout: derived from recordings without loss, and read back, also when it comes from others.

``data/demo_<i>`` holds ``states``, ``actions``, ``rewards``, ``dones``, ``obs/<field>`` and ``next_obs/<field>``, which
any reader of robomimic files knows. The group ``aerial_il`` beside them keeps what the layout has no place for, and is
preferred on import, so that nothing is lost on the way.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from aerial_il.core.bounded import parse_json
from aerial_il.core.errors import AerialError, DemoError
from aerial_il.core.files import sync_folder
from aerial_il.core.specs import ActionSpec, EnvSpec, Field, ObservationSpec
from aerial_il.data.episode import Episode
from aerial_il.data.formats.content_digest import content_digest
from aerial_il.data.recording.writer import storing

PRIVATE = "aerial_il"
COLUMNS = ("states", "actions", "rewards", "dones")
EXTRA = (
    ["executed_actions", "expert_actions", "is_intervention", "phase", "terminated", "truncated", "ctrl", "sim_time"]
)  # fmt: skip
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
    """Return uid -> function that reads the episode from a robomimic file.

    A foreign file, without our group, has neither an environment's bounds nor a terminal observation's state: bounds
    are those seen, success is a last reward or ``done`` above zero.

    Raises:
        DemoError: it is no such file, or refers to data outside itself.
    """
    try:
        with h5py.File(path, "r") as file:
            group = _child(path, file, "data", h5py.Group)
            names = sorted(group, key=lambda name: (len(name), name))  # demo_10 comes after demo_9
            uids = [str(_child(path, group, name, h5py.Group).attrs.get("uid", name)) for name in names]
    except FAULTS as error:
        raise DemoError(path, f"cannot be read as HDF5 ({error}).") from error
    if not names:
        raise DemoError(path, "holds no demonstrations.")
    return {uid: lambda name=name: _read(path, name) for uid, name in zip(uids, names, strict=True)}


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


def _read(path: Path, name: str) -> Episode:
    try:
        with h5py.File(path, "r") as file:
            demo = _child(path, _child(path, file, "data", h5py.Group), name, h5py.Group)
            _check_size(path, demo)
            return _ours(path, demo) if PRIVATE in demo else _foreign(path, demo, name)
    except DemoError:
        raise
    except FAULTS as error:
        raise DemoError(path, f"holds a malformed demonstration {name!r} ({error}).") from error


def _ours(path: Path, demo: h5py.Group) -> Episode:
    private = _child(path, demo, PRIVATE, h5py.Group)
    spec = EnvSpec.from_dict(parse_json(private.attrs["spec"]))
    states = np.concatenate([_array(path, demo, "states"), _array(path, private, "final_state")[None]])
    kept: dict[str, Any] = {name: _array(path, private, name) for name in EXTRA}
    episode = Episode(
        uid=str(demo.attrs["uid"]),
        spec=spec,
        provenance=parse_json(private.attrs["provenance"]),
        obs=_observations(path, demo),
        actions=_array(path, demo, "actions"),
        rewards=_array(path, demo, "rewards"),
        states=states,
        success=bool(private.attrs["success"]),
        model_xml=str(demo.attrs["model_file"]),
        **kept,
    )
    if DIGEST in private.attrs and private.attrs[DIGEST] != content_digest(episode):
        raise DemoError(path, f"was changed after it was written: the digest of {demo.name} differs.")
    return episode


def _foreign(path: Path, demo: h5py.Group, name: str) -> Episode:
    actions, obs = _array(path, demo, "actions").astype(float), _observations(path, demo)
    steps = len(actions)
    rewards = _array(path, demo, "rewards") if "rewards" in demo else np.zeros(steps)
    states = _array(path, demo, "states") if "states" in demo else np.zeros((steps, 0))
    none = np.zeros(steps, bool)
    return Episode(
        uid=name,
        spec=_foreign_spec(actions, obs, states.shape[1]),
        provenance={"policy": "unknown", "note": f"read from {path.name}, a robomimic file"},
        obs=obs,
        actions=actions,
        executed_actions=actions,
        expert_actions=np.full_like(actions, np.nan),
        is_intervention=none,
        phase=np.full(steps, -1),
        rewards=rewards,
        terminated=none,
        truncated=none,
        states=np.concatenate([states, states[-1:]]),
        ctrl=np.zeros((steps, 0)),
        sim_time=np.arange(steps + 1, dtype=float),
        success=bool(rewards[-1] > 0 or ("dones" in demo and _array(path, demo, "dones")[-1])),
        model_xml=str(demo.attrs.get("model_file", "")),
    )


def _foreign_spec(actions: np.ndarray, obs: dict[str, np.ndarray], state_size: int) -> EnvSpec:
    images = {name for name, values in obs.items() if values.dtype == np.uint8 and values.ndim == 4}
    fields = [
        Field(name, values.shape[1:], "image" if name in images else "proprio", str(values.dtype))
        for name, values in obs.items()
    ]
    labels = tuple(map(str, range(actions.shape[1])))
    low, high = actions.min(0) - 1e-6, actions.max(0) + 1e-6
    return EnvSpec(
        robot="unknown",
        task="unknown",
        tier="unknown",
        observation=ObservationSpec(tuple(fields)),
        action=ActionSpec("unknown", labels, ("",) * len(labels), low, high),
        control_dt_s=1.0,
        max_steps=len(actions),
        instruction="",
        subtasks=(),
        state_size=state_size,
    )


def _observations(path: Path, demo: h5py.Group) -> dict[str, np.ndarray]:
    """Return (T + 1, ...) observations; without ``next_obs`` the last one stands in for the terminal one."""
    now = _child(path, demo, "obs", h5py.Group)
    later = _child(path, demo, "next_obs", h5py.Group) if "next_obs" in demo else now
    return {name: np.concatenate([_array(path, now, name), _array(path, later, name, last=True)]) for name in now}


def _array(path: Path, group: h5py.Group, name: str, *, last: bool = False) -> np.ndarray:
    """Return a dataset (T, ...), or of it the ``last`` row alone."""
    dataset = _child(path, group, name, h5py.Dataset)
    if dataset.dtype.kind not in "biuf" or dataset.shape is None or not dataset.shape:
        raise DemoError(path, f"has no rows of numbers in {dataset.name}.", got=(dataset.dtype, dataset.shape))
    return dataset[-1:] if last else dataset[()]


def _check_size(path: Path, demo: h5py.Group) -> None:
    """Require that all datasets of a demonstration together can be held, before one of them is read."""
    groups = [_child(path, demo, name, h5py.Group) for name in ("obs", "next_obs", PRIVATE) if name in demo]
    names = [
        (group, name) for group in (demo, *groups) for name in map(str, group) if group is not demo or name in COLUMNS
    ]
    size = sum(child.size * child.dtype.itemsize for child in (_child(path, *each, h5py.Dataset) for each in names))
    if size > MAX_BYTES:
        problem = f"has an absurdly large demonstration {demo.name}."
        raise DemoError(path, problem, expected=f"at most {MAX_BYTES} bytes", got=size)


def _child(path: Path, group: h5py.Group, name: str, kind: type) -> Any:
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
