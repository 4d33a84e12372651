"""Facts that a conversation shows about a board, collected packet by packet in bounded memory."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Any, NamedTuple

from servolink.doctor.spy.scanner import Scanner, Seen
from servolink.errors import DecodeError
from servolink.protocol import (
    PACKETS,
    ButtonEventResponse,
    ByteOrder,
    Codec,
    Packet,
    QueryMemorySizeResponse,
    Request,
    Response,
    Result,
    SetAngleUnitRequest,
    SetServoParameterRequest,
    TransmissionModeSettingRequest,
    TransmissionModeSettingResponse,
    layout,
)
from servolink.recorder import Direction, Times

PATIENCE = 3.0
"""Seconds after the request until a response counts as missing."""
_REPEATED = 0.2  # seconds within which an equal request counts as a repetition, not as a second question
_MOST_WAITING = 1024
_MOST_CAPTIONS = 5000
_MOST_IDS = 1000
_MOST_RUNS = 200
_MOST_UNKNOWN = 50
_MOST_MODES = 12
_ID_FIELDS = {"servo_id", "servo_id_list", "action_id", "macro_id", "table_id", "button_id", "project_id"}


class Passed(NamedTuple):
    """Packet or other bytes, for a live display."""

    seconds: float
    direction: Direction
    seen: Seen
    packet: Packet | None = None
    """Decoded packet; None for bytes that cannot be decoded."""


class Unknown(NamedTuple):
    """Kind of packet that the document does not define."""

    direction: Direction
    packet_id: int
    byte_order: ByteOrder
    size: int
    """Bytes of its content."""


class Mode(NamedTuple):
    """Setting of the transmission mode, and the traffic before."""

    wanted: int
    asked_before: int
    """Other requests before it."""
    answered_before: int


@dataclass(slots=True)
class _Waiting:
    """A request without a response so far."""

    seconds: float
    seen: Seen
    request: Request[Response]
    is_overtaken: bool = False
    """Whether a later request has its response already: boards answer in order, so the missing one is probably lost."""


class Runs:
    """Sequence of requests, with equal neighbours as a single step: `AddAction` 12 times."""

    def __init__(self) -> None:
        self.runs: list[list[Any]] = []
        self.is_cut = False

    def add(self, name: str) -> None:
        """Add the next step of the conversation."""
        if self.runs and self.runs[-1][0] == name:
            self.runs[-1][1] += 1
        elif len(self.runs) < _MOST_RUNS:
            self.runs.append([name, 1])
        else:
            self.is_cut = True


class Learner:
    """Reads both directions of a conversation."""

    def __init__(self, caption_encoding: str = "utf-8") -> None:
        """Start at the beginning of a conversation. The encoding is for captions in the display."""
        self._codecs = {order: Codec(order, caption_encoding) for order in _BYTE_ORDERS}
        self._scanners: dict[Direction, Scanner] = {"sent": Scanner(), "received": Scanner()}
        self._waiting: deque[_Waiting] = deque()
        self._last_response: float | None = None
        self.size: Counter[str] = Counter()
        """Bytes, by direction."""
        self.orders: dict[str, Counter[ByteOrder]] = {"sent": Counter(), "received": Counter()}
        """Packets, by direction and byte order."""
        self.packets: Counter[str] = Counter()
        """Number of packets, by name."""
        self.modes: list[Mode] = []
        """First settings; `mode_settings` counts all of them."""
        self.echoes: list[int] = []
        """First modes reported by the board; `mode_echoes` counts all of them."""
        self.captions: set[bytes] = set()
        self.ids: dict[str, set[int]] = {}
        self.times: dict[str, Times] = {}
        """Response times, by request."""
        self.all_times = Times()
        self.gaps = Times()
        """From a response to the next request."""
        self.most_under_way = 0
        self.writes, self.reads = Runs(), Runs()
        self.refused: Counter[str] = Counter()
        """Number of requests with the result 0."""
        self.unanswered: Counter[str] = Counter()
        self.unsolicited: Counter[str] = Counter()
        self.unknown: dict[Unknown, tuple[int, bytes]] = {}
        """How often, and the first content."""
        self.undecodable: Counter[str] = Counter()
        self.out_of_range: Counter[str] = Counter()
        self.damaged: Counter[str] = Counter()
        self.noise: Counter[str] = Counter()
        """Bytes outside of frames, by direction."""
        self.first_noise: dict[str, bytes] = {}
        self.memory_sizes: set[int] = set()
        self.stops: Counter[tuple[int, int, int]] = Counter()
        """Servo, is_start and is_hold of requests."""
        self.angle_units: Counter[tuple[int, int]] = Counter()

    @property
    def byte_order(self) -> ByteOrder | None:
        """The byte order of the board's packets, or of the program's until the board has said anything."""
        for direction in ("received", "sent"):
            if found := self.orders[direction].most_common(1):
                return found[0][0]
        return None

    @property
    def mode_settings(self) -> int:
        """How often the transmission mode was set."""
        return self.packets[TransmissionModeSettingRequest.__name__]

    @property
    def mode_echoes(self) -> int:
        """Number of times that the board reported its mode."""
        return self.packets[TransmissionModeSettingResponse.__name__]

    def feed(self, seconds: float, direction: Direction, data: bytes) -> list[Passed]:
        """Take bytes that passed; return the pieces that are complete by now."""
        self.size[direction] += len(data)
        return [self._take(seconds, direction, seen) for seen in self._scanners[direction].feed(seconds, data)]

    def finish(self, seconds: float) -> list[Passed]:
        """End the conversation: requests without a response by now are unanswered."""
        found = [
            self._take(seconds, direction, seen)
            for direction, scanner in self._scanners.items()
            for seen in scanner.finish()
        ]
        for waiting in self._waiting:
            self.unanswered[_name(waiting.request)] += 1
        self._waiting.clear()
        return found

    def _take(self, seconds: float, direction: Direction, seen: Seen) -> Passed:
        packet = None
        match seen.kind:
            case "packet":
                packet = self._packet(seconds, direction, seen)
            case "unknown":
                kind = Unknown(direction, seen.packet_id, seen.byte_order, len(seen.content))
                count, first = self.unknown.get(kind, (0, seen.content))
                if count or len(self.unknown) < _MOST_UNKNOWN:
                    self.unknown[kind] = count + 1, first
            case "damaged":
                self.damaged[direction] += 1
            case "noise":
                self.noise[direction] += len(seen.data)
                self.first_noise.setdefault(direction, seen.data[:32])
        return Passed(seconds, direction, seen, packet)

    def _packet(self, seconds: float, direction: Direction, seen: Seen) -> Packet | None:
        self.orders[direction][seen.byte_order] += 1
        declared = PACKETS[seen.packet_id]
        try:
            packet = self._codecs[seen.byte_order].decode(seen.packet_id, seen.content)
        except DecodeError:
            self.undecodable[declared.__name__] += 1
            return None
        self.packets[declared.__name__] += 1
        if len(self.captions) < _MOST_CAPTIONS:
            self.captions.update(layout(declared, seen.byte_order).captions_in(seen.content))
        self._note_ids(packet)
        if not packet.is_in_range():
            self.out_of_range[declared.__name__] += 1
        if isinstance(packet, Response):
            self._response(seconds, seen, packet)
        else:
            self._request(seconds, seen, packet)
        return packet

    # --- requests -----------------------------------------------------------------------------------------------

    def _request(self, seconds: float, seen: Seen, packet: Packet) -> None:
        match packet:
            case TransmissionModeSettingRequest() if len(self.modes) < _MOST_MODES:
                others = self.orders["sent"].total() - self.mode_settings
                self.modes.append(Mode(packet.mode, others, self.orders["received"].total() - self.mode_echoes))
            case SetServoParameterRequest():
                self.stops[packet.servo_id, packet.is_start, packet.is_hold] += 1
            case SetAngleUnitRequest():
                self.angle_units[packet.servo_id, packet.unit_type] += 1
        name = _name(packet)
        if name in _WRITES:
            self.writes.add(name)
        elif name in _READS:
            self.reads.add(name)
        if self._last_response is not None:
            self.gaps.add(seconds - self._last_response)
            self._last_response = None
        self._expire(seconds)
        for at, earlier in enumerate(self._waiting):
            if earlier.seen.data == seen.data and seconds - earlier.seconds > _REPEATED:
                del self._waiting[at]
                self.unanswered[name] += 1
                break
        if isinstance(packet, Request) and len(self._waiting) < _MOST_WAITING:
            self._waiting.append(_Waiting(seconds, seen, packet))
            under_way = sum(
                not waiting.is_overtaken and seconds - waiting.seconds <= _REPEATED for waiting in self._waiting
            )
            self.most_under_way = max(self.most_under_way, under_way)

    def _response(self, seconds: float, seen: Seen, packet: Response) -> None:
        match packet:
            case TransmissionModeSettingResponse() if len(self.echoes) < _MOST_MODES:
                self.echoes.append(packet.result)
            case QueryMemorySizeResponse():
                self.memory_sizes.add(len(seen.content))
        self._expire(seconds)
        for at, asked in enumerate(self._waiting):
            if asked.seen.packet_id + 1 == seen.packet_id and asked.request.accepts(packet):
                del self._waiting[at]
                for earlier in islice(self._waiting, at):
                    earlier.is_overtaken = True
                name = _name(asked.request)
                self.times.setdefault(name, Times()).add(seconds - asked.seconds)
                self.all_times.add(seconds - asked.seconds)
                self._last_response = seconds
                if isinstance(packet, Result) and not packet.result:
                    self.refused[name] += 1
                return
        self.unsolicited["button event" if isinstance(packet, ButtonEventResponse) else type(packet).__name__] += 1

    def _expire(self, seconds: float) -> None:
        while self._waiting and seconds - self._waiting[0].seconds > PATIENCE:
            self.unanswered[_name(self._waiting.popleft().request)] += 1

    def _note_ids(self, packet: Packet) -> None:
        for name, number in _ids(packet):
            known = self.ids.setdefault(name, set())
            if len(known) < _MOST_IDS:
                known.add(number)


def _ids(record: Any) -> Iterator[tuple[str, int]]:
    for name in record.__struct_fields__:
        found = getattr(record, name)
        if isinstance(found, tuple):
            for item in found:
                if isinstance(item, int):
                    yield name.removesuffix("_list"), item
                else:
                    yield from _ids(item)
        elif name in _ID_FIELDS:
            yield name, found


def _name(packet: Packet) -> str:
    return type(packet).__name__.removesuffix("Request")


_BYTE_ORDERS: tuple[ByteOrder, ...] = ("little", "big")
_STORED = ("3.1.2", "3.3.", "3.4.")
_CHANGES = ("Add", "Delete", "Clear", "Write", "SetActive")


def _stored(*verbs: str) -> set[str]:
    """Return the requests about stored content that begin with one of the verbs."""
    return {
        declared.__name__.removesuffix("Request")
        for declared in PACKETS.values()
        if declared.section.startswith(_STORED) and declared.__name__.startswith(verbs)
    }


_WRITES, _READS = _stored(*_CHANGES), _stored("Query")
