"""Whether a change of the code leaves flights and trainings as they were, bit for bit.

``python -m tests.unchanged measure OUT.json`` flies every cell, tier and action level and trains every algorithm and
policy class for 200 steps; run it in both checkouts. ``python -m tests.unchanged compare A.json B.json`` prints what
differs, and exits with 1 if anything does. A measurement that was stopped goes on.
"""

import hashlib
import json
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

CAMERAS = ("wrist_rgb", "base_rgb")
SEEDS, STEPS, TRAINING_STEPS = np.array([900_000, 900_001, 900_002]), 60, 200


def digest(parts: Iterator[np.ndarray]) -> str:
    """Return one digest of many arrays, in their order."""
    found = hashlib.sha256()
    for part in parts:
        found.update(np.ascontiguousarray(part).tobytes())
    return found.hexdigest()[:24]


def flown(robot: str, task: str, tier: str, level: str) -> Iterator[np.ndarray]:
    """Yield what three worlds show in ``STEPS`` steps: the expert's at ee_pose, else random actions."""
    import aerial_il

    env = aerial_il.load_batch(robot, task, num_envs=3, tier=tier, action=level, num_threads=1)
    obs, rng = env.reset(SEEDS), np.random.default_rng(0)
    expert = aerial_il.expert(robot, task) if level == "ee_pose" else None
    if expert is not None:
        expert.attach(env)
        expert.reset()
    for _ in range(STEPS):
        spec = env.spec.action
        actions = rng.uniform(spec.low, spec.high, (3, spec.size)) if expert is None else expert.act(obs)
        result = env.step(actions)
        obs = result.obs
        yield from (obs[name] for name in sorted(obs))
        yield result.reward
        yield from (result.info[name] for name in ("success", "crash"))
    for world in range(3):
        yield env.data(world).qpos.copy()
    env.close()


def flights() -> Iterator[tuple[str, Any]]:
    """Yield a name, and what computes the digest, for every cell, tier and action level."""
    import aerial_il
    from tests.contract.registered import TIERS, levels

    for robot, task in aerial_il.list_cells():
        for tier in TIERS:
            yield (
                f"flight/{robot}/{task}/{tier}/ee_pose",
                lambda r=robot, t=task, i=tier: digest(flown(r, t, i, "ee_pose")),
            )
        for level in levels(robot)[1:]:
            name = f"flight/{robot}/{task}/hard/{level}"
            yield name, lambda r=robot, t=task, a=level: digest(flown(r, t, "hard", a))


def filmed(count: int) -> Iterator[Any]:
    """Yield demonstrations with two cameras, whose pictures are noise."""
    from aerial_il.core.specs import Field, ObservationSpec
    from tests.algorithms.point_mass import demonstrations

    rng, shape = np.random.default_rng(5), (24, 20, 3)
    cameras = tuple(Field(name, shape, "image", dtype="uint8") for name in CAMERAS)
    for demo in demonstrations(count):
        fields = tuple(field for field in demo.spec.observation.fields if field.group != "image")
        obs = {field.name: demo.obs[field.name] for field in fields}
        obs |= {name: rng.integers(0, 256, (len(demo) + 1, *shape), np.uint8) for name in CAMERAS}
        yield replace(demo, spec=replace(demo.spec, observation=ObservationSpec((*fields, *cameras))), obs=obs)


def trainings() -> Iterator[tuple[str, Any]]:
    """Yield a name, and what computes the digest, for every algorithm and policy class."""
    import torch

    from aerial_il import policies
    from tests.contract import test_algorithms
    from tests.policies.test_contract import config

    torch.set_num_threads(1)

    def weights(run: Path) -> str:
        from safetensors.numpy import load_file

        arrays = load_file(run / "policy" / "arrays.safetensors")
        return digest(arrays[name] for name in sorted(arrays))

    def algorithm(name: str) -> str:
        with tempfile.TemporaryDirectory() as folder:
            test_algorithms.train(test_algorithms.short(name, TRAINING_STEPS), Path(folder) / "run")
            return weights(Path(folder) / "run")

    def policy(name: str) -> str:
        from tests.algorithms.point_mass import demonstrations

        settings = test_algorithms.short("bc", TRAINING_STEPS)
        with tempfile.TemporaryDirectory() as folder:
            settings.train(
                demonstrations(8), replace(config(name), history=2, chunk=4), run=Path(folder) / "run", seed=3,
                progress=False,
            )  # fmt: skip
            return weights(Path(folder) / "run")

    def seeing(name: str, changes: dict[str, Any]) -> str:
        small = {"history": 2, "chunk": 4, "images": CAMERAS, "image_features": 8}
        settings = replace(test_algorithms.short("bc", TRAINING_STEPS), **changes)
        with tempfile.TemporaryDirectory() as folder:
            settings.train(
                filmed(8), replace(config(name), **small), run=Path(folder) / "run", seed=3, progress=False
            )  # fmt: skip
            return weights(Path(folder) / "run")

    for name in test_algorithms.NAMES:
        yield f"algorithm/{name}", lambda n=name: algorithm(n)
    for name in policies.names():
        yield f"policy/{name}", lambda n=name: policy(n)
    for name, changes in (("mlp", {}), ("act", {}), ("gmm", {"obs_noise": 0.1, "field_dropout": 0.5})):
        yield f"image/{name}", lambda n=name, c=changes: seeing(n, c)


def measure(out: Path, only: str = "") -> None:
    """Write ``name -> digest``; what is there is not computed again."""
    found = json.loads(out.read_text()) if out.exists() else {}
    for source in (trainings, flights):
        for name, compute in source():
            if name in found or not name.startswith(only):
                continue
            try:
                found[name] = compute()
            except Exception as error:  # what cannot be computed differs, too
                found[name] = f"{type(error).__name__}: {error}"
            out.write_text(json.dumps(found, indent=1))
            print(name, found[name], flush=True)


def compare(before: Path, after: Path) -> int:
    """Print what differs, and return how much does."""
    old, new = (json.loads(path.read_text()) for path in (before, after))
    differing = [name for name in sorted(old.keys() & new.keys()) if old[name] != new[name]]
    for name in differing:
        print(f"differs: {name}\n  {old[name]}\n  {new[name]}")
    for name in sorted(old.keys() ^ new.keys()):
        print(f"only {'before' if name in old else 'after'}: {name}")
    print(f"{len(old.keys() & new.keys()) - len(differing)} equal, {len(differing)} differ")
    return len(differing)


if __name__ == "__main__":
    if sys.argv[1] == "measure":
        measure(Path(sys.argv[2]), *sys.argv[3:4])
    else:
        sys.exit(1 if compare(Path(sys.argv[2]), Path(sys.argv[3])) else 0)
