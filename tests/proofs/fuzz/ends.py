"""Both ends of a line, the client and the virtual board, withstand any bytes."""

from __future__ import annotations

import asyncio
import selectors
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from servolink.client import Board, connect
from servolink.connection import Connection, ConnectionOptions
from servolink.errors import OpenError, ServolinkError
from servolink.protocol import (
    ALL_SERVOS,
    MAX_CONTENT,
    OVERHEAD,
    AddActionRequest,
    ByteOrder,
    ClearAllDataRequest,
    Codec,
    FrameParser,
    Packet,
    QueryActionListRequest,
    QueryActionRequest,
    QueryJoystickTableRequest,
    QueryMacroRequest,
    QueryMemorySizeRequest,
    QueryProjectIDRequest,
    QueryServoRequest,
    Request,
    SetAngleUnitRequest,
    SetServoParameterRequest,
    SubscribeButtonEventRequest,
    TransmissionModeSettingRequest,
    encode_frame,
)
from servolink.transports import Receiver
from servolink.virtual import BoardKind, VirtualBoard
from tests.client.piped_board import work_at
from tests.proofs.fuzz.errors import check
from tests.proofs.fuzz.recipes import RESPONSE_IDS, Cursor, content_for, made
from tests.proofs.hostile.calls import Call, calls
from tests.proofs.hostile.lying_board import LATENCY, LyingBoard, Speech
from tests.virtual_time import VirtualTimeLoop

_PATIENCE = 120.0
"""Seconds of virtual time after which a call counts as hung: an export can read each of many records eight times."""
_LARGEST_FRAME = 65_544
_MEMORY = 300
_MOST_SAID = 200_000
_NEEDS_FILES = ("apply_project", "rollback_project")
_REQUESTS: tuple[Request[Any], ...] = (
    QueryMemorySizeRequest(),
    QueryServoRequest(1),
    QueryServoRequest(ALL_SERVOS),
    SetServoParameterRequest(0, 1, 1),
    SetAngleUnitRequest(2, 0),
    QueryActionListRequest(),
    QueryActionRequest(0),
    AddActionRequest(0),
    QueryMacroRequest(0),
    QueryProjectIDRequest(),
    QueryJoystickTableRequest(0),
    ClearAllDataRequest(),
    SubscribeButtonEventRequest(1),
    TransmissionModeSettingRequest(1),
)
"""One request for each kind of lane and response. Fuzzers find zeros first, so zeros mean something here."""


def check_talk(data: bytes) -> None:
    """Make some calls, concurrent or in sequence, to a board that sends what the recipe says."""
    cursor = Cursor(data)
    options = cursor.byte()
    chosen = [_calls()[cursor.byte() % len(_calls())] for _ in range(1 + options % 4)]
    _loop().run_until_complete(_talk(chosen, cursor, depth=1 + (options >> 2 & 1), together=bool(options & 8)))


async def _talk(chosen: list[Call], cursor: Cursor, *, depth: int, together: bool) -> None:
    board = LyingBoard(lambda packet, answer: _said(cursor, packet, answer))
    try:
        client = await connect(board, depth=depth)
        work_at(client, depth)
    except OpenError as error:  # its lies keep the handshake from ending
        check(error)
        return
    try:
        await _make(client, chosen, board, together=together)
    finally:
        await client.close()
    await asyncio.sleep(0)
    left = asyncio.all_tasks() - {asyncio.current_task()}
    assert not left, f"tasks left behind: {left}"


async def _make(client: Board, chosen: list[Call], board: LyingBoard, *, together: bool) -> None:
    async with asyncio.timeout(_PATIENCE * len(chosen)):
        if together:
            await asyncio.gather(*(_call(client, call) for call in chosen))
        else:
            for call in chosen:
                await _call(client, call)
    stats = client.stats
    assert stats.bytes_received == board.said
    assert stats.frames_received >= stats.unsolicited + stats.mismatched + stats.undecodable + stats.events_received
    assert len(client.connection.answers._parser._partial) <= _LARGEST_FRAME


async def _call(client: Board, call: Call) -> Any:
    try:
        return await call(client)
    except ServolinkError as error:
        check(error)
        return error


def _said(cursor: Cursor, packet: Packet, answer: bytes) -> Speech:
    """Return the bytes that come back; true ones once the recipe has ended."""
    kind = cursor.byte() if cursor.left else 0
    if kind < 64:
        return [(LATENCY, answer)]
    if kind < 128:
        return [(LATENCY, _frame(cursor, packet.packet_id + 1))] if isinstance(packet, Request) else []
    if kind < 160:
        return [(LATENCY, made(Cursor(cursor.take(cursor.byte() % 64)), "little").stream)]
    late = cursor.byte() / 64
    says: list[Speech] = [
        [],
        [(LATENCY, answer * 2)],
        [(late, answer)],
        [(LATENCY, cursor.take(int(late * 16)))],
        [(LATENCY, _frame(cursor, RESPONSE_IDS[kind % len(RESPONSE_IDS)])), (late, answer)],
        [(late / 4 if at % 8 else LATENCY, answer[at : at + 1]) for at in range(len(answer))],
    ]
    return says[kind % len(says)]


def _frame(cursor: Cursor, packet_id: int) -> bytes:
    return encode_frame(packet_id, content_for(cursor, packet_id, "little"), "little")


