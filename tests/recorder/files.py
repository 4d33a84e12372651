"""MCAP files for tests, written by the library that others use."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from mcap.writer import CompressionType, Writer

from servolink.recorder.channels import CHANNELS, METADATA, SCHEMA_NAMES, TOPICS, Message, encode, schema

START = 1_700_000_000_000_000_000
ABOUT = {"version": "0.1.0", "started": "2026-11-22T15:30:00Z", "board": "rex", "through": "hub"}


def write(
    path: Path,
    messages: Iterable[tuple[float, Message]],
    *,
    about: dict[str, str] | None = ABOUT,
    compression: CompressionType = CompressionType.ZSTD,
    chunk_size: int = 4096,
) -> Path:
    """Write messages with their seconds to `path`, and return it."""
    with path.open("wb") as file:
        writer = Writer(file, compression=compression, chunk_size=chunk_size)
        writer.start(profile="", library="servolink")
        if about is not None:
            writer.add_metadata(METADATA, about)
        channels = {}
        for topic in CHANNELS:
            number = writer.register_schema(SCHEMA_NAMES[topic], "jsonschema", schema(topic))
            channels[topic] = writer.register_channel(topic, "json", number)
        for seconds, message in messages:
            time = START + round(seconds * 1e9)
            writer.add_message(channels[TOPICS[type(message)]], time, encode(message), time)
        writer.finish()  # type: ignore[no-untyped-call]
    return path
