"""The TCP doors: programs in any language get in, web pages and strangers do not.

Module: servolink.hub.doors.frame_doors.
"""

from __future__ import annotations

import os
import socket

import pytest

from servolink.client import connect
from servolink.control import Role
from servolink.errors import OpenError, TransportUnavailable
from servolink.hub.doors.frame_doors import tcp_door
from servolink.hub.hub import Hub
from servolink.protocol import (
    MAGIC,
    Codec,
    ExecuteActionRequest,
    QueryServoListRequest,
    QueryServoListResponse,
    QueryServoRequest,
    SetServoParameterRequest,
    Step,
)
from servolink.virtual import VirtualBoard
from tests.hub.door_hub import on_hub, raw_tcp, until
from tests.open_files import allow_files

ANYWHERE = "127.0.0.1:0"
LIST = Codec().encode(QueryServoListRequest())
ANSWER = Codec().encode(QueryServoListResponse((1, 2, 3)))


def test_a_program_needs_to_know_nothing_of_hubs() -> None:
    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with tcp_door(hub, ANYWHERE) as url, connect(url) as board:
            assert await board.servo_ids() == (1, 2, 3)
            with await raw_tcp(url) as line:
                await line.send(LIST[:5])
                await line.send(LIST[5:] + LIST)
                assert await line.until(2 * len(ANSWER)) == 2 * ANSWER
                (program,) = [each for each in hub.programs.values() if each.counters.requests == 2]
                assert (program.door, program.who) == ("tcp", f"127.0.0.1:{line.line.getsockname()[1]}")
            await until(lambda: len(hub.programs) == 1)

    on_hub(use)


def test_a_watching_program_moves_nothing() -> None:
    async def use(hub: Hub, virtual: VirtualBoard) -> None:
        async with tcp_door(hub, ANYWHERE, role=Role.WATCH) as url, connect(url) as board:
            before = (await board.request(QueryServoRequest(1))).servos
            await board.send(ExecuteActionRequest((Step(1, 10, 1),)))
            await board.request(SetServoParameterRequest(1, 1, 1))
            assert (await board.request(QueryServoRequest(1))).servos == before
            assert [program.door for program in hub.programs.values()] == ["watch-tcp"]

    on_hub(use)


@pytest.mark.parametrize(
    "first",
    [
        b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: text/plain\r\nContent-Length: 9\r\n\r\n" + LIST,
        b"GET / HTTP/1.1\r\nX: " + LIST,
        b"\x16\x03\x01\x02" + LIST,  # the beginning of TLS
        b"\x00" + LIST,
        MAGIC[:3] + b"\x00" + LIST,
    ],
)
def test_what_does_not_begin_with_a_frame_is_closed_before_it_is_parsed(
    first: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    async def use(hub: Hub, _: VirtualBoard) -> None:
        before = hub.board.stats.frames_sent
        async with tcp_door(hub, ANYWHERE) as url:
            for _attempt in range(3):
                with await raw_tcp(url) as line:
                    await line.send(first)
                    assert await line.until_end() == b""
        assert not hub.programs
        assert hub.board.stats.frames_sent == before

    on_hub(use)
    assert caplog.text.count("not of this protocol") == 1


def test_the_first_wrong_byte_closes_it() -> None:
    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with tcp_door(hub, ANYWHERE) as url:
            with await raw_tcp(url) as line:
                await line.send(MAGIC[:2] + b"x")
                assert await line.until_end() == b""

    on_hub(use)


def test_who_only_connects_is_not_a_program_and_harms_nobody() -> None:
    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with tcp_door(hub, ANYWHERE) as url:
            silent = [await raw_tcp(url) for _ in range(300)]
            async with connect(url) as board:
                assert await board.servo_ids() == (1, 2, 3)
                assert len(hub.programs) == 1
            for line in silent:
                line.line.close()

    on_hub(use)


def test_the_silent_make_room_and_programs_do_not(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    allow_files(monkeypatch, 64)  # 16 strangers, 16 programs

    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with tcp_door(hub, ANYWHERE) as url, tcp_door(hub, ANYWHERE, role=Role.WATCH) as other:
            programs = [await raw_tcp(place) for place in (url, other) for _ in range(8)]
            for line in programs:
                await line.send(LIST)
                assert await line.until(len(ANSWER)) == ANSWER
            silent = [await raw_tcp(place) for _ in range(20) for place in (url, other)]
            for line in silent[:16]:  # the oldest
                assert await line.until_end() == b""
            for line in silent[-2:]:
                await line.send(LIST)
                assert await line.until_end() == b""
            for line in programs:
                await line.send(LIST)
                assert await line.until(len(ANSWER)) == ANSWER
            programs[0].line.close()
            await until(lambda: len(hub.programs) == 15)
            await silent[-3].send(LIST)
            assert await silent[-3].until(len(ANSWER)) == ANSWER
            for line in (*programs, *silent):
                line.line.close()

    on_hub(use)
    assert "16 programs are connected already" in caplog.text


def test_garbage_behind_the_magic_is_counted() -> None:
    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with tcp_door(hub, ANYWHERE) as url:
            with await raw_tcp(url) as line:
                await line.send(LIST + os.urandom(300_000).replace(b"\x13", b"") + LIST)
                assert await line.until(2 * len(ANSWER)) == 2 * ANSWER
                (program,) = hub.programs.values()
                assert program.garbage > 290_000

    on_hub(use)


def test_the_system_notices_a_program_that_is_silently_gone() -> None:
    """And holds little for one that does not read."""

    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with tcp_door(hub, ANYWHERE) as url, connect(url) as board:
            await board.servo_ids()
            (program,) = hub.programs.values()
            line = program._sink.__self__._pipe.get_extra_info("socket")  # type: ignore[attr-defined]
            assert line.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE) == 1
            assert line.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF) <= 256 * 1024

    on_hub(use)


def test_a_place_that_cannot_be_had_is_an_error() -> None:
    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with tcp_door(hub, ANYWHERE) as url:
            with pytest.raises(OpenError, match="try another port, or 0"):
                await tcp_door(hub, url.removeprefix("tcp://")).__aenter__()
        for wrong in ("9000", ":9000", "localhost"):  # nobody opens a port to others by leaving something out
            with pytest.raises(TransportUnavailable, match="must be HOST:PORT"):
                await tcp_door(hub, wrong).__aenter__()

    on_hub(use)


def test_a_door_that_closes_ends_its_programs() -> None:
    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with tcp_door(hub, ANYWHERE) as url:
            line = await raw_tcp(url)
            await line.send(LIST)
            assert await line.until(len(ANSWER)) == ANSWER
        with line:
            assert await line.until_end() == b""
        assert not hub.programs

    on_hub(use)
