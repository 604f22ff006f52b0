"""Write a LeRobot v3 dataset without images: whole episodes at a time, straight to Parquet.

lerobot's own writer takes frame after frame through a Hugging Face dataset, which it searches for images. What it would
write comes out of its own functions here too: the schema, the statistics, the files below ``meta/``.

Source: ``DatasetWriter.save_episode`` of lerobot 0.6.1.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

PROVENANCE = "meta/provenance.json"  # ours, beside what lerobot writes there
MEBIBYTE = 1 << 20
BINS = 5000  # of lerobot's histograms


class StateWriter:
    """Appends episodes to a new dataset.

    Args:
        root: the folder, which must not exist yet.
        repo_id, fps, robot_type: for ``meta/info.json``.
        features: lerobot's description of the columns.
    """

    def __init__(
        self, root: Path, *, repo_id: str, fps: int, robot_type: str, features: Mapping[str, dict[str, Any]]
    ) -> None:
        from lerobot.datasets.dataset_metadata import LeRobotDatasetMetadata
        from lerobot.datasets.feature_utils import get_hf_features_from_features

        self.root = root
        self.meta = LeRobotDatasetMetadata.create(
            repo_id, fps, dict(features), robot_type=robot_type, root=root, use_videos=False
        )
        self._schema: pa.Schema = get_hf_features_from_features(self.meta.features).arrow_schema
        self._parquet: pq.ParquetWriter | None = None
        self._chunk = self._file = self._first = 0  # of the file that is open, and its first frame

    def add(self, columns: Mapping[str, np.ndarray], task: str) -> None:
        """Append an episode.

        Args:
            columns: each feature (T, ...), those of one element (T,).
            task: its instruction.
        """
        length, episode, start = len(next(iter(columns.values()))), self.meta.total_episodes, self.meta.total_frames
        self.meta.save_episode_tasks([task])
        frame = np.arange(length)
        known = {
            **columns,
            "timestamp": frame / self.meta.fps,
            "frame_index": frame,
            "episode_index": np.full(length, episode),
            "index": start + frame,
            "task_index": np.full(length, self.meta.get_task_index(task)),
        }
        ordered = {name: known[name] for name in self.meta.features}
        self._write(ordered, start, length)
        place = {"data/chunk_index": self._chunk, "data/file_index": self._file}
        place |= {"dataset_from_index": start, "dataset_to_index": start + length}
        statistics = {name: _statistics(values) for name, values in ordered.items() if values.dtype.kind != "U"}
        self._keep({"episode_index": episode, "tasks": [task], "length": length, **place}, statistics)

    def close(self) -> None:
        """Write the footers, without which nothing can be read, and what is known of the whole."""
        from lerobot.datasets.io_utils import write_info, write_stats

        if self._parquet is not None:
            self._parquet.close()
            self._parquet = None
        if self.meta.stats is not None:
            write_info(self.meta.info, self.root)
            write_stats(self.meta.stats, self.root)
        self.meta.finalize()

    def _keep(self, episode: dict[str, Any], statistics: dict[str, dict[str, np.ndarray]]) -> None:
        """Do what ``save_episode`` of lerobot's metadata does, without writing all of it anew for each episode."""
        from lerobot.datasets.compute_stats import aggregate_stats
        from lerobot.utils.utils import flatten_dict

        meta, info = self.meta, self.meta.info
        meta._save_episode_metadata({**episode, **flatten_dict({"stats": statistics})})
        info.total_episodes, info.total_frames = info.total_episodes + 1, info.total_frames + episode["length"]
        info.total_tasks, info.splits = (
            0 if meta.tasks is None else len(meta.tasks),
            {"train": f"0:{info.total_episodes}"},
        )
        meta.stats = aggregate_stats([meta.stats, statistics]) if meta.stats is not None else statistics

    def _write(self, columns: Mapping[str, np.ndarray], start: int, length: int) -> None:
        from lerobot.datasets.utils import update_chunk_file_indices

        if self._parquet is not None and self._is_full(start, length):
            self._parquet.close()
            self._parquet, self._first = None, start
            self._chunk, self._file = update_chunk_file_indices(self._chunk, self._file, self.meta.chunks_size)
        if self._parquet is None:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._parquet = pq.ParquetWriter(self._path, self._schema, compression="snappy", use_dictionary=True)
        arrays = [_array(columns[field.name], field.type) for field in self._schema]
        self._parquet.write_table(pa.Table.from_arrays(arrays, schema=self._schema))

    def _is_full(self, start: int, length: int) -> bool:
        """Whether ``length`` more frames would make the file larger than lerobot wants it."""
        size, frames = self._path.stat().st_size / MEBIBYTE, start - self._first
        return size + length * size / frames >= self.meta.data_files_size_in_mb

    @property
    def _path(self) -> Path:
        return self.root / self.meta.data_path.format(chunk_index=self._chunk, file_index=self._file)


def _array(values: np.ndarray, kind: pa.DataType) -> pa.Array:
    """Return a column (T,) or (T, D) in the type that lerobot gives it."""
    if pa.types.is_fixed_size_list(kind):
        flat = pa.array(np.ascontiguousarray(values).ravel(), kind.value_type)
        return pa.FixedSizeListArray.from_arrays(flat, type=kind)
    if pa.types.is_list(kind):
        offsets = np.arange(len(values) + 1, dtype=np.int32) * values.shape[1]
        return pa.ListArray.from_arrays(offsets, pa.array(np.ascontiguousarray(values).ravel(), kind.value_type), kind)
    return pa.array(values, kind)


def _statistics(values: np.ndarray) -> dict[str, np.ndarray]:
    """Return what lerobot's ``get_feature_stats`` does of a feature (T,) or (T, D), without filling its histograms.

    A quantile is interpolated in the one of 5,000 bins in which the value of its rank lies.
    """
    from lerobot.datasets.compute_stats import DEFAULT_QUANTILES, get_feature_stats

    if len(values) < 2:
        return get_feature_stats(values, axis=0, keepdims=values.ndim == 1)
    batch = values.reshape(len(values), -1)
    batch = batch.astype(np.result_type(batch.dtype, np.float32), copy=False)
    mean, low, high = batch.mean(0), batch.min(0), batch.max(0)
    found = {"min": low, "max": high, "mean": mean, "std": np.sqrt(np.maximum(0, (batch**2).mean(0) - mean**2))}
    found["count"] = np.array([len(values)])
    columns = list(np.sort(batch, axis=0).T)
    edges = [np.linspace(*ends, BINS + 1) for ends in zip(low - 1e-10, high + 1e-10, strict=True)]
    for q in DEFAULT_QUANTILES:
        each = zip(columns, edges, strict=True)
        found[f"q{int(q * 100):02d}"] = np.array([_quantile(*column, q * len(batch)) for column in each])
    return found


def _quantile(ordered: np.ndarray, edges: np.ndarray, target: float) -> float:
    """Return the value below which ``target`` of the values (T,), in order, lie, as read off their histogram."""
    place = min(int(np.searchsorted(edges, ordered[math.ceil(target) - 1], side="right")) - 1, BINS - 1)
    if place <= 0:
        return edges[0]
    before = np.searchsorted(ordered, edges[place])
    inside = np.searchsorted(ordered, edges[place + 1], side="right" if place == BINS - 1 else "left") - before
    return edges[place] + (target - before) / inside * (edges[place + 1] - edges[place])
