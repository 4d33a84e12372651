"""Actions and macros in time: what runs when, for how long, and what is refused."""

from __future__ import annotations

import struct

import pytest

from servolink.protocol import (
    ACTION,
    MACRO,
    AddMacroRequest,
    AddMacroResponse,
    ClearAllDataRequest,
    DeleteActionRequest,
    DeleteMacroRequest,
    ExecuteActionExRequest,
    ExecuteMacroRequest,
    Macro,
    MacroCommand,
    MacroCommandType,
    QueryMacroRequest,
    SetServoParameterRequest,
    encode_frame,
)
from servolink.virtual.board import VirtualBoard
from tests.virtual.host import START, Host

DELAY, RUN_MACRO = MacroCommandType.DELAY, MacroCommandType.MACRO


@pytest.fixture
def host() -> Host:
    """A host whose board has three poses of servo 1 (0, 40 and 80 degrees, 1 s each), and servo 1 at 0."""
    host = Host(VirtualBoard(servos=2))
    for action_id, degree in ((10, 0), (14, 40), (18, 80)):
        host.store_action(action_id, (1, degree, 100))
    host.store_action(9, (1, 0, 0))
    host.tell(ExecuteActionExRequest(9))
    return host


def execute(host: Host, macro_id: int, now: float = START) -> int:
    return host.ask(ExecuteMacroRequest(macro_id), now).result


def ends(host: Host) -> float:
    """Return how many seconds after the start the running macro ends."""
    board, now = host.board, START
    while (due := board.next_due(now)) is not None:
        now = due
        board.advance(now)
    return now - START


def test_all_steps_of_an_action_run_together_each_in_its_own_time(host: Host) -> None:
    host.store_action(1, (1, 100, 100), (2, 100, 200), (2, 50, 200), (99, 1, 1))
    host.tell(ExecuteActionExRequest(1), START)
    assert host.angle(1, START + 0.5) == 50
    assert host.angle(1, START + 1) == 100
    assert host.angle(2, START + 2) == 50  # the last step of a servo counts


@pytest.mark.parametrize("at", [43, 45, 47])
def test_a_torn_action_is_not_run(host: Host, at: int) -> None:
    host.store_action(1, (1, 90, 100), (2, 90, 100))
    storage = host.board.storage
    whole = storage.get(ACTION, 1) or b""
    for record in (whole[:at].ljust(48, b"\xff"), whole):
        storage.put(ACTION, {1: record})
        host.tell(ExecuteActionExRequest(1))
        assert any(servo.moving for servo in host.board.servos.values()) == (record == whole)


@pytest.mark.parametrize("at", range(39, 50))
def test_a_torn_macro_is_not_run(host: Host, at: int) -> None:
    host.store_macro(1, MacroCommand(10, ratio=50, total_interval=1))
    storage = host.board.storage
    whole = storage.get(MACRO, 1) or b""
    for record in (whole[:at].ljust(50, b"\xff"), whole):
        storage.put(MACRO, {1: record})
        assert execute(host, 1) == (record == whole)


def test_an_unknown_action_does_nothing(host: Host) -> None:
    assert host.tell(ExecuteActionExRequest(77)) == []
    assert host.angle(1, START + 5) == 0


def test_commands_run_one_after_the_other(host: Host) -> None:
    host.store_macro(1, MacroCommand(14), MacroCommand(500, DELAY), MacroCommand(18))
    assert execute(host, 1) == 1
    assert [host.angle(1, START + at) for at in (0.5, 1.0, 1.5, 2.0, 2.5)] == [20, 40, 40, 60, 80]


@pytest.mark.parametrize(
    ("command", "seconds"),
    [
        (MacroCommand(14), 1.0),
        (MacroCommand(14, ratio=50), 2.0),
        (MacroCommand(14, loop=3), 3.0),
        (MacroCommand(14, ratio=50, loop=3), 6.0),
        (MacroCommand(14, loop=0), 0.0),
        (MacroCommand(250, DELAY), 0.25),
        (MacroCommand(250, DELAY, ratio=25, loop=2), 2.0),
        (MacroCommand(14, total_interval=5000), 5.0),
        (MacroCommand(14, loop=3, total_interval=2000), 3.0),  # too short a total does not cut motion off
    ],
)
def test_a_command_takes_its_time(host: Host, command: MacroCommand, seconds: float) -> None:
    host.store_macro(1, command)
    assert execute(host, 1) == 1
    assert ends(host) == pytest.approx(seconds)


