"""Boards that take time: requests wait, and those that find no room are lost."""

from __future__ import annotations

from typing import Any

import pytest

from servolink import Action, Step, connect
from servolink.protocol import (
    ACTION,
    AddActionRequest,
    ButtonEventResponse,
    ClearAllDataRequest,
    ExecuteActionRequest,
    Packet,
    QueryMemorySizeRequest,
    QueryProjectIDRequest,
    QueryProjectIDResponse,
    QueryServoListRequest,
    QueryServoListResponse,
    QueryServoRequest,
    SendDummyDataRequest,
    SetServoParameterRequest,
    SubscribeButtonEventRequest,
    TransmissionModeSettingRequest,
    WriteProjectIDRequest,
    WriteProjectIDResponse,
)
from servolink.virtual.board import VirtualBoard
from servolink.virtual.kind import BoardKind
from servolink.virtual.servers import serve
from servolink.virtual.transport import VirtualTransport
from tests.tables import over
from tests.virtual.host import START, Host

IDS = QueryProjectIDRequest()  # 9 bytes
SERVOS = QueryServoListRequest()


class Line:
    """A host, and the times at which the board said something."""

    def __init__(self, board: VirtualBoard) -> None:
        self.host = Host(board)

    def send(self, *packets: Packet, at: float = 0.0) -> None:
        """Send all in one piece."""
        codec = self.host.board.codec
        self.host.session.receive(b"".join(map(codec.encode, packets)), START + at)

    def times(self) -> list[tuple[float, str]]:
        """Run the board until nothing is due; return when it said what."""
        board, now, said = self.host.board, START, []
        while True:
            heard, self.host.heard = self.host.heard, []
            said += [(round(now - START, 6), type(packet).__name__.removesuffix("Response")) for packet in heard]
            due = board.next_due(now)
            if due is None:
                return said
            now = due
            board.advance(now)


def line(**options: Any) -> Line:
    return Line(VirtualBoard(3, kind=BoardKind(**options)))


def test_requests_are_answered_one_after_the_other() -> None:
    busy = line(turnaround=0.01)
    busy.send(IDS, SERVOS, IDS)
    assert busy.times() == [(0.01, "QueryProjectID"), (0.02, "QueryServoList"), (0.03, "QueryProjectID")]
    busy.send(SERVOS, at=0.5)
    assert [kind for _, kind in busy.times()] == ["QueryServoList"]


def test_answers_come_at_their_time_however_late_the_board_is_advanced() -> None:
    board = VirtualBoard(3, kind=BoardKind(turnaround=0.5))
    host = Host(board)
    host.tell(ExecuteActionRequest((Step(1, 90, 100),)))
    host.tell(QueryServoRequest(1))
    board.advance(START + 100)
    assert 35 < host.heard[0].servos[0].angle < 65  # type: ignore[attr-defined] # after 0.5 of 1 s
    assert board.next_due(START + 100) is None


@pytest.mark.parametrize("queue", [0, 1, 2, 5])
def test_what_the_queue_does_not_hold_is_lost(queue: int) -> None:
    busy = line(turnaround=0.01, queue=queue)
    busy.send(*[IDS] * 6)
    assert len(busy.times()) == min(6, 1 + queue)
    busy.send(IDS, at=1.0)
    assert len(busy.times()) == 1


def test_the_queue_is_of_all_hosts() -> None:
    board = VirtualBoard(3, kind=BoardKind(turnaround=0.01, queue=1))
    first, other = Line(board), Line(board)
    first.send(IDS)
    other.send(SERVOS)
    first.send(IDS)
    assert first.times() == [(0.01, "QueryProjectID")]
    assert other.host.heard == [QueryServoListResponse((1, 2, 3))]


