"""The USB device: URBs go in and come back done, as a host controller would have moved them."""

from __future__ import annotations

from collections.abc import Callable

from servolink.errors import DecodeError
from servolink.usbip.control import Control
from servolink.usbip.descriptors import (
    BULK_IN,
    BULK_OUT,
    HID_IN,
    HID_OUT,
    PACKET,
    SERIAL_IN,
    SERIAL_NOTIFICATION,
    SERIAL_OUT,
)
from servolink.usbip.endpoint import (
    DONE,
    NO_ANSWER,
    STALLED,
    UNLINKED,
    Complete,
    Endpoint,
    InEndpoint,
    OutEndpoint,
    Urb,
)

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


_CONTROL_OUT, _CONTROL_IN = 0x00, 0x80


class UsbDevice:
    """One device with three pipes; what they receive and send is the business of whoever has it."""

    def __init__(self, serial_number: str, complete: Complete) -> None:
        """Give every URB back to `complete`, once, unless it is unlinked."""
        self._complete = complete
        self._outstanding: dict[int, Urb] = {}
        self.serial = Pipe(self._finish, transfers)
        self.hid = Pipe(self._finish, reports)
        self.bulk = Pipe(self._finish, transfers)
        self._endpoints: dict[int, Endpoint] = {
            SERIAL_OUT: self.serial.from_host,
            SERIAL_IN: self.serial.to_host,
            SERIAL_NOTIFICATION: InEndpoint(self._finish),
            HID_OUT: self.hid.from_host,
            HID_IN: self.hid.to_host,
            BULK_OUT: self.bulk.from_host,
            BULK_IN: self.bulk.to_host,
        }
        self._control = Control(serial_number, self._endpoints, self.hid.take)

    @property
    def pipes(self) -> tuple[Pipe, Pipe, Pipe]:
        """The three ways to the board."""
        return self.serial, self.hid, self.bulk

    @property
    def outstanding(self) -> int:
        """How many URBs have not been given back."""
        return len(self._outstanding)

    @property
    def held(self) -> int:
        """Bytes that the host has sent and the device has not taken."""
        return sum(len(urb.data) - urb.taken for urb in self._outstanding.values())

    def submit(self, urb: Urb) -> None:
        """Take a URB; DecodeError if one with its number is outstanding, which no host says."""
        if urb.number in self._outstanding:
            raise DecodeError(f"URB {urb.number} is outstanding already")
        self._outstanding[urb.number] = urb
        if urb.endpoint in {_CONTROL_OUT, _CONTROL_IN}:
            self._transfer_control(urb)
        elif urb.endpoint in self._endpoints:
            self._endpoints[urb.endpoint].submit(urb)
            self.advance()
        else:
            self._finish(urb, NO_ANSWER)

    def unlink(self, number: int) -> int:
        """Take a URB back for the host and return what became of it: UNLINKED, or DONE if it is given back itself.

        A URB that has moved some bytes is given back with them, as programs do not lose them on a bus either.
        """
        urb = self._outstanding.get(number)
        if urb is None:
            return DONE
        self._endpoints[urb.endpoint].unlink(urb)
        if urb.moved:
            self._finish(urb, UNLINKED)
            return DONE
        del self._outstanding[number]
        return UNLINKED

    def halt(self, address: int) -> None:
        """Halt an endpoint, as firmware does that has failed; the host clears it."""
        self._endpoints[address].halt()

    def advance(self) -> None:
        """Take what the host sent and what had to wait because a pipe was not ready."""
        for pipe in self.pipes:
            pipe.from_host.advance()

    def _transfer_control(self, urb: Urb) -> None:
        brought = self._control.answer(urb.setup, urb.data)
        if brought is None:
            self._finish(urb, STALLED)
            return
        urb.received += brought[: urb.length]
        urb.taken = len(urb.data)
        self._finish(urb, DONE)

    def _finish(self, urb: Urb, status: int) -> None:
        del self._outstanding[urb.number]
        self._complete(urb, status)
