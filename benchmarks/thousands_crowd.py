"""Stand-ins for thousands of boards: what their bridges say to a broker, without bridges, hubs and boards.

Each board has a connection with a last will, says that it is there and sends its pulse each second. Ten boards share
one more connection, which answers stops as the bridges of a machine do. Packets are written and read by hand: thousands
of threads of paho-mqtt would take longer than the program that is measured.
"""

from __future__ import annotations

import asyncio
import itertools
import socket
import struct
from collections.abc import Iterator, Sequence
from typing import Any

import msgspec
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

from servolink.fleet.access import parse_broker
from servolink.fleet.topics import (
    OFFLINE,
    ONLINE,
    BoardNow,
    BoardResult,
    BoardTopic,
    Stop,
    StopOver,
    Stored,
    Topics,
)

PER_MACHINE = 10
"""Boards that share a connection for stops."""
_TOPICS = Topics()
_AT_ONCE = 50  # machines that connect together
_CONNECT, _PUBLISH, _CONFIRM, _SUBSCRIBE, _SUBSCRIBED, _PING = 0x10, 0x30, 0x40, 0x82, 0x90, 0xC0
_QOS_1, _RETAIN = 0x02, 0x01
_KEEPALIVE = 10


def _text(content: str) -> bytes:
    return struct.pack("!H", len(content.encode())) + content.encode()


def _packet(head: int, body: bytes) -> bytes:
    size, length = len(body), bytearray()
    while size > 0x7F:
        length.append(size & 0x7F | 0x80)
        size >>= 7
    return bytes((head, *length, size)) + body


def _packets(data: bytearray) -> Iterator[tuple[int, bytes]]:
    """Take the complete packets out of `data`. Yield the head and the body of each."""
    while True:
        size, begin = 0, 1
        while begin < len(data) and (begin == 1 or data[begin - 1] > 0x7F):
            size |= (data[begin] & 0x7F) << 7 * (begin - 1)
            begin += 1
        if begin == 1 or data[begin - 1] > 0x7F or len(data) < begin + size:
            return
        yield data[0], bytes(data[begin : begin + size])
        del data[: begin + size]


