"""pymodbus: its socket and RTU framers, fed as its transport feeds them, with answers of holding registers."""

from __future__ import annotations

from importlib import import_module
from typing import Any, ClassVar

from benchmarks.peers.peer import Peer, content

_pdu = import_module("pymodbus.pdu")
_registers = import_module("pymodbus.pdu.register_message")
_framer = import_module("pymodbus.framer")
_exceptions = import_module("pymodbus.exceptions")

_HOLDING = _registers.ReadHoldingRegistersResponse
_ANSWERS = (_HOLDING, _registers.ReadInputRegistersResponse, _registers.ReadWriteMultipleRegistersResponse)


class _Modbus(Peer):
    package = "pymodbus"
    builds = True
    feeding = "frames"  # the socket framer's transport drops more than 264 bytes, RTU all that follows a good frame
    kind: ClassVar[str]
    overhead: ClassVar[int]

    def __init__(self) -> None:
        """Begin a stream."""
        self._framer = getattr(_framer, self.kind)(_pdu.DecodePDU(False))  # noqa: FBT003 - a client's, by position
        self._buffer = b""

    @classmethod
    def _frame(cls, size: int, number: int, answer: Any = _HOLDING) -> bytes | None:
        count = round((size - cls.overhead) / 2)
        if count > 125:
            return None
        words = content(2 * count, number)
        registers = [int.from_bytes(words[at : at + 2], "big") for at in range(0, 2 * count, 2)]
        framer = getattr(_framer, cls.kind)(_pdu.DecodePDU(False))  # noqa: FBT003 - a client's, by position
        return bytes(framer.buildFrame(answer(registers=registers, dev_id=1, transaction_id=number & 0xFFFF)))

    def feed(self, chunk: bytes) -> list[Any]:
        """Do as its transport and a client that takes every answer."""
        buffer, frames = self._buffer + chunk, []
        try:
            while True:
                used, pdu = self._framer.handleFrame(buffer, 0, 0)
                buffer = buffer[used:]
                if pdu is None:
                    break
                frames.append(pdu)
        except _exceptions.ModbusException:
            buffer = b""
        self._buffer = buffer if len(buffer) <= self._framer.MAX_SIZE else b""
        return frames

    def content(self, frame: Any) -> bytes:
        """Return what the PDU encodes to."""
        return bytes(frame.encode()) + bytes([frame.transaction_id >> 8, frame.transaction_id & 0xFF])


class Socket(_Modbus):
    """The framer of Modbus TCP."""

    name = "pymodbus, socket"
    work = "no checksum; PDU object"
    fairness = "ours: 16-bit registers become a list of numbers; theirs: no checksum"
    resync = "never: a wrong protocol id stops it until the buffer overflows"
    validates = False
    kind = "FramerSocket"
    overhead = 9

    @staticmethod
    def frame(size: int, number: int) -> bytes | None:
        """Return an answer with its transaction id."""
        return Socket._frame(size, number)


class RTU(_Modbus):
    """The framer of Modbus over serial lines."""

    name = "pymodbus, RTU"
    work = "CRC-16 by table; PDU object"
    fairness = "ours: its CRC is a loop in Python, our sum one call in C"
    resync = "the whole buffer is dropped, also what follows a good frame"
    kind = "FramerRTU"
    overhead = 5

    @staticmethod
    def frame(size: int, number: int) -> bytes | None:
        """Return an answer with its CRC."""
        return RTU._frame(size, number)
