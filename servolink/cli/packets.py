"""`servolink decode` and `servolink encode`: frames to readable packets and back, no board needed."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from io import BufferedReader
from typing import Any

from servolink.cli.arguments import not_empty
from servolink.cli.main import FAILED, OK
from servolink.errors import DecodeError, EncodeError, ServolinkError
from servolink.escaping import escape
from servolink.json_text import read_json
from servolink.protocol.codec import Codec
from servolink.protocol.frame import Frame, encode_frame
from servolink.protocol.json_form import packet_from_json, packet_to_json
from servolink.protocol.parser import FrameParser

_BLOCK = 0x10000  # bytes read at once, and the most that one `skipped` object holds
_MAX_LINE = 1 << 22  # several times the longest packet in JSON
_SHOWN_BYTES = 32  # of what was no frame, in text for people


def configure_encode(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink encode`."""
    parser.set_defaults(run=run)
    parser.add_argument(
        "objects",
        nargs="*",
        metavar="OBJECT",
        help="packet as a JSON object; without any, one a line is read from stdin",
    )


def configure_decode(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink decode`."""
    parser.set_defaults(run=run)
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("frames", nargs="*", default=[], metavar="HEX", help="one frame in hex, or its single bytes")
    source.add_argument(
        "--hex", type=not_empty, metavar="FILE", help="read one frame in hex from each line (- for stdin)"
    )
    source.add_argument("--file", type=not_empty, metavar="FILE", help="read a raw byte stream (- for stdin)")


def run(args: argparse.Namespace) -> int:
    """Run `decode` or `encode`: 0, or 1 if anything made no frame or no packet."""
    codec = Codec(args.byte_order, args.caption_encoding)
    if args.command == "encode":
        return _encode(args, codec)
    results = _stream(args.file, codec) if args.file else _frames(args, codec)
    outcome = OK
    for result in results:
        if "packet" not in result:
            outcome = FAILED
        print(json.dumps(result) if args.json else _text(result), flush=True)
    return outcome


def _encode(args: argparse.Namespace, codec: Codec) -> int:
    """Print a frame for each object; errors go to stderr, with --json to stdout in their place."""
    outcome = OK
    given = enumerate((text.encode("utf-8", "surrogateescape") for text in args.objects), 1)
    for number, line in given if args.objects else _lines("-"):
        try:
            frame = codec.encode(packet_from_json(_parse(line))).hex()
        except EncodeError as error:
            outcome = FAILED
            if args.json:
                print(json.dumps({"error": str(error)}), flush=True)
            else:
                place = "object" if args.objects else "line"
                print(f"servolink: {place} {number}: {escape(str(error))}", file=sys.stderr)
        else:
            print(json.dumps({"bytes": frame}) if args.json else frame, flush=True)
    return outcome


def _parse(line: bytes) -> Any:
    """Return the JSON value in `line`."""
    if len(line) > _MAX_LINE:
        raise EncodeError(f"longer than {_MAX_LINE:,} bytes, which no packet needs")
    try:
        return read_json(line)
    except ValueError as error:
        raise EncodeError(str(error)) from None


@contextmanager
def _open(path: str) -> Iterator[BufferedReader]:
    try:
        # The descriptor itself: sys.stdin is None when it is closed, and text besides.
        with open(0 if path == "-" else path, "rb", closefd=path != "-") as source:
            yield source
    except OSError as error:
        name = "standard input" if path == "-" else escape(path)
        raise ServolinkError(f"{name} cannot be read: {error.strerror}") from error


def _lines(path: str) -> Iterator[tuple[int, bytes]]:
    """Yield number and content of each line that is not blank; of one too long only its beginning."""
    with _open(path) as source:
        number = 0
        while line := source.readline(_MAX_LINE + 1):
            number += 1
            rest = line
            while len(rest) > _MAX_LINE and not rest.endswith(b"\n"):
                rest = source.readline(_MAX_LINE + 1)
            if not line.isspace():
                yield number, line


def _frames(args: argparse.Namespace, codec: Codec) -> Iterator[dict[str, Any]]:
    """Decode frames that are given one by one, in hex."""
    for text in _hex_lines(args.hex) if args.hex else _hex_arguments(args.frames):
        try:
            data = bytes.fromhex(text)
        except ValueError:
            yield {"error": f"'{_shortened(text)}' is no text of hex digits in pairs", "bytes": ""}
            continue
        try:
            yield packet_to_json(codec.decode_frame(data))
        except DecodeError as error:
            yield _error(error, data)


def _hex_lines(path: str) -> Iterator[str]:
    for _, line in _lines(path):
        yield _without_separators(line.decode("utf-8", "surrogateescape"))


def _hex_arguments(arguments: list[str]) -> list[str]:
    texts = [_without_separators(argument) for argument in arguments]
    return ["".join(texts)] if all(len(text) <= 2 for text in texts) else texts


def _without_separators(text: str) -> str:
    return "".join(text.split()).replace(":", "")


def _stream(path: str, codec: Codec) -> Iterator[dict[str, Any]]:
    """Decode the frames of a byte stream and show what lies between them, in their order."""
    between = bytearray()
    for event in _events(path, codec):
        if isinstance(event, bytes):
            between += event
            while len(between) >= _BLOCK:
                yield _skipped(between[:_BLOCK])
                del between[:_BLOCK]
            continue
        if between:
            yield _skipped(between)
            between.clear()
        try:
            yield packet_to_json(codec.decode(*event))
        except DecodeError as error:
            yield _error(error, encode_frame(*event, codec.byte_order))
    if between:
        yield _skipped(between)


def _events(path: str, codec: Codec) -> Iterator[Frame | bytes]:
    """Yield the frames and the skipped bytes of a stream."""
    parser = FrameParser(codec.byte_order, keep_skipped=True)
    with _open(path) as source:
        while block := source.read1(_BLOCK):
            yield from _merged(parser.feed(block), parser.take_skipped())
    yield from _merged(parser.finish(), parser.take_skipped())


def _merged(frames: list[Frame], skipped: list[tuple[int, bytes, str]]) -> Iterator[Frame | bytes]:
    at = 0
    for before, data, _ in skipped:
        yield from frames[at:before]
        yield data
        at = before
    yield from frames[at:]


def _error(error: DecodeError, data: bytes) -> dict[str, Any]:
    return {"error": str(error), "bytes": data.hex()}


def _skipped(data: bytes | bytearray) -> dict[str, Any]:
    return {"skipped": len(data), "bytes": data.hex()}


def _text(result: dict[str, Any]) -> str:
    """Return `result` for people: a packet with a line for each record, or what was no packet."""
    if "error" in result:
        return escape(f"error: {result['error']}  {_shortened(result['bytes'])}").rstrip()
    if "skipped" in result:
        return f"skipped {result['skipped']} bytes  {_shortened(result['bytes'])}"
    first = [f"{result['packet']} ({result['id']})"]
    records: list[str] = []
    for name, value in result["fields"].items():
        if isinstance(value, (tuple, list)) and value and isinstance(value[0], dict):
            first.append(f"{name}: {len(value)}")
            records += ("    " + " ".join(_pairs(record.items())) for record in value)
        else:
            first += _pairs([(name, value)])
    return "\n".join([" ".join(first), *records])


def _pairs(fields: Iterable[tuple[str, Any]]) -> Iterator[str]:
    for name, value in fields:
        yield f"{name}='{escape(value)}'" if isinstance(value, str) and name != "data" else f"{name}={value}"


def _shortened(digits: str) -> str:
    width = 2 * _SHOWN_BYTES
    return escape(digits) if len(digits) <= width else f"{escape(digits[:width])}... ({len(digits) // 2} bytes)"
