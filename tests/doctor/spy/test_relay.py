"""The relay on real pseudo-terminals and sockets: bytes unchanged, sides that vanish, sides that do not read."""

from __future__ import annotations

import asyncio
import os
import socket
import sys
import termios
import tty
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager, suppress
from functools import wraps
from random import Random
from typing import Any

import pytest

from servolink.doctor.spy.relay import Relay
from servolink.recorder import Direction
from servolink.transports import SerialTransport

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are those of Unix")

LIMIT = 120.0


def on_loop(test: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., None]:
    """Run a test on an event loop of its own, in real time: the system passes the bytes."""

    @wraps(test)
    def run(*args: Any, **options: Any) -> None:
        asyncio.run(test(*args, **options))

    return run


class End:
    """A descriptor that is written and read in pieces of random size."""

    def __init__(self, descriptor: int, random: Random) -> None:
        self.descriptor = descriptor
        self.received = bytearray()
        self._random = random
        os.set_blocking(descriptor, False)

    async def send(self, data: bytes) -> None:
        while data:
            try:
                data = data[os.write(self.descriptor, data[: self._random.randint(1, 900)]) :]
            except BlockingIOError:
                await asyncio.sleep(0.001)
            await asyncio.sleep(0)

    def read(self) -> bool:
        """Read some bytes; return whether there were any."""
        try:
            data = os.read(self.descriptor, self._random.randint(1, 900))
        except BlockingIOError:
            return False
        self.received += data
        return True

    async def receive(self, count: int) -> bytes:
        while len(self.received) < count:
            if not self.read():
                await asyncio.sleep(0.001)
        return bytes(self.received)


class Stage:
    """A board's port, a relay, and what it has told."""

    def __init__(self) -> None:
        self.board, theirs = os.openpty()
        tty.setraw(theirs)
        self._theirs = theirs
        self.port = SerialTransport("serial://board", os.ttyname(theirs))
        self.passed: dict[Direction, bytearray] = {"sent": bytearray(), "received": bytearray()}
        self.told: list[bool] = []
        self.relay = Relay(self.port, self._tap, self.told.append)

    def _tap(self, seconds: float, direction: Direction, data: bytes) -> None:
        self.passed[direction] += data

    def vanish(self) -> None:
        """Pull the board's cable."""
        os.close(self._theirs)
        os.close(self.board)
        self.board = -1

    async def close(self) -> None:
        await self.relay.close()
        if self.board >= 0:
            os.close(self._theirs)
            os.close(self.board)


@asynccontextmanager
async def staged() -> AsyncIterator[tuple[Stage, str]]:
    """Relay between a board's port and a terminal for programs."""
    async with asyncio.timeout(LIMIT):
        stage = Stage()
        await stage.relay.open()
        try:
            with stage.relay.on_terminal(None, 115_200, stage.port.set_baudrate) as url:
                yield stage, url.removeprefix("serial://")
        finally:
            await stage.close()


def opened(terminal: str) -> int:
    """Open the terminal as a program does that sets nothing."""
    return os.open(terminal, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)


async def until(holds: Callable[[], bool]) -> None:
    while not holds():
        await asyncio.sleep(0.001)


@on_loop
async def test_bytes_pass_unchanged_both_ways_at_once() -> None:
    random = Random(5)
    upward, downward = random.randbytes(200_000), random.randbytes(200_000)
    async with staged() as (stage, terminal):
        program, board = End(opened(terminal), random), End(stage.board, random)
        await until(lambda: stage.told == [True])
        _, _, said, heard = await asyncio.gather(
            program.send(upward), board.send(downward), program.receive(len(downward)), board.receive(len(upward))
        )
        assert (said, heard) == (downward, upward)
        assert stage.passed == {"sent": upward, "received": downward}
        os.close(program.descriptor)


@on_loop
async def test_nothing_is_sent_that_the_program_did_not_send() -> None:
    async with staged() as (stage, terminal):
        os.write(stage.board, b"hello")  # nobody is there: it is seen and dropped
        await until(lambda: stage.passed["received"] == b"hello")
        program = opened(terminal)
        os.write(program, b"first")
        board = End(stage.board, Random(1))
        assert await board.receive(5) == b"first"
        os.write(stage.board, b"answer")
        end = End(program, Random(1))
        assert await end.receive(6) == b"answer"
        os.close(program)
        await until(lambda: stage.told == [True, False])
        assert not board.read()
        assert stage.passed == {"sent": b"first", "received": b"helloanswer"}


@on_loop
async def test_programs_come_and_go() -> None:
    async with staged() as (stage, terminal):
        board = End(stage.board, Random(1))
        for count in (1, 2, 3):
            program = opened(terminal)
            settings = termios.tcgetattr(program)
            assert not settings[3] & (termios.ECHO | termios.ICANON), "a program that sets nothing gets a raw line"
            os.write(program, b"x")
            await board.receive(count)
            os.write(stage.board, b"unread")
            received = stage.passed["received"]
            while len(received) < 6 * count:
                await asyncio.sleep(0.001)
            settings[3] |= termios.ECHO | termios.ICANON
            termios.tcsetattr(program, termios.TCSANOW, settings)
            os.close(program)
            while stage.told != [True, False] * count:
                await asyncio.sleep(0.001)
        fresh = End(opened(terminal), Random(1))
        await until(lambda: len(stage.told) == 7)
        assert not fresh.read(), "what the last program left unread is gone"
        os.close(fresh.descriptor)
        assert stage.passed["sent"] == b"xxx"


