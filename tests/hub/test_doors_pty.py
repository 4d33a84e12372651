"""The door for serial programs: one after the other, each with a fresh session.

Module: servolink.transports.listeners.pty.
"""

from __future__ import annotations

import asyncio
import os
import sys
import termios
from pathlib import Path

import pytest

from servolink.client import connect
from servolink.errors import OpenError
from servolink.hub.doors.frame_doors import pty_door
from servolink.hub.engine.program import FrameProgram, Program
from servolink.hub.hub import Hub
from servolink.protocol import (
    AddActionRequest,
    Codec,
    QueryActionRequest,
    QueryActionResponse,
    QueryServoListRequest,
    QueryServoListResponse,
    SetAngleUnitRequest,
    Step,
)
from servolink.virtual import VirtualBoard
from tests.hub.door_hub import on_hub, until
from tests.hub.serial_program import Port

LIST = Codec().encode(QueryServoListRequest())
ANSWER = Codec().encode(QueryServoListResponse((1, 2, 3)))

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are those of Unix")


def test_programs_come_and_go() -> None:
    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with pty_door(hub) as url:
            sessions = set()
            for _round in range(3):
                with Port(url) as port:
                    await port.send(LIST)
                    assert await port.until(len(ANSWER)) == ANSWER
                    (program,) = hub.programs.values()
                    assert (program.door, program.who) == ("pty", f"serial port {url.removeprefix('serial://')}")
                    sessions.add(program.session_id)
                await until(lambda: not hub.programs)
            assert len(sessions) == 3
        with pytest.raises(FileNotFoundError):
            Port(url)

    on_hub(use)


def test_the_library_opens_it_like_any_port() -> None:
    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with pty_door(hub) as url:
            for _round in range(2):
                async with connect(url) as board:
                    assert await board.servo_ids() == (1, 2, 3)

    on_hub(use)


def test_the_next_program_finds_nothing_of_its_predecessor() -> None:
    """Neither its angle unit nor its settings of the line, nor what it did not read."""

    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with pty_door(hub) as url:
            with Port(url) as port:
                await port.send(Codec().encode(SetAngleUnitRequest(255, 1)) + LIST * 10)
                (program,) = await one_program(hub)
                await until(lambda: program.counters.responses == 11)
                settings = termios.tcgetattr(port.number)
                settings[3] |= termios.ECHO | termios.ICANON
                termios.tcsetattr(port.number, termios.TCSANOW, settings)
            await until(lambda: not hub.programs)
            with Port(url) as port:
                await one_program(hub)
                assert port.is_silent()
                assert not termios.tcgetattr(port.number)[3] & (termios.ECHO | termios.ICANON)
                await port.send(LIST)
                assert await port.until(len(ANSWER)) == ANSWER
                (program,) = hub.programs.values()
                assert program.units.of(1) == "degree"

    on_hub(use)


async def one_program(hub: Hub) -> list[Program]:
    await until(lambda: hub.programs)
    return list(hub.programs.values())


def big_action() -> AddActionRequest:
    return AddActionRequest(1, "", tuple(Step(1, 0, 1) for _ in range(12_000)))


def test_for_a_program_that_does_not_read_nothing_more_is_asked() -> None:
    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with pty_door(hub) as url, pty_door(hub) as other, connect(other) as board:
            await board.request(big_action())
            size = len(Codec().encode(QueryActionResponse(1, "", big_action().steps)))
            with Port(url) as port:
                await port.send(Codec().encode(QueryActionRequest(1)) * 60)
                await until(lambda: len(hub.programs) == 2)
                program = list(hub.programs.values())[-1]
                await until(lambda: program.queue.is_unread)
                for _round in range(20):
                    assert await board.servo_ids() == (1, 2, 3)
                assert program.counters.responses <= 32
                assert len(await port.until(60 * size)) == 60 * size

    on_hub(use)


def test_the_end_of_a_program_that_has_read_nothing_is_noticed() -> None:
    """It has asked for so much that it is not even listened to any more."""

    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with pty_door(hub) as url, pty_door(hub) as other:
            async with connect(other) as board:
                await board.request(big_action())
            await until(lambda: not hub.programs)
            with Port(url) as port:
                await port.send(Codec().encode(QueryActionRequest(1)) * 1200)
                (program,) = await one_program(hub)
                assert isinstance(program, FrameProgram)
                await until(lambda: program.queue.is_unread and program.is_full)
            await until(lambda: not hub.programs)
            with Port(url) as port:
                await port.send(LIST)
                assert await port.until(len(ANSWER)) == ANSWER

    on_hub(use)


def test_a_flood_is_answered_in_order() -> None:
    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with pty_door(hub) as url:
            with Port(url) as port:
                sending = asyncio.ensure_future(port.send(LIST * 1000))
                assert await port.until(len(ANSWER) * 1000) == ANSWER * 1000
                await sending

    on_hub(use)


def test_a_program_that_only_writes_is_heard() -> None:
    """It opens the port, writes and closes it before the hub has looked."""

    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with pty_door(hub) as url:
            before = hub.board.stats.frames_sent
            with Port(url) as port:
                os.write(port.number, LIST)
            await until(lambda: hub.board.stats.frames_sent > before)
            assert hub.board.stats.frames_sent == before + 1

    on_hub(use)


def test_a_link_keeps_the_name(tmp_path: Path) -> None:
    link = tmp_path / "rex port"

    async def use(hub: Hub, _: VirtualBoard) -> None:
        link.symlink_to("/dev/pts/99999")  # left over by a hub that was killed
        async with pty_door(hub, link=link) as url:
            assert url == f"serial://{tmp_path}/rex%20port"
            assert link.is_symlink()
            async with connect(url) as board:
                assert await board.servo_ids() == (1, 2, 3)
            async with pty_door(hub, link=str(link)):  # another hub takes it over, and removes it
                pass
        assert not link.is_symlink()

    on_hub(use)


def test_a_link_replaces_nothing_of_others(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    (tmp_path / "link").symlink_to(tmp_path / "file")

    async def use(hub: Hub, _: VirtualBoard) -> None:
        for name, why in (
            ("file", "is there already"),
            ("link", "is a link to something else than a terminal"),
            ("missing/x", "no link can be made there: No such file or directory"),
        ):
            with pytest.raises(OpenError, match=why):
                await pty_door(hub, link=tmp_path / name).__aenter__()

    on_hub(use)
    assert sorted(each.name for each in tmp_path.iterdir()) == ["file", "link"]
    assert (tmp_path / "link").read_text() == "mine"
