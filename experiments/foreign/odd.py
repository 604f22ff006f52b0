"""Files with one thing wrong or unusual, made of a few flights, and kinds of files that nothing here reads."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from experiments.foreign import layouts
from experiments.foreign.files import GYM, Flights, robomimic_demo, transitions

Write = Callable[[Path], Path]
Demo = dict[str, Any]


def odd_files(flights: Flights) -> tuple[Write, dict[str, Write]]:
    """Return what writes a sound file below a folder, and returns it; and what is odd -> what writes such a file."""
    demos = [robomimic_demo(flight) for flight in flights]
    seen, steps, columns = demos[0]["obs"]["flat"], len(flights[0].actions), transitions(flights)
    pierced = np.where(np.arange(seen.size).reshape(seen.shape) == 123, np.nan, seen)
    whole = [demo | {"obs": demo["obs"] | {"depth": np.ones((steps, 84, 84, 1), np.float32)}} for demo in demos]
    bare = [{"states": np.zeros((steps, 9)), "actions": demo["actions"]} for demo in demos]
    scored = [demo | {"rewards": np.eye(steps)[-1] * (i > 0)} for i, demo in enumerate(demos)]
    changed = lambda **changes: partial(_robomimic, [demos[0] | changes, *demos[1:]])  # noqa: E731
    none = {"obs": {"flat": seen[:0]}, "actions": np.zeros((0, 2))}
    return partial(_robomimic, demos), {
        "an episode without steps": partial(_robomimic, [*demos, none]),
        "observations three rows short": changed(obs={"flat": seen[:-3]}),
        "rewards one row short": changed(rewards=np.zeros(steps - 1)),
        "a value that is not a number": changed(obs={"flat": pierced}),
        "other columns in one episode": changed(obs={"flat": seen[:, :4]}, next_obs={}),
        "a field of one episode alone": changed(obs={"flat": seen, "more": np.ones((steps, 2))}),
        "one episode in another unit": changed(actions=1000 * demos[0]["actions"]),
        "a failure among successes": partial(_robomimic, scored),
        "depth as floats": partial(_robomimic, whole),
        "robosuite's raw recording, states alone": partial(_robomimic, bare),
        "actions that are choices": partial(_npz, columns | {"acts": np.zeros(len(columns["acts"]), int)}),
        "no actions": partial(_npz, {"obs": columns["obs"]}),
        "an npz with arrays for each episode": partial(_npz, {f"ep0/{name}": each for name, each in columns.items()}),
        "pickled objects in an npz": partial(_npz, columns | {"obs": np.array([{}] * 9)}),
        "LeRobot v2.1": partial(_texts, "lerobot", {"meta/info.json": json.dumps({"codebase_version": "v2.1"})}),
        "RLDS": partial(_texts, "rlds", {"features.json": "{}", "rlds-train.tfrecord-00000-of-00001": ""}),
        "Diffusion Policy's zarr": partial(_texts, "replay.zarr", {".zgroup": "{}", "data/action/.zarray": "{}"}),
        "a pickle": partial(_texts, "demos.pkl", {"": "x"}),
        "a table as CSV": partial(_texts, "demos.csv", {"": "x,y\n1,2\n"}),
    }  # fmt: skip


def _robomimic(demos: list[Demo], at: Path) -> Path:
    return layouts.robomimic(at / "demo.hdf5", *demos, env=GYM)


def _npz(columns: dict[str, np.ndarray], at: Path) -> Path:
    return layouts.npz(at / "rollouts.npz", columns)


def _texts(name: str, files: dict[str, str], at: Path) -> Path:
    """Write files below a folder of that name, or the one file of no name in its place."""
    for inner, text in files.items():
        file = at / name / inner
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    return at / name