def test_half_the_speed_moves_half_as_far_in_the_same_time(host: Host) -> None:
    host.store_macro(1, MacroCommand(18, ratio=50))
    execute(host, 1)
    assert host.angle(1, START + 1) == 40


def test_speeds_of_nested_macros_multiply_and_loops_repeat(host: Host) -> None:
    host.store_macro(1, MacroCommand(18), MacroCommand(10))
    host.store_macro(2, MacroCommand(1, RUN_MACRO, ratio=50, loop=2))
    host.store_macro(3, MacroCommand(2, RUN_MACRO, ratio=50))
    assert execute(host, 3) == 1
    assert [host.angle(1, START + at) for at in (2, 4, 8, 12, 14)] == [40, 80, 0, 80, 40]
    assert ends(host) == pytest.approx(16)


def test_totals_inside_a_slower_macro_are_stretched_with_it(host: Host) -> None:
    host.store_macro(1, MacroCommand(14, total_interval=2000))
    host.store_macro(2, MacroCommand(1, RUN_MACRO, ratio=50))
    execute(host, 2)
    assert ends(host) == pytest.approx(4)


def test_a_second_macro_replaces_the_first(host: Host) -> None:
    host.store_macro(1, MacroCommand(18, loop=100))
    host.store_macro(2, MacroCommand(10))
    execute(host, 1)
    assert execute(host, 2, START + 0.5) == 1
    assert host.angle(1, START + 1.5) == 0
    assert host.angle(1, START + 30) == 0
    assert host.board.next_due(START + 30) is None


def test_a_refused_macro_leaves_the_running_one_alone(host: Host) -> None:
    host.store_macro(1, MacroCommand(18))
    execute(host, 1)
    assert execute(host, 2, START + 0.5) == 0
    assert host.angle(1, START + 1) == 80


@pytest.mark.parametrize("missing", [MacroCommand(77), MacroCommand(77, RUN_MACRO)])
def test_a_macro_that_needs_what_is_not_there_is_refused(host: Host, missing: MacroCommand) -> None:
    host.store_macro(1, MacroCommand(14), missing)
    assert execute(host, 1) == 0
    assert host.angle(1, START + 5) == 0


def test_cycles_are_refused_when_run(host: Host) -> None:
    host.store_macro(1, MacroCommand(2, RUN_MACRO))
    host.store_macro(2, MacroCommand(14), MacroCommand(3, RUN_MACRO), MacroCommand(3, RUN_MACRO))
    host.store_macro(3, MacroCommand(1, RUN_MACRO))
    host.store_macro(4, MacroCommand(4, RUN_MACRO))
    assert [execute(host, macro_id) for macro_id in (1, 2, 3, 4)] == [0, 0, 0, 0]


def test_a_macro_used_twice_is_no_cycle(host: Host) -> None:
    host.store_macro(1, MacroCommand(100, DELAY))
    host.store_macro(2, MacroCommand(1, RUN_MACRO), MacroCommand(1, RUN_MACRO))
    host.store_macro(3, MacroCommand(2, RUN_MACRO), MacroCommand(1, RUN_MACRO))
    assert execute(host, 3) == 1
    assert ends(host) == pytest.approx(0.3)


def test_macros_that_meet_again_and_again_are_looked_at_once(host: Host) -> None:
    """Two calls on each of 32 levels: two billion paths."""
    host.store_macro(1, MacroCommand(10, DELAY))
    for macro_id in range(2, Macro.MAX_NESTING + 1):
        host.store_macro(macro_id, *[MacroCommand(macro_id - 1, RUN_MACRO)] * 2)
    assert execute(host, Macro.MAX_NESTING) == 1
    assert host.board.player.macro_id == Macro.MAX_NESTING


def test_nesting_has_a_limit(host: Host) -> None:
    host.store_macro(1, MacroCommand(10, DELAY))
    for macro_id in range(2, Macro.MAX_NESTING + 2):
        host.store_macro(macro_id, MacroCommand(macro_id - 1, RUN_MACRO))
    assert execute(host, Macro.MAX_NESTING) == 1
    assert execute(host, Macro.MAX_NESTING + 1) == 0


