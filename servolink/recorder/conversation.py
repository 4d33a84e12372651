"""Conversation in a recording: each frame sent, with the response of the board, and the times."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from servolink.errors import DecodeError, RecordingError
from servolink.protocol import (
    Codec,
    Frame,
    FrameParser,
    Packet,
    Query,
    Request,
    Response,
    SetAngleUnitRequest,
    TransmissionModeSettingRequest,
    encode_frame,
)
from servolink.recorder.channels import Message, Wire
from servolink.recorder.reading import Entry, Recording, Selection

_PATIENCE = 3.0  # seconds; a later response belongs to no request
_MOST_FRAMES = 1_000_000

SETUP = (Query, SetAngleUnitRequest, TransmissionModeSettingRequest)
"""Requests allowed more or less often than in the recording, as each connection begins with some."""


@dataclass(slots=True)
class Asked:
    """Frame sent to the board, with the response."""

    number: int
    """Number among all sent frames, from 0."""
    seconds: float
    frame: Frame
    packet: Packet | None
    """Decoded frame; None if decoding fails."""
    answer: Said | None = None
    """Response of the board; None without a response."""

    @property
    def is_command(self) -> bool:
        """Whether a replay must send this packet again, unchanged and in order."""
        return not isinstance(self.packet, SETUP)


@dataclass(slots=True)
class Said:
    """Received frame together with the noise before, or the last noise."""

    seconds: float
    """Seconds since the recording began."""
    data: bytes


@dataclass(slots=True)
class Conversation:
    """All frames of a recording, requested and unrequested."""

    codec: Codec
    asked: list[Asked] = field(default_factory=list)
    unasked: list[tuple[int, Said]] = field(default_factory=list)
    """Frames without a request, such as button events, each with the number of commands before."""

    def commands(self) -> Iterator[Asked]:
        """Yield all sent packets except queries."""
        return (asked for asked in self.asked if not isinstance(asked.packet, Query))


def read_conversation(recording: Recording) -> Conversation:
    """Return the conversation in a recording. Raise RecordingError for a recording without one."""
    reader = _ConversationReader(recording.codec)
    for entry in recording.entries(Selection(topics=frozenset({"/wire"}))):
        reader.take(entry)
    reader.finish()
    if not reader.found.asked:
        raise RecordingError(f"{recording.path} cannot be replayed: no sent packets are recorded")
    return reader.found


class _ConversationReader:
    """Combines the two directions of a line."""

    def __init__(self, codec: Codec) -> None:
        self.found = Conversation(codec)
        self._codec = codec
        self._sent = FrameParser(codec.byte_order)
        self._received = FrameParser(codec.byte_order, keep_skipped=True)
        self._waiting: dict[int, deque[Asked]] = {}  # by the id of the response
        self._commands = 0
        self._noise = b""
        self._seconds = 0.0

    def take(self, entry: Entry[Message]) -> None:
        assert isinstance(entry.message, Wire)  # noqa: S101 - only that was selected
        self._seconds = entry.seconds
        if entry.message.direction == "sent":
            self._take_sent(self._sent.feed(entry.message.data))
        else:
            self._take_received(self._received.feed(entry.message.data))

    def finish(self) -> None:
        self._take_sent(self._sent.finish())
        self._take_received(self._received.finish())
        if self._noise:
            self._say(b"")

    def _take_sent(self, frames: Iterable[Frame]) -> None:
        for frame in frames:
            if len(self.found.asked) >= _MOST_FRAMES:
                raise RecordingError(f"the recording has more than {_MOST_FRAMES:,} frames: too many to replay")
            asked = Asked(len(self.found.asked), self._seconds, frame, decoded(self._codec, frame))
            self.found.asked.append(asked)
            self._commands += asked.is_command
            if isinstance(asked.packet, Request):
                self._waiting.setdefault(frame[0] + 1, deque()).append(asked)

    def _take_received(self, frames: list[Frame]) -> None:
        at = 0
        for before, noise, _ in self._received.take_skipped():
            self._take_responses(frames[at:before])
            self._noise += noise
            at = before
        self._take_responses(frames[at:])

    def _take_responses(self, frames: Iterable[Frame]) -> None:
        for frame in frames:
            data = encode_frame(*frame, self._codec.byte_order)
            asked = self._asked_for(frame)
            if asked is None:
                self._say(data)
            else:
                asked.answer = Said(self._seconds, self._noise + data)
                self._noise = b""

    def _say(self, data: bytes) -> None:
        if len(self.found.unasked) < _MOST_FRAMES:
            self.found.unasked.append((self._commands, Said(self._seconds, self._noise + data)))
        self._noise = b""

    def _asked_for(self, frame: Frame) -> Asked | None:
        """Return the oldest request possibly answered by a frame."""
        waiting = self._waiting.get(frame[0], deque())
        response = decoded(self._codec, frame)
        while waiting and waiting[0].seconds < self._seconds - _PATIENCE:
            waiting.popleft()
        for asked in waiting:
            request = asked.packet
            if isinstance(request, Request) and isinstance(response, Response) and request.accepts(response):
                waiting.remove(asked)
                return asked
        return None


def decoded(codec: Codec, frame: Frame) -> Packet | None:
    """Return the packet in a frame; None for a damaged frame."""
    try:
        return codec.decode(*frame)
    except DecodeError:
        return None
