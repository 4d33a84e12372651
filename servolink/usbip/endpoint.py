"""Endpoints: how a host controller carries out transfers (URBs), packet by packet."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import TypeAlias

from servolink.usbip.descriptors import PACKET

DONE = 0
"""The status of a completed URB. The others are errors of Linux, whose numbers USB/IP uses on every system."""
STALLED = -32
NO_RESPONSE = -71
OVERFLOW = -75
UNLINKED = -104

_TOWARDS_HOST = 0x80


@dataclass(slots=True, eq=False)
class Urb:
    """A transfer that the host requests (USB request block)."""

    number: int
    """The number by which the host refers to it."""
    endpoint: int
    """The endpoint's address, with bit 7 for the direction towards the host."""
    length: int
    """The bytes that the host has room for, or sends."""
    setup: bytes = b""
    """The eight bytes that begin a control transfer."""
    data: bytes = b""
    """The data from the host."""
    received: bytearray = field(default_factory=bytearray)
    """The data for the host."""
    taken: int = 0
    """The bytes of `data` that the device has taken."""

    @property
    def inward(self) -> bool:
        """Whether data goes to the host."""
        return bool(self.endpoint & _TOWARDS_HOST)

    @property
    def moved(self) -> int:
        """The bytes that have been transferred."""
        return len(self.received) if self.inward else self.taken


Complete: TypeAlias = Callable[[Urb, int], None]
"""Returns a URB to the host, with a status from above."""


class Endpoint(ABC):
    """An endpoint, with its URBs in the order in which they came."""

    def __init__(self, complete: Complete) -> None:
        """Return completed URBs to `complete`."""
        self._complete = complete
        self._urbs: deque[Urb] = deque()
        self._halted = False

    @property
    def halted(self) -> bool:
        """Whether every URB is completed with STALL."""
        return self._halted

    def halt(self) -> None:
        """Complete every URB with STALL from now on, including those that wait."""
        self._halted = True
        while self._urbs:
            self._complete(self._urbs.popleft(), STALLED)

    def clear_halt(self) -> None:
        """Serve URBs again."""
        self._halted = False

    def submit(self, urb: Urb) -> None:
        """Take a URB."""
        if self._halted:
            self._complete(urb, STALLED)
        else:
            self._urbs.append(urb)
            self.advance()

    def unlink(self, urb: Urb) -> None:
        """Withdraw a URB that waits."""
        self._urbs.remove(urb)

    @abstractmethod
    def advance(self) -> None:
        """Transfer the packets that can be transferred now."""


class InEndpoint(Endpoint):
    """An endpoint towards the host: packets wait for URBs, and URBs for packets."""

    def __init__(self, complete: Complete) -> None:
        """Return completed URBs to `complete`."""
        super().__init__(complete)
        self.waiting = 0
        """The bytes that no URB has fetched yet."""
        self._packets: deque[bytes] = deque()

    def send(self, packets: Iterable[bytes]) -> None:
        """Send `packets`; a short packet ends a transfer."""
        for packet in packets:
            self._packets.append(packet)
            self.waiting += len(packet)
        self.advance()

    def advance(self) -> None:
        """Fill URBs with packets."""
        while self._urbs and self._packets:
            urb, packet = self._urbs[0], self._packets.popleft()
            self.waiting -= len(packet)
            room = urb.length - len(urb.received)
            fits = len(packet) <= room
            if fits:  # a packet that does not fit is lost, as on a bus
                urb.received += packet
            if len(packet) < PACKET or len(packet) >= room:
                self._urbs.popleft()
                self._complete(urb, DONE if fits else OVERFLOW)


class OutEndpoint(Endpoint):
    """An endpoint from the host: packets are taken while the device is ready for them."""

    def __init__(self, complete: Complete, take: Callable[[bytes], None], ready: Callable[[], bool]) -> None:
        """Pass packets to `take` while `ready()` is true; call `advance` when it becomes true."""
        super().__init__(complete)
        self._take = take
        self._ready = ready

    def advance(self) -> None:
        """Take packets while the device is ready."""
        while self._urbs and self._ready():
            urb = self._urbs[0]
            packet = urb.data[urb.taken : urb.taken + PACKET]
            urb.taken += len(packet)
            if urb.taken == len(urb.data):  # returned first: on a bus no response can come before that
                self._urbs.popleft()
                self._complete(urb, DONE)
            if packet:
                self._take(packet)
