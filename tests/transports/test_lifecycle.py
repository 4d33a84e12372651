"""The lifecycle that every kind shares: what becomes of errors that are not ours, and of ends at awkward moments."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable

import pytest

from servolink.errors import ConnectionLost, OpenError
from servolink.transports.lifecycle import BaseTransport, WrappedTransport
from servolink.transports.memory import MemoryTransport
from tests.transports.wires import Ear
from tests.virtual_time import run

URL = "test://\x1b[2J"
SHOWN = r"test://\x1b[2J"


class Kind(BaseTransport):
    """A kind whose opening and sending are up to the test."""

    def __init__(
        self, opening: Callable[[Kind], None] = lambda _: None, sending: Callable[[Kind], None] = lambda _: None
    ) -> None:
        super().__init__(URL)
        self.opening = opening
        self.sending = sending
        self.aborts = 0

    async def _open(self) -> None:
        await asyncio.sleep(0)
        self.opening(self)

    def _send(self, data: bytes) -> Awaitable[None] | None:
        self.sending(self)
        return None

    async def _close(self) -> None:
        await asyncio.sleep(0)

    def _abort(self) -> None:
        self.aborts += 1


def fail(_: Kind) -> None:
    raise TimeoutError


def lose(kind: Kind) -> None:
    kind._lose(OSError("first"))
    kind._lose(OSError("second"))


async def test_a_foreign_error_while_opening_is_an_open_error_that_names_it() -> None:
    transport, ear = Kind(opening=fail), Ear()
    with pytest.raises(OpenError) as caught:
        await transport.open(ear)
    assert str(caught.value) == f"{SHOWN}: cannot open it: TimeoutError"
    assert isinstance(caught.value.__cause__, TimeoutError)
    assert (ear.losses, transport.aborts) == ([], 1)
    with pytest.raises(ConnectionLost, match="closed"):
        await transport.send(b"x")


async def test_a_foreign_error_while_sending_is_the_end() -> None:
    transport, ear = Kind(sending=fail), Ear()
    await transport.open(ear)
    text = f"{SHOWN}: the connection was lost: TimeoutError"
    for _ in range(2):
        with pytest.raises(ConnectionLost) as caught:
            await transport.send(b"x")
        assert str(caught.value) == text
    assert [str(loss) for loss in ear.losses] == [text]
    assert transport.aborts == 1


async def test_a_connection_lost_while_it_is_opened_is_no_connection() -> None:
    transport, ear = Kind(opening=lose), Ear()
    with pytest.raises(OpenError, match=r"it was lost while being opened: .*first$"):
        await transport.open(ear)
    await transport.close()
    assert ear.losses == []
    assert transport.aborts >= 2  # the second one after the opening, as there was nothing to release before


async def test_a_transport_closed_while_it_is_opened_is_released_afterwards() -> None:
    transport, ear = Kind(), Ear()
    opening = asyncio.ensure_future(transport.open(ear))
    await asyncio.sleep(0)
    await transport.close()
    with pytest.raises(OpenError, match="closed while being opened"):
        await opening
    assert ear.losses == []


async def test_the_first_cause_stays_and_each_caller_gets_an_error_of_its_own() -> None:
    transport, ear = Kind(), Ear()
    await transport.open(ear)
    lose(transport)
    errors = []
    for _ in range(2):
        with pytest.raises(ConnectionLost, match="first") as caught:
            await transport.send(b"x")
        errors.append(caught.value)
    assert len({id(error) for error in (*errors, *ear.losses)}) == 3
    assert {str(error.__cause__) for error in errors} == {"first"}


async def test_bytes_after_the_end_are_dropped() -> None:
    transport, ear = Kind(), Ear()
    await transport.open(ear)
    lose(transport)
    transport._deliver(b"late")
    assert ear.heard == b""


def test_opening_closing_and_losses_are_logged_as_information(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        closed, lost = Kind(), Kind()
        for transport in (closed, lost):
            await transport.open(Ear())
        await closed.close()
        lose(lost)

    with caplog.at_level(logging.INFO, "servolink.transport"):
        run(main())
    assert [(record.levelno, record.getMessage()) for record in caplog.records if record.name.startswith("servo")] == [
        (logging.INFO, f"{SHOWN}: opened"),
        (logging.INFO, f"{SHOWN}: opened"),
        (logging.INFO, f"{SHOWN}: closed"),
        (logging.INFO, f"{SHOWN}: the connection was lost: first"),
    ]


def test_nothing_is_sent_past_the_send_of_a_wrapper() -> None:
    class Counting(WrappedTransport):
        async def send(self, data: bytes) -> None:
            await super().send(data)

    assert not Counting(MemoryTransport()).takes_at_once
    assert WrappedTransport(MemoryTransport()).takes_at_once
    assert not WrappedTransport(Counting(MemoryTransport())).takes_at_once
