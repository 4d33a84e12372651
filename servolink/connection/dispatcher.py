"""ResponseDispatcher: the receiving half of a connection, from bytes to waiting calls."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from logging import DEBUG
from typing import Any

from servolink.connection.call import Call, Content, Settled, Slot
from servolink.connection.deadlines import ResponseTimes
from servolink.connection.explain import lost, overtaken, same
from servolink.connection.nested_frames import NestedFrameFilter
from servolink.connection.scheduler import Load, RequestScheduler
from servolink.connection.slots import Slots
from servolink.connection.state import Lifecycle, State
from servolink.connection.stats import Stats
from servolink.connection.taps import FrameLog, Taps, is_logged
from servolink.connection.watchdog import ResponseWatchdog
from servolink.errors import ConnectionLost, DecodeError
from servolink.protocol.codec import Codec
from servolink.protocol.frame import MAGIC, OVERHEAD, ByteOrder, Frame
from servolink.protocol.joystick import ButtonEventResponse
from servolink.protocol.parser import FrameParser

_READY = State.READY  # a global is faster than a member of an enum
_RARE = MAGIC[-1]
_MOST_EARLY = 4096  # bytes


class ResponseDispatcher:
    """Receives from a transport, settles slots, wakes calls and delivers button events."""

    def __init__(
        self,
        url: str,
        codec: Codec,
        lifecycle: Lifecycle,
        slots: Slots,
        scheduler: RequestScheduler,
        patience: float,
        now: Callable[[], float],
        stats: Stats,
        taps: Taps,
        *,
        ignore_extra: bool = False,
    ) -> None:
        """Settle `slots` with responses from `url`; after `patience` seconds of silence the board is gone."""
        self.stats = stats
        self.taps = taps
        self.on_event: Callable[[ButtonEventResponse], None] = lambda event: None
        self.on_end: Callable[[ConnectionLost], None] = lambda error: None
        self.on_several: Callable[[], None] = lambda: None
        """Called when several frames came at once: the tasks of their calls run in the next turn of the loop."""
        self.on_stranger: Callable[[int], None] = lambda packet_id: None
        """Called with the id of an unrequested packet."""
        self.times = ResponseTimes()
        self.frame_log = FrameLog(url, codec, now)
        self._url = url
        self._codec = codec
        self._lifecycle = lifecycle
        self._slots = slots
        self._scheduler = scheduler
        self._learns = scheduler.window.learns
        self._load: Load | None = None  # when the present chunk came, while the depth is learnt
        self.early = bytearray()
        """First bytes received before the handshake begins."""
        self._now = now
        self.over: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        """Done when the connection has ended."""
        self._parser = _parser_for(codec.byte_order, ignore_extra=ignore_extra)
        self._parser.skipped = stats.skipped
        self._nested = NestedFrameFilter(codec.byte_order)
        self._round_trips = stats.round_trips
        self.watchdog = ResponseWatchdog(
            lifecycle, slots, scheduler, self._parser, stats, patience, now, self._take, self.lost
        )
        """Knows by when responses are due."""
        self._silence = self.watchdog.silence

    # --- from the transport -------------------------------------------------------------------------------------

    def data(self, chunk: bytes, /) -> None:
        """Take bytes from the transport."""
        stats = self.stats
        stats.bytes_received += len(chunk)
        if self.taps.members:
            self.taps.received(chunk)
        heard_at = self.watchdog.heard_at = self._now()
        self.frame_log.is_on = is_logged(DEBUG)
        if self._lifecycle.state is not _READY:
            self._keep_evidence(chunk)
        frames = self._parser.feed(chunk)
        scheduler = self._scheduler
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
        if self._lifecycle.opening is not None:
            self._lifecycle.opening.seen(chunk)
        elif self._lifecycle.state in {State.NEW, State.UNPROVED}:
            self.early += chunk[: _MOST_EARLY - len(self.early)]

    def lost(self, error: Exception | None, /) -> None:
        """End the connection: the transport has ended."""
        self.end(lost(self._url, error))

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
        if self._lifecycle.opening is not None:
            self._lifecycle.opening.begin_again()

    def close_all(self) -> None:
        """Close all slots unanswered: the connection is opened again, or has ended."""
        self._report([(slot, None) for slot in self._slots.clear()])

    def end(self, error: ConnectionLost) -> None:
        """End the connection: all waiting calls get the first cause."""
        opening = self._lifecycle.opening
        if not self._lifecycle.end(error):
            return
        self.over.set_result(None)
        self.watchdog.stop()
        if opening is not None:
            opening.end(error)
        self._scheduler.refuse_all(lambda: same(error))
        self.close_all()
        self.on_end(error)

    # --- one frame ----------------------------------------------------------------------------------------------

    def _take(self, frame: Frame) -> None:
        self.stats.frames_received += 1
        self._silence.since = None
        if self.frame_log.is_on:
            self.frame_log.received(frame)
        packet_id, content = frame
        slots = self._slots
        lane = slots.lanes.get(packet_id)
        opening = self._lifecycle.opening
        if lane is not None:
            if self._learns and len(content) + OVERHEAD != lane.response_size:
                lane.heard(len(content) + OVERHEAD)
            if lane.slots and opening is None:
                slot = slots.only_origin(lane)
                if slot is None or slot.call is None or not self._answer(slot, slot.call, content):
                    self._settle(packet_id, content)
                return
        if packet_id == ButtonEventResponse.packet_id:
            self.stats.events_received += 1
            if opening is not None:
                opening.heard_event()
            self.on_event(self._codec.decode(packet_id, content))  # type: ignore[arg-type]  # the id says so
        elif opening is None:
            self.stats.unsolicited += 1
            self.on_stranger(packet_id)
        elif lane is not None:
            opening.heard(packet_id, content)

    def _answer(self, slot: Slot, call: Call, content: bytes) -> bool:
        """Pass a response to the call of the oldest slot of all, as `_settle` does for all cases in more steps.

        Return False, with nothing done, unless this is the first response, in time, to a call that waits for it.
        """
        if call.is_over or call.response is not None or slot.is_fence or slot.holds_permit_of is not None:
            return False
        request, sent_at = slot.request, slot.sent_at
        try:
            response: Any = self._codec.decode(request.packet_id + 1, content)
        except DecodeError:
            return False
        if not request.accepts(response):
            return False
        load = self._load
        if load is None and self._learns:
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
        seconds = heard_at - (free_at if free_at > sent_at else sent_at)
        if seconds > 0.0:
            self.times.record(request.packet_id, seconds)
        self._round_trips.append(heard_at - sent_at)
        call.open_slots -= 1
        call.response = response
        woken = call.woken
        if call.on_wake is not None:
            call.content = content
            call.on_wake(call)
        elif woken is not None and not woken.done():
            woken.set_result(None)
        return True

    def _settle(self, packet_id: int, content: bytes) -> None:
        decoded: Content
        try:
            decoded = self._codec.decode(packet_id, content)  # type: ignore[assignment]  # lanes are response ids
        except DecodeError as error:
            self.stats.undecodable += 1
            decoded = error
        load = self._load
        if load is None and self._learns:
            load = self._load = self._scheduler.load()
        slots = self._slots
        settled = slots.settle(packet_id, decoded)
        if slots.answer_twice:
            self.stats.repeated = slots.repeated
        if settled is None:
            self.stats.mismatched += 1
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
                self.stats.late_responses += content is not None
            elif content is None or isinstance(content, DecodeError):
                call.fault = content or call.fault
                if not call.open_slots or content is not None:
                    call.unanswered += 1
                    call.wake()
            else:
                self._round_trips.append(self.watchdog.heard_at - slot.sent_at)
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
            self.times.late()  # the call had a response already
        elif not slot.overdue:  # a response to an overdue slot may belong to another sending
            seconds = self.watchdog.heard_at - (free_at if free_at > slot.sent_at else slot.sent_at)
            if seconds > 0.0:  # else it came in one chunk with another one, and its time is not known
                self.times.record(slot.request.packet_id, seconds)
        elif call is None or call.is_over:
            self.times.late()
        if load is not None and not slot.is_fence:
            load.responses += 1


def _parser_for(byte_order: ByteOrder, *, ignore_extra: bool) -> FrameParser:
    if not ignore_extra:
        return FrameParser(byte_order)
    from servolink.protocol.lenient import LenientParser  # late: most boards send what the document says

    return LenientParser(byte_order)
