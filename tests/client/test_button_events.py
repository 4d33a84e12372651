"""Button events: one subscription on the board, any number of readers here.

Module: servolink.client.readers.
"""

from __future__ import annotations

import asyncio
import gc
from threading import Thread
from typing import Any

import pytest

from servolink.client.board import Board
from servolink.client.button_events import ButtonEvent, ButtonEvents
from servolink.client.connecting import connect
from servolink.errors import ConnectionLost, OutcomeUnknown, Rejected
from servolink.protocol import SubscribeButtonEventRequest, SubscribeButtonEventResponse
from servolink.testing import Fate
from tests.client.piped_board import LOST, PipedBoard, late, lie, opened, turns_of_the_loop

START, END = SubscribeButtonEventRequest(1), SubscribeButtonEventRequest(0)


def press(number: int) -> ButtonEvent:
    return ButtonEvent(number, 1)


async def read(events: ButtonEvents, count: int) -> list[int]:
    return [(await anext(events)).button_id for _ in range(count)]


async def subscriptions(fake: PipedBoard) -> list[object]:
    """Return what the board was asked about subscriptions, once all of it has been asked."""
    await asyncio.sleep(0.1)
    return [*fake.executed_of(SubscribeButtonEventRequest)]


async def test_events_are_read_in_order_with_their_kind() -> None:
    fake = PipedBoard()
    async with opened(fake) as board, board.button_events() as events:
        fake.speak(press(1), ButtonEvent(1, 2), ButtonEvent(1, 4))
        assert [(await anext(events)).kind for _ in range(3)] == ["press", "long_press", "up"]


async def test_subscribes_before_the_first_wait_and_unsubscribes_at_the_end_of_async_with() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        events = board.button_events()
        assert await subscriptions(fake) == []
        async with events:
            assert await subscriptions(fake) == [START]
        assert await subscriptions(fake) == [START, END]
        with pytest.raises(StopAsyncIteration):
            await anext(events)


async def test_break_unsubscribes() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        asyncio.get_running_loop().call_later(0.5, fake.speak, press(1), press(2))
        async for event in board.button_events():
            assert event.button_id == 1
            break
        gc.collect()
        assert await subscriptions(fake) == [START, END]


async def test_an_iterator_that_python_collects_in_another_thread_unsubscribes() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        asyncio.get_running_loop().set_debug(True)  # refuses calls from other threads, which are unsafe
        events = board.button_events()
        await events.__aenter__()
        cycle: list[object] = [events]
        cycle.append(cycle)
        del events, cycle
        collecting = Thread(target=gc.collect)
        collecting.start()
        collecting.join()
        assert await subscriptions(fake) == [START, END]


async def test_a_reader_that_is_cancelled_unsubscribes() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:

        async def follow() -> None:
            async for _ in board.button_events():
                pass

        reader = asyncio.create_task(follow())
        await asyncio.sleep(1)
        reader.cancel()
        await asyncio.wait((reader,))
        del reader
        gc.collect()
        assert await subscriptions(fake) == [START, END]


async def test_several_readers_share_one_subscription_and_each_gets_every_event() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        async with board.button_events() as one, board.button_events() as other:
            fake.speak(press(1), press(2))
            assert await read(one, 2) == await read(other, 2) == [1, 2]
            assert await subscriptions(fake) == [START]
            await one.aclose()
            assert await subscriptions(fake) == [START]
            fake.speak(press(3))
            assert await read(other, 1) == [3]
            with pytest.raises(StopAsyncIteration):
                await anext(one)
        assert await subscriptions(fake) == [START, END]


async def test_readers_that_come_and_go_at_once_agree_on_the_subscription() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:

        async def come_and_go(number: int) -> None:
            await asyncio.sleep(number % 3 * 0.004)
            async with board.button_events():
                await asyncio.sleep(number % 5 * 0.003)

        async with board.button_events() as events:
            await asyncio.gather(*(come_and_go(number) for number in range(30)))
            assert await subscriptions(fake) == [START]
            fake.speak(press(9))
            assert await read(events, 1) == [9]
        assert await subscriptions(fake) == [START, END]


async def test_a_reader_after_the_last_has_gone_subscribes_anew() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        for _ in range(2):
            async with board.button_events():
                pass
        assert await subscriptions(fake) == [START, END, START, END]


# --- slow readers -------------------------------------------------------------------------------------------------


