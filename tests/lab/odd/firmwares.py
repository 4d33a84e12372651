"""Boards whose firmware forgets, resets, reads too little, or reports what is not so."""

from __future__ import annotations

import struct

from tests.lab.odd.board import ALL, OddBoard, OddLine, OddServo
from tests.lab.odd.wire import ByteOrder, Values, decode, encode

_ACTION = 30020
_LONGEST = 32 - 9  # bytes in the longest content that fits the buffer


class Dozing(OddBoard, name="dozing"):
    """Old mode at power-up, and again after three seconds without a request."""

    lesson = "the mode is set again on an open connection"
    power_up_mode = 0
    _heard_at = 0.0

    def heard(self, line: OddLine, data: bytes) -> None:
        if self.now > self._heard_at + 3:
            self.mode = 0
        self._heard_at = self.now
        super().heard(line, data)


class BrownOut(OddBoard, name="brown-out"):
    """Weak power supply: the board restarts when a servo begins to move, and takes a second for it."""

    lesson = "a motion that did not happen is never confirmed"
    _ready_at = 0.0

    def heard(self, line: OddLine, data: bytes) -> None:
        if self.now >= self._ready_at:
            super().heard(line, data)

    def move(self, servo: OddServo, step: Values) -> None:
        self._ready_at = self.now + 1.0
        self.mode = self.power_up_mode
        for line in list(self.lines):
            line.send_in_turn(0.01, b"rst:0xf (BROWNOUT_RST),boot:0x13\r\n")


class ShortBuffer(OddBoard, name="short-buffer"):
    """Requests longer than 32 bytes are lost."""

    lesson = "a record that does not arrive is named, and nothing else is changed"

    def take(self, line: OddLine, packet_id: int, content: bytes) -> None:
        if len(content) <= _LONGEST:
            super().take(line, packet_id, content)


class CyrillicCaptions(OddBoard, name="cyrillic"):
    """Captions in the encoding cp1251."""

    lesson = "an encoding that is not certain is left open"
    encoding = "cp1251"
    captions = ("Махнуть рукой", "Поклон", "Вперёд", "Левая рука")


class HangulCaptions(OddBoard, name="hangul"):
    """Captions in the encoding EUC-KR."""

    lesson = "an encoding that is not certain is left open"
    encoding = "euc-kr"
    captions = ("손 흔들기", "인사하기", "앞으로", "왼팔")


class CutCaptions(OddBoard, name="cut-captions"):
    """Captions in UTF-8, cut after 31 bytes inside a character."""

    lesson = "a cut character is kept in bytes, and tells nothing about the encoding"
    captions = (
        "揮動左手然後再揮動右手",
        "鞠躬鞠躬鞠躬鞠躬鞠躬鞠躬",
        "向前走三步然後向後走三步",
        "左手左手左手左手左手左手",
    )

    def caption(self, text: str) -> bytes:
        return text.encode(self.encoding)[:31].ljust(32, b"\0")


class MixedOrder(OddBoard, name="mixed-order"):
    """Little-endian numbers around the content, big-endian numbers in it."""

    lesson = "numbers that make no sense in one byte order are no facts, and no motion is sent"
    inner: ByteOrder = "big"

    def take(self, line: OddLine, packet_id: int, content: bytes) -> None:
        try:
            values = decode(packet_id, content, self.inner)
        except (KeyError, struct.error):
            return
        super().take(line, packet_id, encode(packet_id, values, self.order))

    def content(self, packet_id: int, values: Values) -> bytes:
        return encode(packet_id, values, self.inner)


class ListedTwice(OddBoard, name="listed-twice"):
    """List of servos with the first id twice."""

    lesson = "servos are counted by their ids"

    def servo_list(self, values: Values) -> Values:
        ids = [next(iter(self.servos)), *self.servos]
        return {"servoCount": len(ids), "servoIDList": [{"servoID": servo_id} for servo_id in ids]}


class DeadServo(OddBoard, name="dead-servo"):
    """Servo without a cable: all bytes of its state are ff."""

    lesson = "a state that was not measured is shown as such, and confirms nothing"
    dead = 3

    def servo_states(self, values: Values) -> Values:
        found = super().servo_states(values)
        for state in found["servos"]:
            if state["servoID"] == self.dead:
                state.update(angle=-1, current=-1, temperature=-1, servoType=-1, isStart=255, isHold=255)
        return found


class BadRecord(OddBoard, name="bad-record"):
    """Action whose query is not answered, and blocks the board for a second."""

    lesson = "the record is named, and no export leaves it out in silence"
    _ready_at = 0.0

    def take(self, line: OddLine, packet_id: int, content: bytes) -> None:
        if self.now < self._ready_at:
            return
        if packet_id == _ACTION and content == b"\2\0\0\0":
            self._ready_at = self.now + 1.0
        else:
            super().take(line, packet_id, content)


class OldStates(OddBoard, name="old-states"):
    """Gateway that asks the board for all states once a second, and answers queries from its table."""

    lesson = "an old reading confirms neither a motion nor a stop"
    period = 1.0
    _read_at = -1.0
    _table: Values

    def servo_states(self, values: Values) -> Values:
        if self.now - self._read_at >= self.period:
            self._read_at = self.now - self.now % self.period
            self._table = super().servo_states({"servoID": ALL})
        wanted = values["servoID"]
        states = [dict(state) for state in self._table["servos"] if wanted in {ALL, state["servoID"]}]
        return {"servoCount": len(states), "servos": states}
