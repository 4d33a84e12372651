"""Faults are repeatable, follow their probabilities, and are applied to either direction."""

from __future__ import annotations

import asyncio
import gc
import os
from collections.abc import Callable
from typing import Self

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import fields

from servolink.errors import ConnectionLost, ServolinkError, TransportUnavailable
from servolink.transports.address import Address
from servolink.transports.line_faults import MAX_LATE, Faults, FaultyTransport, LineFaults
from servolink.transports.memory import MemoryTransport
from tests.transports.wires import Ear
from tests.virtual_time import VirtualTimeLoop, run

MANY = 100_000
ZEROS = bytes(100)


def _damaged(faults: Faults, data: bytes, *, size: int = 100, seed: int = 1) -> bytes:
    line = LineFaults(faults, seed)
    pieces = (line.apply(data[at : at + size], 0.0) for at in range(0, len(data), size))
    return b"".join(piece for some in pieces for _, piece in some)


def test_a_good_line_changes_nothing() -> None:
    data = os.urandom(5000)
    assert LineFaults(Faults(), 1).apply(data, 7.0) == [(7.0, data)]


def test_bytes_are_dropped_as_often_as_asked() -> None:
    left = _damaged(Faults(drop=0.1), bytes(MANY))
    assert len(left) == pytest.approx(MANY * 0.9, rel=0.01)


def test_one_bit_of_a_byte_is_flipped_as_often_as_asked() -> None:
    out = _damaged(Faults(flip=0.1), bytes(MANY))
    flipped = [byte for byte in out if byte]
    assert len(out) == MANY
    assert len(flipped) == pytest.approx(MANY * 0.1, rel=0.05)
    assert set(flipped) == {1 << bit for bit in range(8)}


def test_random_bytes_are_inserted_as_often_as_asked() -> None:
    out = _damaged(Faults(insert=0.1), b"\xff" * MANY)
    assert len(out) == pytest.approx(MANY * 1.1, rel=0.01)
    assert len(set(out)) == 256


def test_faults_of_bytes_do_not_weaken_each_other() -> None:
    out = _damaged(Faults(drop=0.2, flip=0.3, insert=0.4), bytes(MANY))
    assert len(out) == pytest.approx(MANY * (0.8 + 0.4), rel=0.02)
    zeros = MANY * (0.8 * 0.7 + 0.4 / 256)
    assert out.count(0) == pytest.approx(zeros, rel=0.03)


@pytest.mark.parametrize("faults", [Faults(drop=1.0), Faults(drop=1.0, flip=0.5)])
def test_a_line_that_drops_all_brings_nothing(faults: Faults) -> None:
    assert _damaged(faults, bytes(1000)) == b""


def test_a_line_that_flips_all_leaves_no_byte_alone() -> None:
    out = _damaged(Faults(flip=1.0), bytes(1000))
    assert len(out) == 1000
    assert 0 not in out


def test_the_rarest_fault_takes_no_time() -> None:
    assert _damaged(Faults(drop=1e-15), bytes(MANY)) == bytes(MANY)


def test_faults_of_bytes_do_not_depend_on_how_they_are_cut() -> None:
    faults, data = Faults(drop=0.01, flip=0.02, insert=0.03), bytes(10_000)
    assert _damaged(faults, data, size=7) == _damaged(faults, data, size=1000) != data


def test_chunks_are_duplicated_as_often_as_asked() -> None:
    assert len(_damaged(Faults(duplicate=0.25), bytes(MANY), size=10)) == pytest.approx(MANY * 1.25, rel=0.03)


def test_a_cut_keeps_the_beginning_of_a_chunk() -> None:
    line = LineFaults(Faults(cut=1.0), 3)
    chunk = bytes(range(100))
    lengths = set()
    for _ in range(2000):
        pieces = [piece for _, piece in line.apply(chunk, 0.0)]
        left = b"".join(pieces)
        assert chunk.startswith(left)
        lengths.add(len(left))
    assert lengths == set(range(100))


def test_a_delay_holds_back_what_follows() -> None:
    line = LineFaults(Faults(delay=0.3, delay_time=1.0), 1)
    times = [line.apply(ZEROS, number / 10)[0][0] for number in range(1000)]
    assert times == sorted(times)
    late = [at - number / 10 for number, at in enumerate(times)]
    assert max(late) == pytest.approx(1.0)
    assert min(late) == 0


