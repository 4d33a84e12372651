"""Board written from the document alone; odd boards override single methods.

Without a clock: the driver passes the present time, in seconds of any monotonic clock.
"""

from __future__ import annotations

import heapq
import struct
from collections.abc import Callable, Sequence
from itertools import count
from typing import Any, ClassVar

from tests.lab.odd.wire import NAMES, ByteOrder, FrameReader, Values, decode, encode, frame

ALL = 0xFF
_INTERVAL_UNIT = 0.01  # seconds
_CHARGE = 874  # per mille
_MODE = 10010
_RECORDS = {30010: "action", 30050: "macro", 40010: "table"}
"""Query of each list; the query of a record, adding and deleting follow in steps of 10."""


class OddServo:
    """Servo that turns at an even speed to its goal."""

    def __init__(self, servo_id: int) -> None:
        self.servo_id = servo_id
        self.is_start = self.is_hold = 1
        self.unit = 0
        self._start = self._goal = 0.0
        self._begun = self._seconds = 0.0

    def move(self, number: int, seconds: float, now: float) -> None:
        """Turn to an angle in the unit in use, in so many seconds."""
        if self.is_start and self.is_hold:
            self._start, self._begun, self._seconds = self.degrees(now), now, seconds
            self._goal = (number - 500) / 3 if self.unit else float(number)

    def stop(self, now: float) -> None:
        """Stay at the present angle."""
        self._start = self._goal = self.degrees(now)

    def degrees(self, now: float) -> float:
        """Return the present angle in degrees."""
        share = (now - self._begun) / self._seconds if self._seconds else 1.0
        return self._start + (self._goal - self._start) * min(1.0, share)

    def state(self, now: float) -> Values:
        """Return the record of the servo in a response."""
        degrees = self.degrees(now)
        return {
            "servoID": self.servo_id,
            "angle": round(500 + 3 * degrees) if self.unit else round(degrees),
            "current": 12,
            "temperature": 301,
            "servoType": 1,
            "isStart": self.is_start,
            "isHold": self.is_hold,
        }


class OddLine:
    """Conversation of a host with an odd board."""

    def __init__(self, board: OddBoard, send: Callable[[bytes], None], unplugged: Callable[[], None]) -> None:
        self.board = board
        self.frames = FrameReader(board.order)
        self.free_at = 0.0
        """Time at which the last chunk in the queue of the board is sent."""
        self._send = send
        self._unplugged = unplugged

    def receive(self, data: bytes, now: float) -> None:
        """Receive bytes from the host at the time `now`."""
        self.board.advance(now)
        if data and self in self.board.lines:
            self.board.heard(self, data)
        self.board.notify()

    def send(self, data: bytes) -> None:
        """Send bytes to the host, unless it has detached."""
        if self in self.board.lines:
            self._send(data)

    def send_in_turn(self, seconds: float, data: bytes) -> None:
        """Send bytes `seconds` after the previous bytes, or after now on an idle line."""
        self.free_at = max(self.free_at, self.board.now) + seconds
        self.board.after(self.free_at - self.board.now, lambda: self.send(data))

    def close(self) -> None:
        """End the connection from the side of the board."""
        if self in self.board.lines:
            self.board.lines.remove(self)
            self._unplugged()

    def detach(self, now: float) -> None:
        """End the connection from the side of the host."""
        self.board.detach(self, now=now)


