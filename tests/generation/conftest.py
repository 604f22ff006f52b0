"""One flight of the expert for each task that generation is tried on."""

from collections.abc import Callable
from pathlib import Path

import pytest

from aerial_il.cli.main import main
from aerial_il.data.dataset import open_dataset
from aerial_il.data.episode import Episode

Shown = Callable[[str], Path]


@pytest.fixture(scope="session")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Shown:
    """Return a function from a task to a dataset of one flight, flown once."""
    folder = tmp_path_factory.mktemp("shown")

    def dataset(task: str) -> Path:
        words = [f"task={task}", "episodes=1", "seed=7", "expert.noise=0", "num_envs=1", "progress=false"]
        if not (folder / task).exists():
            assert main(["collect", "robot=fa_hexa_arm4", *words, f"out={folder / task}"]) == 0
        return folder / task

    return dataset


@pytest.fixture(scope="session")
def flight(shown: Shown) -> Callable[[str], Episode]:
    """Return a function from a task to its one flight."""
    return lambda task: next(iter(open_dataset(shown(task))))
