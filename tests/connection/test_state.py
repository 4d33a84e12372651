"""A connection has one state; events lead from one to the next as the page on openings says."""

from __future__ import annotations

import asyncio
import re
from pathlib import Path

import pytest

from servolink.connection.connection import Connection
from servolink.connection.state import TRANSITIONS, ConnectionEvent, Lifecycle, State
from servolink.errors import ConnectionLost
from servolink.protocol import QueryProjectIDRequest, QueryProjectIDResponse
from servolink.testing import Fate
from tests.client.piped_board import SWALLOWED, PipedBoard, connected
from tests.connection.openings import LIST, STOP, opening
from tests.tables import over

PAGE = Path(__file__).parents[2] / "docs/design/opening.md"
QUERY = QueryProjectIDRequest()
STRAY = QueryProjectIDResponse(666)


def table(header: str) -> list[list[str]]:
    """Return the cells of the table of the page that begins with `header`, row by row."""
    lines = PAGE.read_text(encoding="utf-8").split(f"\n{header}\n")[1].split("\n\n")[0].splitlines()
    return [line.strip("| ").split(" | ") for line in lines[1:]]


def in_state(state: State) -> Lifecycle:
    lifecycle = Lifecycle()
    lifecycle.state = state
    return lifecycle


def test_the_page_names_every_state() -> None:
    rows = table("| state | requests | what is under way |")
    assert [row[0] for row in rows] == [f"`{state.value}`" for state in State]


def test_the_page_prints_the_table_of_transitions() -> None:
    printed = [
        (state.strip("`"), event, following.strip("`"))
        for state, events, following in table("| state | event | next state |")
        for event in re.findall(r"`([\w ]+)`", events)
    ]
    assert printed == [
        (state.value, event.value, following.value)
        for state, events in TRANSITIONS.items()
        for event, following in events.items()
    ]


@over("event", ConnectionEvent)
@over("state", State)
def test_an_event_leads_to_the_next_state_or_is_a_defect(state: State, event: ConnectionEvent) -> None:
    lifecycle = in_state(state)
    following = TRANSITIONS[state].get(event)
    if following is None:
        with pytest.raises(RuntimeError, match=f"internal error: .*'{event.value}'.* is {state.value}"):
            lifecycle.change(event)
    else:
        lifecycle.change(event)
    assert lifecycle.state is (following or state)


def test_every_state_can_be_reached_and_all_but_the_last_can_end() -> None:
    reached = {State.NEW}
    while more := {following for state in reached for following in TRANSITIONS[state].values()} - reached:
        reached |= more
    assert reached == set(State)
    assert all(events[ConnectionEvent.LOST] is State.ENDED for events in TRANSITIONS.values())
    assert set(TRANSITIONS[State.ENDED].values()) == {State.ENDED}


def test_the_first_cause_of_the_end_stays() -> None:
    lifecycle = Lifecycle()
    first = ConnectionLost("first")
    assert lifecycle.end(first)
    assert not lifecycle.end(ConnectionLost("second"))
    assert lifecycle.ended is first


def test_the_reason_of_a_suspension_goes_with_it() -> None:
    lifecycle = in_state(State.READY)
    lifecycle.silent_because = "the board is gone"
    lifecycle.suspend("a copy is being made")
    assert lifecycle.excuse == "a copy is being made"
    lifecycle.suspend("a project is being written")
    assert lifecycle.excuse == "a project is being written"
    lifecycle.change(ConnectionEvent.RESUMED)
    assert lifecycle.excuse == "the board is gone"


async def test_a_connection_that_is_opened_goes_from_state_to_state() -> None:
    board = PipedBoard()
    connection = Connection(board)
    states = [connection.lifecycle.state]
    await connection.open()
    states.append(connection.lifecycle.state)
    opened = asyncio.create_task(connection.shake_hands())
    await asyncio.sleep(0)
    states.append(connection.lifecycle.state)
    await opened
    states.append(connection.lifecycle.state)
    board.speak(STRAY)
    states.append(connection.lifecycle.state)
    await connection.request(QUERY)
    states.append(connection.lifecycle.state)
    connection.suspend("a project is being written")
    states.append(connection.lifecycle.state)
    connection.resume()
    states.append(connection.lifecycle.state)
    await connection.close()
    states.append(connection.lifecycle.state)
    connection.suspend("too late")
    connection.resume()
    states.append(connection.lifecycle.state)
    assert [state.value for state in states] == [
        *("new", "unproved", "opening", "ready", "reopening", "ready", "suspended", "ready", "ended", "ended")
    ]


async def test_a_connection_to_a_hub_is_ready_at_once() -> None:
    async with connected(PipedBoard(), handshake=False) as connection:
        assert connection.lifecycle.state is State.READY


async def test_a_connection_that_is_lost_while_it_is_opened_has_ended() -> None:
    board = PipedBoard()
    connection = Connection(board)
    connection.answers.lost(OSError("unplugged"))
    await connection.open()
    assert connection.lifecycle.state is State.ENDED
    with pytest.raises(ConnectionLost, match="unplugged"):
        await connection.shake_hands()
    await connection.close()


@pytest.mark.parametrize("again", [False, True], ids=["opening", "reopening"])
async def test_after_a_handshake_that_is_cancelled_the_next_request_begins_another(again: bool) -> None:
    board = PipedBoard()
    async with opening(board) as connection:
        if again:
            await connection.shake_hands()
        board.usual = SWALLOWED
        asking = asyncio.create_task(connection.request(LIST))
        await asyncio.sleep(0.1)
        if again:
            board.speak(STRAY)
            await asyncio.sleep(0.1)
        under_way = connection.answers.opening
        assert under_way is not None
        assert under_way.task is not None
        under_way.task.cancel()
        await asyncio.wait((under_way.task,))
        assert connection.lifecycle.state is State.UNPROVED
        assert connection.answers.opening is None
        await connection.send_stop(STOP)
        board.usual = Fate()
        assert await connection.request(QUERY) == QueryProjectIDResponse(0)
        assert len((await asking).servo_id_list) == 4
