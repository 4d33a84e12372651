"""Endpoints: transfers (URBs) carried out packet by packet, as by a host controller."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import TypeAlias

from tests.lab.usbip.descriptors import PACKET

DONE = 0
"""Status of a completed URB. Other statuses are error numbers of Linux, used by USB/IP on every system."""
STALLED = -32
NO_RESPONSE = -71
OVERFLOW = -75
UNLINKED = -104

_TOWARDS_HOST = 0x80


@dataclass(slots=True, eq=False)
class Urb:
    """Transfer requested by the host (USB request block)."""

    number: int
    """Number of the URB, chosen by the host."""
    endpoint: int
    """Address of the endpoint, with bit 7 for the direction towards the host."""
    length: int
    """Bytes to send, or room of the host for received bytes."""
    setup: bytes = b""
    """Setup packet of a control transfer, eight bytes."""
    data: bytes = b""
    """Data from the host."""
    received: bytearray = field(default_factory=bytearray)
    """Data for the host."""
    transferred: int = 0
    """Bytes of `data` accepted by the device so far."""

    @property
    def inward(self) -> bool:
        """Whether the direction is towards the host."""
        return bool(self.endpoint & _TOWARDS_HOST)

    @property
    def moved(self) -> int:
        """Number of bytes transferred so far."""
        return len(self.received) if self.inward else self.transferred


Complete: TypeAlias = Callable[[Urb, int], None]
"""Callback to return a URB to the host, with one of the statuses above."""


class Endpoint(ABC):
    """Endpoint with a queue of URBs."""

    def __init__(self, complete: Complete) -> None:
        """Return completed URBs to `complete`."""
        self._complete = complete
        self._urbs: deque[Urb] = deque()
        self._halted = False

    @property
    def halted(self) -> bool:
        """Whether the endpoint completes every URB with STALL."""
        return self._halted

    def halt(self) -> None:
        """Complete every URB with STALL from now on, including waiting URBs."""
        self._halted = True
        while self._urbs:
            self._complete(self._urbs.popleft(), STALLED)

    def clear_halt(self) -> None:
        """Serve URBs again after a halt."""
        self._halted = False

    def submit(self, urb: Urb) -> None:
        """Add a URB to the queue."""
        if self._halted:
            self._complete(urb, STALLED)
        else:
            self._urbs.append(urb)
            self.advance()

    def unlink(self, urb: Urb) -> None:
        """Withdraw a waiting URB."""
        self._urbs.remove(urb)

    @abstractmethod
    def advance(self) -> None:
        """Transfer as many packets as possible now."""


class InEndpoint(Endpoint):
    """Endpoint towards the host: packets wait for URBs, and URBs for packets."""

    def __init__(self, complete: Complete) -> None:
        """Return completed URBs to `complete`."""
        super().__init__(complete)
        self.waiting = 0
        """Number of bytes waiting for a URB."""
        self._packets: deque[bytes] = deque()

    def send(self, packets: Iterable[bytes]) -> None:
        """Queue `packets` for the host; a short packet ends a transfer."""
        for packet in packets:
            self._packets.append(packet)
            self.waiting += len(packet)
        self.advance()

    def advance(self) -> None:
        """Fill URBs with waiting packets, and complete full URBs."""
        while self._urbs and self._packets:
            urb, packet = self._urbs[0], self._packets.popleft()
            self.waiting -= len(packet)
            room = urb.length - len(urb.received)
            fits = len(packet) <= room
            if fits:  # a packet larger than the URB is lost, as on a bus
                urb.received += packet
            if len(packet) < PACKET or len(packet) >= room:
                self._urbs.popleft()
                self._complete(urb, DONE if fits else OVERFLOW)


class OutEndpoint(Endpoint):
    """Endpoint from the host: packets are accepted while the device is ready."""

    def __init__(self, complete: Complete, take: Callable[[bytes], None], ready: Callable[[], bool]) -> None:
        """Pass packets to `take` while `ready()` is true; call `advance` when `ready()` becomes true."""
        super().__init__(complete)
        self._take = take
        self._ready = ready

    def advance(self) -> None:
        """Pass packets to the device while the device is ready."""
        while self._urbs and self._ready():
            urb = self._urbs[0]
            packet = urb.data[urb.transferred : urb.transferred + PACKET]
            urb.transferred += len(packet)
            if urb.transferred == len(
                urb.data
            ):  # returned first: on a bus no response can arrive before the URB is returned
                self._urbs.popleft()
                self._complete(urb, DONE)
            if packet:
                self._take(packet)
