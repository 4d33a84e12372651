"""Pipes in memory carry bytes both ways, pause writers, and end as sockets do.

Module: servolink.support.platforms.memory_pipes.
"""

from __future__ import annotations

import asyncio

import pytest

from servolink.support.platforms import memory_pipes
from servolink.support.platforms.memory_pipes import connect_in_memory, listening_in_memory


@pytest.fixture(autouse=True)
def without_sockets(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory_pipes, "_HAS_SOCKETS", False)


class End(asyncio.Protocol):
    """What one end of a pipe hears."""

    def __init__(self) -> None:
        self.heard = b""
        self.calls: list[str] = []
        self.pipe: asyncio.Transport

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.pipe = transport

    def data_received(self, data: bytes) -> None:
        self.heard += data

    def pause_writing(self) -> None:
        self.calls.append("pause")

    def resume_writing(self) -> None:
        self.calls.append("resume")

    def connection_lost(self, exc: Exception | None) -> None:
        self.calls.append(f"lost {exc}")


class BufferedEnd(asyncio.BufferedProtocol):
    """An end with a buffer of three bytes."""

    def __init__(self) -> None:
        self.heard = b""
        self._buffer = bytearray(3)

    def get_buffer(self, sizehint: int) -> bytearray:
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        self.heard += self._buffer[:nbytes]


async def turns() -> None:
    """Let the loop turn a few times."""
    for _ in range(4):
        await asyncio.sleep(0)


def joined() -> tuple[End, End]:
    """Return both ends of a pipe."""
    near, far = End(), End()
    with listening_in_memory("rex", lambda: far):
        connect_in_memory("rex", lambda: near)
    return near, far


async def test_bytes_go_both_ways() -> None:
    near, far = joined()
    near.pipe.write(b"move")
    near.pipe.write(b" 1")
    far.pipe.write(b"done")
    await turns()
    assert (near.heard, far.heard) == (b"done", b"move 1")


async def test_a_buffered_protocol_gets_all_bytes() -> None:
    far = BufferedEnd()
    with listening_in_memory("rex", lambda: far):
        pipe = connect_in_memory("rex", End)
    pipe.write(b"seven b")
    await turns()
    assert far.heard == b"seven b"


async def test_an_end_that_does_not_read_pauses_the_other() -> None:
    near, far = joined()
    near.pipe.set_write_buffer_limits(high=10)
    far.pipe.pause_reading()
    near.pipe.write(b"x" * 11)
    await turns()
    assert (far.heard, near.calls, near.pipe.get_write_buffer_size()) == (b"", ["pause"], 11)
    far.pipe.resume_reading()
    await turns()
    assert (far.heard, near.calls, near.pipe.get_write_buffer_size()) == (b"x" * 11, ["pause", "resume"], 0)


async def test_a_closed_pipe_ends_after_its_last_bytes() -> None:
    near, far = joined()
    near.pipe.write(b"last")
    near.pipe.close()
    near.pipe.write(b"late")
    await turns()
    assert (far.heard, far.calls, near.calls) == (b"last", ["lost None"], ["lost None"])
    assert near.pipe.is_closing()
    assert far.pipe.is_closing()


async def test_an_aborted_pipe_ends_at_once() -> None:
    near, far = joined()
    far.pipe.pause_reading()
    near.pipe.write(b"lost")
    near.pipe.abort()
    await turns()
    assert (far.heard, far.calls, near.calls) == (b"", ["lost None"], ["lost None"])


async def test_a_pipe_that_is_closed_by_both_ends_once_each() -> None:
    near, far = joined()
    near.pipe.close()
    far.pipe.abort()
    await turns()
    assert (near.calls, far.calls) == (["lost None"], ["lost None"])


async def test_nobody_listens_before_and_after_the_context() -> None:
    with listening_in_memory("rex", End), pytest.raises(FileExistsError), listening_in_memory("rex", End):
        pass
    with pytest.raises(ConnectionRefusedError):
        connect_in_memory("rex", End)


async def test_a_system_with_sockets_does_not_need_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory_pipes, "_HAS_SOCKETS", True)
    with listening_in_memory("rex", End) as is_listening:
        assert not is_listening