class Link(asyncio.Protocol):
    """A connection with the broker."""

    def __init__(self, identifier: str, topics: Sequence[tuple[str, int]], will: str | None = None) -> None:
        """Subscribe to `topics`, with their QoS; `will` is the topic of the last will."""
        self.is_ready = asyncio.get_running_loop().create_future()
        self._topics = topics
        self._ids = itertools.cycle(range(1, 0xFFFF))
        self._received = bytearray()
        flags = 0x02 if will is None else 0x2E  # clean start; will with QoS 1, retained
        last = b"" if will is None else b"\0" + _text(will) + _text(OFFLINE)
        head = _text("MQTT") + struct.pack("!BBHB", 5, flags, _KEEPALIVE, 0)
        self._greeting = _packet(_CONNECT, head + _text(identifier) + last)

    async def open(self, url: str) -> None:
        """Connect, and return when the broker has confirmed the subscriptions."""
        address = parse_broker(url)
        await asyncio.get_running_loop().create_connection(lambda: self, address.host, address.port)
        await self.is_ready

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Greet the broker."""
        assert isinstance(transport, asyncio.Transport)  # noqa: S101 - it is a socket
        transport.get_extra_info("socket").setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._transport = transport
        filters = b"".join(_text(topic) + bytes((qos,)) for topic, qos in self._topics)
        self.write(self._greeting + _packet(_SUBSCRIBE, struct.pack("!HB", 1, 0) + filters))

    def write(self, data: bytes) -> None:
        """Send packets."""
        self._transport.write(data)

    def publication(self, topic: str, payload: str | bytes, *, qos: int = 1, retain: bool = False) -> bytes:
        """Return a packet for `write`."""
        content = payload.encode() if isinstance(payload, str) else payload
        number = struct.pack("!H", next(self._ids)) if qos else b""
        head = _PUBLISH | (_QOS_1 if qos else 0) | (_RETAIN if retain else 0)
        return _packet(head, _text(topic) + number + b"\0" + content)

    def ping(self) -> None:
        """Show the broker that this program is there."""
        self.write(_packet(_PING, b""))

    def data_received(self, data: bytes) -> None:
        """Handle the packets that are complete."""
        self._received += data
        for head, body in _packets(self._received):
            if head & 0xF0 == _PUBLISH:
                end = 2 + int.from_bytes(body[:2], "big")
                topic, content = body[2:end].decode(), end
                if head & _QOS_1:
                    content += 2
                    self.write(_packet(_CONFIRM, body[end:content]))
                self.heard(topic, body[content:])
            elif head == _SUBSCRIBED and not self.is_ready.done():
                self.is_ready.set_result(None)

    def heard(self, topic: str, content: bytes) -> None:
        """Take properties and payload of a message; a board takes none."""


class Board(Link):
    """The connection of a board."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._words = itertools.count(1)
        self._pulse_topic = _TOPICS.board(name, "pulse")
        kinds: tuple[BoardTopic, ...] = ("cmd", "pulse", "available")
        topics = [(_TOPICS.board(name, kind), 1) for kind in kinds]
        super().__init__(f"servolink/{name}", topics, _TOPICS.board(name, "available"))

    def announce(self) -> None:
        """Say that the board is there, and in which state."""
        stored = tuple(Stored(number, f"Action {number}") for number in range(1, 9))
        now = BoardNow(
            board=self.name,
            host=f"machine-{self.name}",
            version="0.1.0",
            connection="connected",
            allow="edit",
            servos=16,
            actions=stored,
            at=0.0,
        )
        self.write(
            self.publication(_TOPICS.board(self.name, "available"), ONLINE, retain=True)
            + self.publication(_TOPICS.board(self.name, "state"), msgspec.json.encode(now), retain=True)
        )

    def rest(self) -> None:
        """Read nothing until `wake`: what the broker says to boards one by one would take longer than a stop."""
        self._transport.pause_reading()

    def wake(self) -> None:
        """Read what has come."""
        self._transport.resume_reading()

    def pulse(self, qos: int = 0) -> str:
        """Send the next word of the pulse; return it."""
        word = f"{self.name[-8:]}-{next(self._words)}"
        self.write(self.publication(self._pulse_topic, word, qos=qos, retain=True))
        return word


class Machine(Link):
    """The connection of a machine, for stops of all its boards."""

    def __init__(self, boards: Sequence[Board]) -> None:
        self.boards = boards
        topics = [(_TOPICS.board(board.name, "stop"), 1) for board in boards]
        super().__init__(f"servolink/_fleet/{boards[0].name}", topics)
        self._by_topic = dict(zip((topic for topic, _ in topics), boards, strict=True))

    def heard(self, topic: str, content: bytes) -> None:
        """Answer a stop: a board sends a word first, as a bridge does."""
        properties: Any = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]
        _, size = properties.unpack(content)
        stop, board = msgspec.json.decode(content[size:], type=Stop), self._by_topic[topic]
        result = BoardResult(id=stop.id, board=board.name, ok=True, result=StopOver(board.pulse(qos=1)))
        self.write(self.publication(properties.ResponseTopic, msgspec.json.encode(result)))


class Crowd:
    """Boards at a broker."""

    def __init__(self, count: int) -> None:
        """Make `count` boards, named `crowd0` and so on."""
        boards = [Board(f"crowd{number}") for number in range(count)]
        self._machines = [Machine(boards[at : at + PER_MACHINE]) for at in range(0, count, PER_MACHINE)]

    async def join(self, url: str) -> None:
        """Connect all boards."""
        for at in range(0, len(self._machines), _AT_ONCE):
            await asyncio.gather(*(self._begin(machine, url) for machine in self._machines[at : at + _AT_ONCE]))

    async def _begin(self, machine: Machine, url: str) -> None:
        for board in machine.boards:
            await board.open(url)
            board.announce()
        await machine.open(url)

    async def live(self) -> None:
        """Send the pulses, spread over each second, in an endless loop."""
        while True:
            pause = 1.0 / max(1, len(self._machines))
            due = asyncio.get_running_loop().time()
            for machine in self._machines:
                machine.ping()
                for board in machine.boards:
                    board.wake()
                    board.pulse()
                due += pause
                await asyncio.sleep(due - asyncio.get_running_loop().time())
                for board in machine.boards:
                    board.rest()