@on_loop
async def test_a_program_that_does_not_read_slows_the_board_down() -> None:
    random = Random(2)
    data = random.randbytes(600_000)
    async with staged() as (stage, terminal):
        program, board = End(opened(terminal), random), End(stage.board, random)
        await until(lambda: stage.told == [True])
        sending = asyncio.ensure_future(board.send(data))
        passed = -1
        while passed != len(stage.passed["received"]):  # it has come to a stop
            passed = len(stage.passed["received"])
            await asyncio.sleep(0.05)
        assert passed < 100_000
        assert not sending.done()
        await program.send(b"still heard")
        assert await board.receive(11) == b"still heard"
        assert await program.receive(len(data)) == data
        await sending
        os.close(program.descriptor)


@on_loop
async def test_a_board_that_does_not_read_slows_the_program_down() -> None:
    random = Random(3)
    data = random.randbytes(600_000)
    async with staged() as (stage, terminal):
        program, board = End(opened(terminal), random), End(stage.board, random)
        await until(lambda: stage.told == [True])
        sending = asyncio.ensure_future(program.send(data))
        passed = -1
        while passed != len(stage.passed["sent"]):
            passed = len(stage.passed["sent"])
            await asyncio.sleep(0.05)
        assert passed < 100_000
        await board.send(b"still heard")
        assert await program.receive(11) == b"still heard"
        assert await board.receive(len(data)) == data
        await sending
        os.close(program.descriptor)


@pytest.mark.parametrize("is_full", [False, True])
@on_loop
async def test_a_program_that_vanishes_while_it_does_not_read(is_full: bool) -> None:
    async with staged() as (stage, terminal):
        program, board = opened(terminal), End(stage.board, Random(4))
        await until(lambda: stage.told == [True])
        sending = asyncio.ensure_future(board.send(bytes(200_000 if is_full else 10)))
        await until(lambda: len(stage.passed["received"]) >= 10)
        os.close(program)
        await until(lambda: stage.told == [True, False])
        await sending
        await until(lambda: len(stage.passed["received"]) >= (200_000 if is_full else 10))
        assert stage.passed == {"sent": b"", "received": bytes(200_000 if is_full else 10)}


@on_loop
async def test_a_board_that_vanishes_ends_the_relay() -> None:
    async with staged() as (stage, terminal):
        program = opened(terminal)
        os.write(program, b"x")
        await End(stage.board, Random(1)).receive(1)
        stage.vanish()
        error = await stage.relay.until_lost()
        assert "the connection was lost" in str(error)
        os.write(program, b"nobody hears it")
        await until(lambda: stage.told == [True])
        os.close(program)


@on_loop
async def test_the_baud_rate_of_the_program_is_followed() -> None:
    async with staged() as (stage, terminal):
        program = opened(terminal)
        settings = termios.tcgetattr(program)
        assert settings[5] == termios.B115200
        settings[4] = settings[5] = termios.B57600
        termios.tcsetattr(program, termios.TCSANOW, settings)
        os.write(program, b"x")
        await End(stage.board, Random(1)).receive(1)
        assert stage.port.baudrate == 57_600
        settings[4] = settings[5] = termios.B9600  # and sends nothing
        termios.tcsetattr(program, termios.TCSANOW, settings)
        await until(lambda: stage.port.baudrate == 9600)
        os.close(program)


@asynccontextmanager
async def served() -> AsyncIterator[tuple[Stage, tuple[str, int]]]:
    """Relay between a board's port and a TCP port for programs."""
    async with asyncio.timeout(LIMIT):
        stage = Stage()
        await stage.relay.open()
        try:
            async with stage.relay.on_network("127.0.0.1", 0) as url:
                host, _, port = url.removeprefix("tcp://").rpartition(":")
                yield stage, (host, int(port))
        finally:
            await stage.close()


@on_loop
async def test_a_program_over_tcp() -> None:
    random = Random(6)
    upward, downward = random.randbytes(300_000), random.randbytes(300_000)
    async with served() as (stage, place):
        with socket.create_connection(place) as connection:
            program, board = End(connection.fileno(), random), End(stage.board, random)
            await until(lambda: stage.told == [True])
            with socket.create_connection(place) as second:
                second.setblocking(False)
                reader, writer = await asyncio.open_connection(sock=second)
                assert await reader.read() == b"", "one program at a time"
                writer.close()
            _, _, said, heard = await asyncio.gather(
                program.send(upward), board.send(downward), program.receive(len(downward)), board.receive(len(upward))
            )
            assert (said, heard) == (downward, upward)
        await until(lambda: stage.told == [True, False])
        assert stage.passed == {"sent": upward, "received": downward}


@on_loop
async def test_a_web_page_reaches_no_board() -> None:
    async with served() as (stage, place):
        reader, writer = await asyncio.open_connection(*place)
        writer.write(b"POST / HTTP/1.1\r\n\r\n\x13\x4c\x05\x1d")
        with suppress(ConnectionResetError):
            assert await reader.read() == b""
        writer.close()
        await until(lambda: stage.told == [True, False])
        assert stage.passed["sent"] == b""
