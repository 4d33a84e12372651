"""USB device: accepts URBs from a host and returns each completed URB, like a host controller."""

from __future__ import annotations

from collections.abc import Callable

from servolink.errors import DecodeError
from tests.lab.usbip.control import ControlEndpoint
from tests.lab.usbip.descriptors import (
    BULK_IN,
    BULK_OUT,
    HID_IN,
    HID_OUT,
    PACKET,
    SERIAL_IN,
    SERIAL_NOTIFICATION,
    SERIAL_OUT,
)
from tests.lab.usbip.endpoint import (
    DONE,
    NO_RESPONSE,
    STALLED,
    UNLINKED,
    Complete,
    Endpoint,
    InEndpoint,
    OutEndpoint,
    Urb,
)

MAX_UNREAD = 64 * 1024
"""Bytes unread by the host, from which requests of the host have to wait."""
MAX_WAITING = 1024 * 1024
"""Most bytes unread by the host; further data is lost."""


class Pipe:
    """Pair of endpoints, read and written by programs on the host. Each `send` is one transfer of packets."""

    def __init__(self, complete: Complete, cut: Callable[[bytes], list[bytes]]) -> None:
        """Return URBs to `complete`; `cut` divides data to be sent into packets."""
        self.to_host = InEndpoint(complete)
        self.from_host = OutEndpoint(complete, self.take, self.ready)
        self.receive: Callable[[bytes], None] = _ignore
        """Callback for data from the host; must not raise."""
        self._cut = cut

    def send(self, data: bytes) -> None:
        """Send `data` to the host; beyond MAX_WAITING bytes, data is lost."""
        if self.to_host.waiting + len(data) <= MAX_WAITING:
            self.to_host.send(self._cut(data))

    def take(self, data: bytes) -> None:
        """Receive data from the host, through an endpoint or as a report."""
        self.receive(data)

    def ready(self) -> bool:
        """Return whether data from the host is accepted: not while the host leaves MAX_UNREAD bytes unread."""
        return self.to_host.waiting < MAX_UNREAD


def transfers(data: bytes) -> list[bytes]:
    """Cut `data` into packets of a bulk transfer, with a short packet at the end, empty if necessary."""
    return [data[at : at + PACKET] for at in range(0, len(data) + 1, PACKET)]


def reports(data: bytes) -> list[bytes]:
    """Cut `data` into HID reports, the last report padded with zeros."""
    return [data[at : at + PACKET].ljust(PACKET, b"\0") for at in range(0, len(data), PACKET)]


def _ignore(data: bytes) -> None:
    """Ignore data before a receiver is set."""


_CONTROL_OUT, _CONTROL_IN = 0x00, 0x80


class UsbDevice:
    """USB device with three pipes; the owner sets `receive` of each pipe and calls `send`."""

    def __init__(self, serial_number: str, complete: Complete) -> None:
        """Plug in a device, and return every URB to `complete`, once, unless unlinked."""
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
        self._control = ControlEndpoint(serial_number, self._endpoints, self.hid.take)

    @property
    def pipes(self) -> tuple[Pipe, Pipe, Pipe]:
        """Serial, HID and vendor pipe, all to the same board."""
        return self.serial, self.hid, self.bulk

    @property
    def outstanding(self) -> int:
        """Number of URBs not returned yet."""
        return len(self._outstanding)

    @property
    def pending_bytes(self) -> int:
        """Number of bytes sent by the host and not accepted yet."""
        return sum(len(urb.data) - urb.transferred for urb in self._outstanding.values())

    def submit(self, urb: Urb) -> None:
        """Accept a URB. Raise DecodeError if another URB with this number is outstanding."""
        if urb.number in self._outstanding:
            raise DecodeError(f"URB {urb.number} is outstanding already")
        self._outstanding[urb.number] = urb
        if urb.endpoint in {_CONTROL_OUT, _CONTROL_IN}:
            self._transfer_control(urb)
        elif urb.endpoint in self._endpoints:
            self._endpoints[urb.endpoint].submit(urb)
            self.advance()
        else:
            self._finish(urb, NO_RESPONSE)

    def unlink(self, number: int) -> int:
        """Withdraw a URB for the host. Return UNLINKED, or DONE if the URB was returned before or is returned now.

        A URB with some transferred bytes is returned: as on a bus, programs do not lose these bytes.
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
        """Halt an endpoint, as failed firmware does, until the host clears the halt."""
        self._endpoints[address].halt()

    def advance(self) -> None:
        """Accept data that waited for a pipe to be ready."""
        for pipe in self.pipes:
            pipe.from_host.advance()

    def _transfer_control(self, urb: Urb) -> None:
        response = self._control.respond(urb.setup, urb.data)
        if response is None:
            self._finish(urb, STALLED)
            return
        urb.received += response[: urb.length]
        urb.transferred = len(urb.data)
        self._finish(urb, DONE)

    def _finish(self, urb: Urb, status: int) -> None:
        del self._outstanding[urb.number]
        self._complete(urb, status)
