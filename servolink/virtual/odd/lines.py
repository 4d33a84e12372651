"""Boards whose conversation is odd: when they answer, how often, and with which bytes in between."""

from __future__ import annotations

from itertools import count

from servolink.virtual.odd.board import OddBoard, OddLine
from servolink.virtual.odd.wire import NAMES, Values, frame

_BUTTON_EVENT = 40081


class BigEndian(OddBoard, name="big"):
    """The numbers in its packets are big-endian."""

    lesson = "both byte orders are tried, and the advice says how to keep the right one"
    order = "big"


class OldMode(OddBoard, name="old"):
    """It powers up in the old mode, and drops requests for 50 ms after the answer to the mode setting."""

    lesson = "the answer to the mode setting is an answer, and the query after it waits"
    power_up_mode = 0
    deaf = 0.05
    """Seconds without an ear after the mode was set."""
    deaf_until = 0.0

    def take(self, line: OddLine, packet_id: int, content: bytes) -> None:
        """Drop a request that comes too soon."""
        if self.now >= self.deaf_until:
            super().take(line, packet_id, content)

    def set_mode(self, values: Values) -> Values:
        """Set the mode, and hear nothing for a while."""
        self.deaf_until = self.now + self.deaf
        return super().set_mode(values)


class OldModeAtOpening(OldMode, name="old-at-opening"):
    """It falls back to the old mode at each opening, and drops requests for 50 ms after the mode setting."""

    lesson = "the mode is set again at each opening"

    def opened(self, line: OddLine) -> None:
        """Return to the old mode."""
        self.mode = 0


class SlowOldMode(OldMode, name="old-slow"):
    """It powers up in the old mode, and drops requests for 300 ms after the mode setting."""

    lesson = "the query after the mode setting is repeated, with the mode left alone"
    deaf = 0.3


class BigOldMode(OldMode, name="big-old"):
    """It is big-endian, powers up in the old mode, and needs 50 ms after the mode setting."""

    lesson = "byte order and mode are found together"
    order = "big"


class Busy(OddBoard, name="busy"):
    """It works 10 ms on each request, and drops all requests that come meanwhile."""

    lesson = "one request at a time, unless more was learnt"
    delay = 0.01
    busy_until = 0.0

    def take(self, line: OddLine, packet_id: int, content: bytes) -> None:
        """Drop a request that comes during the work on another."""
        if self.now >= self.busy_until:
            self.busy_until = self.now + self.delay
            super().take(line, packet_id, content)


class BusyOldMode(Busy, name="old-busy"):
    """It powers up in the old mode, and drops all requests that come before the response to another."""

    lesson = "mode setting and query are not sent together"
    power_up_mode = 0


class Late(OddBoard, name="late"):
    """It answers each request 300 ms late."""

    lesson = "the time for a response is measured before it is used"
    delay = 0.3


class VeryLate(Late, name="very-late"):
    """It answers each request one second late."""

    lesson = "late responses to repeated queries are no sign of a bad line"
    delay = 1.0


class Merging(OddBoard, name="merging"):
    """It collects its responses for 20 ms and sends them together."""

    lesson = "a chunk of bytes may hold several frames"

    def transmit(self, line: OddLine, data: bytes) -> None:
        """Send the response with the next chunk."""
        self.after(0.02 - self.now % 0.02, lambda: line.send(data))


