"""`servolink decode` and `servolink encode`: frames to readable packets and back, without a board."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from io import BufferedReader
from typing import Any

from msgspec import UNSET, UnsetType

from servolink.cli.arguments import not_empty
from servolink.cli.command import DEVELOPERS, Command, one_of, option
from servolink.cli.screen.output import counted
from servolink.cli.screen.result import CommandResult, Remark, show
from servolink.errors import DecodeError, EncodeError, ServolinkError, escape
from servolink.protocol import Codec, Frame, FrameParser, encode_frame, packet_from_json, packet_to_json
from servolink.support import ExitCode, read_json

_BLOCK = 0x10000  # bytes read at once, and the most in one `skipped` object
_MAX_LINE = 1 << 22  # several times the longest packet in JSON
_SHOWN_BYTES = 32  # shown of an invalid frame, in text for people


@Command(
    "decode",
    DEVELOPERS,
    help="turn frames into readable packets",
    examples=("decode 134c051d344e0100070b",),
    options=(
        one_of(
            option("frames", "HEX", "frames in hex, or the bytes of one frame", nargs="*", default=[]),
            option("--hex", "FILE", "read a frame in hex from each line (-: standard input)", not_empty),
            option("--file", "FILE", "read a raw byte stream (-: standard input)", not_empty),
            required=True,
        ),
    ),
    takes_board=False,
)
def run_decode(args: argparse.Namespace) -> int:
    """Print a packet for each frame. Return 1 if anything is not a packet."""
    codec = _codec(args)
    results = _stream(args.file, codec) if args.file else _frames(args, codec)
    outcome = ExitCode.OK
    for result in results:
        if "packet" not in result:
            outcome = ExitCode.FAILED
        show(result, lines_for(result))
    return outcome


def _codec(args: argparse.Namespace) -> Codec:
    return Codec(args.byte_order or "little", args.caption_encoding or "utf-8")


class EncodedFrame(CommandResult, frozen=True, kw_only=True):
    """JSON of each line of `encode`: a frame in hex, or why an object cannot be a packet."""

    bytes: str | UnsetType = UNSET
    error: str | UnsetType = UNSET


@Command(
    "encode",
    DEVELOPERS,
    help="turn packets into frames",
    examples=('encode \'{"packet":"QueryServoRequest","fields":{"servo_id":7}}\'',),
    options=(
        option(
            "objects",
            "OBJECT",
            "a packet as a JSON object; if there is none, one is read from each line of standard input",
            nargs="*",
            default=[],
        ),
    ),
    takes_board=False,
)
def run_encode(args: argparse.Namespace) -> int:
    """Print a frame for each object, and errors among them with --json. Return 1 if anything is not a packet."""
    codec = _codec(args)
    outcome = ExitCode.OK
    given = enumerate((text.encode("utf-8", "surrogateescape") for text in args.objects), 1)
    for number, line in given if args.objects else _lines("-"):
        try:
            frame = codec.encode(packet_from_json(parse_object(line))).hex()
        except EncodeError as error:
            outcome = ExitCode.FAILED
            what = "object" if args.objects else "line"
            show(EncodedFrame(error=str(error)), Remark(f"{what} {number}: {error}"))
        else:
            show(EncodedFrame(bytes=frame), frame)
    return outcome


def parse_object(line: bytes) -> Any:
    """Return the JSON value in `line`."""
    if len(line) > _MAX_LINE:
        raise EncodeError(f"is longer than {_MAX_LINE:,} bytes, and no packet is")
    try:
        return read_json(line)
    except ValueError as error:
        raise EncodeError(str(error)) from None


@contextmanager
def _open(path: str) -> Iterator[BufferedReader]:
    try:
        # Opened by descriptor: sys.stdin is text, and None when standard input is closed.
        with open(0 if path == "-" else path, "rb", closefd=path != "-") as source:
            yield source
    except OSError as error:
        name = "standard input" if path == "-" else path
        raise ServolinkError(f"{name} cannot be read: {error.strerror}") from error


def _lines(path: str) -> Iterator[tuple[int, bytes]]:
    """Yield number and content of each line except blank lines; an overlong line is cut."""
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
    """Decode frames given in hex."""
    for text in _hex_lines(args.hex) if args.hex else _hex_arguments(args.frames):
        try:
            data = bytes.fromhex(text)
        except ValueError:
            yield {"error": f"must be hex digits in pairs, not '{_shortened(text)}'", "bytes": ""}
            continue
        try:
            yield packet_to_json(codec.decode_frame(data))
        except DecodeError as error:
            yield _error(error, data)


def _hex_lines(path: str) -> Iterator[str]:
    for _, line in _lines(path):
        yield _without_separators(line.decode("utf-8-sig", "surrogateescape"))


def _hex_arguments(arguments: list[str]) -> list[str]:
    texts = [_without_separators(argument) for argument in arguments]
    return ["".join(texts)] if all(len(text) <= 2 for text in texts) else texts


def _without_separators(text: str) -> str:
    return "".join(text.split()).replace(":", "")


def _stream(path: str, codec: Codec) -> Iterator[dict[str, Any]]:
    """Decode the frames of a byte stream, with the bytes skipped between them, in order."""
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
    """Yield the frames of a stream and the bytes skipped between them."""
    parser = FrameParser(codec.byte_order, keep_skipped=True)
    with _open(path) as source:
        while block := source.read1(_BLOCK):
            yield from _merged(parser.feed(block), parser.take_skipped())
    yield from _merged(parser.finish(), parser.take_skipped())


def _merged(frames: list[Frame], skipped: list[tuple[int, bytes, str]]) -> Iterator[Frame | bytes]:
    """Yield frames and skipped bytes in the order of the input."""
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


def lines_for(result: dict[str, Any]) -> list[str]:
    """Return `result` for people: a packet with a line for each record, or the reason why decoding failed."""
    if "error" in result:
        return [f"error: {result['error']}  {_shortened(result['bytes'])}".rstrip()]
    if "skipped" in result:
        return [f"skipped {counted(result['skipped'], 'byte')}  {_shortened(result['bytes'])}"]
    first = [f"{result['packet']} ({result['id']})"]
    records: list[str] = []
    for name, value in result["fields"].items():
        if isinstance(value, (tuple, list)) and value and isinstance(value[0], dict):
            first.append(f"{name}: {len(value)}")
            records += ("    " + " ".join(_pairs(record.items())) for record in value)
        else:
            first += _pairs([(name, value)])
    return [" ".join(first), *records]


def _pairs(fields: Iterable[tuple[str, Any]]) -> Iterator[str]:
    for name, value in fields:
        yield f"{name}='{value}'" if isinstance(value, str) and name != "data" else f"{name}={value}"


def _shortened(digits: str) -> str:
    width = 2 * _SHOWN_BYTES
    return escape(digits) if len(digits) <= width else f"{escape(digits[:width])}... ({len(digits) // 2} bytes)"
