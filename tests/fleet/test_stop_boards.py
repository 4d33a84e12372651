"""Which boards a stop of a whole fleet waits for, and what it says of those that are lost meanwhile.

Modules: servolink.fleet.pending_command, servolink.fleet.stop_handler, servolink.fleet.urgent.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, cast

import pytest

from servolink.errors import ConnectionLost
from servolink.fleet.broker import Denied
from servolink.fleet.controller import Controller
from servolink.fleet.pending_command import PendingCommand
from servolink.fleet.roster import Roster
from servolink.fleet.stop_boards import stop_all
from servolink.fleet.topics import BoardResult, Topics


class Network:
    """Stands for a controller: what is sent goes nowhere, and boards come, go and answer when the test says so."""

    who, no_answers = "test", ""
    topics = Topics()

    def __init__(self, *boards: str) -> None:
        self.roster = Roster()
        self.sent: list[str] = []
        self.is_gone = False
        self.denied: set[str] = set()
        for board in boards:
            self.tell(board, "online")

    def tell(self, board: str, available: str) -> None:
        self.roster.take(board, "available", available.encode(), 0.0)

    @property
    def missing(self) -> int:
        """How many boards have to answer."""
        return len(self._exchange.awaited)

    def answer(self, board: str) -> None:
        self._exchange.take(BoardResult(id=self._exchange.id, board=board, ok=True))

    @contextmanager
    def pending_command(self, message_id: str) -> Iterator[PendingCommand]:
        self._exchange = PendingCommand(message_id)
        yield self._exchange

    async def settle(self, patience: float) -> None:
        await asyncio.sleep(patience if self.is_gone else 0.2)
        if self.is_gone:
            raise ConnectionLost("the broker is gone")

    async def publish(self, topic: str, *_: Any, **__: Any) -> None:
        if topic in self.denied:
            raise Denied("not allowed")
        self.sent.append(topic)


async def test_a_board_that_is_lost_during_a_stop_may_still_move() -> None:
    network = Network("rex", "fido", "bob")
    stopping = asyncio.create_task(stop_all(cast("Controller", network), patience=2.0))
    await asyncio.sleep(0.1)
    network.tell("rex", "offline")  # while nothing has settled yet
    await asyncio.sleep(0.4)
    network.tell("bob", "offline")
    network.answer("fido")
    stopped = await stopping
    assert list(stopped.stopped) == ["fido"]
    assert (sorted(stopped.silent), stopped.offline) == (["bob", "rex"], ())


async def test_it_ends_when_all_have_answered_who_are_there_and_names_who_was_away() -> None:
    network = Network("rex", "fido")
    network.tell("fido", "offline")
    began = asyncio.get_running_loop().time()
    stopping = asyncio.create_task(stop_all(cast("Controller", network), patience=60.0))
    await asyncio.sleep(0.5)
    network.answer("rex")
    stopped = await stopping
    assert asyncio.get_running_loop().time() - began < 1
    assert (list(stopped.stopped), stopped.offline) == (["rex"], ("fido",))
    assert stopped.is_complete


async def test_a_stop_of_some_boards_reaches_these_alone_whether_known_or_not() -> None:
    network = Network("rex", "fido", "bob")
    stopping = asyncio.create_task(stop_all(cast("Controller", network), ("rex", "fido", "new"), patience=5.0))
    await asyncio.sleep(0.5)
    assert network.sent == [f"servolink/{board}/stop" for board in ("rex", "fido", "new")]
    network.answer("rex")
    await asyncio.sleep(1.0)
    assert network.sent[3:] == ["servolink/fido/stop"]
    network.answer("fido")
    stopped = await stopping
    assert (list(stopped.stopped), stopped.silent, stopped.offline) == (["rex", "fido"], (), ("new",))


async def test_a_name_that_no_board_can_have_holds_up_no_stop() -> None:
    network = Network("rex")
    stopping = asyncio.create_task(stop_all(cast("Controller", network), ("all", "../rex", "rex"), patience=5.0))
    await asyncio.sleep(0.5)
    assert network.sent == ["servolink/rex/stop"]
    network.answer("rex")
    stopped = await stopping
    assert (list(stopped.stopped), stopped.offline) == (["rex"], ("all", "../rex"))


async def test_a_stop_is_sent_to_each_board_alone_and_repeated_to_those_that_are_missing() -> None:
    network = Network("bob", "fido", "rex")
    network.tell("bob", "offline")  # as the broker says, which may be wrong
    stopping = asyncio.create_task(stop_all(cast("Controller", network), patience=5.0))
    await asyncio.sleep(0.1)
    network.tell("new", "online")  # the first messages of the broker still come in
    assert network.sent == ["servolink/bob/stop", "servolink/fido/stop", "servolink/rex/stop"]
    await asyncio.sleep(0.2)
    assert network.sent[3:] == ["servolink/new/stop"]
    for name in ("fido", "new"):
        network.answer(name)
    await asyncio.sleep(1.0)
    assert network.sent[4:] == ["servolink/rex/stop"]
    network.answer("rex")
    stopped = await stopping
    assert stopped.is_complete
    assert stopped.offline == ("bob",)


async def test_a_denied_stop_is_named_with_the_reason_and_holds_up_no_other() -> None:
    network = Network("fido", "rex")
    network.denied = {"servolink/rex/stop"}
    stopping = asyncio.create_task(stop_all(cast("Controller", network), patience=2.0))
    await asyncio.sleep(0.1)
    network.answer("fido")
    stopped = await stopping
    assert (list(stopped.stopped), stopped.failed, stopped.silent) == (["fido"], {"rex": "not allowed"}, ())
    assert not stopped.is_complete


async def test_a_broker_that_is_gone_is_no_reason_to_give_up_early_or_to_call_a_stop_complete() -> None:
    network = Network("rex", "fido")
    network.is_gone = True
    began = asyncio.get_running_loop().time()
    stopping = asyncio.create_task(stop_all(cast("Controller", network), patience=5.0))
    await asyncio.sleep(0.1)
    network.answer("fido")
    stopped = await stopping
    assert asyncio.get_running_loop().time() - began == pytest.approx(5)
    assert (list(stopped.stopped), stopped.silent) == (["fido"], ("rex",))
    assert len(network.sent) >= 5, "it is sent again"
    for known in ((), ("fido",)):  # there may be others
        network = Network(*known)
        network.is_gone = True
        stopping = asyncio.create_task(stop_all(cast("Controller", network), patience=5.0))
        await asyncio.sleep(0.1)
        for board in known:
            network.answer(board)
        with pytest.raises(ConnectionLost):
            await stopping


class _CountingRoster(Roster):
    """Roster that counts how often the connected boards are listed."""

    listed = 0

    @property
    def online(self) -> tuple[str, ...]:
        self.listed += 1
        return super().online


@pytest.mark.parametrize("are_named", [False, True])
async def test_answers_of_a_thousand_boards_are_counted_without_listing_the_boards_for_each(are_named: bool) -> None:
    network, names = Network(), tuple(f"board{number}" for number in range(1000))
    network.roster = _CountingRoster()
    for name in names:
        network.tell(name, "online")
    network.tell("board7", "offline")
    stopping = asyncio.create_task(stop_all(cast("Controller", network), names if are_named else None, patience=5.0))
    await asyncio.sleep(0.5)
    for at, name in enumerate(name for name in names if name != "board7"):
        assert network.missing == 999 - at
        network.answer(name)
        await asyncio.sleep(0)
    stopped = await stopping
    assert (len(stopped.stopped), stopped.silent, stopped.offline) == (999, (), ("board7",))
    assert network.roster.listed < 8