class Halves(OddBoard, name="halves"):
    """It sends the second half of each response 50 ms after the first."""

    lesson = "a frame may come in parts"

    def transmit(self, line: OddLine, data: bytes) -> None:
        """Send the response in two parts."""
        line.send_in_turn(0.0, data[: len(data) // 2])
        line.send_in_turn(0.05, data[len(data) // 2 :])


class SingleBytes(OddBoard, name="single-bytes"):
    """It sends one byte at a time, each after 3 ms."""

    lesson = "waiting goes on while bytes come"

    def transmit(self, line: OddLine, data: bytes) -> None:
        """Send the response byte by byte."""
        for byte in data:
            line.send_in_turn(0.003, bytes((byte,)))


class Stalling(OddBoard, name="stalling"):
    """It stands still for 0.6 s at every twentieth response."""

    lesson = "late is not lost"

    def __init__(self) -> None:
        super().__init__()
        self._sent = count(1)

    def transmit(self, line: OddLine, data: bytes) -> None:
        """Send the response in turn, after a standstill where one is due."""
        line.send_in_turn(self.delay if next(self._sent) % 20 else 0.6, data)


class Echoing(OddBoard, name="echoing"):
    """It sends back all bytes that it receives, as a two-wire bus does."""

    lesson = "requests that come back are no answers"

    def heard(self, line: OddLine, data: bytes) -> None:
        """Send the bytes back first."""
        line.send(data)
        super().heard(line, data)


class BootText(OddBoard, name="boot-text"):
    """It is started by opening, prints text for two seconds, and hears nothing meanwhile."""

    lesson = "a board that prints text is given time to start"

    def __init__(self) -> None:
        super().__init__()
        self._ready_at = 0.0

    def opened(self, line: OddLine) -> None:
        """Start again."""
        self._ready_at = self.now + 2.0
        for number in range(20):
            line.send_in_turn(0.1, b"[%5d] init block %d ok\r\n" % (100 * number, number))

    def take(self, line: OddLine, packet_id: int, content: bytes) -> None:
        """Drop a request that comes during the start."""
        if self.now >= self._ready_at:
            super().take(line, packet_id, content)


class Logging(OddBoard, name="logging"):
    """It prints a line of text before each response."""

    lesson = "text between frames is named as text"

    def transmit(self, line: OddLine, data: bytes) -> None:
        """Print, then send."""
        super().transmit(line, b"D (%d) rx ok, heap 20480\r\n" % (self.now * 1000) + data)


class Resetting(OddBoard, name="resetting"):
    """It ends the first connection after 50 ms, and stays from the second on."""

    lesson = "a connection that ends at once is opened once more"

    def __init__(self) -> None:
        super().__init__()
        self._openings = count()

    def opened(self, line: OddLine) -> None:
        """End the first connection soon."""
        if not next(self._openings):
            self.after(0.05, line.close)


class Twice(OddBoard, name="twice"):
    """It sends each response twice, as a repeating bridge does."""

    lesson = "copies are named and counted, and a learnt setting makes such a board usable"
    each = 1

    def __init__(self) -> None:
        super().__init__()
        self._sent = count(1)

    def transmit(self, line: OddLine, data: bytes) -> None:
        """Send the response, and a copy where one is due."""
        super().transmit(line, data if next(self._sent) % self.each else data + data)


class SecondTwice(Twice, name="twice-2"):
    """It sends every second response twice."""

    lesson = "copies are recognised if only some responses have one"
    each = 2


class TenthTwice(Twice, name="twice-10"):
    """It sends every tenth response twice."""

    lesson = "rare copies are counted too"
    each = 10


class BadSum(OddBoard, name="bad-sum"):
    """The checksum of every tenth response is wrong."""

    lesson = "damaged responses are asked for again, and counted"

    def __init__(self) -> None:
        super().__init__()
        self._sent = count(1)

    def transmit(self, line: OddLine, data: bytes) -> None:
        """Send the response, damaged where damage is due."""
        damage = 0 if next(self._sent) % 10 else 0x55
        super().transmit(line, data[:-1] + bytes((data[-1] ^ damage,)))


class Padded(OddBoard, name="padded"):
    """The content of each response is one byte longer than in the document; length and checksum are right."""

    lesson = "frames with a known id and a right checksum are recognised, and their length is named"

    def content(self, packet_id: int, values: Values) -> bytes:
        """Return the content with one byte more."""
        return super().content(packet_id, values) + b"\0"


class Flooding(OddBoard, name="flooding"):
    """It sends a button event every 5 ms, although no host has subscribed."""

    lesson = "events are no responses, and hide none"

    def opened(self, line: OddLine) -> None:
        """Begin to send events."""
        if line in self.lines:
            line.send(frame(_BUTTON_EVENT, self.content(_BUTTON_EVENT, {"buttonID": 1, "event": 1}), self.order))
            self.after(0.005, lambda: self.opened(line))


class Silent(OddBoard, name="silent"):
    """Not a board: a port that opens and sends nothing."""

    lesson = "refused within seconds"
    ignored = frozenset(NAMES.values())


class Chatting(Silent, name="chatting"):
    """Not a board: a positioning receiver that sends a line of text every 200 ms."""

    lesson = "refused as another device, with its text"

    def opened(self, line: OddLine) -> None:
        """Begin to send text."""
        if line in self.lines:
            line.send(b"$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n")
            self.after(0.2, lambda: self.opened(line))


class LoopBack(Silent, name="loop-back"):
    """Not a board: a plug that sends back all bytes."""

    lesson = "own requests are no answers of a board"

    def heard(self, line: OddLine, data: bytes) -> None:
        """Send the bytes back."""
        line.send(data)


class Modem(Silent, name="modem"):
    """Not a board: a modem that answers anything with ERROR."""

    lesson = "refused as another device"

    def heard(self, line: OddLine, data: bytes) -> None:
        """Answer as modems do."""
        line.send(b"\r\nERROR\r\n")
