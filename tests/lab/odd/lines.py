"""Boards with an odd conversation: late, repeated, cut and mixed responses."""

from __future__ import annotations

from functools import partial
from itertools import count

from tests.lab.odd.board import OddBoard, OddLine
from tests.lab.odd.wire import NAMES, Values, decode, frame

_BUTTON_EVENT = 40081


class BigEndian(OddBoard, name="big"):
    """Big-endian numbers in all packets."""

    lesson = "both byte orders are tried, and the advice says how to keep the right one"
    order = "big"


class OldMode(OddBoard, name="old"):
    """Old mode at power-up; for 50 ms after the mode setting, requests are dropped."""

    lesson = "the response to the mode setting counts as a response, and the next query waits"
    power_up_mode = 0
    deaf = 0.05
    """Seconds without an ear after the mode was set."""
    deaf_until = 0.0

    def take(self, line: OddLine, packet_id: int, content: bytes) -> None:
        if self.now >= self.deaf_until:
            super().take(line, packet_id, content)

    def set_mode(self, values: Values) -> Values:
        self.deaf_until = self.now + self.deaf
        return super().set_mode(values)


class OldModeAtOpening(OldMode, name="old-at-opening"):
    """Old mode at each opening; for 50 ms after the mode setting, requests are dropped."""

    lesson = "the mode is set again at each opening"

    def opened(self, line: OddLine) -> None:
        self.mode = 0


class SlowOldMode(OldMode, name="old-slow"):
    """Old mode at power-up; for 300 ms after the mode setting, requests are dropped."""

    lesson = "the query after the mode setting is repeated, with the mode left alone"
    deaf = 0.3


class BigOldMode(OldMode, name="big-old"):
    """Big-endian numbers, old mode at power-up, and 50 ms without an ear after the mode setting."""

    lesson = "byte order and mode are found together"
    order = "big"


class Busy(OddBoard, name="busy"):
    """Work of 10 ms on each request; requests received meanwhile are dropped."""

    lesson = "one request at a time, unless more was learnt"
    delay = 0.01
    busy_until = 0.0

    def take(self, line: OddLine, packet_id: int, content: bytes) -> None:
        if self.now >= self.busy_until:
            self.busy_until = self.now + self.delay
            super().take(line, packet_id, content)


class BusyOldMode(Busy, name="old-busy"):
    """Old mode at power-up; requests before the response to an earlier request are dropped."""

    lesson = "mode setting and query are not sent together"
    power_up_mode = 0


class Late(OddBoard, name="late"):
    """Responses 300 ms after each request."""

    lesson = "the time for a response is measured before it is used"
    delay = 0.3


class VeryLate(Late, name="very-late"):
    """Responses one second after each request."""

    lesson = "late responses to repeated queries are no sign of a bad line"
    delay = 1.0


class Merging(OddBoard, name="merging"):
    """Responses collected for 20 ms and sent together."""

    lesson = "a chunk of bytes may hold several frames"

    def transmit(self, line: OddLine, data: bytes) -> None:
        self.after(0.02 - self.now % 0.02, lambda: line.send(data))


