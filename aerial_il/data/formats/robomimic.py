"""robomimic's HDF5 layout: derived from recordings without loss, and read back, also when it comes from others.

``data/demo_<i>`` holds ``states``, ``actions``, ``rewards``, ``dones``, ``obs/<field>`` and ``next_obs/<field>``, which
any reader of robomimic files knows; the actions are what is to be learned, the expert's where one was asked. The group
``aerial_il`` beside them keeps what the layout has no place for, what was commanded among it, and is preferred on
import, so that nothing is lost on the way.

A foreign file, without our group, has neither an environment's bounds nor a terminal observation's state. Success is a
last reward above zero; where that holds for no demonstration, nobody has said, and all were meant to be imitated.
What ``dones`` mean, a success or an end for whatever reason, is not said. ``mask/NAME`` lists parts of the dataset.
"""

import json
from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from aerial_il.core.bounded import parse_json
from aerial_il.core.errors import DemoError
from aerial_il.core.specs import UNKNOWN, EnvSpec
from aerial_il.data.episode import Episode
from aerial_il.data.formats.parts.content_digest import content_digest
from aerial_il.data.formats.parts.hdf5 import FAULTS, array, child, holds, later, numbered, opened
from aerial_il.data.formats.parts.whole import replacing, require_room
from aerial_il.data.source import Later, Raw, Source, Wanted

ENDINGS, OWN_NAME = (".hdf5", ".h5"), "robomimic.hdf5"
PRIVATE = "aerial_il"
COLUMNS = ("states", "actions", "rewards", "dones")
EXTRA = (
    ["executed_actions", "expert_actions", "is_intervention", "phase", "terminated", "truncated", "ctrl", "sim_time"]
)  # fmt: skip
GYM = 2  # robomimic's number for environments of Gym
RENDERED = "robomimic adds them: python -m robomimic.scripts.dataset_states_to_obs --dataset FILE --output_name OUT"
DIGEST = "digest"  # attribute of our group


def recognises(path: Path) -> bool:
    return holds(path, "data") and (holds(path, "data/*/actions") or not holds(path, "data/*"))


def read(path: Path, wanted: Wanted) -> Source:
    with opened(path, "cannot be read as HDF5") as file:
        group = child(path, file, "data", h5py.Group)
        demos = {name: child(path, group, name, h5py.Group) for name in numbered(group)}
        names = {str(demo.attrs.get("uid", name)): name for name, demo in demos.items()}
        if len(names) < len(demos):
            raise DemoError(
                path, f"names {len(demos) - len(names)} of its {len(demos)} demonstrations as others by uid."
            )
        ours = {uid for uid, name in names.items() if PRIVATE in demos[name]}
        robot, task, control_dt_s = _named(_env_args(group))
        filters = dict(_masks(path, file, {name: uid for uid, name in names.items()}))
    return Source(
        path=path,
        kind="a robomimic file",
        recorded={uid: partial(_recorded, path, name) for uid, name in names.items() if uid in ours},
        raw={uid: partial(_raw, path, name) for uid, name in names.items() if uid not in ours},
        robot=robot,
        task=task,
        control_dt_s=control_dt_s,
        filters=filters,
    )


def write(episodes: Iterable[Episode], out: Path, *, env_spec: str | None = None) -> Path:
    """Write episodes of one environment as one file."""
    with replacing(out) as temporary, h5py.File(temporary, "w") as file:
        data, total = file.create_group("data"), 0
        for i, episode in enumerate(episodes):
            require_room(temporary, 3 * episode.nbytes)
            _write(data.create_group(f"demo_{i}"), episode)
            total += len(episode)
            if i == 0:
                spec = episode.spec
                names = {"env_name": f"{spec.robot}/{spec.task}", "type": PRIVATE, "env_kwargs": {"tier": spec.tier}}
                data.attrs["env_args"] = json.dumps(names)
        data.attrs["total"] = total
    return out


def _write(demo: h5py.Group, episode: Episode) -> None:
    demo.attrs.update(num_samples=len(episode), model_file=episode.model_xml, uid=episode.uid)
    dones = np.zeros(len(episode), np.int64)
    dones[-1] = 1
    columns = (episode.states[:-1], episode.labels, episode.rewards, dones)
    for name, values in zip(COLUMNS, columns, strict=True):
        demo[name] = values
    for name, values in episode.obs.items():
        demo[f"obs/{name}"], demo[f"next_obs/{name}"] = values[:-1], values[1:]
    private = demo.create_group(PRIVATE)
    private.attrs.update(success=episode.success, provenance=json.dumps(dict(episode.provenance)))
    private.attrs["spec"] = json.dumps(episode.spec.to_dict())
    private["final_state"] = episode.states[-1]
    for name in ("actions", *EXTRA):
        private[name] = getattr(episode, name)
    private.attrs[DIGEST] = content_digest(episode)


