"""All functions that are fed with random and mutated bytes, with the seeds for a fuzzer."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

from servolink.project import ProjectFile
from tests.proofs.fuzz import ends, texts, usb, wire
from tests.proofs.fuzz.recipes import IDS
from tests.proofs.hostile.calls import PROJECT
from tests.protocol.declared import VECTORS


@dataclass(frozen=True)
class Target:
    """A function that takes any bytes and raises if a property does not hold."""

    check: Callable[[bytes], None]
    what: str
    seeds: Callable[[], list[bytes]]
    share: int = 1
    """Share of the time."""
    longest: int = 160
    """The length of the longest input in bytes."""


def _streams() -> list[bytes]:
    raw = [bytes((2, at)) + vector.frame * 2 for at, vector in enumerate(VECTORS[::6]) if len(vector.frame) < 80]
    return [*raw, *(bytes((0, at, 0, at, 3)) + bytes(range(40)) for at in range(len(IDS)))]


def _contents() -> list[bytes]:
    whole = [
        bytes((128 + (vector.byte_order == "big"), IDS.index(vector.packet_id))) + vector.frame[8:-1]
        for vector in VECTORS[::3]
    ]
    return [*whole, *(bytes((at % 16, at, 2)) + bytes(range(30, 90)) for at in range(len(IDS)))]


def _objects() -> list[bytes]:
    return [
        json.dumps({"packet": vector.name, "id": vector.packet_id, "fields": vector.fields}).encode()
        for vector in VECTORS[::5]
    ]


def _answers() -> list[bytes]:
    return [bytes((at, at, at + 1, 0, at * 11 % 256, 1, at)) + bytes(range(30)) for at in range(24)]


def _projects() -> list[bytes]:
    return [ProjectFile(PROJECT).text().encode(), b'{"schema": 1}', b'{"schema": 1, "actions": [{"action_id": 1}]}']


_ADDRESSES = (
    b"\0tcp://host:9000",
    b"\1/dev/ttyACM0?baudrate=115200&dtr=1",
    b"\3[::1]:80",
    b"\4" + b"1234:5678/serial?report_size=64",
    b"\5" + b"1234:5678?interface=1&in=0x81&out=2",
    b"\6name",
    b"\7tmp/a.jsonl?timing=0",
    b"\x08servos=4&seed=1&memory=1000&on_duplicate=reject&clear=records&partial_writes=1&drop=0.01&state=/tmp/x%20y",
    b"\x08mode=0&memory_unit=1024&project_id_bits=16&unsupported=QueryServo,AddMacro&turnaround=.01&queue=0&queue_bytes=64",
    b"\x09ttyUSB0?rts=1",
)
_FAULTS = (b"drop=0.01,flip=0.001,insert=1e-3,delay=.1,delay_time=2,duplicate=1,cut=0.5,unplug=100", b"127.0.0.1:80")
_SCRIPTS = (b"1.5 press 3\n2 long 4 # held\n", b"0 down 1\n1e3 up 4294967295\n2.0 push 1 -45\n")

TARGETS: dict[str, Target] = {
    "parse": Target(wire.check_stream, "streams, cut anyhow, to frames", _streams, 10),
    "decode": Target(wire.check_content, "contents to packets, to contents, to objects and back", _contents, 8),
    "frame": Target(wire.check_frame, "bytes to exactly one packet", lambda: [one.frame for one in VECTORS[::4]], 3),
    "object": Target(wire.check_json, "JSON to packets", _objects, 2, 400),
    "caption": Target(wire.check_captions, "captions in any encoding", lambda: [b"utf-8\0wave", b"big5\0\xa4\xa4"]),
    "answer": Target(ends.check_answer, "frames to requests that wait", _answers, 4),
    "talk": Target(ends.check_talk, "calls to a board that sends anything", _answers, 2),
    "command": Target(ends.check_command, "anything to a virtual board", _streams, 3),
    "usb": Target(
        usb.check_device, "anything to its USB device", lambda: [bytes.fromhex("0111800300000000") + bytes(60)]
    ),
    "address": Target(texts.check_address, "addresses to transports", lambda: list(_ADDRESSES), longest=120),
    "faults": Target(texts.check_faults, "texts to faults of a line", lambda: list(_FAULTS), longest=120),
    "script": Target(texts.check_script, "texts to button presses", lambda: list(_SCRIPTS), longest=120),
    "project": Target(texts.check_project, "texts to projects and back", _projects, 2, 3000),
}


@cache
def seeds(name: str) -> tuple[bytes, ...]:
    """Return the seeds for a fuzzer."""
    return tuple(seed[: TARGETS[name].longest] for seed in TARGETS[name].seeds())