class Halves(OddBoard, name="halves"):
    """Responses in halves, 50 ms apart."""

    lesson = "a frame may come in parts"

    def transmit(self, line: OddLine, data: bytes) -> None:
        line.send_in_turn(0.0, data[: len(data) // 2])
        line.send_in_turn(0.05, data[len(data) // 2 :])


class SingleBytes(OddBoard, name="single-bytes"):
    """Responses byte by byte, 3 ms apart."""

    lesson = "the waiting time starts again with each byte"

    def transmit(self, line: OddLine, data: bytes) -> None:
        for byte in data:
            line.send_in_turn(0.003, bytes((byte,)))


class Stalling(OddBoard, name="stalling"):
    """Standstill of 0.6 s before every twentieth response."""

    lesson = "late is not lost"

    def __init__(self) -> None:
        super().__init__()
        self._sent = count(1)

    def transmit(self, line: OddLine, data: bytes) -> None:
        line.send_in_turn(self.delay if next(self._sent) % 20 else 0.6, data)


class Echoing(OddBoard, name="echoing"):
    """Echo of all received bytes, as on a two-wire bus."""

    lesson = "an echoed request is not a response"

    def heard(self, line: OddLine, data: bytes) -> None:
        line.send(data)
        super().heard(line, data)


class BootText(OddBoard, name="boot-text"):
    """Restart at each opening: two seconds of text, and no ear for requests."""

    lesson = "a board with boot text needs time to start"

    def __init__(self) -> None:
        super().__init__()
        self._ready_at = 0.0

    def opened(self, line: OddLine) -> None:
        self._ready_at = self.now + 2.0
        for number in range(20):
            line.send_in_turn(0.1, b"[%5d] init block %d ok\r\n" % (100 * number, number))

    def take(self, line: OddLine, packet_id: int, content: bytes) -> None:
        if self.now >= self._ready_at:
            super().take(line, packet_id, content)


class Logging(OddBoard, name="logging"):
    """Line of log text before each response."""

    lesson = "text between frames is reported as text"

    def transmit(self, line: OddLine, data: bytes) -> None:
        super().transmit(line, b"D (%d) rx ok, heap 20480\r\n" % (self.now * 1000) + data)


class Resetting(OddBoard, name="resetting"):
    """End of the first connection at once; later connections stay."""

    lesson = "a connection that ends at once is opened once more"

    def __init__(self) -> None:
        super().__init__()
        self._openings = count()

    def opened(self, line: OddLine) -> None:
        if not next(self._openings):
            line.close()


class Twice(OddBoard, name="twice"):
    """Responses sent twice, as by a repeating bridge."""

    lesson = "copies are counted and reported, and a learnt setting makes the board usable"
    each = 1

    def __init__(self) -> None:
        super().__init__()
        self._sent = count(1)

    def transmit(self, line: OddLine, data: bytes) -> None:
        super().transmit(line, data if next(self._sent) % self.each else data + data)


class SecondTwice(Twice, name="twice-2"):
    """Every second response sent twice, the others once."""

    lesson = "copies of some responses are recognised too"
    each = 2


class TenthTwice(Twice, name="twice-10"):
    """Every tenth response sent twice, the others once."""

    lesson = "rare copies are counted too"
    each = 10


class LateCopies(OddBoard, name="late-copies"):
    """Responses sent again, unchanged, one second later."""

    lesson = "copies are noticed and reported, and readings are proved"
    copied_after: float = 1.0
    """Seconds from a response to its copy."""
    each = 1

    def __init__(self) -> None:
        super().__init__()
        self._sent = count(1)

    def transmit(self, line: OddLine, data: bytes) -> None:
        super().transmit(line, data)
        if not next(self._sent) % self.each:
            self.after(self.delay + self.copied_after, lambda: line.send(data))


class CrowdedLine(OddBoard, name="two-boards"):
    """Two boards on one line, with different project ids and angles; the second one answers 4 ms later."""

    lesson = "answers to one request are compared, and nothing but a stop is sent"
    others = 1
    lag = 0.004
    """Seconds by which each further board is later than the one before."""

    def __init__(self) -> None:
        super().__init__()
        self.twins = [self.twin(number) for number in range(1, self.others + 1)]

    def twin(self, number: int) -> OddBoard:
        """Return another board of the line."""
        board = OddBoard()
        board.project_id = 700 + number
        for servo in board.servos.values():
            servo.move(-70 - number, 0, 0.0)
        return board

    def answers(self) -> list[OddBoard]:
        """Return the other boards that execute and answer the next request."""
        return self.twins

    def take(self, line: OddLine, packet_id: int, content: bytes) -> None:
        super().take(line, packet_id, content)
        for number, twin in enumerate(self.answers(), 1):
            twin.now = self.now
            response = twin.answer(packet_id, decode(packet_id, content, self.order))
            if response is not None:
                data = frame(packet_id + 1, twin.content(packet_id + 1, response), self.order)
                self.after(self.delay + number * self.lag, partial(line.send, data))


class Twins(CrowdedLine, name="twins"):
    """Three boards on one line that differ in the angle of one servo only, and answer at almost the same time."""

    lesson = "all servos are compared before a board that answers more than once is used"
    others = 2
    lag = 0.0001

    def twin(self, number: int) -> OddBoard:
        board = OddBoard()
        board.servos[3].move(number, 0, 0.0)
        return board


class BadSum(OddBoard, name="bad-sum"):
    """Wrong checksum in every tenth response."""

    lesson = "damaged responses are counted, and queries repeated"

    def __init__(self) -> None:
        super().__init__()
        self._sent = count(1)

    def transmit(self, line: OddLine, data: bytes) -> None:
        damage = 0 if next(self._sent) % 10 else 0x55
        super().transmit(line, data[:-1] + bytes((data[-1] ^ damage,)))


class Padded(OddBoard, name="padded"):
    """Contents one byte longer than in the document, with right length and checksum."""

    lesson = "frames with a known id and a right checksum are recognised, and the length is reported"

    def content(self, packet_id: int, values: Values) -> bytes:
        return super().content(packet_id, values) + b"\0"


class Flooding(OddBoard, name="flooding"):
    """Button event every 5 ms, without a subscription."""

    lesson = "events are told from responses"

    def opened(self, line: OddLine) -> None:
        if line in self.lines:
            line.send(frame(_BUTTON_EVENT, self.content(_BUTTON_EVENT, {"buttonID": 1, "event": 1}), self.order))
            self.after(0.005, lambda: self.opened(line))


class Silent(OddBoard, name="silent"):
    """Not a board: a silent port."""

    lesson = "refused within seconds"
    ignored = frozenset(NAMES.values())


class Chatting(Silent, name="chatting"):
    """Not a board: a positioning receiver with a line of text every 200 ms."""

    lesson = "refused as another device, with the text in the error"

    def opened(self, line: OddLine) -> None:
        if line in self.lines:
            line.send(b"$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n")
            self.after(0.2, lambda: self.opened(line))


class LoopBack(Silent, name="loop-back"):
    """Not a board: a plug with its two data lines connected."""

    lesson = "an echoed request is not a response"

    def heard(self, line: OddLine, data: bytes) -> None:
        line.send(data)


class Modem(Silent, name="modem"):
    """Not a board: a modem with the response ERROR to all bytes."""

    lesson = "refused as another device"

    def heard(self, line: OddLine, data: bytes) -> None:
        line.send(b"\r\nERROR\r\n")
