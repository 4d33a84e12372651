from __future__ import annotations

import asyncio
import gc
from typing import Self

import pytest

from servolink.errors import ConnectionLost, ServolinkError
from servolink.transports.faults import Faults, FaultyTransport
from servolink.transports.memory import MemoryTransport
from tests.transports.wires import Ear
from tests.virtual_time import VirtualTimeLoop, run


class _Line:
    """A faulty end, and the other one without faults."""

    def __init__(self, faults: Faults, *, seed: int = 1, sent: bool = True, received: bool = True) -> None:
        inner, self.other = MemoryTransport.pair()
        self.faulty = FaultyTransport(inner, faults, seed=seed, sent=sent, received=received)
        self.ear, self.far = Ear(), Ear()

    async def __aenter__(self) -> Self:
        await self.other.open(self.far)
        await self.faulty.open(self.ear)
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.faulty.close()
        await self.other.close()


@pytest.mark.parametrize(("sent", "received"), [(True, True), (True, False), (False, True)])
def test_each_direction_may_have_faults(*, sent: bool, received: bool) -> None:
    async def main() -> None:
        async with _Line(Faults(flip=1.0), sent=sent, received=received) as line:
            await line.faulty.send(bytes(10))
            await line.other.send(bytes(10))
            assert (0 not in await line.far.hear(10)) is sent
            assert (0 not in await line.ear.hear(10)) is received

    run(main())


def test_the_two_directions_draw_different_faults() -> None:
    async def main() -> None:
        async with _Line(Faults(flip=1.0)) as line:
            await line.faulty.send(bytes(50))
            await line.other.send(bytes(50))
            assert await line.far.hear(50) != await line.ear.hear(50)

    run(main())


def test_what_is_delayed_arrives_late_and_in_order() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        async with _Line(Faults(delay=0.3, delay_time=2.0), seed=5) as line:
            start = loop.time()
            for number in range(40):
                await line.faulty.send(bytes([number]))
                await line.other.send(bytes([number]))
                await asyncio.sleep(0.1)
            assert loop.time() - start == pytest.approx(4.0)
            assert len(line.far.heard) < 40
            assert len(line.ear.heard) < 40
            assert await line.far.hear(40) == bytes(range(40))
            assert await line.ear.hear(40) == bytes(range(40))
            assert 4.0 < loop.time() - start < 6.1

    run(main())


def test_nothing_overtakes_a_late_chunk_when_the_loop_was_busy() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualTimeLoop)
        async with _Line(Faults(delay=0.5, delay_time=1.0), seed=5) as line:
            for number in range(20):
                await line.faulty.send(bytes([number]))
                line.faulty.data(bytes([number]))
                loop.stall(3)
            assert await line.far.hear(20) == bytes(range(20))
            assert await line.ear.hear(20) == bytes(range(20))

    run(main())


def test_a_delay_lasts_as_long_as_asked() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        async with _Line(Faults(delay=1.0, delay_time=0.7)) as line:
            start = loop.time()
            await line.faulty.send(b"x")
            await line.far.hear(1)
            assert loop.time() - start == pytest.approx(0.7)
            await line.other.send(b"y")
            await line.ear.hear(1)
            assert loop.time() - start == pytest.approx(1.4)

    run(main())


def test_closing_forgets_what_is_delayed() -> None:
    async def main() -> None:
        async with _Line(Faults(delay=1.0, delay_time=60.0)) as line:
            await line.faulty.send(b"x")
            await line.other.send(b"y")
            await asyncio.sleep(1)
            await line.faulty.close()
            await asyncio.sleep(100)
            assert (line.far.heard, line.ear.heard) == (b"", b"")
            assert line.ear.losses == [None]

    run(main())


def test_a_line_lost_while_chunks_are_delayed_is_told_once() -> None:
    async def main() -> None:
        async with _Line(Faults(delay=1.0, delay_time=1.0)) as line:
            await line.faulty.send(b"x")
            await line.other.close()
            assert isinstance(await line.ear.end(), ConnectionLost)
            await asyncio.sleep(5)
            with pytest.raises(ConnectionLost):
                await line.faulty.send(b"y")
            assert len(line.ear.losses) == 1

    run(main())


def test_unplugging_while_sending_cuts_the_frame_and_loses_the_line() -> None:
    async def main() -> None:
        async with _Line(Faults(unplug=15)) as line:
            await line.faulty.send(bytes(10))
            with pytest.raises(ConnectionLost, match="unplugged by fault injection"):
                await line.faulty.send(bytes(10))
            assert isinstance(await line.ear.end(), ConnectionLost)
            await line.far.end()
            assert len(line.far.heard) == 15
            await line.faulty.close()
            assert len(line.ear.losses) == 1

    run(main())


def test_an_inner_transport_that_cannot_be_closed_is_told_in_the_log(caplog: pytest.LogCaptureFixture) -> None:
    class Stuck(MemoryTransport):
        async def close(self) -> None:
            raise ServolinkError("it cannot be saved")

    async def main() -> None:
        faulty = FaultyTransport(Stuck("memory://stuck"), Faults(unplug=1), seed=1)
        await faulty.open(Ear())
        with pytest.raises(ConnectionLost, match="unplugged by fault injection"):
            await faulty.send(bytes(10))
        await asyncio.sleep(1)
        gc.collect()

    run(main())
    assert [record.getMessage() for record in caplog.records] == [
        "memory://stuck: closing it failed: it cannot be saved"
    ]


def test_unplugging_while_receiving_cuts_the_frame_and_loses_the_line() -> None:
    async def main() -> None:
        async with _Line(Faults(unplug=15)) as line:
            await line.other.send(bytes(20))
            assert "unplugged by fault injection" in str(await line.ear.end())
            assert len(line.ear.heard) == 15
            await line.far.end()
            with pytest.raises(ConnectionLost, match="unplugged by fault injection"):
                await line.faulty.send(b"x")

    run(main())


def test_a_late_chunk_that_cannot_be_sent_ends_quietly(caplog: pytest.LogCaptureFixture) -> None:
    class Deaf(MemoryTransport):
        async def send(self, data: bytes) -> None:
            raise ConnectionLost(f"{len(data)} bytes were not taken")

    async def main() -> None:
        transport, ear = FaultyTransport(Deaf(), Faults(delay=1.0, delay_time=1.0)), Ear()
        await transport.open(ear)
        await transport.send(b"x")
        await asyncio.sleep(2)
        await transport.close()
        assert ear.losses == [None]

    run(main())
    gc.collect()
    assert caplog.records == []


def test_an_empty_send_waits_for_the_wrapped_transport() -> None:
    class Slow(MemoryTransport):
        async def send(self, data: bytes) -> None:
            await asyncio.sleep(1)

    async def main() -> None:
        transport = FaultyTransport(Slow(), Faults())
        await transport.open(Ear())
        begun = asyncio.get_running_loop().time()
        await transport.send(b"")
        assert asyncio.get_running_loop().time() == begun + 1
        await transport.close()

    run(main())
