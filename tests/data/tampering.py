"""Rewrite a recording with something changed and every checksum right, as a hostile or careless tool would."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from mcap.reader import make_reader
from mcap.records import Channel, Message, Schema
from mcap.writer import CompressionType, Writer

Change = Callable[[str, Message], Message | None]
Entries = dict[str, dict[str, str]]


def rewrite(
    source: Path,
    target: Path,
    *,
    message: Change = lambda topic, message: message,
    metadata: Callable[[Entries], Entries] = lambda entries: entries,
    attachments: bool = True,
    schema: Callable[[Schema], Schema] = lambda schema: schema,
    compression: CompressionType = CompressionType.ZSTD,
) -> Path:
    """Copy a recording record by record; ``message`` returns None to drop one."""
    with open(source, "rb") as raw, open(target, "wb") as file:
        reader, writer = make_reader(raw), Writer(file, compression=compression, enable_data_crcs=True)
        writer.start("ros2", "tampering")
        summary = reader.get_summary()
        assert summary is not None
        for old in summary.schemas.values():
            new = schema(old)
            writer.register_schema(new.name, new.encoding, new.data)
        channels: dict[int, Channel] = summary.channels
        used = {channel.id for _, channel, m in reader.iter_messages() if message(channel.topic, replace(m))}
        ids = {
            i: writer.register_channel(c.topic, c.message_encoding, c.schema_id)
            for i, c in sorted(channels.items())
            if i in used
        }
        for attachment in reader.iter_attachments() if attachments else ():
            writer.add_attachment(0, 0, attachment.name, attachment.media_type, attachment.data)
        for name, entries in metadata({m.name: dict(m.metadata) for m in reader.iter_metadata()}).items():
            writer.add_metadata(name, entries)
        for _, channel, old_message in reader.iter_messages():
            changed = message(channel.topic, replace(old_message))
            if changed:
                writer.add_message(
                    ids[channel.id], changed.log_time, changed.data, changed.publish_time, changed.sequence
                )  # fmt: skip
        writer.finish()
    return target
