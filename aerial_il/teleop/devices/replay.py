"""The input log of a session, given again tick by tick."""

from collections.abc import Iterable
from pathlib import Path

from aerial_il.core.errors import DemoError
from aerial_il.data.episode import Episode
from aerial_il.teleop.input.frame import LABELS, DeviceFrame

TOPIC = "device"
CONTROLS: tuple[str, ...] = ()  # those of the recording


class Replay:
    """Give the frames of a log one after the other; at its end nothing new arrives.

    Args:
        frames: one for each tick.
    """

    def __init__(self, frames: Iterable[DeviceFrame]) -> None:
        self._frames, self._last = iter(frames), DeviceFrame()

    def frame(self) -> DeviceFrame:
        frame = next(self._frames, None)
        self._last = frame or DeviceFrame(seq=self._last.seq, t_client=self._last.t_client)
        return self._last


def frames_of(episode: Episode, path: Path | str = "") -> list[DeviceFrame]:
    """Return the input log of a recording.

    Raises:
        DemoError: nobody flew it by hand.
    """
    if TOPIC not in episode.extras:
        raise DemoError(path or episode.uid, "holds no frames of a device: nobody flew it by hand.", topic=f"/{TOPIC}")
    labels = episode.extra_labels.get(TOPIC, LABELS)
    return [DeviceFrame.from_row(row, labels) for row in episode.extras[TOPIC]]
