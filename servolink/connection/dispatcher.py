"""ResponseDispatcher: the receiving half of a connection, from bytes to waiting calls."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from logging import DEBUG
from typing import Any, Protocol

from servolink.connection.call import Call, Content, Settled, Slot
from servolink.connection.core import ConnectionCore
from servolink.connection.explain import lost, overtaken
from servolink.connection.scheduler import Load
from servolink.connection.state import State
from servolink.connection.taps import FrameLog, is_logged
from servolink.connection.times import QUICK
from servolink.connection.watchdog import ResponseWatchdog
from servolink.errors import ConnectionLost, DecodeError
from servolink.protocol import (
    MAGIC,
    OVERHEAD,
    ButtonEventResponse,
    ByteOrder,
    Frame,
    FrameParser,
    LenientParser,
    encode_frame,
)

_RARE = MAGIC[-1]
_MOST_EARLY = 4096  # bytes


class OpeningUnderWay(Protocol):
    """Opening of a connection, as far as it is told what comes (see `Opening`)."""

    task: asyncio.Task[None] | None

    def seen(self, chunk: bytes) -> None:
        """Take bytes of the line as evidence."""

    def heard(self, packet_id: int, content: bytes) -> None:
        """Take a response into account."""

    def heard_event(self) -> None:
        """Take a button event as a sign of life."""

    def begin_again(self) -> None:
        """Draw a new word: a stop was sent."""

    def end(self, error: ConnectionLost) -> None:
        """End: the connection is lost."""


class ResponseDispatcher:
    """Receives from a transport, settles slots, wakes calls and delivers button events."""

    def __init__(self, core: ConnectionCore, *, ignore_extra: bool = False) -> None:
        """Settle the slots of `core`.

        `ignore_extra` ignores what responses have behind the content of the document.
        """
        self.on_event: Callable[[ButtonEventResponse], None] = lambda event: None
        self.on_end: Callable[[ConnectionLost], None] = lambda error: None
        self.on_several: Callable[[], None] = lambda: None
        """Called when several frames came at once: the tasks of their calls run in the next turn of the loop."""
        self.on_stranger: Callable[[int], None] = lambda packet_id: None
        """Called with the id of an unrequested packet."""
        self.opening: OpeningUnderWay | None = None
        """Opening that gets all responses; None in all states but `opening` and `reopening`."""
        self.early = bytearray()
        """First bytes received before the handshake begins."""
        self.over: asyncio.Future[None] = core.loop.create_future()
        """Done when the connection has ended."""
        self.frame_log = FrameLog(core.url, core.codec, core.loop.time)
        self._core = core
        self._slots = core.slots
        self._scheduler = core.scheduler
        self._load: Load | None = None  # when the present chunk came, while the depth is learnt
        self._parser = (LenientParser if ignore_extra else FrameParser)(core.codec.byte_order)
        self._parser.skipped = core.stats.skipped
        self._nested = NestedFrameFilter(core.codec.byte_order)
        self.watchdog = ResponseWatchdog(core, self._parser, self._take, self.lost)
        """Knows by when responses are due."""

    # --- from the transport -------------------------------------------------------------------------------------

    def data(self, chunk: bytes, /) -> None:
        """Take bytes from the transport."""
        core, scheduler = self._core, self._scheduler
        stats = core.stats
        stats.bytes_received += len(chunk)
        if core.taps.members:
            core.taps.received(chunk)
        heard_at = self.watchdog.heard_at = core.loop.time()
        self.frame_log.is_on = is_logged(DEBUG)
        if core.lifecycle.state is not State.READY:
            self._keep_evidence(chunk)
        frames = self._parser.feed(chunk)
        scheduler.hold()
        try:
            for frame in frames:
                content = frame[1]  # a byte is found in a tenth of the time of MAGIC
                if ((_RARE in content and MAGIC in content) or self._nested.inside) and self._nested.hides(frame):
                    stats.hidden += 1
                else:
                    self._take(frame)
            if (load := self._load) is not None:
                self._load = None
                scheduler.learn(load, heard_at)
        finally:
            scheduler.go_on()
        if len(frames) > 1:
            self.on_several()

    def _keep_evidence(self, chunk: bytes) -> None:
        """Keep what comes before a connection is ready: it explains why no board answers."""
        if self.opening is not None:
            self.opening.seen(chunk)
        elif self._core.lifecycle.state in {State.NEW, State.UNPROVED}:
            self.early += chunk[: _MOST_EARLY - len(self.early)]

    def lost(self, error: Exception | None, /) -> None:
        """End the connection: the transport has ended."""
        self.end(lost(self._core.url, error))

    # --- from the sending half ----------------------------------------------------------------------------------

    def leave(self, call: Call) -> None:
        """End a call. Without a response, the latest slot keeps the permit as long as a response is expected."""
        call.is_over = True
        slot, call.latest = call.latest, None  # else a cycle for the garbage collector
        if call.is_aside:
            self._scheduler.step_back()
            return
        if slot is not None and slot.open and not slot.overdue:
            if call.response is None:
                slot.holds_permit_of = call.packet
                return
            # An older slot got the response, most likely the response to this slot: no other is expected.
            self._slots.expire(slot)
        self._scheduler.release(call.packet)

    def open_stop(self, slot: Slot) -> None:
        """Open the slot of a stop. Responses to calls on the same lane can no longer be told from its response."""
        for other in slot.lane.slots:
            self.watchdog.mark_overdue(other)
            if other.call is not None and not other.call.is_over and not other.is_fence:
                other.call.error = overtaken(other.request)
                other.call.wake()
        self._slots.open_stop(slot)
        self._core.repeats.asked(slot.lane.response_id, counts=False)
        if self.opening is not None:
            self.opening.begin_again()

    def close_all(self) -> None:
        """Close all slots unanswered: the connection is opened again, or has ended."""
        self._report([(slot, None) for slot in self._slots.clear()])

    def end(self, error: ConnectionLost) -> None:
        """End the connection: all waiting calls get the first cause."""
        if not self._core.lifecycle.end(error):
            return
        opening, self.opening = self.opening, None
        self.over.set_result(None)
        self.watchdog.stop()
        if opening is not None:
            opening.end(error)
        self._scheduler.refuse_all(error.copy)
        self.close_all()
        self.on_end(error)

    # --- one frame ----------------------------------------------------------------------------------------------

    def _take(self, frame: Frame) -> None:  # noqa: C901 - a further call would cost each response time
        core, slots = self._core, self._slots
        core.stats.frames_received += 1
        self.watchdog.silence.since = None
        if self.frame_log.is_on:
            self.frame_log.received(frame)
        packet_id, content = frame
        lane = slots.lanes.get(packet_id)
        opening = self.opening
        if lane is not None:
            if core.repeats.is_on:
                core.repeats.heard(frame)
            if self._scheduler.learns and len(content) + OVERHEAD != lane.response_size:
                lane.heard(len(content) + OVERHEAD)
            if lane.slots and opening is None:
                slot = slots.only_origin(lane)
                if slot is None or slot.call is None or not self._answer(slot, slot.call, content):
                    self._settle(packet_id, content)
                return
        if packet_id == ButtonEventResponse.packet_id:
            core.stats.events_received += 1
            if opening is not None:
                opening.heard_event()
            self.on_event(core.codec.decode(packet_id, content))  # type: ignore[arg-type]  # the id says so
        elif opening is None:
            self._take_stray(frame, is_response=lane is not None)
        elif lane is not None:
            opening.heard(packet_id, content)

    def _take_stray(self, frame: Frame, *, is_response: bool) -> None:
        self._core.stats.unsolicited += 1
        if is_response and self._core.lifecycle.state is State.READY:
            self._core.repeats.stray(frame)
        self.on_stranger(frame[0])

    def _answer(self, slot: Slot, call: Call, content: bytes) -> bool:  # noqa: C901 - likewise
        """Pass a response to the call of the oldest slot of all, as `_settle` does for all cases in more steps.

        Return False, with nothing done, unless this is the first response, in time, to a call that waits for it.
        """
        if call.is_over or call.response is not None or slot.is_fence or slot.holds_permit_of is not None:
            return False
        core, request, sent_at = self._core, slot.request, slot.sent_at
        try:
            response: Any = core.codec.decode(request.packet_id + 1, content)
        except DecodeError:
            return False
        if not request.accepts(response):
            return False
        load = self._load
        if load is None and self._scheduler.learns:
            load = self._load = self._scheduler.load()
        self._slots.close_only_origin(slot)
        watchdog = self.watchdog
        heard_at, free_at = watchdog.heard_at, watchdog.free_at
        watchdog.free_at, watchdog.arrival = heard_at, None
        watchdog.answered_in_a_row += 1
        if load is not None:
            load.responses += 1
            if sent_at < free_at and not watchdog.has_expired:
                load.due += 1
                load.size += len(content) + OVERHEAD
                load.seconds += heard_at - free_at
            watchdog.has_expired = False
        seconds = heard_at - max(sent_at, free_at)
        if seconds > core.times.quick:
            core.times.record(request.packet_id, seconds)
        elif self._distrusts(call, seconds, is_single=sent_at >= free_at):
            return True
        core.stats.round_trips.append(heard_at - sent_at)
        call.open_slots -= 1
        call.response = response
        woken = call.woken
        if call.on_wake is not None:
            call.content = content
            call.on_wake(call)
        elif woken is not None and not woken.done():
            woken.set_result(None)
        return True

    def _distrusts(self, call: Call, seconds: float, *, is_single: bool) -> bool:
        """Learn from a response much quicker than all before; send a query again at once if it may be a copy."""
        times = self._core.times
        if seconds > 0.0:
            times.record(call.packet.packet_id, seconds)
        if not times.quick or not is_single:
            return False
        times.quick = QUICK * seconds
        if not call.packet.is_query or not self._core.repeats.suspect():
            return False
        call.open_slots -= 1
        call.unanswered += 1
        call.wake()
        return True

    def _settle(self, packet_id: int, content: bytes) -> None:
        core, slots, load = self._core, self._slots, self._load
        decoded: Content
        try:
            decoded = core.codec.decode(packet_id, content)  # type: ignore[assignment]  # lanes are response ids
        except DecodeError as error:
            core.stats.undecodable += 1
            decoded = error
        if load is None and self._scheduler.learns:
            load = self._load = self._scheduler.load()
        settled = slots.settle(packet_id, decoded)
        if slots.answer_twice:
            core.stats.repeated = slots.repeated
        if settled is None:
            core.stats.mismatched += 1
            core.repeats.stray((packet_id, content))
            return
        watchdog = self.watchdog
        heard_at, free_at = watchdog.heard_at, watchdog.free_at
        if settled:
            slot, answer = settled[-1]
            call = slot.call
            if call is not None and call.on_wake is not None and answer is decoded:
                call.content = content
            watchdog.free_at, watchdog.arrival = heard_at, None
            if load is not None:
                if slot.sent_at < free_at and not watchdog.has_expired:
                    load.due += 1
                    load.size += len(content) + OVERHEAD
                    load.seconds += heard_at - free_at
                watchdog.has_expired = False
        self._report(settled, free_at, load)

    def _report(self, settled: list[Settled], free_at: float = 0.0, load: Load | None = None) -> None:
        """Notify the calls of slots that are over; then further requests may be sent.

        The board was free to respond to the slot that was answered from `free_at` on. With `load`, the depth is learnt.
        """
        for slot, content in settled:
            call = slot.call
            if content is None:
                self._lost_one(slot, load)
            else:
                self._answered(slot, call, free_at, load)
            if slot.holds_permit_of is not None:
                self._scheduler.release_held(slot)
            if call is None:
                continue
            if slot.is_fence:
                call.wake()
                continue
            call.open_slots -= 1
            if call.is_over or call.response is not None:
                self._core.stats.late_responses += content is not None
            elif content is None or isinstance(content, DecodeError):
                call.fault = content or call.fault
                if not call.open_slots or content is not None:
                    call.unanswered += 1
                    call.wake()
            else:
                self._core.stats.round_trips.append(self.watchdog.heard_at - slot.sent_at)
                call.response = content
                call.wake()

    def _lost_one(self, slot: Slot, load: Load | None) -> None:
        """Learn from a slot that is over without a response."""
        self.watchdog.answered_in_a_row = 0
        if load is not None and not slot.overdue:  # an overdue slot was counted before
            load.climb.lost()

    def _answered(self, slot: Slot, call: Call | None, free_at: float, load: Load | None) -> None:
        """Learn from the response to a slot."""
        self.watchdog.answered_in_a_row += 1
        if call is not None and call.response is not None:
            self._core.times.late()  # the call had a response already
        elif not slot.overdue:  # a response to an overdue slot may belong to another sending
            seconds = self.watchdog.heard_at - max(slot.sent_at, free_at)
            if seconds > 0.0:  # a response in one chunk with another has no known time
                self._core.times.record(slot.request.packet_id, seconds)
        elif call is None or call.is_over:
            self._core.times.late()
        if load is not None and not slot.is_fence:
            load.responses += 1


class NestedFrameFilter:
    """Tells frames inside another frame, such as in a caption, from frames of the board.

    The parser returns those right behind the frame around them, in order.
    """

    def __init__(self, byte_order: ByteOrder) -> None:
        """Start without a frame."""
        self._byte_order: ByteOrder = byte_order
        self.inside = b""
        """Rest of the latest frame behind the inner frames returned so far; empty if no frame begins inside."""

    def hides(self, frame: Frame) -> bool:
        """Return whether `frame` begins inside the latest frame. If not, remember `frame` as the latest."""
        data = encode_frame(*frame, self._byte_order)
        begins = self._beginning(data)
        if begins is None:
            self.inside = data[1:] if MAGIC in frame[1] else b""
            return False
        self.inside = self.inside[begins + len(data) :]
        return True

    def _beginning(self, data: bytes) -> int | None:
        """Return the place of `data` in the latest frame, whole or up to the end of the frame."""
        at = self.inside.find(MAGIC)
        while at >= 0:
            if data.startswith(self.inside[at : at + len(data)]):
                return at
            at = self.inside.find(MAGIC, at + 1)
        return None