def _masks(path: Path, file: h5py.File, uids: Mapping[str, str]) -> Iterator[tuple[str, list[str]]]:
    """Yield the parts of a dataset that it names, by the uids of their demonstrations."""
    if "mask" in file:
        masks = child(path, file, "mask", h5py.Group)
        for name in map(str, masks):
            listed = np.ravel(child(path, masks, name, h5py.Dataset)[()])
            yield name, [uids[each] for each in (_text(word) for word in listed) if each in uids]


def _text(word: object) -> str:
    return word.decode(errors="replace") if isinstance(word, bytes) else str(word)


def _env_args(data: h5py.Group) -> dict[str, Any]:
    """Return what a file says of its environment; names in it are only ever compared with lists."""
    try:
        said = parse_json(data.attrs.get("env_args", "{}"))
    except FAULTS:
        return {}
    return said if isinstance(said, dict) else {}


def _named(env: Mapping[str, Any]) -> tuple[str, str, float | None]:
    """Return robot, task and control period (s) as ``env_args`` tell them; robosuite's say the rate."""
    kwargs = env.get("env_kwargs") or {}
    rate, name = kwargs.get("control_freq") if isinstance(kwargs, dict) else None, str(env.get("env_name", UNKNOWN))
    period = 1 / rate if isinstance(rate, (int, float)) and 0 < rate < 1e6 else None
    if env.get("type") == GYM:
        return "gymnasium", name, period
    robots = kwargs.get("robots", UNKNOWN) if isinstance(kwargs, dict) else UNKNOWN
    return str(robots[0] if isinstance(robots, list) and robots else robots), name, period


def _recorded(path: Path, name: str) -> Episode:
    with opened(path, f"holds a malformed demonstration {name!r}") as file:
        demo = _demo(path, file, name)
        private = child(path, demo, PRIVATE, h5py.Group)
        spec = parse_json(private.attrs["spec"])
        kept: dict[str, Any] = {name: array(path, private, name) for name in EXTRA}
        labels = array(path, demo, "actions")
        episode = Episode(
            uid=str(demo.attrs["uid"]),
            spec=EnvSpec.from_dict(spec),
            provenance=parse_json(private.attrs["provenance"]),
            obs=_recorded_obs(path, demo),
            actions=array(path, private, "actions") if "actions" in private else labels,
            rewards=array(path, demo, "rewards"),
            states=np.concatenate([array(path, demo, "states"), array(path, private, "final_state")[None]]),
            success=bool(private.attrs["success"]),
            model_xml=str(demo.attrs["model_file"]),
            **kept,
        )
        taught = "actions" not in private or np.array_equal(labels, episode.labels)
        if not taught or private.attrs.get(DIGEST) != content_digest(episode, spec):
            raise DemoError(path, f"was changed after it was written: the digest of {demo.name} differs.")
        return episode


def _raw(path: Path, name: str) -> Raw:
    with opened(path, f"holds a malformed demonstration {name!r}") as file:
        demo = _demo(path, file, name)
        held = {name: later(path, demo, name) for name in COLUMNS if name in demo}
        if "obs" not in demo and "states" in demo:
            raise DemoError(path, f"holds no observations in {demo.name}, only states of a simulator.", hint=RENDERED)
        last = held["rewards"][-1:].read().ravel() if "rewards" in held else np.zeros(0)
        return Raw(
            obs=_fields(path, demo, "obs"),
            next_obs=_fields(path, demo, "next_obs") if "next_obs" in demo else {},
            actions=held["actions"] if "actions" in held else later(path, demo, "actions"),
            rewards=held.get("rewards"),
            done=held.get("dones"),
            states=held.get("states"),
            success=True if last.size and last[-1] > 0 else None,
            steps=_count(demo.attrs.get("num_samples")),
            model_xml=str(demo.attrs.get("model_file", "")),
        )


def _count(said: object) -> int | None:
    return int(said) if isinstance(said, (int, np.integer)) else None


def _demo(path: Path, file: h5py.File, name: str) -> h5py.Group:
    return child(path, child(path, file, "data", h5py.Group), name, h5py.Group)


def _fields(path: Path, demo: h5py.Group, name: str) -> dict[str, Later]:
    group = child(path, demo, name, h5py.Group)
    return {str(field): later(path, group, str(field)) for field in group}


def _recorded_obs(path: Path, demo: h5py.Group) -> dict[str, np.ndarray]:
    """Return (T + 1, ...) observations: those before each action, and the one after the last."""
    seen, after = _fields(path, demo, "obs"), _fields(path, demo, "next_obs")
    return {name: np.concatenate([values.read(), after[name][-1:].read()]) for name, values in seen.items()}
