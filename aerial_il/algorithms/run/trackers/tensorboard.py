"""TensorBoard: event files in the run's folder."""

import shutil
import time
from collections.abc import Mapping
from pathlib import Path

FOLDER = "tensorboard"


class TensorBoard:
    """Scalars for TensorBoard, written synchronously: a writer thread would hang the run on a full disk."""

    def __init__(self, run: Path) -> None:
        from tensorboardX.event_file_writer import EventsWriter

        folder = run / FOLDER
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        self._writer = EventsWriter(str(folder / "events"))

    def write(self, row: Mapping[str, float]) -> None:
        from tensorboardX.proto.event_pb2 import Event  # pyright: ignore[reportAttributeAccessIssue]
        from tensorboardX.summary import scalar

        for tag, value in row.items():
            if tag != "step":
                self._writer.write_event(
                    Event(wall_time=time.time(), step=int(row["step"]), summary=scalar(tag, value))
                )
        self._writer.flush()

    def close(self) -> None:
        self._writer.close()