async def test_a_slow_reader_loses_its_oldest_events_counted_and_a_fast_one_none() -> None:
    fake = PipedBoard()
    async with opened(fake) as board, board.button_events(limit=3) as slow, board.button_events(limit=10) as fast:
        fake.speak(*(press(number) for number in range(8)))
        assert await read(slow, 3) == [5, 6, 7]
        assert await read(fast, 8) == list(range(8))
        assert (slow.dropped, fast.dropped) == (5, 0)
        assert board.stats.events_dropped == 5
        assert board.stats.events_received == 8
        fake.speak(press(8))
        assert await read(slow, 1) == await read(fast, 1) == [8]


async def test_a_flood_with_the_reader_stopped_stays_bounded() -> None:
    fake = PipedBoard()
    async with opened(fake) as board, board.button_events(limit=100) as events:
        flood = fake.codec.encode(press(7)) * 100
        for _ in range(1000):
            fake.deliver(flood)
        assert len(events._reader.items) == 100
        assert events.dropped == board.stats.events_dropped == 100_000 - 100
        assert (await board.servos())[0].servo_id == 1


@pytest.mark.parametrize("limit", [0, -1])
async def test_a_limit_that_keeps_nothing_is_refused(limit: int) -> None:
    async with opened(PipedBoard()) as board:
        with pytest.raises(ValueError, match=f"limit must be at least 1, not {limit}"):
            board.button_events(limit=limit)
        gc.collect()


@pytest.mark.parametrize("limit", ["3", 2.5, True, None])
async def test_a_limit_that_is_no_integer_is_refused(limit: Any) -> None:
    async with opened(PipedBoard()) as board:
        with pytest.raises(TypeError, match=f"limit must be an integer, not '?{limit}"):
            board.button_events(limit)


# --- ends ---------------------------------------------------------------------------------------------------------


async def test_loss_is_raised_with_its_cause_after_the_events_that_came_before() -> None:
    fake = PipedBoard()
    async with opened(fake) as board, board.button_events() as events:
        cause = OSError("device disconnected")
        fake.speak(press(1), press(2))
        fake.vanish(cause)
        assert await read(events, 2) == [1, 2]
        for _ in range(2):
            with pytest.raises(ConnectionLost, match="device disconnected") as caught:
                await anext(events)
            assert str(caught.value).startswith("the connection to fake://board is gone: OSError: device discon")
            assert caught.value.__cause__ is not None
            assert caught.value.__cause__.__cause__ is cause


async def test_loss_wakes_a_waiting_reader_also_when_only_sending_shows_it() -> None:
    fake = PipedBoard()
    async with opened(fake) as board, board.button_events() as events:
        reading = asyncio.ensure_future(anext(events))
        await turns_of_the_loop(3)
        fake.gone = OSError("write failed")
        with pytest.raises(ConnectionLost):
            await board.servo_ids()
        with pytest.raises(ConnectionLost, match="write failed"):
            await reading


async def test_close_ends_readers_after_the_events_that_came_before() -> None:
    fake = PipedBoard()
    board = await connect(fake)
    events = board.button_events()
    await events.__aenter__()
    fake.speak(press(1))
    other = board.button_events()
    waiting = asyncio.ensure_future(anext(other))
    await asyncio.sleep(0.1)
    await board.close()
    assert [event.button_id async for event in events] == [1]
    with pytest.raises(StopAsyncIteration):
        await waiting
    assert fake.executed_of(SubscribeButtonEventRequest) == [START, END]


async def test_a_reader_that_gives_up_too_early_to_be_subscribed_may_try_again() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        events = board.button_events()
        fake.plan(SubscribeButtonEventRequest, late(0.15))
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.1):
                await anext(events)
        await asyncio.sleep(1)
        waiting = asyncio.ensure_future(anext(events))
        await asyncio.sleep(1)
        fake.speak(press(3))
        assert (await waiting).button_id == 3
        await events.aclose()
        with pytest.raises(StopAsyncIteration):
            await anext(events)


async def test_two_tasks_read_from_one_iterator_though_the_first_gives_up() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        events = board.button_events()
        fake.plan(SubscribeButtonEventRequest, late(0.15))
        first = asyncio.ensure_future(anext(events))
        second = asyncio.ensure_future(anext(events))
        await asyncio.sleep(0.1)
        first.cancel()
        await asyncio.sleep(1)
        fake.speak(press(3))
        assert (await second).button_id == 3
        await events.aclose()