def test_a_stop_waits_and_is_lost_like_any_other_request() -> None:
    stop = SetServoParameterRequest(255, 0, 1)
    busy = line(turnaround=0.01, queue=1)
    busy.send(IDS, stop)
    assert busy.times() == [(0.01, "QueryProjectID"), (0.02, "SetServoParameter")]
    full = line(turnaround=0.01, queue=1)
    full.send(IDS, IDS, stop)
    full.times()
    assert full.host.board.servos[1].is_start == 1


def test_a_request_without_an_answer_takes_its_time() -> None:
    busy = line(turnaround=0.01)
    busy.send(SendDummyDataRequest(), ExecuteActionRequest(()), IDS)
    assert busy.times() == [(0.03, "QueryProjectID")]


def test_what_the_board_ignores_takes_no_time() -> None:
    busy = line(turnaround=0.01, mode=0, unsupported=("QueryMemorySize",))
    busy.send(IDS, TransmissionModeSettingRequest(1), QueryMemorySizeRequest(), IDS)
    assert busy.times() == [(0.01, "TransmissionModeSetting"), (0.02, "QueryProjectID")]


def test_storing_and_clearing_take_longer() -> None:
    slow = line(turnaround=0.01, write_seconds=0.1, clear_seconds=5)
    slow.send(WriteProjectIDRequest(1), AddActionRequest(0), AddActionRequest(1), ClearAllDataRequest(), IDS)
    assert slow.times() == [
        (0.11, "WriteProjectID"),
        (0.12, "AddAction"),  # refused
        (0.23, "AddAction"),
        (5.24, "ClearAllData"),
        (5.25, "QueryProjectID"),
    ]


@pytest.mark.parametrize(("room", "answers"), [(0, 1), (8, 1), (9, 2), (17, 2), (18, 3), (27, 4), (1000, 6)])
def test_bytes_beyond_the_buffer_are_lost(room: int, answers: int) -> None:
    busy = line(turnaround=0.01, queue_bytes=room)
    busy.send(*[IDS] * 6)
    assert len(busy.times()) == answers


@over("room", range(46))
def test_after_a_frame_was_cut_it_finds_the_next(room: int) -> None:
    busy = line(turnaround=0.01, queue_bytes=room)
    busy.send(IDS, AddActionRequest(5))
    assert len(busy.times()) == 1
    # What was cut claims bytes that did not come, and swallows a few requests until it must be wrong.
    answers = []
    for at in range(1, 7):
        busy.send(IDS, at=at / 50)
        answers.append(len(busy.times()))
    assert sum(answers) >= 5
    assert answers[-1] == 1
    busy.send(IDS, at=0.14)
    assert len(busy.times()) == 1


def test_a_buffer_is_of_one_host_and_has_room_again_when_a_request_is_taken_out() -> None:
    board = VirtualBoard(3, kind=BoardKind(turnaround=0.01, queue_bytes=9))
    first, other = Line(board), Line(board)
    first.send(IDS, SERVOS)
    other.send(IDS)
    first.send(IDS)  # lost
    board.advance(START + 0.015)
    first.send(IDS, at=0.015)
    first.times()
    assert first.host.board.next_due(START) is None
    assert other.host.heard == [QueryProjectIDResponse(0)]


def test_pieces_of_requests_fill_the_buffer_as_well() -> None:
    busy = line(turnaround=0.01, queue_bytes=17)
    frame = busy.host.board.codec.encode(IDS)
    busy.send(IDS)
    for piece in (frame[:8], frame[8:], frame[:8], frame[8:]):
        busy.host.session.receive(piece, START)
    assert len(busy.times()) == 2
    assert busy.host.session.waiting == 0


def test_events_are_sent_while_it_works() -> None:
    busy = line(turnaround=0.01, clear_seconds=1)
    busy.send(SubscribeButtonEventRequest(1))
    busy.times()
    busy.send(ClearAllDataRequest())
    busy.host.board.press_button(3, START + 0.5)
    busy.host.board.release_button(3, START + 0.6)
    assert busy.host.heard[0] == ButtonEventResponse(3, ButtonEventResponse.PRESS)
    assert len(busy.host.heard) == 2


