"""Real flights of the expert, recorded once, and how a file of rerun's is read back."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

import aerial_il
from aerial_il.collection.collect import collect
from aerial_il.core.rendering import can_render
from aerial_il.data.dataset import open_dataset
from aerial_il.data.episode import Episode
from aerial_il.presentation.rerun.file import FlightFile
from aerial_il.presentation.rerun.flight import Flight

SIZE = (24, 32)


class Shown:
    """What a file of rerun's holds: entity -> component -> its values, all rows one after the other."""

    def __init__(self, path: Path) -> None:
        from rerun.chunk import RrdReader

        self.path = path
        self.chunks = RrdReader(str(path)).stream().to_chunks()

    @property
    def entities(self) -> set[str]:
        return {str(chunk.entity_path) for chunk in self.chunks}

    def column(self, entity: str, component: str) -> pa.ChunkedArray:
        """Return the column of a component or a timeline, rows in the order of the chunks."""
        batches = [c.to_record_batch() for c in self.chunks if str(c.entity_path) == entity]
        result = [batch.column(component) for batch in batches if component in batch.schema.names]
        assert result, f"{entity} has no {component}, but {[batch.schema.names for batch in batches]}"
        return pa.chunked_array(result)

    def numbers(self, entity: str, component: str) -> np.ndarray:
        """Return all numbers of a component, row by row, flat."""
        values = self.column(entity, component).combine_chunks()
        while pa.types.is_list(values.type) or pa.types.is_fixed_size_list(values.type):
            values = values.flatten()
        return values.to_numpy(zero_copy_only=False)


def fly(folder: Path, task: str, *, seeds: range, tier: str = "calm", cameras: tuple[str, ...] = ()) -> Path:
    env = aerial_il.load_batch(
        "fa_hexa_arm4", task, num_envs=len(seeds), tier=tier, cameras=cameras, image_size=SIZE, num_threads=1
    )
    collect(env, aerial_il.expert("fa_hexa_arm4", task), seeds, folder, progress=False)
    env.close()
    return folder


@pytest.fixture(scope="session")
def grasps(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of two flights that grasp, in gusts, seen by a camera where this machine can render."""
    cameras = ("wrist",) if can_render() else ()
    return fly(tmp_path_factory.mktemp("grasps") / "pick", "pick_place", seeds=range(2), tier="gusts", cameras=cameras)


@pytest.fixture(scope="session")
def episodes(grasps: Path) -> list[Episode]:
    return list(open_dataset(grasps, cameras=True))


@pytest.fixture(scope="session")
def write(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Shown]:
    """Write flights as one recording, and read it back."""

    def written(flights: dict[str, Flight], **how: object) -> Shown:
        path = tmp_path_factory.mktemp("rrd") / "flight.rrd"
        with FlightFile(path) as file:
            file.add(flights, name="flight", **how)  # type: ignore[arg-type]
        return Shown(path)

    return written


@pytest.fixture(scope="session")
def shown(episodes: list[Episode], write: Callable[..., Shown]) -> Shown:
    """The first flight as rerun holds it."""
    return write({"": Flight.of(episodes[0])})
