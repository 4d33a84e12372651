"""The contract of every transport, kept on the kernel's real drivers: cdc-acm, hidraw, usbfs."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from tests.kernel.guest.wires import KernelHidWire, KernelWire, unplug_all
from tests.transports import test_contract, wires
from tests.transports.test_contract import *  # noqa: F403
from tests.transports.wires import Wire

pytestmark = pytest.mark.timeout(120)
DRIVERS: dict[str, Callable[[], Wire]] = {
    "serial": lambda: KernelWire("serial"),
    "hid": KernelHidWire,
    "usb": lambda: KernelWire("usb"),
}


del test_a_slow_reader_is_no_stall  # noqa: F821 - it takes more than these drivers hold
del test_the_virtual_board_keeps_the_rules_of_opening_and_closing  # noqa: F821 - no driver is part of that


@pytest.fixture(params=DRIVERS)  # type: ignore[no-redef]  # is meant to
def make(request: pytest.FixtureRequest) -> Callable[[], Wire]:
    return DRIVERS[request.param]


@pytest.fixture(autouse=True)
def _slow(monkeypatch: pytest.MonkeyPatch) -> None:
    """This machine is some 20 times slower than a real one, and its drivers hold less than a socket does."""
    for wire in (KernelWire, KernelHidWire):
        monkeypatch.setattr(wire, "flood", 40_000)
    monkeypatch.setattr(test_contract, "CONNECTIONS", 10)
    monkeypatch.setattr(wires, "LIMIT", 60.0)


@pytest.fixture(autouse=True, scope="module")
def _unplugged() -> Iterator[None]:
    yield
    unplug_all()
