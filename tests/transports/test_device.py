from __future__ import annotations

import asyncio
import threading

import pytest

from servolink.errors import OpenError, TransportUnavailable
from servolink.transports.threaded import DeviceTransport, OpenDevice
from tests.transports.wires import LIMIT, Ear, on_loop

URL = "test://device"


class Slow:
    """A device that opens when the test lets it, and then not at all if there is a failure."""

    def __init__(self, failure: Exception) -> None:
        self.go = threading.Event()
        self.failure = failure

    def open(self) -> OpenDevice:
        assert self.go.wait(LIMIT)
        raise self.failure


@pytest.mark.parametrize("failure", [OpenError("no"), TransportUnavailable("no")])
@on_loop
async def test_a_failure_to_open_is_told_as_it_is(failure: Exception) -> None:
    device = Slow(failure)
    device.go.set()
    with pytest.raises(type(failure), match=r"^no$"):
        await DeviceTransport(URL, device).open(Ear())


@on_loop
async def test_any_other_failure_to_open_is_an_open_error() -> None:
    device = Slow(RuntimeError("a bug\x1b"))
    device.go.set()
    with pytest.raises(OpenError, match=r"test://device: cannot open it: a bug\\x1b"):
        await DeviceTransport(URL, device).open(Ear())


@on_loop
async def test_an_opening_that_is_stuck_does_not_hold_up_the_close() -> None:
    device = Slow(OSError("late"))
    transport = DeviceTransport(URL, device)
    opening = asyncio.ensure_future(transport.open(Ear()))
    await asyncio.sleep(0)
    await transport.close()
    with pytest.raises(OpenError, match="closed while being opened"):
        await opening
    device.go.set()
    while any(thread.name.startswith("servolink device") for thread in threading.enumerate()):
        await asyncio.sleep(0)
