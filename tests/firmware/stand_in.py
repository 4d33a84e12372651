"""Firmware in place of the virtual board's own work, for tests of everything else: `pytest --board firmware`.

Requests to a virtual board that is as the document describes it go to the core of the firmware, and its stored records
are those of the firmware. Sessions, delays and lost connections stay those of the virtual board. Servos turn from -180
to 180 degrees and are held where they were when power comes on, which tests expect; flash takes no time, as many tests
expect a response at once.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any
from unittest import SkipTest

import msgspec

from servolink.protocol import (
    ALL_SERVOS,
    RECORD_TYPES,
    SERVO_PARAMETER,
    TABLE,
    ButtonEventResponse,
    ClearAllDataRequest,
    FrameParser,
    SetActiveJoystickTableRequest,
    SetAngleUnitRequest,
    SubscribeButtonEventRequest,
    encode_frame,
)
from servolink.virtual import (
    ADC,
    HIGHEST,
    LOWEST,
    AnyType,
    BoardKind,
    Contents,
    Hardware,
    Record,
    RequestContext,
    Response,
    SimulatedServo,
    Storage,
    VirtualBoard,
)
from tests.firmware.host import PERIOD, HostBoard, load

FOLDER = "SERVOLINK_FIRMWARE_TESTS"
"""Environment variable with the folder of the library `board.so`, and of a file with the tests that used it."""
USED = "used"
"""Name of that file: a line for each test that sent a request to a core."""

_STEP = 2000
_LONGEST = 60_000_000
"""Microseconds of which the last are passed in steps after a longer time."""
_TICKS = 5000
"""Ticks of flash after which a response does not come."""
_ROW = 35
"""Size of the parameters of a servo."""
_COUNT = 2
BOARD_SERVOS, BOARD_BUTTONS = 16, 8
NO_RESPONSE = {10050, 20050, 20060}
_KEEP_RECORDS = {10010, 10030, 10040, 20010, 20020, 20030, 20040, 30010, 30020, 30050, 30060, 30090, 30100, 30130} | {
    *(40010, 40020, 40060, 40070),
    *NO_RESPONSE,
}
"""Requests that change no record."""
_TIMING = ("turnaround", "write_seconds", "clear_seconds", "queue", "queue_bytes", "bus_powered")
"""What a kind of board may have beside the core."""
_VIRTUAL_INIT, _VIRTUAL_HANDLE = VirtualBoard.__init__, VirtualBoard.handle
_VIRTUAL_ADVANCE, _VIRTUAL_SWITCH = Hardware.advance, Hardware.switch
_VIRTUAL_PRESS, _VIRTUAL_RELEASE = Hardware.press_button, Hardware.release_button


class Core:
    """Core of the firmware behind a virtual board."""

    def __init__(self, functions: Any, board: VirtualBoard) -> None:
        """Switch on, and hold all servos where the virtual board has them."""
        self._host = HostBoard(functions, servos=len(board.servos), angles=(LOWEST, HIGHEST))
        self._board = board
        self._used_by = ""
        self._parser = FrameParser()
        self._epoch: float | None = None
        self.switch_on()

    def __del__(self) -> None:
        """Free the memory."""
        self._host.close()

    def switch_on(self) -> None:
        """Lose power, come back, and hold all servos where they were."""
        self._place([servo.angle for servo in self._board.servos.values()])

    def _place(self, angles: list[float]) -> None:
        self._host.cut_power(0)
        self.ask(20030, b"\xff\1\1")
        steps = b"".join(struct.pack("<Bhh", servo, round(angle), 0) for servo, angle in enumerate(angles, 1))
        self.ask(20050, bytes([len(angles)]) + steps, answered=False)
        self._host.run(1.1)
        self._epoch = None

    def advance(self, now: float) -> None:
        """Let time pass."""
        fields = self._host.fields
        epoch = now - fields.now / 1e6 if self._epoch is None else self._epoch
        self._epoch = epoch
        until = round((now - epoch) * 1e6)
        if until - fields.now > _LONGEST:
            self._host.tick(until - _LONGEST)
        step = _STEP if until - fields.now < 1_000_000 else 10 * _STEP
        while fields.now < until:
            self._host.tick(min(fields.now + step, until))
        self._take(None)

    def count(self) -> None:
        """Write the name of the running test to the file of tests that used a core."""
        name = os.environ.get("PYTEST_CURRENT_TEST", "").rpartition(" (")[0]
        if name != self._used_by:
            with suppress(OSError), (Path(os.environ[FOLDER]) / USED).open("a", encoding="utf-8") as file:
                file.write(f"{name}\n")  # fails in programs that may write no files
            self._used_by = name

    def press(self, button_id: int, *, is_down: bool) -> None:
        """Press or release a button, and let the time pass in which it may bounce."""
        bit = 1 << (button_id - 1)
        self._host.fields.pressed = self._host.fields.pressed & ~bit | bit * is_down
        before = self._host.fields.now
        for _ in range(3):
            self._host.tick(self._host.fields.now + round(PERIOD * 1e6))
        if self._epoch is not None:
            self._epoch -= (self._host.fields.now - before) / 1e6
        self._take(None)

    def angle(self, servo_id: int) -> float:
        """Return the angle of a servo in degrees, 0 for a released one."""
        value: int
        (value,) = struct.unpack("<h", (self.ask(20020, bytes([servo_id])) or bytes(12))[2:4])
        is_adc = self._board.servos[servo_id].unit == ADC
        return round((value - 1500) * (HIGHEST - LOWEST) / 2000) if is_adc else value

    def flags(self, servo_id: int) -> bytes:
        """Return whether a servo obeys and holds."""
        return (self.ask(20020, bytes([servo_id])) or bytes(12))[-2:]

    def ask(self, packet_id: int, content: bytes = b"", *, answered: bool = True) -> bytes | None:
        """Return the content of the response, None without one."""
        self._host.receive(encode_frame(packet_id, content, "little"))
        for _ in range(_TICKS if answered else 1):
            if (found := self._take(packet_id + 1)) is not None:
                return found
            self._host.fields.until = self._host.fields.now
            self._host.tick()
        return self._take(packet_id + 1)

    def _take(self, packet_id: int | None) -> bytes | None:
        found = None
        for received_id, content in self._parser.feed(self._host.transmit()):
            if received_id == packet_id:
                found = bytes(content)
            elif received_id == ButtonEventResponse.packet_id:
                self._board._send_event(encode_frame(received_id, content, "little"))
        return found


class CoreStorage(Storage):
    """Storage of a virtual board whose contents are those of a core."""

    def __init__(self, core: Core) -> None:
        """Start with what the core has."""
        self.core = core
        self.is_read = False
        self.chosen = 0
        super().__init__(BoardKind.DEFAULT)

    @property
    def contents(self) -> Contents:
        """Contents, in the order of the virtual board."""
        if not self.is_read:
            before, records = self._contents, dict[AnyType, tuple[Record, ...]]()
            for each in (SERVO_PARAMETER, *RECORD_TYPES):
                found = dict(self._read(each))
                kept = {record_id: old for record_id, old in before.records[each] if record_id in found}
                same = {record_id: kept[record_id] for record_id in kept if kept[record_id] == found[record_id]}
                records[each] = tuple(({**kept, **found} | same).items())
            if self.chosen not in {record_id for record_id, _ in records[TABLE]}:
                self.chosen = 0
            now = Contents(records, int.from_bytes(self.core.ask(30130) or b"", "little"), self.chosen)
            self._contents = before if now == before else now
            self.is_read = True
        return self._contents

    @contents.setter
    def contents(self, contents: Contents) -> None:
        self.core.ask(ClearAllDataRequest.packet_id)
        for each in RECORD_TYPES:
            for _, record in contents.records[each]:
                self._add(each.add_class.packet_id, record)
        parameters = [record for _, record in contents.records[SERVO_PARAMETER]]
        if parameters:
            self._add(
                SERVO_PARAMETER.add_class.packet_id, len(parameters).to_bytes(_COUNT, "little") + b"".join(parameters)
            )
        self._add(30120, contents.project_id.to_bytes(4, "little"))
        if contents.chosen_table:
            self._add(40050, contents.chosen_table.to_bytes(4, "little"))
        self._contents, self.chosen, self.is_read = contents, contents.chosen_table, True

    @property
    def used(self) -> int:
        """Used memory, in bytes."""
        return self.contents.size

    @used.setter
    def used(self, used: int) -> None:
        pass

    def put(self, stored_type: AnyType, records: Any, **options: Any) -> bool:
        """Add records as the virtual board does."""
        _ = self.contents
        is_put = super().put(stored_type, records, **options)
        self.contents = self._contents
        return is_put

    def _add(self, packet_id: int, content: bytes) -> None:
        if self.core.ask(packet_id, content) != b"\1":
            raise SkipTest(f"the firmware refuses what this test has stored: {packet_id} {content.hex()}")

    def _read(self, stored_type: AnyType) -> Iterator[Record]:
        if stored_type is SERVO_PARAMETER:
            rows = (self.core.ask(30100) or b"")[_COUNT:]
            yield from ((rows[at], rows[at : at + _ROW]) for at in range(0, len(rows), _ROW))
            return
        rows = (self.core.ask(stored_type.list_request.packet_id) or b"")[2:]  # type: ignore[attr-defined]
        for at in range(0, len(rows), 36):
            query = stored_type.query(int.from_bytes(rows[at : at + 4], "little"))  # type: ignore[attr-defined]
            record = self.core.ask(query.packet_id, rows[at : at + 4])
            assert record is not None
            yield int.from_bytes(rows[at : at + 4], "little"), record


class CoreServo(SimulatedServo):
    """Servo of a virtual board that is where the pulses of a core have it.

    A test that turns it sends a movement; a test that holds or releases it sends that.
    """

    def __init__(self, servo: SimulatedServo, core: Core) -> None:
        """Follow a core in place of a simulated servo."""
        self._core = core
        self._servo_id = servo.servo_id
        vars(self).update(vars(servo))

    @property
    def angle(self) -> float:
        """Angle in degrees, 0 without pulses."""
        return self._core.angle(self._servo_id)

    @angle.setter
    def angle(self, angle: float) -> None:
        self._core.ask(20050, struct.pack("<BBhh", 1, self._servo_id, round(angle), 0), answered=False)

    @property
    def is_start(self) -> int:
        """Whether the servo obeys."""
        return self._core.flags(self._servo_id)[0]

    @is_start.setter
    def is_start(self, is_start: int) -> None:
        self._core.ask(20030, bytes([self._servo_id, is_start, self.is_hold]))

    @property
    def is_hold(self) -> int:
        """Whether the servo holds its angle."""
        return self._core.flags(self._servo_id)[1]

    @is_hold.setter
    def is_hold(self, is_hold: int) -> None:
        self._core.ask(20030, bytes([self._servo_id, self.is_start, is_hold]))


def _handle(board: VirtualBoard, context: RequestContext[Any]) -> tuple[Response, float]:
    storage = board.storage
    if not isinstance(storage, CoreStorage):
        return _VIRTUAL_HANDLE(board, context)
    request, core = context.request, storage.core
    core.count()
    core.advance(context.now)
    packet_id = type(request).packet_id
    response = core.ask(packet_id, context.content, answered=packet_id not in NO_RESPONSE)
    storage.is_read = storage.is_read and packet_id in _KEEP_RECORDS
    if isinstance(request, SetAngleUnitRequest) and response:
        for servo in board.servos.values():
            if request.servo_id in {servo.servo_id, ALL_SERVOS}:
                servo.unit = request.unit_type
    if response == b"\1":
        if isinstance(request, SetActiveJoystickTableRequest):
            storage.chosen = request.table_id
        elif isinstance(request, SubscribeButtonEventRequest):
            context.host.subscribed = bool(request.subscribe)
    return response, board.kind.turnaround


def _advance(hardware: Hardware, now: float) -> None:
    _VIRTUAL_ADVANCE(hardware, now)
    if isinstance(hardware.storage, CoreStorage):
        hardware.storage.core.advance(now)


def _switch(hardware: Hardware, *, on: bool) -> None:
    _VIRTUAL_SWITCH(hardware, on=on)
    if on and isinstance(hardware.storage, CoreStorage):
        hardware.storage.core.switch_on()
        hardware.storage.is_read = False


def _press(hardware: Hardware, button_id: int, now: float) -> None:
    _turn(hardware, button_id, now, _VIRTUAL_PRESS, is_down=True)


def _release(hardware: Hardware, button_id: int, now: float) -> None:
    _turn(hardware, button_id, now, _VIRTUAL_RELEASE, is_down=False)


def _turn(hardware: Hardware, button_id: int, now: float, virtual: Callable[..., None], *, is_down: bool) -> None:
    if isinstance(hardware.storage, CoreStorage) and 1 <= button_id <= BOARD_BUTTONS:
        hardware.advance(now)
        hardware.storage.core.count()
        hardware.storage.core.press(button_id, is_down=is_down)
        hardware.notify_watchers()
    else:
        virtual(hardware, button_id, now)


def install() -> None:
    """Give all virtual boards of this process a core, if they are as the document has them."""
    functions = load(Path(os.environ[FOLDER]) / "board.so")

    def made(board: VirtualBoard, *arguments: Any, **options: Any) -> None:
        _VIRTUAL_INIT(board, *arguments, **options)
        timing = {name: getattr(board.kind, name) for name in _TIMING}
        is_described = msgspec.structs.replace(BoardKind.DEFAULT, **timing) == board.kind
        if is_described and board.codec.byte_order == "little" and 0 < len(board.servos) <= BOARD_SERVOS:
            core = Core(functions, board)
            board.servos.update((servo_id, CoreServo(servo, core)) for servo_id, servo in board.servos.items())
            board.storage = board.player._storage = board._buttons._storage = CoreStorage(core)

    VirtualBoard.__init__ = made  # type: ignore[method-assign, assignment]
    VirtualBoard.handle = _handle  # type: ignore[method-assign, assignment]
    Hardware.advance = _advance  # type: ignore[method-assign, assignment]
    Hardware.switch = _switch  # type: ignore[method-assign, assignment]
    Hardware.press_button = _press  # type: ignore[method-assign, assignment]
    Hardware.release_button = _release  # type: ignore[method-assign, assignment]
