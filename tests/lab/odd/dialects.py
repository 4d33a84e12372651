"""Boards and bridges with another form of frames, or without some of them."""

from __future__ import annotations

import struct

from tests.lab.odd.board import OddBoard, OddLine
from tests.lab.odd.wire import MAGIC, NAMES, Values, frame

_STATES = 20021
_LISTS = {30011, 30051, 40011, 30101}


class ContentSum(OddBoard, name="content-sum"):
    """Checksum of responses over the content only."""

    lesson = "a checksum by another rule is named, with the rule and a frame"

    def transmit(self, line: OddLine, data: bytes) -> None:
        super().transmit(line, data[:-1] + bytes((sum(data[8:-1]) % 256,)))


class WholeLength(OddBoard, name="whole-length"):
    """Length field of responses that counts the whole frame."""

    lesson = "a length that counts something else is named, with a frame"

    def transmit(self, line: OddLine, data: bytes) -> None:
        body = data[:6] + struct.pack("<H", len(data)) + data[8:-1]
        super().transmit(line, body + bytes((sum(body) % 256,)))


class SameId(OddBoard, name="same-id"):
    """Responses with the id of their request."""

    lesson = "ids by another rule are named, and no setting is promised to help"

    def transmit(self, line: OddLine, data: bytes) -> None:
        packet_id = struct.unpack_from("<H", data, len(MAGIC))[0] - 1
        super().transmit(line, frame(packet_id, data[8:-1], self.order))


class SmallCounts(OddBoard, name="small-counts"):
    """Counts of the lists of records in one byte in place of two."""

    lesson = "a list that is answered in another form is not unsupported, and no export leaves it out"

    def content(self, packet_id: int, values: Values) -> bytes:
        content = super().content(packet_id, values)
        return content[:1] + content[2:] if packet_id in _LISTS else content


class OneMore(OddBoard, name="one-more"):
    """Count of servo states one higher than the states that follow."""

    lesson = "each kind of response is read before a verdict"

    def content(self, packet_id: int, values: Values) -> bytes:
        content = super().content(packet_id, values)
        return bytes((content[0] + 1,)) + content[1:] if packet_id == _STATES else content


class Singly(OddBoard, name="singly"):
    """Response for all servos as one frame for each servo."""

    lesson = "servos are counted by their ids, and read one by one"

    def transmit(self, line: OddLine, data: bytes) -> None:
        content = data[8:-1]
        if struct.unpack_from("<H", data, len(MAGIC))[0] != _STATES or content[:1] == b"\1":
            super().transmit(line, data)
            return
        for at in range(1, len(content), 11):
            super().transmit(line, frame(_STATES, b"\1" + content[at : at + 11], self.order))


class Refusals(OddBoard, name="refusals"):
    """Text, `ERR` with the id, in place of some responses."""

    lesson = "text in place of a response is shown, and differs from silence"

    def take(self, line: OddLine, packet_id: int, content: bytes) -> None:
        if NAMES[packet_id] in {"QueryMemorySize", "QueryRemainPower", "QueryServoParameter"}:
            self.transmit(line, b"ERR %d\r\n" % packet_id)
        else:
            super().take(line, packet_id, content)


class Telnet(OddBoard, name="telnet"):
    """Serial server in telnet mode: it negotiates, and doubles ff."""

    lesson = "a bridge is named by what it does to bytes, and nothing is learnt from silence behind it"

    def opened(self, line: OddLine) -> None:
        line.send(bytes.fromhex("fffb01fffb03fffd03fffb2c"))

    def heard(self, line: OddLine, data: bytes) -> None:
        super().heard(line, data.replace(b"\xff\xff", b"\xff"))

    def transmit(self, line: OddLine, data: bytes) -> None:
        super().transmit(line, data.replace(b"\xff", b"\xff\xff"))


class FlowControl(OddBoard, name="flow-control"):
    """XOFF and XON before each response."""

    lesson = "bytes between frames are shown, and two of them name flow control"

    def transmit(self, line: OddLine, data: bytes) -> None:
        super().transmit(line, b"\x13\x11" + data)


class EvenParity(OddBoard, name="even-parity"):
    """Seven data bits and even parity from the board."""

    lesson = "parity is named by the bits of all bytes"

    def transmit(self, line: OddLine, data: bytes) -> None:
        low = [each & 0x7F for each in data]
        super().transmit(line, bytes(each | (each.bit_count() % 2) << 7 for each in low))


class Sleeper(OddBoard, name="sleeper"):
    """Sleep after 60 ms without a byte; the first two bytes that wake the board are lost."""

    lesson = "two queries in a row wake the board, and the sleep is named"
    _heard_at = -1.0

    def heard(self, line: OddLine, data: bytes) -> None:
        slept, self._heard_at = self.now - self._heard_at > 0.06, self.now
        super().heard(line, data[2:] if slept else data)


class UnitLies(OddBoard, name="unit-lies"):
    """Degrees confirmed, and raw ADC readings in use."""

    lesson = "angles beyond a full turn are shown as such, and no motion starts from them"

    def __init__(self) -> None:
        super().__init__()
        for servo in self.servos.values():
            servo.unit = 1

    def set_unit(self, values: Values) -> Values:
        return values


class SlowMoving(OddBoard, name="slow-moving"):
    """Responses 0.8 s late while a servo turns."""

    lesson = "a unit of time is certain only where no other one fits"

    def transmit(self, line: OddLine, data: bytes) -> None:
        turns = any(servo.degrees(self.now) != servo.degrees(self.now + 9) for servo in self.servos.values())
        self.after(0.8 if turns else self.delay, lambda: line.send(data))


class SilentWrite(OddBoard, name="silent-write"):
    """Success for each record, deletion and project id, of which nothing is stored."""

    lesson = "a failed import is undone, and ends"

    def store(self, stored: dict[int, Values], record_id: int, values: Values) -> int:
        return 1

    def write_project_id(self, values: Values) -> Values:
        return {"result": 1}

    def answer_for_records(self, packet_id: int, values: Values, stored: dict[int, Values], base: int) -> Values:
        if packet_id == base + 30:
            return {"result": 1}
        return super().answer_for_records(packet_id, values, stored, base)


class Renumbering(OddBoard, name="renumbering"):
    """Records stored under the next free id in place of their own."""

    lesson = "the id under which a record is stored is named, and nothing more is written"

    def store(self, stored: dict[int, Values], record_id: int, values: Values) -> int:
        free = max(stored, default=0) + 1
        stored[free] = {name: free if name.endswith("ID") else value for name, value in values.items()}
        return 1