def test_an_unplugged_line_brings_so_many_bytes_and_no_more() -> None:
    line = LineFaults(Faults(unplug=250), 1)
    brought = [sum(len(piece) for _, piece in line.apply(ZEROS, 0.0)) for _ in range(5)]
    assert brought == [100, 100, 50, 0, 0]
    assert line.unplugged


def test_a_line_is_plugged_in_until_then() -> None:
    line = LineFaults(Faults(unplug=250), 1)
    line.apply(bytes(249), 0.0)
    assert not line.unplugged
    assert not LineFaults(Faults(), 1).unplugged


probabilities = st.floats(0, 1)
any_faults = st.builds(
    Faults,
    drop=probabilities,
    flip=probabilities,
    insert=probabilities,
    delay=probabilities,
    delay_time=st.floats(0, 10),
    duplicate=probabilities,
    cut=probabilities,
    unplug=st.integers(0, 500),
)


@given(any_faults, st.integers(), st.lists(st.binary(max_size=100), max_size=10))
def test_the_same_seed_gives_the_same_faults(faults: Faults, seed: int, chunks: list[bytes]) -> None:
    one, other = LineFaults(faults, seed), LineFaults(faults, seed)
    for now, chunk in enumerate(chunks):
        pieces = one.apply(chunk, now)
        assert pieces == other.apply(chunk, now)
        assert all(piece for _, piece in pieces)
        assert all(at >= now for at, _ in pieces)


def test_another_seed_gives_other_faults() -> None:
    data = bytes(1000)
    assert _damaged(Faults(flip=0.1), data, seed=1) != _damaged(Faults(flip=0.1), data, seed=2)


def test_all_are_read_from_a_text_or_from_an_address() -> None:
    expected = Faults(
        drop=0.01, flip=0.02, insert=0.03, delay=0.04, delay_time=0.5, duplicate=0.05, cut=0.06, unplug=700
    )
    text = "drop=0.01,flip=0.02,insert=0.03,delay=0.04,delay_time=0.5,duplicate=0.05,cut=0.06,unplug=700"
    assert all(getattr(expected, field.name) != field.default for field in fields(Faults))
    assert Faults.parse(text) == expected
    assert Faults.from_address(Address.parse("x://?" + text.replace(",", "&"))) == expected
    assert Faults.parse("") == Faults()


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (
            "drp=0.1",
            "'drp' is not a fault; the faults are drop, flip, insert, delay, delay_time, duplicate, cut, unplug",
        ),
        ("byte_order=big", "'byte_order' is not a fault"),
        ("drop=2", "drop must be a number from 0 to 1, not '2'"),
        ("drop", "must be written name=value"),
        ("unplug=0.5", "an integer"),
        ("delay_time=-1", "a number from 0 to 3600"),
    ],
)
def test_what_is_no_fault_is_refused(text: str, reason: str) -> None:
    with pytest.raises(TransportUnavailable) as caught:
        Faults.parse(text)
    assert reason in str(caught.value)
    assert "faults://" not in str(caught.value)


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
async def test_each_direction_may_have_faults(*, sent: bool, received: bool) -> None:
    async with _Line(Faults(flip=1.0), sent=sent, received=received) as line:
        await line.faulty.send(bytes(10))
        await line.other.send(bytes(10))
        assert (0 not in await line.far.hear(10)) is sent
        assert (0 not in await line.ear.hear(10)) is received


async def test_the_two_directions_draw_different_faults() -> None:
    async with _Line(Faults(flip=1.0)) as line:
        await line.faulty.send(bytes(50))
        await line.other.send(bytes(50))
        assert await line.far.hear(50) != await line.ear.hear(50)


async def test_what_is_delayed_arrives_late_and_in_order() -> None:
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


async def test_nothing_overtakes_a_late_chunk_when_the_loop_was_busy() -> None:
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualTimeLoop)
    async with _Line(Faults(delay=0.5, delay_time=1.0), seed=5) as line:
        for number in range(20):
            await line.faulty.send(bytes([number]))
            line.faulty.data(bytes([number]))
            loop.stall(3)
        assert await line.far.hear(20) == bytes(range(20))
        assert await line.ear.hear(20) == bytes(range(20))


