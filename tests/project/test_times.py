"""How long the commands of macros take: as long as a board that plays them.

Module: servolink.project.record_lookup.
"""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from servolink.project.model import Project
from servolink.project.record_lookup import MAX_INTERVAL, dependency_order, durations
from servolink.protocol import ACTION, HEADER_SIZE, MACRO, Action, Codec, Macro, MacroCommand, RecordType, Step
from servolink.virtual import BoardKind, Player, Storage

FAST = Action(1, "fast", (Step(1, 90, 50), Step(2, 90, 100)))  # 1 s


def played(project: Project, macro_id: int) -> float:
    """Return how many seconds a board plays a macro."""
    codec, storage = Codec(), Storage(BoardKind(memory=1_000_000))
    kinds: list[RecordType[Any]] = [ACTION, MACRO]
    for kind in kinds:
        for record_id, record in kind.by_id(project).items():
            storage.put(kind, {record_id: codec.encode(kind.add(record))[HEADER_SIZE:-1]})
    player = Player({}, storage, codec)
    assert player.run_macro(macro_id, 0.0)
    now = 0.0
    while player.due is not None:
        now = player.due
        player.advance(now, now)
    return now


@pytest.mark.parametrize(
    ("command", "takes"),
    [
        (MacroCommand(1), 1000),
        (MacroCommand(1, 0, 50, 3), 6000),
        (MacroCommand(1, 0, 30), 3333),
        (MacroCommand(1, 0, 60), 1667),
        (MacroCommand(1, 0, 100, 0), 0),
        (MacroCommand(250, 1), 250),
        (MacroCommand(250, 1, 50, 2), 1000),
        (MacroCommand(2, 2), 1500),
        (MacroCommand(2, 2, 50, 2), 6000),
        (MacroCommand(9), None),
        (MacroCommand(9, 2), None),
        (MacroCommand(1, 2), None),
        (MacroCommand(3, 2), None),
        (MacroCommand(4, 2), None),
        (MacroCommand(1, 3), None),
        (MacroCommand(1, 0, 0), None),
        (MacroCommand(1, 0, 100, -1), None),
        (MacroCommand(-5, 1), None),
        (MacroCommand(MAX_INTERVAL, 1), MAX_INTERVAL),
        (MacroCommand(MAX_INTERVAL, 1, 99), None),
    ],
)
def test_a_command_takes_the_time_of_what_it_does_with_ratio_and_loops(
    command: MacroCommand, takes: int | None
) -> None:
    macros = (
        Macro(1, "", (command,)),
        Macro(2, "", (MacroCommand(1, total_interval=77), MacroCommand(500, 1))),
        Macro(3, "endless", (MacroCommand(3, 2),)),
        Macro(4, "calls an endless one", (MacroCommand(3, 2),)),
    )
    assert durations(Project(actions=(FAST,), macros=macros))[1] == (takes,)


def test_an_action_without_steps_takes_no_time() -> None:
    assert durations(Project(actions=(Action(1),), macros=(Macro(1, "", (MacroCommand(1),)),))) == {1: (0,)}


def test_those_that_are_called_come_first_however_deep_they_are() -> None:
    macros = {number: Macro(number, "", (MacroCommand(number + 1, 2),)) for number in range(1, 5000)}
    macros |= {0: Macro(0, "", (MacroCommand(0, 2),)), -1: Macro(-1, "", (MacroCommand(0, 2), MacroCommand(7, 2)))}
    assert dependency_order(macros) == list(range(4999, 0, -1))


def test_loops_in_loops_for_ages_are_not_counted_out() -> None:
    macros = [Macro(1, "", (MacroCommand(1),))]
    macros += [Macro(number, "", (MacroCommand(number - 1, 2, 1, 0x7FFF),)) for number in range(2, 2000)]
    assert durations(Project(actions=(FAST,), macros=tuple(macros)))[1999] == (None,)


@st.composite
def _playable(draw: st.DrawFn) -> Project:
    actions = tuple(
        Action(number, "", (Step(1, 0, draw(st.integers(0, 300))), Step(2, 0, draw(st.integers(0, 300)))))
        for number in (1, 2)
    )

    def command(macro_id: int) -> MacroCommand:
        what = draw(st.integers(0, 2 if macro_id > 1 else 1))
        called = (draw(st.integers(1, 2)), draw(st.integers(0, 2000)), draw(st.integers(1, max(1, macro_id - 1))))[what]
        return MacroCommand(called, what, draw(st.sampled_from((100, 50, 25, 10))), draw(st.integers(0, 3)))

    macros = [Macro(number, "", tuple(command(number) for _ in range(draw(st.integers(0, 3))))) for number in (1, 2, 3)]
    return Project(actions=actions, macros=tuple(macros))


@given(_playable())
def test_a_board_plays_as_long(project: Project) -> None:
    found = durations(project)
    for macro in project.macros:
        whole = [time for time in found[macro.macro_id] if time is not None]
        assert played(project, macro.macro_id) == pytest.approx(sum(whole) / 1000)

    def told(macro: Macro) -> Any:
        commands = zip(macro.commands, found[macro.macro_id], strict=True)
        return replace(macro, commands=tuple(replace(one, total_interval=time) for one, time in commands))

    with_times = replace(project, macros=tuple(map(told, project.macros)))
    assert played(with_times, 3) == pytest.approx(played(project, 3))
