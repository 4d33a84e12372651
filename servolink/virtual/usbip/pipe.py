"""A function's byte stream to the host and back, over a pair of endpoints."""

from __future__ import annotations

from collections.abc import Callable

from servolink.virtual.usbip.descriptors import PACKET
from servolink.virtual.usbip.endpoint import Complete, InEndpoint, OutEndpoint

ENOUGH = 64 * 1024
"""Bytes that wait for the host to fetch them, at which no more is taken from it."""
MOST_WAITING = 1024 * 1024
"""Bytes that may wait for the host; what would be more is lost."""


class Pipe:
    """What programs on the host read and write: frames are cut into packets, a transfer for each `send`."""

    def __init__(self, complete: Complete, cut: Callable[[bytes], list[bytes]]) -> None:
        """Give URBs back to `complete`; `cut` makes packets of what is sent."""
        self.to_host = InEndpoint(complete)
        self.from_host = OutEndpoint(complete, self.take, self.ready)
        self.receive: Callable[[bytes], None] = _ignore
        """Takes what the host sends; must not raise."""
        self._cut = cut

    def send(self, data: bytes) -> None:
        """Send `data` to the host, unless too much waits for it already."""
        if self.to_host.waiting + len(data) <= MOST_WAITING:
            self.to_host.send(self._cut(data))

    def take(self, data: bytes) -> None:
        """Take what the host sent, by whatever way."""
        self.receive(data)

    def ready(self) -> bool:
        """Tell whether the host is heard: not while it leaves too much unread."""
        return self.to_host.waiting < ENOUGH


def transfers(data: bytes) -> list[bytes]:
    """Cut `data` as bulk transfers are: the last packet is not full, and empty if need be."""
    return [data[at : at + PACKET] for at in range(0, len(data) + 1, PACKET)]


def reports(data: bytes) -> list[bytes]:
    """Cut `data` into HID reports; the last one is padded with zeros."""
    return [data[at : at + PACKET].ljust(PACKET, b"\0") for at in range(0, len(data), PACKET)]


def _ignore(data: bytes) -> None:
    """Take bytes that nobody asked for."""
