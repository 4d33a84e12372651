"""Check of a macro before its start: levels, what is missing, and how long it may take."""

from __future__ import annotations

import struct

from tests.firmware.conversations import frame
from tests.firmware.host import HostBoard, needs_compiler
from tests.firmware.test_core import RELEASE, add_action, add_macro, answers, run_macro

pytestmark = needs_compiler

_LONG = 4500
"""Commands of a macro whose check takes several turns."""


def _chain(board: HostBoard, first: int, count: int, *last: tuple[int, int, int, int]) -> None:
    """Add macros that call each other in turn; the last one has other commands."""
    for number in range(first, first + count - 1):
        board.ask(add_macro(number, (number + 1, 2, 100, 1)))
    board.ask(add_macro(first + count - 1, *last))


def test_levels_of_macros_are_counted_on_every_path(ready: HostBoard) -> None:
    ready.ask(add_action(2, (1, 90, 0)))
    _chain(ready, 100, 10, (2, 0, 100, 1))
    _chain(ready, 200, 10, (100, 2, 100, 1))  # 20 levels, though each chain is short enough
    ready.ask(add_macro(1, (100, 2, 100, 1), (200, 2, 100, 1), (2, 0, 100, 1)))
    for _ in range(2):
        assert [answers(ready.ask(run_macro(each)))[0][1] for each in (1, 200)] == [b"\0"] * 2
    assert answers(ready.ask(run_macro(204)))[0][1] == b"\1", "which has 16"
    assert answers(ready.ask(run_macro(203)))[0][1] == b"\0"
    ready.run(0.2)
    assert ready.pulses[0] == 2500, "the deepest one has run"
    ready.ask(add_macro(1, (205, 2, 100, 1), (204, 2, 100, 1)))
    assert answers(ready.ask(run_macro(1)))[0][1] == b"\0"
    ready.ask(add_macro(1, (205, 2, 100, 1), (100, 2, 100, 1)))
    assert answers(ready.ask(run_macro(1)))[0][1] == b"\1"


def test_what_was_found_of_a_macro_is_forgotten_when_actions_change(ready: HostBoard) -> None:
    ready.ask(add_macro(1, (2, 2, 100, 1)))
    ready.ask(add_macro(2, (5, 0, 100, 1)))
    for change, result in (
        (add_action(4), b"\0"),
        (add_action(5), b"\1"),
        (frame(30040, struct.pack("<i", 5)), b"\0"),
        (add_macro(2), b"\1"),
        (frame(10020), b"\0"),
    ):
        ready.ask(change)
        assert [answers(ready.ask(run_macro(1)))[0][1] for _ in range(2)] == [result] * 2


def test_a_path_through_all_macros_that_fit_is_too_deep_but_for_its_end(ready: HostBoard) -> None:
    ready.ask(add_action(2, (1, 90, 0)))
    _chain(ready, 1, 800, (2, 0, 100, 1))
    assert answers(ready.ask(run_macro(1)))[0][1] == b"\0"
    assert answers(ready.ask(run_macro(800 - 16)))[0][1] == b"\0"
    assert answers(ready.ask(run_macro(800 - 15)))[0][1] == b"\1"
    ready.ask(add_macro(800, (1, 2, 100, 1)))
    assert [answers(ready.ask(run_macro(each)))[0][1] for each in (1, 785, 800)] == [b"\0"] * 3, "a circle"


def _add_long(board: HostBoard, macro_id: int, *last: tuple[int, int, int, int]) -> None:
    board.ask(add_action(1, (1, 45, 0)))
    board.ask(add_macro(macro_id, *[(1, 0, 100, 0)] * _LONG, *last))


def test_requests_wait_for_a_check_that_takes_several_turns(ready: HostBoard) -> None:
    _add_long(ready, 1, (1, 0, 100, 1))
    sent = ready.ask(run_macro(1) + frame(30080, b"\1\0\0\0") + frame(30040, b"\1\0\0\0") + run_macro(1))
    assert answers(sent + ready.run(0.2)) == [(30091, b"\1"), (30081, b"\1"), (30041, b"\1"), (30091, b"\0")]
    ready.run(0.1)
    ready.run(_LONG / 4 * 0.002)
    assert ready.pulses[0] == 2000, "it sees what was there at its start"


def test_the_answer_to_a_host_that_has_gone_is_not_sent_to_the_next_one(ready: HostBoard) -> None:
    _add_long(ready, 1)
    data = run_macro(1)
    ready.receive_once(data)
    ready.detach()
    assert answers(ready.ask(frame(20010)) + ready.run(0.1))[0][0] == 20011


def _table(*macros: int, uninterruptible: int = 0) -> bytes:
    button = struct.pack("<I32siiiB", 1, b"button", *macros, uninterruptible)
    return frame(40030, struct.pack("<i32sH", 1, b"table", 1) + button)


def test_buttons_start_macros_whose_check_takes_several_turns(ready: HostBoard) -> None:
    ready.ask(add_action(2, (2, 45, 0)))
    ready.ask(add_macro(2, (2000, 1, 100, 1), (2, 0, 100, 1)))
    _add_long(ready, 3, (1, 0, 100, 1))
    ready.ask(_table(0, 2, 3, uninterruptible=1))
    ready.fields.pressed = 1
    ready.run(1.2)
    ready.fields.pressed = 0
    ready.run(1)
    assert ready.pulses[:2] == [1500, 1500]
    ready.run(1 + _LONG / 4 * 0.002)
    assert ready.pulses[:2] == [2000, 2000], "the second one follows the first"


def test_a_macro_that_a_button_has_begun_to_check_is_ended_by_a_release_behind_it(ready: HostBoard) -> None:
    _add_long(ready, 1, (1, 0, 100, 1))
    ready.ask(_table(1, 0, 0))
    ready.fields.pressed = 1
    ready.run(0.041, 1000)
    ready.receive(RELEASE)
    ready.run(_LONG / 4 * 0.002 + 0.1)
    assert ready.pulses == [0] * 16
