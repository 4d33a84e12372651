"""Random conversations with a board: valid requests, invalid ones, and damaged frames."""

from __future__ import annotations

import random
from typing import Any

from tests.protocol.declared import DOCUMENT

PACKETS: dict[int, dict[str, Any]] = {packet["id"]: packet for packet in DOCUMENT["packets"]}
REQUESTS = [packet_id for packet_id, packet in PACKETS.items() if packet["direction"] == "client-to-server"]
SIZES = {"u8": 1, "u16": 2, "i16": 2, "u32": 4, "i32": 4}
MAGIC = bytes.fromhex("134c051d")

USUAL = {
    "servoID": (1, 2, 3, 16, 255),
    "degree": (-90, -45, 0, 30, 90),
    "interval": (0, 5, 20),
    "type": (0, 1, 2),
    "ratio": (50, 100),
    "loop": (1, 2),
    "totalInterval": (0, 100),
    "commandID": (1, 2, 3, 100),
    "adjustedDegree": (-3, 0, 4),
    "mode": (1,),
    "unitType": (0,),
}
"""Values of fields that make sense; ids of records are 1, 2 and 3, flags 0 and 1."""
ODD = (-(2**31), -32768, -1, 0, 101, 255, 32767, 65535, 2**31 - 1)


def frame(packet_id: int, content: bytes = b"") -> bytes:
    """Return the frame of a packet."""
    data = MAGIC + packet_id.to_bytes(2, "little") + len(content).to_bytes(2, "little") + content
    return data + bytes([sum(data) % 256])


def _number(draw: random.Random, name: str, size: int, odd: float) -> bytes:
    usual = USUAL.get(name, (1, 2, 3) if size == 4 else (0, 1))
    is_odd = draw.random() < odd and name != "adjustedDegree"  # as it moves what later angles mean
    value = draw.choice(ODD if is_odd else usual)
    return int(value % 256**size).to_bytes(size, "little")


def content(draw: random.Random, fields: list[dict[str, Any]], odd: float) -> bytes:
    """Return random values of fields; `odd` is how often a number makes no sense."""
    parts = list[bytes]()
    for field in fields:
        if "repeat" in field:
            size = len(parts[-1])
            count = draw.randrange(4)
            parts[-1] = (count + (draw.random() < odd / 3)).to_bytes(size, "little")
            parts += [content(draw, field["fields"], odd) for _ in range(count)]
        elif field["type"] == "char[32]":
            text = draw.choice([b"Hello", "揮手".encode(), bytes(32), b"\xff" * 32, b"x" * 32])
            parts.append(text.ljust(32, b"\0"))
        elif field["type"] == "bytes":
            parts.append(draw.randbytes(draw.randrange(30)))
        else:
            parts.append(_number(draw, field["name"], SIZES[field["type"]], odd))
    return b"".join(parts)


def _damaged(draw: random.Random, data: bytes) -> bytes:
    at = draw.randrange(len(data))
    match draw.randrange(4):
        case 0:
            return data[:at] + bytes([data[at] ^ 1 << draw.randrange(8)]) + data[at + 1 :]
        case 1:
            return data[:at]
        case 2:
            return draw.randbytes(draw.randrange(1, 20)) + data
        case _:
            return data[:at] + data[draw.randrange(at, len(data)) :]


def conversation(draw: random.Random, length: int) -> list[tuple[bytes, bool]]:
    """Return the bytes of random requests, each with whether they were damaged."""
    odd = draw.choice([0.0, 0.0, 0.1])
    damage = draw.choice([0.0, 0.0, 0.2])
    said = list[tuple[bytes, bool]]()
    for _ in range(length):
        packet_id = draw.choice(REQUESTS)
        data = frame(packet_id, content(draw, PACKETS[packet_id]["fields"], odd))
        is_damaged = draw.random() < damage
        said.append((_damaged(draw, data) if is_damaged else data, is_damaged))
    return said