class OddBoard:
    """A board as the document describes it."""

    lesson: ClassVar[str] = "the standard for all others"
    order: ClassVar[ByteOrder] = "little"
    encoding: ClassVar[str] = "utf-8"
    captions: ClassVar[tuple[str, ...]] = ("揮手", "鞠躬", "前進", "左手")
    """Captions of two actions, a macro and a servo."""
    servo_ids: ClassVar[Sequence[int]] = (1, 2, 3, 4)
    power_up_mode: ClassVar[int] = 1
    delay: ClassVar[float] = 0.001
    """Seconds from a request to the response."""
    memory: ClassVar[int] = 65536
    ignored: ClassVar[frozenset[str]] = frozenset()
    """Names of requests without a response, such as `QueryMemorySize`."""
    name: ClassVar[str] = "plain"

    def __init_subclass__(cls, name: str) -> None:
        """Name the kind."""
        super().__init_subclass__()
        cls.name = name

    def __init__(self) -> None:
        """Switch on, with a few records."""
        self.now = 0.0
        self.mode = self.power_up_mode
        self.lines: list[OddLine] = []
        self.servos = {servo_id: OddServo(servo_id) for servo_id in self.servo_ids}
        self.project_id = 4242
        self.active_table = 1
        first = next(iter(self.servo_ids), 1)
        step = {"servoID": first, "degree": 20, "interval": 50}
        command = {"commandID": 1, "type": 0, "ratio": 100, "loop": 1, "totalInterval": 500}
        button = {"buttonID": 1, "buttonPressMacro": 1, "buttonLongPressMacro": 0, "buttonUpMacro": 0}
        captions = [self.caption(text) for text in self.captions]
        self.records: dict[int, dict[int, Values]] = {
            30010: {
                1: {"actionID": 1, "actionCaption": captions[0], "stepCount": 1, "steps": [step]},
                2: {"actionID": 2, "actionCaption": captions[1], "stepCount": 0, "steps": []},
            },
            30050: {1: {"macroID": 1, "macroCaption": captions[2], "commandCount": 1, "commands": [command]}},
            40010: {
                1: {
                    "tableID": 1,
                    "tableCaption": captions[0],
                    "buttonCount": 1,
                    "buttons": [{**button, "buttonCaption": captions[0], "uninterruptible": 0}],
                }
            },
        }
        self.parameters: dict[int, Values] = {
            first: {"servoID": first, "adjustedDegree": 0, "servoCaption": captions[3]}
        }
        self._timers: list[tuple[float, int, Callable[[], object]]] = []
        self._numbers = count()
        self._watchers: list[Callable[[], None]] = []
        self._handlers: dict[str, Callable[[Values], Values | None]] = {
            "TransmissionModeSetting": self.set_mode,
            "ClearAllData": self._clear,
            "QueryMemorySize": self.memory_size,
            "QueryRemainPower": self.remaining_power,
            "QueryServoList": self.servo_list,
            "QueryServo": self.servo_states,
            "SetServoParameter": self._set_flags,
            "SetAngleUnit": self.set_unit,
            "ExecuteAction": self._move,
            "ExecuteActionEx": self._run_action,
            "ExecuteMacro": lambda values: {"result": int(values["macroID"] in self.records[30050])},
            "QueryServoParameter": lambda values: _group("servo", self.parameters.values()),
            "AddServoParameter": self._add_parameters,
            "WriteProjectID": self.write_project_id,
            "QueryProjectID": lambda values: {"projectID": self.project_id},
            "SetActiveJoystickTable": self._activate,
            "QueryActiveJoystickTable": lambda values: {"tableID": self.active_table},
            "SubscribeButtonEvent": lambda values: {"result": 1},
        }

    # ── time and hosts, as the driver and the servers use them ──

    def attach(
        self,
        send: Callable[[bytes], None],
        unsent: Callable[[], int] = lambda: 0,
        unplugged: Callable[[], None] = lambda: None,
    ) -> OddLine:
        """Attach a host; `send` receives the bytes of the board, `unplugged` is called if the board hangs up."""
        line = OddLine(self, send, unplugged)
        self.lines.append(line)
        # Later: the host gets its session only with the end of this method.
        self.after(0.0, lambda: self.opened(line))
        self.notify()
        return line

    def detach(self, *lines: OddLine, now: float | None = None) -> None:
        """Detach hosts at the time `now`."""
        if now is not None:
            self.advance(now)
        self.lines = [line for line in self.lines if line not in lines]

    def advance(self, now: float) -> None:
        """Execute all events due until `now`."""
        while self._timers and self._timers[0][0] <= now:
            due, _, act = heapq.heappop(self._timers)
            self.now = max(self.now, due)
            act()
        self.now = max(self.now, now)

    def next_due(self, now: float) -> float | None:
        """Return the time for the next call of `advance`; None if nothing will happen."""
        return max(now, self._timers[0][0]) if self._timers else None

    def watch(self, changed: Callable[[], None]) -> None:
        """Call `changed` when `next_due` may have changed."""
        self._watchers.append(changed)

    def unwatch(self, changed: Callable[[], None]) -> None:
        """End the calls begun by `watch`."""
        self._watchers.remove(changed)

    def notify(self) -> None:
        """Call all watchers, as `next_due` may have changed."""
        for changed in list(self._watchers):
            changed()

    def after(self, seconds: float, act: Callable[[], object]) -> None:
        """Call `act` after so many seconds."""
        heapq.heappush(self._timers, (self.now + seconds, next(self._numbers), act))

    # ── the conversation, to be overridden ──

    def opened(self, line: OddLine) -> None:
        """Begin the conversation with a new host."""

    def heard(self, line: OddLine, data: bytes) -> None:
        """Find the frames in bytes from a host, and take the requests."""
        for packet_id, content in line.frames.feed(data):
            if packet_id in NAMES:
                self.take(line, packet_id, content)

    def take(self, line: OddLine, packet_id: int, content: bytes) -> None:
        """Execute a request and send the response; in the old mode, only the mode can be set."""
        if (self.mode == 0 and packet_id != _MODE) or NAMES[packet_id] in self.ignored:
            return
        try:
            response = self.answer(packet_id, decode(packet_id, content, self.order))
        except (KeyError, struct.error):
            return
        if response is not None:
            self.transmit(line, frame(packet_id + 1, self.content(packet_id + 1, response), self.order))

    def answer(self, packet_id: int, values: Values) -> Values | None:
        """Return the fields of the response to a request; None for no response."""
        for base, stored in self.records.items():
            if base <= packet_id <= base + 30:
                return self.answer_for_records(packet_id, values, stored, base)
        handler = self._handlers.get(NAMES[packet_id])
        return handler(values) if handler else None

    def content(self, packet_id: int, values: Values) -> bytes:
        """Return the content of a response."""
        return encode(packet_id, values, self.order)

    def transmit(self, line: OddLine, data: bytes) -> None:
        """Send the frame of a response after the usual delay."""
        self.after(self.delay, lambda: line.send(data))

    # ── the answers, to be overridden ──

    def caption(self, text: str) -> bytes:
        """Return a caption as stored, 32 bytes."""
        return text.encode(self.encoding).ljust(32, b"\0")

    def set_mode(self, values: Values) -> Values:
        """Set the transmission mode, and return the mode."""
        self.mode = values["mode"]
        return {"result": self.mode}

    def memory_size(self, values: Values) -> Values:
        """Return free and total memory."""
        return {"size": max(0, self.memory - self.used), "totalSize": self.memory}

    @property
    def used(self) -> int:
        """Bytes in use by stored records, as in their responses."""
        return sum(
            len(encode(base + 11, record, self.order))
            for base, stored in self.records.items()
            for record in stored.values()
        )

    def remaining_power(self, values: Values) -> Values:
        """Return the charge in per mille."""
        return {"permil": _CHARGE}

    def servo_list(self, values: Values) -> Values:
        """Return the ids of all servos."""
        return {"servoCount": len(self.servos), "servoIDList": [{"servoID": servo_id} for servo_id in self.servos]}

    def servo_states(self, values: Values) -> Values:
        """Return the states of the requested servos."""
        return _group("servo", [servo.state(self.now) for servo in self.addressed(values["servoID"])])

    def set_unit(self, values: Values) -> Values:
        """Set the angle unit of the addressed servos."""
        addressed = self.addressed(values["servoID"])
        for servo in addressed:
            servo.unit = values["unitType"]
        return values if addressed else {"servoID": 0, "unitType": 1 - values["unitType"]}

    def move(self, servo: OddServo, step: Values) -> None:
        """Begin the movement of one servo."""
        servo.move(step["degree"], step["interval"] * _INTERVAL_UNIT, self.now)

    def store(self, stored: dict[int, Values], record_id: int, values: Values) -> int:
        """Store a record, and return the result."""
        if self.used + 64 > self.memory:
            return 0
        stored[record_id] = values
        return 1

    def write_project_id(self, values: Values) -> Values:
        """Store the project id, and return the result."""
        self.project_id = values["projectID"]
        return {"result": 1}

    def addressed(self, servo_id: int) -> list[OddServo]:
        """Return the servos addressed by an id."""
        if servo_id == ALL:
            return list(self.servos.values())
        return [self.servos[servo_id]] if servo_id in self.servos else []

    def answer_for_records(self, packet_id: int, values: Values, stored: dict[int, Values], base: int) -> Values:
        """Return the response to listing, reading, adding or deleting of records."""
        kind = _RECORDS[base]
        if packet_id == base:
            return _group(kind, stored.values())
        record_id = values[f"{kind}ID"]
        if packet_id == base + 10:
            return stored.get(record_id) or _absent(kind)
        if packet_id == base + 20:
            return {"result": self.store(stored, record_id, values)}
        return {"result": int(stored.pop(record_id, None) is not None)}

    # ── the other answers ──

    def _clear(self, values: Values) -> Values:
        for stored in self.records.values():
            stored.clear()
        self.parameters.clear()
        self.project_id = self.active_table = 0
        return {"result": 1}

    def _set_flags(self, values: Values) -> Values:
        addressed = self.addressed(values["servoID"])
        for servo in addressed:
            servo.is_start, servo.is_hold = values["isStart"], values["isHold"]
            if not servo.is_start:
                servo.stop(self.now)
        return values if addressed else {"servoID": 0, "isStart": 1 - values["isStart"], "isHold": 1}

    def _move(self, values: Values) -> None:
        for step in values["steps"]:
            for servo in self.addressed(step["servoID"]):
                self.move(servo, step)

    def _run_action(self, values: Values) -> None:
        self._move(self.records[30010].get(values["actionID"]) or {"steps": []})

    def _add_parameters(self, values: Values) -> Values:
        self.parameters.update({each["servoID"]: each for each in values["servos"]})
        return {"result": 1}

    def _activate(self, values: Values) -> Values:
        is_stored = values["tableID"] in self.records[40010]
        self.active_table = values["tableID"] if is_stored else self.active_table
        return {"result": int(is_stored)}


def _group(kind: str, records: Any) -> Values:
    records = list(records)
    return {f"{kind}Count": len(records), f"{kind}s": records}


_PARTS = {"action": ("step", "steps"), "macro": ("command", "commands"), "table": ("button", "buttons")}


def _absent(kind: str) -> Values:
    part, parts = _PARTS[kind]
    return {f"{kind}ID": 0, f"{kind}Caption": bytes(32), f"{part}Count": 0, parts: []}