def test_nesting_is_judged_along_every_path(host: Host) -> None:
    """A macro first met high up, where it is allowed, may also be used too far down."""
    host.store_macro(1, MacroCommand(10, DELAY))
    for macro_id in range(2, Macro.MAX_NESTING):
        host.store_macro(macro_id, MacroCommand(1, RUN_MACRO), MacroCommand(macro_id - 1, RUN_MACRO))
    top = Macro.MAX_NESTING - 1
    host.store_macro(100, MacroCommand(top, RUN_MACRO))
    host.store_macro(101, MacroCommand(top, RUN_MACRO), MacroCommand(100, RUN_MACRO))
    assert execute(host, 100) == 1
    assert execute(host, 101) == 0


def test_edits_do_not_reach_a_running_macro(host: Host) -> None:
    host.store_macro(1, MacroCommand(500, DELAY), MacroCommand(18))
    execute(host, 1)
    host.tell(DeleteActionRequest(18), START + 0.1)
    host.tell(DeleteMacroRequest(1), START + 0.1)
    assert host.angle(1, START + 1.5) == 80


def test_stopping_all_servos_ends_the_macro_for_good(host: Host) -> None:
    host.store_macro(1, MacroCommand(18), MacroCommand(10))
    execute(host, 1)
    host.tell(SetServoParameterRequest(255, 0, 1), START + 0.5)
    host.tell(SetServoParameterRequest(255, 1, 1), START + 0.6)
    assert host.angle(1, START + 10) == 40
    assert host.board.next_due(START + 10) is None


def test_stopping_one_servo_leaves_the_macro_to_the_others(host: Host) -> None:
    host.store_action(20, (1, 80, 100), (2, 80, 100))
    host.store_macro(1, MacroCommand(20))
    execute(host, 1)
    host.tell(SetServoParameterRequest(1, 0, 1), START + 0.5)
    assert host.angle(1, START + 2) == 40
    assert host.angle(2, START + 2) == 80


def test_clearing_the_board_ends_the_macro(host: Host) -> None:
    host.store_macro(1, MacroCommand(14), MacroCommand(18))
    execute(host, 1)
    host.tell(ClearAllDataRequest(), START + 0.5)
    assert host.angle(1, START + 5) == 40


@pytest.mark.parametrize(
    ("command_id", "kind", "ratio", "loop", "total"),
    [(5, 1, 0, 1, 0), (5, 1, 101, 1, 0), (5, 3, 100, 1, 0), (-1, 1, 100, 1, 0), (5, 1, 100, -1, 0), (5, 1, 100, 1, -1)],
)
def test_commands_that_no_board_can_run_are_not_stored(
    host: Host, command_id: int, kind: int, ratio: int, loop: int, total: int
) -> None:
    content = struct.pack("<i32sHiBBhi", 1, b"", 1, command_id, kind, ratio, loop, total)
    host.session.receive(encode_frame(AddMacroRequest.packet_id, content, "little"), START)
    assert host.heard[-1] == AddMacroResponse(0)
    assert host.ask(QueryMacroRequest(1)).macro_id == 0


def test_endless_macros_in_no_time_do_not_hold_the_board_up(host: Host) -> None:
    """32,767 loops to the power of five, none of which takes any time."""
    host.store_macro(1)
    for macro_id in range(2, 7):
        host.store_macro(macro_id, MacroCommand(macro_id - 1, RUN_MACRO, loop=32767))
    assert execute(host, 6) == 1
    for step in range(1, 50):
        host.board.advance(START + step)
    assert host.angle(1, START + 50) == 0
    assert execute(host, 1, START + 50) == 1


def test_a_very_long_sleep_of_the_host_is_caught_up_in_bounded_time(host: Host) -> None:
    host.store_macro(1, MacroCommand(1, DELAY, loop=32767), MacroCommand(18))
    host.store_macro(2, MacroCommand(1, RUN_MACRO, loop=32767))
    execute(host, 2)
    host.board.advance(START + 1e9)
    assert host.board.next_due(START + 1e9) == pytest.approx(START + 1e9, abs=0.1)