def test_what_a_host_asked_before_it_left_is_done_without_an_answer() -> None:
    board = VirtualBoard(3, kind=BoardKind(turnaround=0.01))
    gone, other = Line(board), Line(board)
    gone.send(IDS, WriteProjectIDRequest(7))
    gone.host.session.detach()
    other.send(IDS)
    assert other.times() == [(0.03, "QueryProjectID")]
    assert gone.host.heard == []
    assert board.storage.project_id == 7


def test_a_host_that_asks_again_at_once_does_not_overtake_others() -> None:
    board = VirtualBoard(3, kind=BoardKind(turnaround=0.01))
    codec, said = board.codec, []

    def ask_again(frame: bytes) -> None:
        said.append(codec.decode_frame(frame))
        if len(said) == 1:
            first.receive(codec.encode(IDS), START + 0.01)

    first = board.attach(ask_again)
    first.receive(codec.encode(IDS) + codec.encode(SERVOS), START)
    board.advance(START + 1)
    assert [type(packet).__name__ for packet in said] == [
        "QueryProjectIDResponse",
        "QueryServoListResponse",
        "QueryProjectIDResponse",
    ]


def test_what_was_stored_after_waiting_is_noticed() -> None:
    busy = line(turnaround=0.01)
    busy.send(IDS, WriteProjectIDRequest(7))
    noticed: list[int] = []
    busy.host.board.watch(lambda: noticed.append(busy.host.board.storage.project_id))
    busy.times()
    assert noticed == [7, 7]


def test_losing_power_ends_the_work_and_empties_the_queue() -> None:
    busy = line(turnaround=0.01, queue=2, queue_bytes=30)
    busy.send(WriteProjectIDRequest(7), WriteProjectIDRequest(8), IDS)
    busy.host.board.power_cycle(START + 0.005)
    assert busy.times() == []
    assert busy.host.board.storage.project_id == 7
    busy.send(IDS, IDS, IDS, at=1)
    assert len(busy.times()) == 3


def test_power_lost_while_it_clears_leaves_a_part() -> None:
    left = set()
    for seed in range(40):
        board = VirtualBoard(3, seed, kind=BoardKind(clear_seconds=2, partial_writes=True, bus_powered=True))
        host = Host(board)
        host.store_action(1)
        host.store_action(2)
        host.tell(ClearAllDataRequest(), START + 1)
        host.session.detach(START + 2)
        left.add(len(board.storage.all(ACTION)))
    assert left == {0, 1, 2}


def test_a_write_that_was_answered_is_whole() -> None:
    for seed in range(20):
        board = VirtualBoard(3, seed, kind=BoardKind(write_seconds=1, partial_writes=True, bus_powered=True))
        host = Host(board)
        host.tell(WriteProjectIDRequest(7))
        board.advance(START + 1)
        assert host.heard == [WriteProjectIDResponse(1)]
        host.session.detach(START + 2)
        assert board.storage.project_id == 7


async def test_a_client_is_served_in_the_time_of_the_board() -> None:
    import asyncio

    loop = asyncio.get_running_loop()
    virtual = VirtualBoard(3, kind=BoardKind(turnaround=0.004, write_seconds=0.05, clear_seconds=2, queue=0))
    async with connect(VirtualTransport(virtual), patience=10) as board:
        start = loop.time()
        for _ in range(10):
            await board.servo_ids()
        assert loop.time() - start == pytest.approx(0.04)
        start = loop.time()
        await board.add_action(Action(1, "wave"))
        assert loop.time() - start == pytest.approx(0.054)


def test_over_a_pseudo_terminal_it_works_as_well() -> None:
    async def main() -> None:
        board = VirtualBoard(3, kind=BoardKind(mode=0, turnaround=0.002, queue=4, memory_unit=1024))
        async with serve(board, pty=True) as (url,), connect(url) as client:
            assert await client.servo_ids() == (1, 2, 3)
            assert (await client.memory()).total_size == 64

    import asyncio

    asyncio.run(main())
