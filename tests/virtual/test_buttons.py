"""Buttons: events to subscribers, and the macros of the active table."""

from __future__ import annotations

import pytest

from servolink.errors import EncodeError
from servolink.protocol import (
    AddJoystickTableRequest,
    Button,
    ButtonEventResponse,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    MacroCommand,
    SetActiveJoystickTableRequest,
    Step,
    SubscribeButtonEventRequest,
    TransmissionModeSettingRequest,
)
from servolink.virtual.board import VirtualBoard
from servolink.virtual.buttons import LONG_PRESS_AFTER
from tests.virtual.host import START, Host

LONG = START + LONG_PRESS_AFTER


@pytest.fixture
def host() -> Host:
    """A subscribed host; servo 1 is at 0, macro 1 moves it to 10, macro 2 to 20 and macro 3 to 30, in 2 s each."""
    host = Host(VirtualBoard(servos=1))
    host.ask(SubscribeButtonEventRequest(1))
    host.tell(ExecuteActionRequest((Step(1, 0, 0),)))
    for macro_id in (1, 2, 3):
        host.store_action(macro_id, (1, 10 * macro_id, 200))
        host.store_macro(macro_id, MacroCommand(macro_id))
    host.heard.clear()
    return host


def assign(host: Host, *, press: int = 0, long: int = 0, up: int = 0, uninterruptible: int = 0, table: int = 1) -> None:
    button = Button(7, "seven", press, long, up, uninterruptible)
    assert host.ask(AddJoystickTableRequest(table, "table", (Button(6), button))).result == 1


def events(host: Host) -> list[tuple[int, int]]:
    """Return the events heard, other answers left out."""
    return [(heard.button_id, heard.event) for heard in host.heard if isinstance(heard, ButtonEventResponse)]


def test_a_short_press_is_two_events(host: Host) -> None:
    host.board.press_button(7, START)
    host.board.release_button(7, START + 0.1)
    host.board.advance(START + 10)
    assert events(host) == [(7, ButtonEventResponse.PRESS), (7, ButtonEventResponse.UP)]


def test_held_long_enough_it_is_three_and_the_second_comes_by_itself(host: Host) -> None:
    host.board.press_button(7, START)
    assert host.board.next_due(START) == LONG
    host.board.advance(LONG - 0.001)
    assert events(host) == [(7, ButtonEventResponse.PRESS)]
    host.board.advance(LONG)
    assert events(host) == [(7, ButtonEventResponse.PRESS), (7, ButtonEventResponse.LONG_PRESS)]
    assert host.board.next_due(LONG) is None
    host.board.release_button(7, LONG + 5)
    assert events(host) == [
        (7, ButtonEventResponse.PRESS),
        (7, ButtonEventResponse.LONG_PRESS),
        (7, ButtonEventResponse.UP),
    ]


def test_a_release_that_comes_late_still_had_its_long_press(host: Host) -> None:
    host.board.press_button(7, START)
    host.board.release_button(7, LONG + 1)
    assert events(host) == [
        (7, ButtonEventResponse.PRESS),
        (7, ButtonEventResponse.LONG_PRESS),
        (7, ButtonEventResponse.UP),
    ]


def test_bounces_and_releases_of_what_is_up_are_nothing(host: Host) -> None:
    host.board.release_button(7, START)
    host.board.press_button(7, START)
    host.board.press_button(7, START + 0.1)
    host.board.release_button(7, START + 0.2)
    host.board.release_button(7, START + 0.3)
    assert events(host) == [(7, ButtonEventResponse.PRESS), (7, ButtonEventResponse.UP)]


def test_buttons_are_held_independently(host: Host) -> None:
    host.board.press_button(1, START)
    host.board.press_button(2, START + 0.5)
    host.board.release_button(1, START + 0.6)
    host.board.advance(START + 2)
    assert events(host) == [
        (1, ButtonEventResponse.PRESS),
        (2, ButtonEventResponse.PRESS),
        (1, ButtonEventResponse.UP),
        (2, ButtonEventResponse.LONG_PRESS),
    ]


