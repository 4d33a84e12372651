"""Who moves when."""

from __future__ import annotations

import pytest

from servolink.errors import EncodeError, ProjectError
from servolink.protocol import Action, Macro, MacroCommand, Step
from servolink.virtual import dry_run as rehearsal
from servolink.virtual.dry_run import LONGEST, DryMove, DryRun, Timeline

UP = Action(1, "up", (Step(1, 60, 50), Step(2, -30, 25)))
DOWN = Action(2, "down", (Step(1, 0, 10),))


def play(record: Action | Macro, *others: Macro) -> Timeline:
    macros = [*([record] if isinstance(record, Macro) else []), *others]
    return DryRun([UP, DOWN], macros, [1, 2, 3]).play(record)


def test_an_action() -> None:
    assert play(UP) == Timeline(
        0.5,
        (DryMove(1, 0.0, 0.5, 0.0, 60), DryMove(2, 0.0, 0.25, 0.0, -30)),
        {1: 60.0, 2: -30.0, 3: 0.0},
        is_whole=True,
    )


def test_a_macro_with_speed_loops_pauses_and_other_macros() -> None:
    inner = Macro(7, "", (MacroCommand(1, ratio=50), MacroCommand(200, 1)))
    outer = Macro(8, "", (MacroCommand(7, 2, loop=2), MacroCommand(2, total_interval=300)))
    timeline = play(outer, inner)
    assert [(move.servo_id, round(move.start, 6), round(move.end, 6), move.target) for move in timeline.moves] == [
        (1, 0.0, 1.0, 60),
        (2, 0.0, 0.5, -30),
        (1, 1.2, 2.2, 60),
        (2, 1.2, 1.7, -30),
        (1, 2.4, 2.5, 0),
    ]
    assert timeline.seconds == pytest.approx(2.7)  # until the end of the last command's time
    assert timeline.is_whole
    assert not any(move.is_cut for move in timeline.moves)


def test_a_move_that_another_cuts_short() -> None:
    early = Action(3, "", (Step(1, 90, 100), Step(2, 5, 5), Step(1, -90, 50)))
    timeline = DryRun([early], [], [1, 2]).play(early)
    assert timeline.moves[0] == DryMove(1, 0.0, 0.0, 0.0, 90, is_cut=True)
    assert timeline.moves[2] == DryMove(1, 0.0, 0.5, 0.0, -90)
    assert (timeline.seconds, timeline.angles[1]) == (0.5, -90.0)


def test_servos_end_at_their_stops() -> None:
    far = Action(3, "", (Step(1, 400, 10),))
    assert DryRun([far], [], [1]).play(far).angles == {1: 180.0}


def test_servos_that_are_not_there_do_not_move() -> None:
    assert DryRun([UP], [], [2]).play(UP).moves == (DryMove(2, 0.0, 0.25, 0.0, -30),)


def test_an_endless_macro_is_cut_off() -> None:
    timeline = play(Macro(5, "", (MacroCommand(1, loop=0x7FFF),)))
    assert not timeline.is_whole
    assert LONGEST - 1 < timeline.seconds <= LONGEST


def test_endless_work_in_no_time_is_cut_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rehearsal, "_MAX_TURNS", 100)
    nothing = Macro(5, "", (MacroCommand(0, 1, loop=0x7FFF),))
    much = Macro(6, "", (MacroCommand(5, 2, loop=0x7FFF),))
    assert not play(much, nothing).is_whole
    jump = Action(3, "", (Step(1, 1, 0),) * 2000)
    again = Macro(7, "", (MacroCommand(3, loop=0x7FFF),))
    timeline = DryRun([jump], [again], [1]).play(again)
    assert not timeline.is_whole
    assert len(timeline.moves) < 200_000


@pytest.mark.parametrize(
    ("command", "why"),
    [
        (MacroCommand(9), "action 9 is missing, or has unplayable values"),
        (MacroCommand(9, 2), "macro 9 is missing, or has unplayable values"),
        (MacroCommand(5, 2), "macro 5 runs itself"),
        (MacroCommand(6, 2), "macro 5 runs itself"),
    ],
)
def test_what_cannot_be_played_is_refused_with_the_reason(command: MacroCommand, why: str) -> None:
    with pytest.raises(ProjectError, match=f"cannot be played: {why}"):
        play(Macro(5, "", (command,)), Macro(6, "", (MacroCommand(5, 2),)))


def test_macros_nest_as_deep_as_a_virtual_board_plays() -> None:
    macros = [Macro(one, "", (MacroCommand(one - 1, 2 if one > 1 else 1),)) for one in range(1, 34)]
    assert play(*reversed(macros[:32])).is_whole
    with pytest.raises(ProjectError, match="macros are nested more than 32 levels deep, the limit of a virtual board"):
        play(*reversed(macros))


def test_what_no_board_takes_is_refused() -> None:
    with pytest.raises(ProjectError, match="the id of one action is 0"):
        DryRun([Action(0)], [], [])
    with pytest.raises(EncodeError, match="70000 is outside"):
        DryRun([Action(1, "", (Step(1, 70000, 1),))], [], [])