@pytest.mark.parametrize("closed", [True, False])
async def test_a_reader_that_comes_after_the_end_is_told_and_ends(closed: bool) -> None:
    fake = PipedBoard()
    board = await connect(fake)
    if closed:
        await board.close()
    else:
        fake.vanish()
    events = board.button_events()
    with pytest.raises(ConnectionLost, match="closed by this program" if closed else "device disconnected"):
        await anext(events)
    with pytest.raises(StopAsyncIteration):
        await anext(events)
    await events.aclose()
    await board.close()


async def test_closing_a_reader_of_a_lost_board_is_quiet() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        async with board.button_events():
            fake.vanish()
        assert fake.executed_of(SubscribeButtonEventRequest) == [START]


async def test_a_board_that_vanishes_as_a_reader_breaks_off_disturbs_nobody() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        events = board.button_events()
        await events.__aenter__()
        fake.plan(SubscribeButtonEventRequest, LOST)
        del events
        gc.collect()
        await asyncio.sleep(0.02)
        fake.vanish()
    assert len(fake.sent_of(SubscribeButtonEventRequest)) == 2  # to begin, and to end, which was under way


# --- refusal, silence, cancellation -------------------------------------------------------------------------------


async def test_a_refused_subscription_is_rejected_and_may_be_tried_again() -> None:
    fake = PipedBoard()
    fake.plan(SubscribeButtonEventRequest, lie(SubscribeButtonEventResponse(0)))
    async with opened(fake) as board:
        events = board.button_events()
        with pytest.raises(Rejected, match="refused to start button events") as caught:
            await anext(events)
        assert caught.value.request == START
        async with board.button_events() as again:
            fake.speak(press(1))
            assert await read(again, 1) == [1]


async def test_a_refused_end_of_the_subscription_is_told_and_the_next_reader_needs_no_new_one() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        events = board.button_events()
        await events.__aenter__()
        fake.plan(SubscribeButtonEventRequest, lie(SubscribeButtonEventResponse(0)))
        with pytest.raises(Rejected, match="refused to end button events"):
            await events.aclose()
        async with board.button_events() as again:
            fake.speak(press(1))
            assert await read(again, 1) == [1]
        assert await subscriptions(fake) == [START, END, END]


async def _subscribe(board: Board) -> None:
    async with board.button_events():
        pass


@pytest.mark.parametrize("cancel_at", [0.0, 0.001, 0.05, 0.099, 0.101])
async def test_who_is_cancelled_while_subscribing_leaves_no_subscription(cancel_at: float) -> None:
    fake = PipedBoard()
    fake.plan(SubscribeButtonEventRequest, late(0.1))
    async with opened(fake) as board:
        subscribing = asyncio.create_task(_subscribe(board))
        await asyncio.sleep(cancel_at)
        subscribing.cancel()
        await asyncio.wait((subscribing,))
        assert subscribing.cancelled()
        await asyncio.sleep(1)
        asked = await subscriptions(fake)
        assert asked in ([], [START, END])
        async with board.button_events() as events:
            fake.speak(press(1))
            assert await read(events, 1) == [1]


async def test_a_subscription_of_which_it_is_not_known_whether_it_began_is_ended() -> None:
    fake = PipedBoard()
    fake.plan(SubscribeButtonEventRequest, Fate(answers=False))
    async with opened(fake, patience=0.1) as board:
        with pytest.raises(OutcomeUnknown):
            await _subscribe(board)
        assert await subscriptions(fake) == [START, END]


async def test_one_who_is_cancelled_while_subscribing_does_not_disturb_another_who_subscribes() -> None:
    fake = PipedBoard()
    fake.plan(SubscribeButtonEventRequest, late(0.5))
    async with opened(fake) as board:
        cancelled = asyncio.create_task(_subscribe(board))
        await asyncio.sleep(0.1)
        async with asyncio.TaskGroup() as group:
            events = board.button_events()
            joining = group.create_task(events.__aenter__())
            await asyncio.sleep(0.1)
            cancelled.cancel()
        await joining
        fake.speak(press(5))
        assert await read(events, 1) == [5]
        assert (await subscriptions(fake))[-1] == START
        await events.aclose()
        assert (await subscriptions(fake))[-1] == END