async def test_a_delay_lasts_as_long_as_asked() -> None:
    loop = asyncio.get_running_loop()
    async with _Line(Faults(delay=1.0, delay_time=0.7)) as line:
        start = loop.time()
        await line.faulty.send(b"x")
        await line.far.hear(1)
        assert loop.time() - start == pytest.approx(0.7)
        await line.other.send(b"y")
        await line.ear.hear(1)
        assert loop.time() - start == pytest.approx(1.4)


async def test_a_sender_waits_while_too_much_is_late() -> None:
    loop = asyncio.get_running_loop()
    async with _Line(Faults(delay=1.0, delay_time=60.0)) as line:
        start = loop.time()
        await line.faulty.send(bytes(MAX_LATE - 1))
        assert loop.time() - start == 0, "there was room"
        await line.faulty.send(b"x")
        assert loop.time() - start == pytest.approx(60)
        await line.far.hear(MAX_LATE)
        await line.other.send(bytes(MAX_LATE))
        await asyncio.sleep(0)
        await line.faulty.send(b"")
        assert loop.time() - start == pytest.approx(120), "a request would bring more"
        assert len(await line.ear.hear(MAX_LATE)) == MAX_LATE


async def test_late_requests_wait_while_too_many_responses_are_late() -> None:
    loop = asyncio.get_running_loop()
    async with _Line(Faults(delay=1.0, delay_time=60.0)) as line:
        start = loop.time()
        await line.faulty.send(b"x")
        await asyncio.sleep(30)
        await line.other.send(bytes(MAX_LATE))
        assert await line.far.hear(1) == b"x"
        assert loop.time() - start == pytest.approx(90)


async def test_closing_forgets_what_is_delayed() -> None:
    async with _Line(Faults(delay=1.0, delay_time=60.0)) as line:
        await line.faulty.send(b"x")
        await line.other.send(b"y")
        await asyncio.sleep(1)
        await line.faulty.close()
        await asyncio.sleep(100)
        assert (line.far.heard, line.ear.heard) == (b"", b"")
        assert line.ear.losses == [None]


async def test_a_line_lost_while_chunks_are_delayed_is_told_once() -> None:
    async with _Line(Faults(delay=1.0, delay_time=1.0)) as line:
        await line.faulty.send(b"x")
        await line.other.close()
        assert isinstance(await line.ear.end(), ConnectionLost)
        await asyncio.sleep(5)
        with pytest.raises(ConnectionLost):
            await line.faulty.send(b"y")
        assert len(line.ear.losses) == 1


async def test_unplugging_while_sending_cuts_the_frame_and_loses_the_line() -> None:
    async with _Line(Faults(unplug=15)) as line:
        await line.faulty.send(bytes(10))
        with pytest.raises(ConnectionLost, match="unplugged by fault injection"):
            await line.faulty.send(bytes(10))
        assert isinstance(await line.ear.end(), ConnectionLost)
        await line.far.end()
        assert len(line.far.heard) == 15
        await line.faulty.close()
        assert len(line.ear.losses) == 1


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
        "memory://stuck: closing it failed: ServolinkError: it cannot be saved (raised by the transport Stuck)"
    ]


async def test_unplugging_while_receiving_cuts_the_frame_and_loses_the_line() -> None:
    async with _Line(Faults(unplug=15)) as line:
        await line.other.send(bytes(20))
        assert "unplugged by fault injection" in str(await line.ear.end())
        assert len(line.ear.heard) == 15
        await line.far.end()
        with pytest.raises(ConnectionLost, match="unplugged by fault injection"):
            await line.faulty.send(b"x")


def test_a_late_chunk_that_cannot_be_sent_ends_quietly(warnings_logged: Callable[[], list[str]]) -> None:
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
    assert warnings_logged() == []


async def test_an_empty_send_waits_for_the_wrapped_transport() -> None:
    class Slow(MemoryTransport):
        async def send(self, data: bytes) -> None:
            await asyncio.sleep(1)

    transport = FaultyTransport(Slow(), Faults())
    await transport.open(Ear())
    begun = asyncio.get_running_loop().time()
    await transport.send(b"")
    assert asyncio.get_running_loop().time() == begun + 1
    await transport.close()
