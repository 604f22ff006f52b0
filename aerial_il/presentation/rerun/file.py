"""Files of rerun's: flights as recordings of one file, with our layout in front."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import rerun as rr

from aerial_il.core.errors import StorageError
from aerial_il.presentation.rerun.blueprint import blueprint
from aerial_il.presentation.rerun.flight import Flight, log_flight
from aerial_il.presentation.rerun.log import ALIGNED, SIM_TIME, Clock
from aerial_il.presentation.rerun.program import run

APPLICATION = "aerial_il"


class FlightFile:
    """A file that flights are added to; use it as a context. What was there before is replaced when it is whole.

    Args:
        path: the .rrd file.

    Raises:
        StorageError: it cannot be written.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self._parts: list[Path] = []

    def __enter__(self) -> FlightFile:
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._folder = TemporaryDirectory(prefix=f".{self.path.stem}-", dir=self.path.parent)
        except OSError as error:
            raise StorageError(self.path, error) from error
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: object) -> None:
        with self._folder:
            if kind is None:
                self._whole().replace(self.path)

    def add(self, flights: Mapping[str, Flight], *, name: str, clocks: Mapping[str, Clock] | None = None) -> None:
        """Add a recording of one flight, its root empty, or of several, each below its root.

        Args:
            flights: root -> flight. name: of the recording. clocks: root -> its times, where they are aligned.
        """
        with self.recording(name, _kind(flights)) as stream:
            stream.send_blueprint(blueprint(dict(flights), ALIGNED if clocks else SIM_TIME))
            for i, (root, flight) in enumerate(flights.items()):
                log_flight(stream, flight, root, clocks[root] if clocks else None, second=i > 0)

    @contextmanager
    def recording(self, name: str, application: str) -> Iterator[rr.RecordingStream]:
        """Yield a stream whose recording stands in the file in the end; layouts are kept by ``application``."""
        part = Path(self._folder.name) / f"{len(self._parts):06d}.rrd"
        stream = rr.RecordingStream(application, recording_id=name)
        sent = stream.binary_stream()  # not stream.save(): on a full disk rerun's own writer can wait for ever
        stream.send_recording_name(name)
        yield stream
        try:
            part.write_bytes(sent.read() or b"")  # read twice it would be two recordings
        except OSError as error:
            raise StorageError(self.path, error, "Make room and run the same command again.") from error
        self._parts.append(part)

    def _whole(self) -> Path:
        """Return one file of all recordings."""
        if len(self._parts) == 1:
            return self._parts[0]
        whole = Path(self._folder.name) / "whole.rrd"
        run("rrd", "merge", *map(str, self._parts), "-o", str(whole))
        return whole


def _kind(flights: Mapping[str, Flight]) -> str:
    """Return the name under which rerun keeps a layout: alike for flights that look alike."""
    specs = [flight.episode.spec for flight in flights.values()]
    return "-".join([APPLICATION, *dict.fromkeys(f"{spec.task}-{spec.robot}" for spec in specs)]).replace("/", "_")