def test_only_subscribers_hear_of_it_and_only_while_they_are(host: Host) -> None:
    other = Host(host.board)
    third = Host(host.board)
    third.ask(SubscribeButtonEventRequest(1))
    third.session.detach()
    host.board.press_button(7, START)
    host.tell(SubscribeButtonEventRequest(0))
    host.board.release_button(7, START)
    assert events(host) == [(7, ButtonEventResponse.PRESS)]
    assert events(other) == events(third) == []


def test_nothing_is_pushed_in_the_old_protocol(host: Host) -> None:
    host.tell(TransmissionModeSettingRequest(0))
    host.board.press_button(7, START)
    assert events(host) == []


def test_an_impossible_button_is_refused_and_changes_nothing(host: Host) -> None:
    with pytest.raises(EncodeError, match="button_id"):
        host.board.press_button(-1, START)
    assert host.board.next_due(START) is None


def test_press_and_release_start_their_macros(host: Host) -> None:
    assign(host, press=1, up=2)
    host.board.press_button(7, START)
    assert host.angle(1, START + 0.5) == 2  # on its way to 10
    host.board.release_button(7, START + 0.5)
    assert host.angle(1, START + 5) == 20


def test_the_long_press_macro_replaces_the_press_macro(host: Host) -> None:
    assign(host, press=1, long=3)
    host.board.press_button(7, START)
    assert host.angle(1, LONG + 2) == 30


@pytest.mark.parametrize(("uninterruptible", "halfway", "end"), [(0, 20, 20), (1, 30, 20)])
def test_uninterruptible_lets_the_long_press_macro_end_first(
    host: Host, uninterruptible: int, halfway: int, end: int
) -> None:
    assign(host, long=3, up=2, uninterruptible=uninterruptible)
    host.board.press_button(7, START)
    host.board.advance(LONG)
    host.board.release_button(7, LONG + 0.1)
    if uninterruptible:
        assert host.angle(1, LONG + 2) == halfway
        assert host.angle(1, LONG + 3) == 25
    else:
        assert host.angle(1, LONG + 2.1) == halfway
    assert host.angle(1, LONG + 4) == end


def test_without_a_release_macro_the_long_press_macro_just_runs_on(host: Host) -> None:
    assign(host, long=3)
    host.board.press_button(7, START)
    host.board.release_button(7, LONG + 0.1)
    assert host.angle(1, LONG + 2) == 30


def test_a_long_press_macro_that_has_ended_holds_nothing_up(host: Host) -> None:
    assign(host, long=3, up=2, uninterruptible=1)
    host.board.press_button(7, START)
    host.board.release_button(7, LONG + 10)
    assert host.angle(1, LONG + 12) == 20


def test_uninterruptible_says_nothing_of_short_presses(host: Host) -> None:
    assign(host, press=1, up=2, uninterruptible=1)
    host.board.press_button(7, START)
    host.board.release_button(7, START + 0.5)
    assert host.angle(1, START + 2.5) == 20


def test_the_active_table_decides(host: Host) -> None:
    assign(host, press=1, table=1)
    assign(host, press=3, table=2)
    host.board.press_button(7, START)
    host.board.release_button(7, START + 0.1)
    assert host.angle(1, START + 5) == 0  # none of the two is active
    host.tell(SetActiveJoystickTableRequest(2), START + 5)
    host.board.press_button(7, START + 5)
    assert host.angle(1, START + 7) == 30


def test_macros_that_are_not_there_are_not_run(host: Host) -> None:
    assign(host, press=77, long=78, up=79, uninterruptible=1)
    host.board.press_button(7, START)
    host.board.release_button(7, LONG + 1)
    assert host.angle(1, START + 5) == 0
    assert events(host) == [
        (7, ButtonEventResponse.PRESS),
        (7, ButtonEventResponse.LONG_PRESS),
        (7, ButtonEventResponse.UP),
    ]


def test_a_macro_started_meanwhile_takes_the_place_of_the_one_that_waits(host: Host) -> None:
    assign(host, long=3, up=2, uninterruptible=1)
    host.board.press_button(7, START)
    host.board.release_button(7, LONG + 0.1)
    assert host.ask(ExecuteMacroRequest(1), LONG + 0.5).result == 1
    assert host.angle(1, LONG + 10) == 10
