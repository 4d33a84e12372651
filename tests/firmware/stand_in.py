"""Firmware in place of the virtual board's own work, for tests of everything else: `pytest --board firmware`.

Requests to a virtual board that is as the document describes it go to the core of the firmware, and its stored records
are those of the firmware. Sessions, delays and lost connections stay those of the virtual board. Servos are held at 0
degrees when power comes on, which tests expect; flash takes no time, as many tests expect a response at once.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import msgspec
import pytest

from servolink.protocol.frame import encode_frame
from servolink.protocol.joystick import ButtonEventResponse, SetActiveJoystickTableRequest, SubscribeButtonEventRequest
from servolink.protocol.parser import FrameParser
from servolink.protocol.record_types import RECORD_TYPES, SERVO_PARAMETER, TABLE
from servolink.protocol.settings import ClearAllDataRequest
from servolink.virtual.board import VirtualBoard
from servolink.virtual.handlers import RequestContext, Response
from servolink.virtual.hardware import Hardware
from servolink.virtual.kind import DEFAULT_KIND
from servolink.virtual.simulated_servo import SimulatedServo
from servolink.virtual.storage import AnyType, Contents, Record, Storage
from tests.firmware.conversations import frame
from tests.firmware.host import HostBoard, library

_STEP = 2000
_LONGEST = 60_000_000
"""Microseconds of which the last are passed in steps after a longer time."""
_TICKS = 5000
"""Ticks of flash after which a response does not come."""
_ROW = 35
"""Size of the parameters of a servo."""
_COUNT = 2
BOARD_SERVOS = 16
NO_RESPONSE = {10050, 20050, 20060}
_KEEP_RECORDS = {10010, 10030, 10040, 20010, 20020, 20030, 20040, 30010, 30020, 30050, 30060, 30090, 30100, 30130} | {
    *(40010, 40020, 40060, 40070),
    *NO_RESPONSE,
}
"""Requests that change no record."""
_TIMING = ("turnaround", "write_seconds", "clear_seconds", "queue", "queue_bytes", "bus_powered")
"""What a kind of board may have beside the core."""
_VIRTUAL_HANDLE, _VIRTUAL_ADVANCE, _VIRTUAL_SWITCH = VirtualBoard.handle, Hardware.advance, Hardware.switch


_OWN = "the test changes the storage of the virtual board itself"
DIFFERENT = {
    "tests/project/test_import.py::test_a_project_that_is_there_but_for_a_doubled_record_is_not_there_yet": _OWN,
    "tests/project/test_import.py::test_a_project_that_just_fits_is_taken": _OWN,
    "tests/project/test_import.py::test_doubled_records_make_room_where_they_go": _OWN,
    "tests/project/test_long_lists.py::"
    "test_a_deletion_that_was_done_and_does_not_show_makes_everything_be_read_again": _OWN,
    "tests/project/test_long_lists.py::"
    "test_a_write_that_was_done_and_does_not_show_makes_everything_be_read_again": _OWN,
    "tests/project/test_project_ids.py::test_a_board_that_refuses_large_ids_gets_a_small_marker": _OWN,
    "tests/project/test_reading.py::test_what_is_listed_twice_is_named": _OWN,
    "tests/project/test_untaken.py": _OWN,
}
"""Tests, and files of tests, that are not for the firmware."""


class Core:
    """Core of the firmware behind a virtual board."""

    requests = 0
    """Requests that boards of this process have got."""

    def __init__(self, functions: Any, board: VirtualBoard) -> None:
        """Switch on, and hold all servos at 0 degrees."""
        self._host = HostBoard(functions, servos=len(board.servos))
        self._board = board
        self._parser = FrameParser()
        self._epoch: float | None = None
        self.switch_on()

    def __del__(self) -> None:
        """Free the memory."""
        self._host.close()

    def switch_on(self) -> None:
        """Lose power, come back, and hold all servos at 0 degrees."""
        self._host.cut_power(0)
        self.ask(20030, b"\xff\1\1")
        count = len(self._board.servos)
        self.ask(20050, bytes([count]) + b"".join(bytes([servo, 0, 0, 0, 0]) for servo in range(1, count + 1)))
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

    def ask(self, packet_id: int, content: bytes = b"", *, answered: bool = True) -> bytes | None:
        """Return the content of the response, None without one."""
        self._host.receive(frame(packet_id, content))
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
        super().__init__(DEFAULT_KIND)

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
            pytest.skip(f"the firmware refuses what this test has stored: {packet_id} {content.hex()}")

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


class CoreServos(dict[int, SimulatedServo]):
    """Servos of a virtual board, at the angles of a core."""

    def __init__(self, servos: dict[int, SimulatedServo], core: Core) -> None:
        """Follow a core."""
        super().__init__(servos)
        self._core = core

    def __getitem__(self, servo_id: int) -> SimulatedServo:
        """Return a servo as it is now."""
        self._follow()
        return super().__getitem__(servo_id)

    def _follow(self) -> None:
        rows = (self._core.ask(20020, b"\xff") or b"")[1:]
        for at in range(0, len(rows), 11):
            servo = super().__getitem__(rows[at])
            servo.angle = float(int.from_bytes(rows[at + 1 : at + 3], "little", signed=True))
            servo.is_start, servo.is_hold = rows[at + 9], rows[at + 10]


def _handle(board: VirtualBoard, context: RequestContext[Any]) -> tuple[Response, float]:
    storage = board.storage
    if not isinstance(storage, CoreStorage):
        return _VIRTUAL_HANDLE(board, context)
    Core.requests += 1
    request, core = context.request, storage.core
    core.advance(context.now)
    packet_id = type(request).packet_id
    response = core.ask(packet_id, context.content, answered=packet_id not in NO_RESPONSE)
    storage.is_read = storage.is_read and packet_id in _KEEP_RECORDS
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


@pytest.fixture(scope="session", autouse=True)
def _boards_have_a_core(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Give all virtual boards a core, if they are as the document has them."""
    functions = library(tmp_path_factory.mktemp("core"))
    make = VirtualBoard.__init__

    def made(board: VirtualBoard, *arguments: Any, **options: Any) -> None:
        make(board, *arguments, **options)
        timing = {name: getattr(board.kind, name) for name in _TIMING}
        is_described = msgspec.structs.replace(DEFAULT_KIND, **timing) == board.kind
        if is_described and board.codec.byte_order == "little" and 0 < len(board.servos) <= BOARD_SERVOS:
            core = Core(functions, board)
            board.servos = CoreServos(board.servos, core)
            board.storage = board.player._storage = board._buttons._storage = CoreStorage(core)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(VirtualBoard, "__init__", made)
        patch.setattr(VirtualBoard, "handle", _handle)
        patch.setattr(Hardware, "advance", _advance)
        patch.setattr(Hardware, "switch", _switch)
        yield


@pytest.fixture(autouse=True)
def _is_counted(request: pytest.FixtureRequest) -> Iterator[None]:
    before = Core.requests
    yield
    if Core.requests > before:
        request.node.user_properties.append(("firmware", Core.requests - before))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Count the tests whose board was the firmware."""
    reports = [each for kind in terminalreporter.stats.values() for each in kind if isinstance(each, pytest.TestReport)]
    used = {each.nodeid for each in reports if any(name == "firmware" for name, _ in each.user_properties)}
    failed = {each.nodeid for each in reports if each.failed}
    terminalreporter.write_line(f"{len(used)} tests used the firmware, {len(used & failed)} of them failed")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave out what the firmware is right to do otherwise."""
    for item in items:
        name = item.nodeid.partition("[")[0]
        if reason := DIFFERENT.get(name) or DIFFERENT.get(name.partition("::")[0]):
            item.add_marker(pytest.mark.skip(reason))
