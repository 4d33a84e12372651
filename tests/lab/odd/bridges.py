"""Boards behind cables, adapters and bridges that change, hold, cut or add bytes."""

from __future__ import annotations

from functools import partial
from itertools import count

from tests.lab.odd.board import OddBoard, OddLine
from tests.lab.odd.lines import Silent
from tests.lab.odd.wire import frame

_SERVO_STATES = 20021


class LineEnds(OddBoard, name="line-ends"):
    """Bridge that sends each line feed as carriage return and line feed, as an open terminal does."""

    lesson = "the damage is shown in bytes, and a damaged response is not a missing one"
    servo_ids = (9, 10, 13)

    def transmit(self, line: OddLine, data: bytes) -> None:
        super().transmit(line, data.replace(b"\n", b"\r\n"))


class TextBridge(OddBoard, name="text-bridge"):
    """Bridge that sends responses as text: bytes that are no UTF-8 become the three bytes of U+FFFD."""

    lesson = "the damage is shown in bytes, and a damaged response is not a missing one"

    def transmit(self, line: OddLine, data: bytes) -> None:
        super().transmit(line, data.decode("utf-8", "replace").encode("utf-8"))


class HeldPackets(OddBoard, name="held-packets"):
    """USB adapter that holds a response of whole packets (64, 128, ... bytes) until the next response."""

    lesson = "a response that comes with the next one is late, and not missing"
    servo_ids = range(1, 35)  # all states take 384 bytes
    _held = b""

    def transmit(self, line: OddLine, data: bytes) -> None:
        data, self._held = self._held + data, b""
        if len(data) % 64:
            super().transmit(line, data)
        else:
            self._held = data


class OneBehind(OddBoard, name="one-behind"):
    """Each response is sent when the next request arrives."""

    lesson = "a response to an earlier request is late, and not missing"
    _held = b""

    def transmit(self, line: OddLine, data: bytes) -> None:
        data, self._held = self._held, data
        super().transmit(line, data)


class ShortPackets(OddBoard, name="short-packets"):
    """Radio bridge that carries the first 32 bytes of a response and loses the others."""

    lesson = "a cut response is not a missing one, and the servos are read singly"

    def transmit(self, line: OddLine, data: bytes) -> None:
        super().transmit(line, data[:32])


class Reordering(OddBoard, name="reordering"):
    """Network bridge that swaps the first two packets of 16 bytes in every third longer response."""

    lesson = "damage is looked for in long responses too"

    def __init__(self) -> None:
        super().__init__()
        self._sent = count(1)

    def transmit(self, line: OddLine, data: bytes) -> None:
        if len(data) > 32 and next(self._sent) % 3 == 0:
            data = data[16:32] + data[:16] + data[32:]
        super().transmit(line, data)


class FirstByteLost(OddBoard, name="first-byte-lost"):
    """Two-wire adapter that turns its direction too late, and loses the first byte of each response."""

    lesson = "responses without a whole beginning are recognised, and reported with what is missing"

    def transmit(self, line: OddLine, data: bytes) -> None:
        super().transmit(line, data[1:])


class FloatingLine(Silent, name="floating"):
    """Not a board: an open line that reads as zeros."""

    lesson = "refused within seconds, as a line without a sender"

    def opened(self, line: OddLine) -> None:
        if line in self.lines:
            line.send(bytes(24))
            self.after(0.02, lambda: self.opened(line))


class ServoBus(Silent, name="servo-bus"):
    """Not a board: a bus of servos with a binary protocol of their own."""

    lesson = "refused as another device, with its bytes in the error"

    def heard(self, line: OddLine, data: bytes) -> None:
        line.send(b"\xff\xff\x01\x02\x00\xfc")


class Overheard(OddBoard, name="overheard"):
    """Serial server that also sends the responses to another program, which asks for a servo every 50 ms."""

    lesson = "responses that were not asked for are counted and reported, and taken for no answer"

    def opened(self, line: OddLine) -> None:
        if line in self.lines:
            content = self.content(_SERVO_STATES, self.servo_states({"servoID": 2}))
            line.send(frame(_SERVO_STATES, content, self.order))
            self.after(0.05, lambda: self.opened(line))


class Leftovers(OddBoard, name="leftovers"):
    """Serial server that sends a new host the last responses to the host before."""

    lesson = "what arrives before the first request is no answer"

    def __init__(self) -> None:
        super().__init__()
        self._latest: list[bytes] = []

    def opened(self, line: OddLine) -> None:
        for data in self._latest:
            line.send(data)

    def transmit(self, line: OddLine, data: bytes) -> None:
        self._latest = [*self._latest[-5:], data]
        super().transmit(line, data)


class HangingUp(OddBoard, name="hanging-up"):
    """Bridge that closes a connection after two seconds without a byte from the host."""

    lesson = "a connection that ends is named, and opened again where that was asked for"

    def __init__(self) -> None:
        super().__init__()
        self._heard_at = 0.0

    def opened(self, line: OddLine) -> None:
        self._heard_at = self.now
        self._watch(line)

    def heard(self, line: OddLine, data: bytes) -> None:
        self._heard_at = self.now
        super().heard(line, data)

    def _watch(self, line: OddLine) -> None:
        if self.now >= self._heard_at + 2:
            line.close()
        elif line in self.lines:
            self.after(self._heard_at + 2 - self.now, partial(self._watch, line))
