"""Message records of fixed-size topics and of cameras, taken out of a file and compared with what it says."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from aerial_il.data.recording.encoding.packing import first_difference
from aerial_il.data.recording.encoding.topics import RECORD_HEAD, RECORD_HEAD_SIZE, Block, Camera, FixedTopic
from aerial_il.data.recording.report import Report
from aerial_il.data.recording.scan import Contents, Stream


@dataclass(frozen=True)
class Messages:
    """The decoded messages of a file.

    Attributes:
        rows: (k,) steps as rows of the layout; of a whole file the last one is how the flight ended.
        images: camera field -> k compressed images.
        digested: topic -> the records that its digest covers, in order.
    """

    rows: np.ndarray
    images: Mapping[str, list[bytes]]
    digested: Mapping[str, list[np.ndarray]]


def read_records(report: Report, topic: FixedTopic, contents: Contents, steps: np.ndarray) -> np.ndarray:
    """Return the message records of one topic, one for each of ``steps``, equal to its template outside the slots."""
    messages = contents.messages.get(topic.channel, Stream())
    if len(messages) != len(steps):
        report.fail("has another number of messages than steps.", topic.name, expected=len(steps), got=len(messages))
    size = len(topic.record_template)
    try:
        raw = messages.joined(size)
    except ValueError:
        step, got = next((i, len(message)) for i, message in enumerate(messages) if len(message) != size)
        report.fail("has a message of another size.", topic.name, step=int(steps[step]), expected=size, got=got)
    if wrong := first_difference(raw, np.frombuffer(topic.record_template, np.uint8), topic.constant_mask):
        step, byte = wrong
        field = f"byte {byte - RECORD_HEAD_SIZE}"
        report.fail("differs from its specification.", topic.name, step=int(steps[step]), field=field)
    records = raw.view(topic.dtype)[:, 0]
    _check_stamps(report, topic, records, steps)
    return records


def check_shown(report: Report, topic: FixedTopic, records: np.ndarray, times: np.ndarray, block: Block) -> None:
    """Require that a topic shows what is recorded exactly, ``block`` (k, ...), at the ``times`` (k,)."""
    body = records["body"]
    report.check_equal(topic.name, "log_time", records["log_time"], times)
    for slot in topic.sources:
        if slot == "orientation" or slot.startswith("rotation"):
            report.check_unit(topic.name, slot, body[slot])
        else:
            report.check_equal(topic.name, slot, body[slot], topic.expected(slot, block))


def read_images(report: Report, camera: Camera, contents: Contents, times: np.ndarray) -> list[bytes]:
    """Return the compressed images of one camera, one for each of ``times``: what it holds was written once."""
    messages, reached = contents.messages.get(camera.channel, Stream()), images_of(camera, contents)
    if reached != len(times):
        report.fail("has another number of images than observations.", camera.name, expected=len(times), got=reached)
    dtype = np.dtype([*RECORD_HEAD, ("body", camera.template.dtype)])
    found: list[bytes] = []
    for message in messages:
        i = len(found)
        if len(message) < dtype.itemsize:
            report.fail("has a message that is too short.", camera.name, step=i)
        record = np.frombuffer(message[: dtype.itemsize], dtype)[0]
        got = int(record["sequence"]), int(record["log_time"])
        held = got[0] - i if camera.holds and found and i < got[0] < len(times) else 0
        if i >= len(times) or got != (i + held, int(times[i + held])):
            expected = (i, int(times[min(i, len(times) - 1)]))
            report.fail("is out of order.", camera.name, step=i, expected=expected, got=got)
        if int(record["body"]["size"]) != len(message) - dtype.itemsize:
            report.fail("has a message of another size.", camera.name, step=i)
        found += [*found[-1:] * held, message[dtype.itemsize :].tobytes()]
    return found


def images_of(camera: Camera, contents: Contents) -> int:
    """Return for how many steps, from the first on, a file holds images of a camera."""
    messages = contents.messages.get(camera.channel, Stream())
    if not camera.holds or not len(messages):
        return len(messages)
    return int(messages.last[:RECORD_HEAD_SIZE].view(np.dtype(RECORD_HEAD))[0]["sequence"]) + 1


def _check_stamps(report: Report, topic: FixedTopic, records: np.ndarray, steps: np.ndarray) -> None:
    """Require that sequence numbers and the different time stamps of a topic agree."""
    report.check_equal(topic.name, "sequence", records["sequence"], steps)
    report.check_equal(topic.name, "publish_time", records["publish_time"], records["log_time"])
    for slots, part in zip(topic.stamps, np.divmod(records["log_time"], np.uint64(10**9)), strict=True):
        for slot in slots:
            report.check_equal(topic.name, slot, records["body"][slot], part)
