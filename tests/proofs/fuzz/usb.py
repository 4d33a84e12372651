"""The device that a virtual board exports over USB/IP withstands any host."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

from servolink.errors import DecodeError
from servolink.virtual import VirtualBoard
from tests.lab.usbip import usbip_messages
from tests.lab.usbip.device import MAX_WAITING, UsbDevice
from tests.lab.usbip.endpoint import Urb
from tests.lab.usbip.usbip_messages import COMMAND_SIZE, OPENING_SIZE
from tests.proofs.fuzz.recipes import Cursor, made

_ENDPOINTS = (0x00, 0x80, 0x01, 0x81, 0x82, 0x02, 0x83, 0x03, 0x84, 0x04, 0x85)
_BIG = 4


def check_device(data: bytes) -> None:
    """Attach the device, and send what the recipe describes: any messages, or URBs to existing endpoints."""
    cursor = Cursor(data)
    board = VirtualBoard(2)
    given_back: list[int] = []
    device = UsbDevice("1", lambda urb, status: given_back.append(urb.number))
    for pipe in device.pipes:
        pipe.receive = _hearing(board, pipe.send)
    submitted = 0
    with suppress(DecodeError):
        usbip_messages.parse_opening(cursor.take(OPENING_SIZE))
    while cursor.left:
        try:
            submitted += _obey(device, cursor)
        except DecodeError:
            break
        assert all(pipe.to_host.waiting <= MAX_WAITING for pipe in device.pipes)
    assert len(given_back) + device.outstanding <= submitted


def _hearing(board: VirtualBoard, send: Callable[[bytes], None]) -> Callable[[bytes], None]:
    session = board.attach(send)
    return lambda said: session.receive(said, 1.0)


def _obey(device: UsbDevice, cursor: Cursor) -> int:
    """Do one step; return the number of URBs submitted."""
    kind = cursor.byte()
    if kind >= 192:
        device.unlink(cursor.byte())
        return 0
    if kind >= 128:
        command = usbip_messages.parse_command(cursor.take(COMMAND_SIZE))
        if not isinstance(command, Urb):
            device.unlink(command.number)
            return 0
        urb = command
    else:
        endpoint = _ENDPOINTS[kind % len(_ENDPOINTS)]
        urb = Urb(cursor.byte(), endpoint, cursor.byte() * _BIG, cursor.take(8))
    if not urb.inward:
        said = cursor.take(min(urb.length, cursor.left))
        urb.data = said if kind % 2 else made(Cursor(said), "little").stream
    device.submit(urb)
    return 1
