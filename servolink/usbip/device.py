"""The USB device: takes URBs from a host and returns each when it is completed, as a host controller does."""

from __future__ import annotations

from collections.abc import Callable

from servolink.errors import DecodeError
from servolink.usbip.control import ControlEndpoint
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
"""Bytes that wait for the host to fetch them, at which its requests have to wait."""
MAX_WAITING = 1024 * 1024
"""Bytes that may wait for the host; data beyond that is lost."""


class Pipe:
    """A pair of endpoints that programs on the host read and write. Each `send` is one transfer of packets."""

    def __init__(self, complete: Complete, cut: Callable[[bytes], list[bytes]]) -> None:
        """Return URBs to `complete`; `cut` makes packets of the data to be sent."""
        self.to_host = InEndpoint(complete)
        self.from_host = OutEndpoint(complete, self.take, self.ready)
        self.receive: Callable[[bytes], None] = _ignore
        """Takes the data that the host sends; must not raise."""
        self._cut = cut

    def send(self, data: bytes) -> None:
        """Send `data` to the host; it is lost if MAX_WAITING is exceeded."""
        if self.to_host.waiting + len(data) <= MAX_WAITING:
            self.to_host.send(self._cut(data))

    def take(self, data: bytes) -> None:
        """Take data that the host sent, through an endpoint or as a report."""
        self.receive(data)

    def ready(self) -> bool:
        """Return whether data is taken from the host: not while it leaves too much unread."""
        return self.to_host.waiting < MAX_UNREAD


def transfers(data: bytes) -> list[bytes]:
    """Cut `data` as a bulk transfer, which ends with a short packet, an empty one if necessary."""
    return [data[at : at + PACKET] for at in range(0, len(data) + 1, PACKET)]


def reports(data: bytes) -> list[bytes]:
    """Cut `data` into HID reports; the last one is padded with zeros."""
    return [data[at : at + PACKET].ljust(PACKET, b"\0") for at in range(0, len(data), PACKET)]


def _ignore(data: bytes) -> None:
    """Ignore data that nobody receives yet."""


_CONTROL_OUT, _CONTROL_IN = 0x00, 0x80


class UsbDevice:
    """One device with three pipes; its owner sets what they receive and send."""

    def __init__(self, serial_number: str, complete: Complete) -> None:
        """Return every URB to `complete`, once, unless it is unlinked."""
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
        """The three ways to the board."""
        return self.serial, self.hid, self.bulk

    @property
    def outstanding(self) -> int:
        """The number of URBs that have not been returned."""
        return len(self._outstanding)

    @property
    def held(self) -> int:
        """The bytes that the host has sent and the device has not taken."""
        return sum(len(urb.data) - urb.taken for urb in self._outstanding.values())

    def submit(self, urb: Urb) -> None:
        """Take a URB. Raise DecodeError if one with its number is outstanding."""
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
        """Withdraw a URB for the host. Return UNLINKED, or DONE if the URB was or is now returned itself.

        A URB that has transferred some bytes is returned with them: on a bus, too, programs do not lose them.
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
        """Halt an endpoint, as failed firmware does, until the host clears it."""
        self._endpoints[address].halt()

    def advance(self) -> None:
        """Take the data that had to wait because a pipe was not ready."""
        for pipe in self.pipes:
            pipe.from_host.advance()

    def _transfer_control(self, urb: Urb) -> None:
        response = self._control.respond(urb.setup, urb.data)
        if response is None:
            self._finish(urb, STALLED)
            return
        urb.received += response[: urb.length]
        urb.taken = len(urb.data)
        self._finish(urb, DONE)

    def _finish(self, urb: Urb, status: int) -> None:
        del self._outstanding[urb.number]
        self._complete(urb, status)
