"""Transports that are not ours, given to `connect` or wrapped: they cannot hang a program or hide an error."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from servolink.client import connect
from servolink.errors import ConnectionLost, OpenError
from servolink.protocol import QueryServoRequest
from servolink.transports.base import Receiver, Transport
from servolink.transports.lifecycle import BaseTransport
from servolink.transports.line_faults import Faults, FaultyTransport
from servolink.transports.memory import MemoryTransport
from servolink.transports.registry import create
from tests.transports.wires import Ear
from tests.virtual_time import run


def now() -> float:
    return asyncio.get_running_loop().time()


class Gadget:
    """A virtual board behind a transport that keeps no promise a test takes from it."""

    url = "gadget://1"

    def __init__(self) -> None:
        self._board = create("virtual://")
        self.opens: Callable[[], Awaitable[object]] | None = None
        self.sends: Callable[[], Awaitable[object]] | None = None
        self.closes: Callable[[], Awaitable[object]] | None = None
        self.closings = 0

    async def open(self, receiver: Receiver) -> None:
        if self.opens is not None:
            await self.opens()
        await self._board.open(receiver)

    async def send(self, data: bytes) -> None:
        if self.sends is not None:
            await self.sends()
        await self._board.send(data)

    async def close(self) -> None:
        self.closings += 1
        if self.closes is not None:
            await self.closes()
        await self._board.close()


async def hang() -> None:
    await asyncio.Event().wait()


async def fail() -> None:
    raise ValueError("no such gadget")


def test_an_opening_that_fails_is_told_though_closing_fails_or_hangs_too(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        for closes in (fail, hang):
            gadget = Gadget()
            gadget.opens, gadget.closes = fail, closes
            begun = now()
            with pytest.raises(OpenError, match=r"gadget://1: cannot open it: ValueError: .* by the transport Gadget"):
                await connect(gadget)
            assert now() - begun <= 1
            assert gadget.closings == 1

    run(main())
    assert caplog.text == ""


async def test_an_opening_that_hangs_is_given_up_after_a_minute() -> None:
    gadget = Gadget()
    gadget.opens = hang
    with pytest.raises(OpenError, match="gadget://1: the transport Gadget did not open it within 60 s"):
        await connect(gadget)


def test_a_closing_that_hangs_is_given_up_after_a_second(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        gadget = Gadget()
        board = await connect(gadget)
        gadget.closes = hang
        begun = now()
        await board.close()
        assert now() - begun <= 1
        await board.close()
        assert gadget.closings == 1
        assert asyncio.all_tasks() == {asyncio.current_task()}

    run(main())
    assert "gadget://1: closing it failed: the transport Gadget did not close it within 1 s" in caplog.text


async def test_a_sending_that_hangs_loses_the_connection_for_all_who_wait() -> None:
    gadget = Gadget()
    board = await connect(gadget)
    gadget.sends = hang
    begun = now()
    asking = board.request(QueryServoRequest(255), timeout=0.2)
    for outcome in await asyncio.gather(asking, board.stop(), return_exceptions=True):
        assert isinstance(outcome, ConnectionLost)
        assert "the transport Gadget did not return from send within 2" in str(outcome)
    assert now() - begun <= 2.5
    await board.close()
    assert asyncio.all_tasks() == {asyncio.current_task()}


async def test_a_send_that_waits_ends_with_the_connection() -> None:
    gadget, ear = Gadget(), Ear()
    transport = create(gadget)
    await transport.open(ear)
    gadget.sends = hang
    sending = asyncio.ensure_future(transport.send(b"x"))
    await asyncio.sleep(0.1)
    await transport.close()
    with pytest.raises(ConnectionLost, match="it is closed"):
        await sending
    assert ear.losses == [None]


async def test_much_data_may_take_longer_and_one_send_behind_another_too() -> None:
    gadget, ear = Gadget(), Ear()
    transport = create(gadget)
    await transport.open(ear)
    line, times = asyncio.Lock(), iter((9, 1))

    async def slowly() -> None:
        async with line:
            await asyncio.sleep(next(times))

    gadget.sends = slowly
    begun = now()
    await asyncio.gather(transport.send(bytes(9600)), transport.send(b"x"))
    assert now() - begun == pytest.approx(10)
    assert ear.losses == []
    await transport.close()


class Slow(BaseTransport):
    """A transport on the base class, of which a test says how much it takes."""

    def __init__(self) -> None:
        super().__init__("slow://")
        self.bytes_taken = 0

    async def _open(self) -> None:
        pass

    def _send(self, data: bytes) -> Awaitable[None]:
        return self._drain()

    async def _drain(self) -> None:
        for _ in range(10):
            await asyncio.sleep(1)
            self.bytes_taken += 1
        await asyncio.Event().wait()

    def _accepted(self) -> int:
        return self.bytes_taken

    async def _close(self) -> None:
        pass

    def _abort(self) -> None:
        pass


async def test_a_transport_that_reports_its_progress_is_lost_only_once_it_makes_none() -> None:
    slow, ear = Slow(), Ear()
    transport = create(slow)
    await transport.open(ear)
    begun = now()
    with pytest.raises(ConnectionLost, match="the transport Slow did not return"):
        await transport.send(b"x")
    assert 12 <= now() - begun <= 13


def test_our_own_transports_are_not_wrapped() -> None:
    ours: tuple[Transport, ...] = (MemoryTransport(), create("virtual://"), create("share://rex"))
    assert all(create(transport) is transport for transport in ours)


async def test_a_foreign_transport_inside_one_of_ours_is_contained_too() -> None:
    gadget = Gadget()
    gadget.closes = hang
    board = await connect(FaultyTransport(gadget, Faults()))
    begun = now()
    await board.close()
    assert now() - begun <= 1
