"""Program: session of a program; FrameProgram: session of a program that sends and receives bytes."""

from __future__ import annotations

import asyncio
import logging
import secrets
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from typing import Protocol

from servolink.client import ButtonEvent
from servolink.control import ProgramStatus, Role, StoppedNotice
from servolink.errors import DecodeError, escape
from servolink.hub.rules.exchanges import Exchange, HeardStops, ProgramCounters, ProgramQueue
from servolink.motion import NO_TICKET, AngleUnit, ServoUnits, StopCounter
from servolink.protocol import (
    Codec,
    Effect,
    FrameParser,
    Packet,
    Response,
    TransmissionModeSettingRequest,
    TransmissionModeSettingResponse,
    encode_frame,
)

MOST_HELD = 256 * 1024
"""Most bytes in unfinished requests of a program, which is not read beyond the limit. There is room
for more than a board answers in a while, because a stop that was not read is not found."""
REQUEST_BYTES = 256
"""Bytes counted for a request, besides the content: there is room for a thousand short requests."""

_logger = logging.getLogger(__name__)

_SILENCE = 0.25  # seconds until half a frame is given up, as by a board


class Exchanger(Protocol):
    """Receiver of the requests of programs, such as a hub."""

    stops: StopCounter
    """Stops of servos, which issues the tickets of motions."""

    def ask(self, exchange: Exchange) -> None:
        """Take a request, and call `exchange.program.finish` at the end."""

    def ask_stop(self, exchange: Exchange) -> None:
        """Take a stop, send the stop before everything else, and call `exchange.program.finish` at the end."""

    def withdraw(self, exchange: Exchange) -> bool:
        """Drop a request that was not sent yet. Return whether the request was unsent."""
        ...

    def forget(self, program: Program) -> None:
        """Drop all unsent requests of a program that has left."""

    def ask_waiting(self) -> None:
        """Send the requests that may be sent again."""


class Program(ABC):
    """Session of a program at a hub."""

    def __init__(
        self,
        hub: Exchanger,
        codec: Codec,
        *,
        who: str,
        door: str,
        role: Role,
        unit: AngleUnit,
        session_id: str | None = None,
    ) -> None:
        self.session_id = session_id or secrets.token_hex(16)
        """Identifier that ties the connections of the program together; shown in the status."""
        self.who = who
        """Name for people; must be escaped before display."""
        self.door = door
        self.role = role
        self.codec = codec
        self.units = ServoUnits(unit)
        """Units of the angles that the program sends and reads."""
        self.dead_man: float | None = None
        """Seconds without a beat until the board is stopped, once a motion has taken the lease; None for no beats."""
        self.is_subscribed = False
        """Whether button events are sent to the program (3.4.7)."""
        self.counters = ProgramCounters()
        self.queue = ProgramQueue()
        """Unsent requests of the program."""
        self.has_left = False
        self.on_end: Callable[[], None] | None = None
        """Called when the hub ends the session."""
        self._hub = hub
        self._now = asyncio.get_running_loop().time
        self._joined_at = self._now()

    @property
    @abstractmethod
    def waiting(self) -> int:
        """How many of its requests are not over."""

    @property
    def garbage(self) -> int:
        """How many bytes were received that belong to no frame."""
        return 0

    def status(self) -> ProgramStatus:
        """Return name, role and counters of the session."""
        counters = self.counters
        return ProgramStatus(
            self.session_id,
            self.who,
            self.door,
            str(self.role),
            self._now() - self._joined_at,
            self.waiting,
            counters.requests,
            counters.responses,
            counters.unanswered,
            counters.refused,
            counters.ignored,
            self.garbage,
        )

    def put(self, exchange: Exchange) -> None:
        """Queue a request at the hub; stops are sent first."""
        if exchange.packet.effect is Effect.STOPS:
            self._hub.ask_stop(exchange)
        else:
            self._hub.ask(exchange)

    def leave(self) -> None:
        """End the session; may be called again. Unsent requests are dropped, sent ones end without a response."""
        if self.has_left:
            return
        self.has_left = True
        self._hub.forget(self)

    @abstractmethod
    def finish(
        self, exchange: Exchange, response: Packet | None, content: bytes | None = None, codec: Codec | None = None
    ) -> None:
        """Finish a request with a response, or with None; `content` is how `codec` would write it."""

    @abstractmethod
    def push(self, event: ButtonEvent) -> None:
        """Pass on a button event."""


