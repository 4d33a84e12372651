from __future__ import annotations

import asyncio

import pytest

from servolink.errors import ConnectionLost, OpenError
from servolink.transports.memory import MemoryTransport
from servolink.transports.registry import create
from tests.transports.wires import Ear
from tests.virtual_time import run


async def test_what_is_sent_arrives_in_a_later_turn() -> None:
    (one, other), ear = MemoryTransport.pair(), Ear()
    await one.open(Ear())
    await other.open(ear)
    await one.send(b"abc")
    assert ear.heard == b""
    assert await ear.hear(3) == b"abc"


async def test_what_was_sent_before_the_other_end_opened_waits_for_it() -> None:
    one, other, ear = create("memory://early"), create("memory://early"), Ear()
    await one.open(Ear())
    await one.send(b"early")
    await other.open(ear)
    await one.send(b", late")
    assert await ear.hear(11) == b"early, late"


async def test_a_name_joins_two_openers_and_refuses_a_third() -> None:
    one, other, third = (create("memory://room") for _ in range(3))
    ears = Ear(), Ear()
    await one.open(ears[0])
    await other.open(ears[1])
    with pytest.raises(OpenError, match="both ends are in use"):
        await third.open(Ear())
    await other.send(b"x")
    assert await ears[0].hear(1) == b"x"


async def test_a_name_is_free_again_as_soon_as_an_end_closes() -> None:
    one, other, third, fourth = (create("memory://room") for _ in range(4))
    lost, ear = Ear(), Ear()
    await one.open(Ear())
    await other.open(lost)
    await one.close()
    await third.open(Ear())  # must not be joined to `other`, which has yet to learn of its end
    assert isinstance(await lost.end(), ConnectionLost)
    await fourth.open(ear)
    await third.send(b"new")
    assert await ear.hear(3) == b"new"


def test_names_belong_to_an_event_loop() -> None:
    async def abandon() -> None:
        await create("memory://left").open(Ear())

    async def join() -> None:
        one, other, ear = create("memory://left"), create("memory://left"), Ear()
        await one.open(Ear())
        await other.open(ear)
        await one.send(b"x")
        assert await ear.hear(1) == b"x"

    run(abandon())
    run(join())


async def test_unplugging_is_a_loss_at_both_ends() -> None:
    (one, other), ears = MemoryTransport.pair(), (Ear(), Ear())
    await one.open(ears[0])
    await other.open(ears[1])
    await one.send(b"last")
    one.unplug()
    errors = [await ear.end() for ear in ears]
    assert [type(error) for error in errors] == [ConnectionLost] * 2
    assert "unplugged" in str(errors[0])
    assert ears[1].heard == b"last"
    with pytest.raises(ConnectionLost, match="unplugged"):
        await other.send(b"x")
    await asyncio.gather(one.close(), other.close())
    assert [len(ear.losses) for ear in ears] == [1, 1]


async def test_an_end_whose_other_is_gone_cannot_be_opened() -> None:
    one, other = MemoryTransport.pair()
    await one.open(Ear())
    await one.close()
    with pytest.raises(OpenError):
        await other.open(Ear())


async def test_an_end_that_nobody_joined_ends_alone() -> None:
    one, other, ears = create("memory://alone"), create("memory://alone"), (Ear(), Ear())
    await one.open(ears[0])
    await one.close()
    await other.open(ears[1])
    assert isinstance(other, MemoryTransport)
    other.unplug()
    assert isinstance(await ears[1].end(), ConnectionLost)
    assert ears[0].losses == [None]