def check_answer(data: bytes) -> None:
    """Make concurrent requests, and deliver frames and bytes, which may be responses to them."""
    _loop().run_until_complete(_answer(Cursor(data)))


async def _answer(cursor: Cursor) -> None:
    options = cursor.byte()
    wire = _Wire()
    depth = 1 + (options >> 1 & 3)
    chosen = ConnectionOptions(patience=1 + 2 * (options & 1), depth=depth, write_depth=depth)
    link = Connection(wire, chosen, learn=False)
    await link.open(handshake=False)
    requests = [_REQUESTS[cursor.byte() % len(_REQUESTS)] for _ in range(1 + (options >> 3 & 3))]
    tasks = [asyncio.ensure_future(link.request(request)) for request in requests]
    size = 0
    while cursor.left:
        await asyncio.sleep(cursor.byte() // 64 / 4)
        piece = _piece(cursor, requests)
        size += len(piece)
        wire.bring(piece)
    await asyncio.sleep(0)
    await link.close()
    for request, result in zip(requests, await asyncio.gather(*tasks, return_exceptions=True), strict=True):
        if isinstance(result, BaseException):
            assert isinstance(result, ServolinkError), repr(result)
            check(result)
        else:
            assert request.packet_id + 1 == result.packet_id
            assert request.accepts(result)
    stats = link.stats
    kinds = stats.unsolicited, stats.mismatched, stats.undecodable, stats.events_received, stats.late_responses
    assert max(kinds) <= stats.frames_received
    assert len(stats.round_trips) <= len(requests)
    assert stats.bytes_received == size


def _piece(cursor: Cursor, requests: list[Request[Any]]) -> bytes:
    kind = cursor.byte()
    if kind < 160:  # the id of an answer that is waited for
        return _frame(cursor, requests[kind % len(requests)].packet_id + 1)
    if kind < 224:
        return made(Cursor(cursor.take(cursor.byte() % 48)), "little").stream
    return cursor.take(kind % 32)


class _Wire:
    """A transport without another end."""

    url = "nobody://"

    async def open(self, receiver: Receiver) -> None:
        self.bring = receiver.data
        self._lost = receiver.lost

    async def send(self, data: bytes) -> None:
        pass

    async def close(self) -> None:
        self._lost(None)


def check_command(data: bytes) -> None:
    """Send anything to a virtual board at any time."""
    if len(data) < 2:
        return
    cursor = Cursor(data)
    options = cursor.byte()
    order: ByteOrder = "big" if options & 1 else "little"
    said: list[bytes] = []
    board = VirtualBoard(3, codec=Codec(order), kind=_kind(options))
    session = board.attach(said.append)
    now = 1.0
    for piece in _pieces(cursor, order, raw=bool(options & 8)):
        pause = cursor.byte()
        now += pause / 8 if pause < 250 else 10.0 ** (pause - 248)
        session.receive(piece, now)
        board.advance(now)
        _check_board(board)
        assert 0 <= session.waiting <= board.kind.queue_bytes + MAX_CONTENT + OVERHEAD
        if pause % 32 == 31:
            board.power_cycle(now)
        if pause % 16 == 15:
            board.press_button(pause, now)
            board.release_button(pause, now + pause / 100)
            now += pause / 100
    board.detach(session, now=now)
    assert sum(map(len, said)) <= _MOST_SAID
    answers = b"".join(said)
    parser = FrameParser(order)
    frames = parser.feed(answers) + parser.finish()
    assert b"".join(encode_frame(*frame, order) for frame in frames) == answers, "the board said what is no frame"
    for frame in frames:
        board.codec.decode(*frame)


def _kind(options: int) -> BoardKind:
    takes_time, has_little_room = bool(options & 16), bool(options & 32)
    return BoardKind(
        memory=_MEMORY,
        partial_writes=bool(options & 2),
        bus_powered=bool(options & 4),
        turnaround=0.1 * takes_time,
        write_seconds=5.0 * takes_time,
        queue=3 if has_little_room else 1000,
        queue_bytes=40 if has_little_room else 2**20,
        unknown_ids="silent" if options & 64 else "empty",
        mode=0 if options & 128 else 1,
    )


def _pieces(cursor: Cursor, order: ByteOrder, *, raw: bool) -> Iterator[bytes]:
    while cursor.left:
        size = 1 + cursor.byte() % 96
        piece = cursor.take(min(size, max(1, cursor.left)))
        yield piece if raw else made(Cursor(piece), order).stream


def _check_board(board: VirtualBoard) -> None:
    assert 0 <= board.storage.used <= _MEMORY
    assert 0 <= board.battery <= 1000
    assert all(-180 <= servo.angle <= 180 for servo in board.servos.values())
    assert len(board._buttons._held) <= 256


@cache
def _calls() -> list[Call]:
    return [call for name, call in calls(Path()).items() if name not in _NEEDS_FILES]


@cache
def _loop() -> VirtualTimeLoop:
    return VirtualTimeLoop(_NoSelector)


class _NoSelector(selectors.DefaultSelector):
    """Jumps in time without asking the system: there is nothing to read."""

    def __init__(self, loop: VirtualTimeLoop) -> None:
        super().__init__()
        self._loop = loop

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        if timeout is None:
            raise RuntimeError("deadlock: nothing is ready, nothing is timed, and the call still waits")
        self._loop.now += timeout
        return []
