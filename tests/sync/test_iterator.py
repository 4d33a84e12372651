"""Iterators of servolink.sync: items in order, none lost, and an end."""

from __future__ import annotations

import gc
import itertools
import threading
from collections.abc import Iterator
from math import nan
from types import SimpleNamespace
from typing import Any

import pytest

import servolink.sync
from servolink.errors import ConnectionLost
from servolink.protocol import ButtonEventResponse, SubscribeButtonEventRequest
from tests.client.piped_board import PipedBoard
from tests.processes import until
from tests.sync.sync_board import on_loop, opened

START, END = SubscribeButtonEventRequest(1), SubscribeButtonEventRequest(0)


@pytest.fixture
def fake() -> PipedBoard:
    return PipedBoard()


@pytest.fixture
def board(fake: PipedBoard) -> Iterator[servolink.sync.Board]:
    with opened(fake) as board:
        yield board


def press(fake: PipedBoard, *button_ids: int) -> None:
    on_loop(fake.speak, *(ButtonEventResponse(button_id, 1) for button_id in button_ids))


def test_events_come_in_order(fake: PipedBoard, board: servolink.sync.Board) -> None:
    with board.button_events() as events:
        press(fake, 1, 2, 3)
        assert [next(events).button_id for _ in range(3)] == [1, 2, 3]
        assert repr(events) == "<ButtonEvents subscribed, 0 unread, 0 dropped>"
    assert fake.executed_of(SubscribeButtonEventRequest) == [START, END]
    with pytest.raises(StopIteration):
        next(events)


def test_servos_are_read_until_the_end_of_the_block(fake: PipedBoard, board: servolink.sync.Board) -> None:
    with board.watch(500) as readings:
        assert repr(readings) == "<ServoReadings at 500 Hz, reading>"
        first, second = next(readings), next(readings)
        assert first.seconds < second.seconds
        assert len(first.servos) == len(second.servos) == 4
    with pytest.raises(StopIteration):
        next(readings)


def test_a_slow_reader_loses_the_oldest(fake: PipedBoard, board: servolink.sync.Board) -> None:
    with board.button_events(limit=2) as events:
        press(fake, 1, 2, 3)
        assert [event.button_id for event in events.within(0)] == [2, 3]
        assert events.dropped == 1


def test_a_loop_can_have_its_time(fake: PipedBoard, board: servolink.sync.Board) -> None:
    with board.button_events() as events:
        assert not list(events.within(0.02))
        press(fake, 7)
        assert [event.button_id for event in events.within(0.02)] == [7]
        assert not list(events.within(-1))


@pytest.mark.parametrize(
    ("seconds", "error"), [("x", TypeError), (None, TypeError), (True, TypeError), (nan, ValueError)]
)
def test_the_time_of_a_loop_must_be_a_number(seconds: Any, error: type[Exception], board: servolink.sync.Board) -> None:
    events = board.button_events()
    with pytest.raises(error, match=f"^seconds must be a number of seconds, not {seconds!r}$"):
        events.within(seconds)


def test_a_loop_slower_than_its_events_ends_in_time(
    fake: PipedBoard, board: servolink.sync.Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    with board.button_events() as events:
        press(fake, *range(10))
        clock = itertools.count()  # one second from each look at it to the next
        monkeypatch.setattr("servolink.sync.iterator.time", SimpleNamespace(monotonic=lambda: next(clock)))
        read = [event.button_id for event in events.within(3.5)]
        monkeypatch.undo()
        assert read == [0, 1]
        assert [event.button_id for event in events.within(0)] == [2, 3, 4, 5, 6, 7, 8, 9]


def test_an_event_after_the_time_is_up_is_not_lost(fake: PipedBoard, board: servolink.sync.Board) -> None:
    with board.button_events() as events:
        assert next(events.within(0.01), None) is None
        press(fake, 7, 8)
        assert next(events).button_id == 7
        assert [event.button_id for event in events.within(0)] == [8]


def test_leaving_the_loop_unsubscribes(fake: PipedBoard, board: servolink.sync.Board) -> None:
    def press_when_subscribed() -> None:
        until(lambda: fake.executed_of(SubscribeButtonEventRequest) or fake.closed)
        if not fake.closed:
            press(fake, 1)

    threading.Thread(target=press_when_subscribed).start()
    for _ in board.button_events():
        break
    gc.collect()
    board.servo_ids()  # behind the end of the subscription
    assert fake.executed_of(SubscribeButtonEventRequest) == [START, END]


def test_closing_ends_another_threads_loop(fake: PipedBoard, board: servolink.sync.Board) -> None:
    events = board.button_events()
    assert not list(events.within(0))
    seen: list[ButtonEventResponse] = []
    thread = threading.Thread(target=lambda: seen.extend(events))
    thread.start()
    events.close()
    events.close()
    thread.join()
    assert not seen


def test_two_threads_share_an_iterator(fake: PipedBoard, board: servolink.sync.Board) -> None:
    with board.button_events() as events:
        seen: list[int] = []
        threads = [
            threading.Thread(target=lambda: seen.extend(next(events).button_id for _ in range(5))) for _ in range(2)
        ]
        for thread in threads:
            thread.start()
        press(fake, *range(10))
        for thread in threads:
            thread.join()
    assert sorted(seen) == list(range(10))


def test_a_loss_ends_the_loop_with_an_error(fake: PipedBoard, board: servolink.sync.Board) -> None:
    with board.button_events() as events:
        on_loop(fake.vanish)
        with pytest.raises(ConnectionLost):
            next(events)


def test_states_end_with_the_board(fake: PipedBoard) -> None:
    with opened(fake) as board:
        states = board.states()
        assert next(states) == "connected"
        on_loop(fake.vanish)
        assert next(states) == "lost"
    assert list(states) == ["closed"]


def test_follow_reads_until_the_servos_have_arrived() -> None:
    with servolink.sync.connect("virtual://?servos=1") as board:
        seconds = board.move({1: 40}, duration=0.1)
        angles = [servos[0].angle for servos in board.follow({1: 40}, seconds)]
    assert angles[-1] == 40


def test_reading_on_after_the_time_is_up_continues_a_generator() -> None:
    with servolink.sync.connect("virtual://") as board:
        states = board.states()
        assert list(states.within(0.01)) == ["connected"]
    assert next(states) == "closed"