class FrameProgram(Program):
    """Session of a program with frames. Responses leave strictly in the order of requests."""

    def __init__(
        self,
        hub: Exchanger,
        sink: Callable[[bytes], None],
        codec: Codec,
        *,
        who: str,
        door: str,
        role: Role,
        unit: AngleUnit,
        session_id: str | None = None,
    ) -> None:
        super().__init__(hub, codec, who=who, door=door, role=role, unit=unit, session_id=session_id)
        self.mode = 1
        """Transmission mode (3.1.1); a program in mode 0 gets only the response that sets mode 1."""
        self.on_room: Callable[[], None] | None = None
        """Called when the program may be read again after `is_full`."""
        self.stops_heard = HeardStops()
        """Stops that the program has acknowledged among its frames."""
        self._sink = sink
        self._parser = FrameParser(codec.byte_order)
        self._received_at = 0.0
        self._open: deque[Exchange] = deque()  # unfinished requests, and finished ones behind them
        self._held = 0  # bytes held by these requests
        self._was_full = False

    @property
    def is_full(self) -> bool:
        """Whether too many requests are unfinished to read more of them now."""
        return self._held > MOST_HELD

    @property
    def waiting(self) -> int:
        """Number of unfinished requests of the program."""
        return len(self._open)

    @property
    def garbage(self) -> int:
        """Number of received bytes that belong to no frame."""
        skipped = self._parser.skipped
        return sum(skipped.values()) - skipped[FrameParser.PADDING]

    # --- from the program ---------------------------------------------------------------------------------------

    def receive(self, data: bytes) -> None:
        """Take bytes of the program, cut and damaged anyhow; at most some KiB at once, and none while `is_full`."""
        if self.has_left:
            return
        now = self._now()
        if now - self._received_at >= _SILENCE:
            # Half a frame and then silence: the sender has given up, but the claimed length could swallow
            # everything that follows.
            while self._parser.partial_frame is not None:
                for frame in self._parser.abandon_frame():
                    self._take(*frame)
        self._received_at = now
        for frame in self._parser.feed(data):
            self._take(*frame)
        if self._held > MOST_HELD:
            self._was_full = True

    def leave(self) -> None:
        """End the session; may be called again. Unsent requests are dropped, sent ones end without a response."""
        super().leave()
        self.on_room = None
        self._open.clear()
        self._held = 0

    def _take(self, packet_id: int, content: bytes) -> None:
        self.counters.requests += 1
        packet = self._request(packet_id, content)
        if packet is None:
            self.counters.ignored += 1
            return
        if (number := StoppedNotice.number_heard(packet)) is not None:
            self.stops_heard.heard = number
            return
        size = REQUEST_BYTES + len(content)
        ticket = NO_TICKET if packet.is_query else self._hub.stops.ticket(who=self.session_id)
        if self.stops_heard.is_behind:
            ticket = ticket.expired()
        exchange = Exchange(self, packet, ticket, asked_at=self._received_at, is_silent=self.mode != 1, size=size)
        self._open.append(exchange)
        self._held += size
        if isinstance(packet, TransmissionModeSettingRequest):
            self._set_mode(exchange, packet)
        else:
            self.put(exchange)

    def _request(self, packet_id: int, content: bytes) -> Packet | None:
        """Return the packet of a frame, None if a board would ignore it."""
        try:
            packet = self.codec.decode(packet_id, content)
        except DecodeError:
            return None
        if isinstance(packet, Response):
            return None
        if self.mode == 1 or packet.effect is Effect.STOPS or isinstance(packet, TransmissionModeSettingRequest):
            return packet
        return None

    def _set_mode(self, exchange: Exchange, packet: TransmissionModeSettingRequest) -> None:
        if packet.is_in_range():
            self.mode = packet.mode
        exchange.is_silent = False
        self.finish(exchange, TransmissionModeSettingResponse(self.mode))

    def pause(self) -> None:
        """Hold back the program's requests, except stops: the program does not read responses."""
        self.queue.is_unread = True

    def resume(self) -> None:
        """Ask again: the program reads."""
        self.queue.is_unread = False
        if not self.has_left:
            self._hub.ask_waiting()

    # --- to the program -----------------------------------------------------------------------------------------

    def finish(
        self, exchange: Exchange, response: Packet | None, content: bytes | None = None, codec: Codec | None = None
    ) -> None:
        """Finish a request with a response, or with None; `content` is the response in the encoding of `codec`."""
        frame = None
        if response is not None and content is not None and codec and self.codec.byte_order == codec.byte_order:
            # Content as received: captions keep undecodable bytes, and encoding again takes longer.
            frame = encode_frame(response.packet_id, content, codec.byte_order)
        elif response is not None and not self.has_left:
            frame = self.codec.encode(response, unchecked=True)
        self.finish_with(exchange, frame)

    def finish_with(self, exchange: Exchange, frame: bytes | None) -> None:
        """Finish a request with the frame of a response, or with None."""
        if exchange.is_over or self.has_left:
            return
        exchange.frame = None if exchange.is_silent else frame
        exchange.is_over = True
        waiting = self._open
        if waiting[0] is not exchange:
            return
        frames: list[bytes] = []
        while waiting and waiting[0].is_over:
            over = waiting.popleft()
            self._held -= over.size
            if over.frame is not None:
                frames.append(over.frame)
        if frames:
            self._send(frames)
        if self._was_full and not self.is_full:
            self._was_full = False
            self._received_at = self._now()  # the hub did not read: this is not a pause within a frame
            if self.on_room is not None:
                self.on_room()

    def push(self, event: ButtonEvent) -> None:
        """Send a button event, unless the program is in transmission mode 0."""
        if not self.has_left and self.mode == 1:
            self._send([self.codec.encode(event, unchecked=True)])

    def _send(self, frames: list[bytes]) -> None:
        self.counters.responses += len(frames)
        try:
            self._sink(frames[0] if len(frames) == 1 else b"".join(frames))
        except Exception:
            # A defect of a door. The board and the other programs should go on all the same.
            _logger.exception("%s cannot be answered any more", escape(self.who))
            self.leave()
