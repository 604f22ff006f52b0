"""Small recorded datasets: cranes flown by an expert that sometimes dives, and by a person's name."""

import shutil
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path

import pytest

from aerial_il.collection.collect import collect
from tests.data.crane import CraneBatch, CraneExpert

Recorded = Callable[..., Path]
QUIET = "progress=false"


@pytest.fixture(scope="session")
def cranes(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """Return a function that flies a dataset once: the seeds, who flies, and other things of the environment."""
    home = tmp_path_factory.mktemp("cranes")

    def record(first: int, count: int, policy: str = "expert", *, noise: float = 0.0, max_steps: int = 120) -> Path:
        out = home / f"{first}-{count}-{policy.replace(':', '_')}-{noise}-{max_steps}"
        if not out.exists():
            pilot, settings = CraneExpert(dive=True, noise=noise), {"noise": noise}
            env = CraneBatch(4, max_steps=max_steps)
            seeds = range(first, first + count)
            collect(env, pilot, seeds, out, policy_name=policy, settings=settings, progress=False)
        return out

    return record


@pytest.fixture
def dataset(cranes: Recorded, tmp_path: Path) -> Path:
    """A copy of twelve flights by ana, several of which crash."""
    return Path(shutil.copytree(cranes(0, 12, "human:ana"), tmp_path / "cranes"))


def digests(folder: Path) -> dict[str, str]:
    """Return the place and the SHA-256 of every finished episode that counts, and of the index."""
    kept = [*folder.glob("demos/*"), *folder.glob("failures/*"), folder / "dataset.yaml"]
    return {str(file.relative_to(folder)): sha256(file.read_bytes()).hexdigest() for file in kept}
