"""What a board does when its power goes, and what is left of a write that was under way."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from servolink.protocol import (
    AddActionRequest,
    ClearAllDataRequest,
    Codec,
    DeleteActionRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    MacroCommand,
    Packet,
    QueryServoListRequest,
    QueryServoListResponse,
    SetAngleUnitRequest,
    SetServoParameterRequest,
    Step,
    SubscribeButtonEventRequest,
    TransmissionModeSettingRequest,
    WriteProjectIDRequest,
)
from servolink.virtual.board import HostSession, VirtualBoard
from servolink.virtual.kind import BoardKind
from servolink.virtual.simulated_servo import ADC, DEGREES
from servolink.virtual.storage import Contents
from tests.virtual.host import START, Host

CODEC = Codec()
ACTION = AddActionRequest(1, "wave", tuple(Step(at, 30, 40) for at in range(1, 9)))


def busy() -> VirtualBoard:
    """A board that loses its power with its last host, which is Host 0, with all sorts of things going on."""
    host = Host(VirtualBoard(servos=3, kind=BoardKind(bus_powered=True)))
    host.store_macro(1, MacroCommand(500, 1, loop=100))
    host.ask(ExecuteMacroRequest(1))
    host.ask(SetAngleUnitRequest(2, ADC))
    host.ask(SetServoParameterRequest(3, 0, 1))
    host.ask(SubscribeButtonEventRequest(1))
    host.board.servos[1].angle = 0.0
    host.tell(ExecuteActionRequest((Step(1, 90, 100),)))
    host.board.press_button(4, START)
    return host.board


def forgotten(board: VirtualBoard) -> bool:
    """Tell whether nothing is going on any more."""
    return (
        board.next_due(START) is None
        and board.player.macro_id == 0
        and not any(servo.moving for servo in board.servos.values())
        and all(servo.unit == DEGREES and servo.is_start for servo in board.servos.values())
        and not any(session.subscribed for session in board.sessions)
    )


def test_a_board_keeps_running_without_hosts_unless_it_reboots() -> None:
    board = busy()
    other = Host(board)
    (first, _) = board.sessions
    first.detach(START + 0.25)
    assert not forgotten(board)
    other.session.detach(START + 0.5)
    assert forgotten(board)
    assert not board.powered
    assert not any(servo.is_hold for servo in board.servos.values())
    assert board.servos[1].angle == pytest.approx(45)  # where it was half way, and stays
    board.advance(START + 10)
    assert board.servos[1].angle == pytest.approx(45)


def test_the_next_host_finds_it_as_switched_on_with_all_that_is_stored() -> None:
    board = busy()
    contents = board.storage.contents
    board.sessions[0].detach(START + 0.5)
    host = Host(board)
    assert board.powered
    assert board.storage.contents is contents
    for servo_id in board.servos:
        state = host.servo(servo_id, START + 1)
        assert (state.is_start, state.is_hold) == (1, 1)
    host.board.press_button(4, START + 1)  # it was down when the power went
    assert host.board.next_due(START + 1) == pytest.approx(START + 1.8)
    assert host.heard[-1].packet_id != 40081  # and nobody has subscribed


def test_buttons_do_nothing_without_power() -> None:
    board = busy()
    board.sessions[0].detach()
    board.press_button(5, START + 1)
    assert board.next_due(START + 1) is None
    board.release_button(5, START + 1)
    assert board.player.macro_id == 0


def test_several_hosts_of_one_plug_are_gone_at_once() -> None:
    board = busy()
    Host(board)
    board.detach(*board.sessions)
    assert forgotten(board)
    assert board.sessions == []


def test_the_old_protocol_is_forgotten() -> None:
    board = VirtualBoard(servos=1, kind=BoardKind(bus_powered=True))
    host = Host(board)
    host.tell(TransmissionModeSettingRequest(0))
    assert host.tell(QueryServoListRequest()) == []
    host.session.detach()
    assert Host(board).ask(QueryServoListRequest()) == QueryServoListResponse((1,))


def test_a_power_cycle_forgets_what_hosts_that_stay_have_said() -> None:
    board = busy()
    host = Host(board)
    host.tell(SubscribeButtonEventRequest(1))
    half = CODEC.encode(ACTION)[:20]
    host.session.receive(half, START + 0.4)
    board.power_cycle(START + 0.5)
    assert board.servos[1].angle == pytest.approx(45)
    assert forgotten(board)
    assert board.powered
    assert all(servo.is_hold for servo in board.servos.values())
    assert host.ask(QueryServoListRequest(), START + 0.6) == QueryServoListResponse((1, 2, 3))  # the half frame is gone


def test_those_who_watch_learn_that_nothing_is_due_any_more() -> None:
    board, due = busy(), []
    board.watch(lambda: due.append(board.next_due(START)))
    board.sessions[0].detach(START)
    assert due == [None]


def test_a_host_that_detaches_twice_takes_the_power_once() -> None:
    board = VirtualBoard(servos=1, kind=BoardKind(bus_powered=True))
    first = Host(board)
    first.session.detach()
    second = Host(board)
    first.session.detach()
    assert board.powered
    second.session.detach()
    assert not board.powered


class Cut:
    """A host whose cable is cut when a number of bytes of what the board says have come through."""

    def __init__(self, board: VirtualBoard, after: int) -> None:
        self.session = board.attach(self._hear, lambda: self.lost)
        self.lost = 0
        self._left = after

    def _hear(self, data: bytes) -> None:
        self.lost += len(data[self._left :])
        self._left -= len(data)
        if self._left < 0:
            self.session.detach()


STORED = AddActionRequest(2, "kept", (Step(1, 1, 1),))


def left(packet: Packet, after: int, *, partial_writes: bool, bus_powered: bool) -> list[Contents]:
    """Return what may be stored when the cable is cut `after` bytes of the answer."""
    seen: list[Contents] = []
    for seed in range(60):
        board = VirtualBoard(
            servos=1, seed=seed, kind=BoardKind(partial_writes=partial_writes, bus_powered=bus_powered)
        )
        host = Host(board)
        host.ask(STORED)
        host.ask(WriteProjectIDRequest(5))
        cut = Cut(board, after)
        host.session.detach()
        cut.session.receive(CODEC.encode(packet), START)
        cut.session.detach()
        if board.storage.contents not in seen:
            seen.append(board.storage.contents)
    return seen


ANSWER = 10


@pytest.mark.parametrize("packet", [ACTION, DeleteActionRequest(2), ClearAllDataRequest()])
def test_a_write_is_torn_until_the_host_has_all_of_its_answer(packet: Packet) -> None:
    (done,) = left(packet, ANSWER, partial_writes=True, bus_powered=True)
    for after in (0, 1, ANSWER - 1):
        assert len(left(packet, after, partial_writes=True, bus_powered=True)) > 3
        assert left(packet, after, partial_writes=False, bus_powered=True) == [done]
        assert left(packet, after, partial_writes=True, bus_powered=False) == [done]


def project_ids(end: Callable[[VirtualBoard, HostSession], None]) -> set[int]:
    """Write a project id, hear nothing, let that `end`, and return which ids the board may then have."""
    seen = set()
    for seed in range(20):
        board = VirtualBoard(seed=seed, kind=BoardKind(partial_writes=True, bus_powered=True))
        session = board.attach(lambda _: None, lambda: ANSWER)
        session.receive(CODEC.encode(WriteProjectIDRequest(77)), START)
        end(board, session)
        seen.add(board.storage.project_id)
    return seen


def test_a_power_cycle_tears_once() -> None:
    def cycle(board: VirtualBoard, session: HostSession) -> None:
        board.power_cycle(START)
        board.power_cycle(START + 1)
        contents = board.storage.contents
        session.detach()
        assert board.storage.contents is contents

    assert project_ids(cycle) == {0, 77}


def test_a_write_is_done_when_its_host_goes_and_the_power_stays() -> None:
    def first(board: VirtualBoard, session: HostSession) -> None:
        other = Host(board)
        session.detach()
        other.session.detach()

    assert project_ids(first) == {77}


def test_of_several_hosts_at_once_the_last_write_is_torn() -> None:
    def together(board: VirtualBoard, session: HostSession) -> None:
        board.detach(session, Host(board).session)

    def overtaken(board: VirtualBoard, session: HostSession) -> None:
        other = Host(board)
        other.ask(WriteProjectIDRequest(5))
        board.detach(session, other.session)

    assert project_ids(together) == {0, 77}
    assert project_ids(overtaken) == {5}


def test_what_was_set_from_outside_is_not_torn() -> None:
    def change(board: VirtualBoard, session: HostSession) -> None:
        board.storage.project_id = 9
        session.detach()

    assert project_ids(change) == {9}
