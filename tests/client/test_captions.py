"""Servos, records and buttons by caption, in place of an id."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from servolink.client.board import Board
from servolink.client.captions import button_id
from servolink.errors import AmbiguousName, EncodeError, NotFound, RequestError, ServolinkError
from servolink.project import Project
from servolink.protocol import (
    Action,
    ActionEntry,
    AddServoParameterRequest,
    Button,
    DeleteActionRequest,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    JoystickTable,
    Macro,
    MacroCommand,
    QueryActionListRequest,
    QueryActionListResponse,
    QueryActionRequest,
    QueryMacroListRequest,
    QueryServoListRequest,
    QueryServoParameterRequest,
    QueryServoParameterResponse,
    ServoParameter,
    SetServoParameterRequest,
    Step,
)
from tests.client.piped_board import PipedBoard, lie, opened
from tests.project.pulled import contents_of
from tests.proofs.hostile.corpus import controls
from tests.virtual_time import run

CAPTIONS = {1: "hip", 2: "3", 3: "all"}
WAVE, BOW, BOW_TOO, NUMBER = (Action(1, "Wave"), Action(2, "Bow"), Action(3, "bow"), Action(4, "7"))
TWICE, TWICE_TOO = Action(5, "Twice", (Step(1, 0, 1),)), Action(6, "Twice", (Step(1, 0, 1),))
DANCE = Macro(1, "Dance", (MacroCommand(1),))
PAD = JoystickTable(1, "Pad", (Button(7, "A"), Button(9, "B")))
STORED = Project(
    servo_parameters=tuple(ServoParameter(servo_id, 0, caption) for servo_id, caption in CAPTIONS.items()),
    actions=(WAVE, BOW, BOW_TOO, NUMBER, TWICE, TWICE_TOO),
    macros=(DANCE,),
    joystick_tables=(PAD,),
)

Use = Callable[[Board], Awaitable[Any]]


def used(use: Use, *plans: tuple[Any, Any], stored: Project = STORED) -> PipedBoard:
    """Return a fake board with names on which `use` was done."""
    fake = PipedBoard(servos=3)
    fake.storage.contents = contents_of(stored)
    for request, response in plans:
        fake.plan(request, lie(response))

    async def main() -> None:
        async with opened(fake) as board:
            await use(board)

    run(main())
    return fake


def failure(use: Use, error: type[ServolinkError], *plans: tuple[Any, Any], stored: Project = STORED) -> str:
    """Return the text of the error that `use` ends with, which must be safe to show; nothing was changed by it."""
    texts = []

    async def attempt(board: Board) -> None:
        with pytest.raises(error) as found:
            await use(board)
        texts.append(str(found.value))

    fake = used(attempt, *plans, stored=stored)
    for change in (DeleteActionRequest, ExecuteActionRequest, SetServoParameterRequest, ExecuteMacroRequest):
        assert not fake.executed_of(change)
    assert not controls(texts[0])
    return texts[0]


# --- what is meant ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "action_id"),
    [(1, 1), ("1", 1), ("Wave", 1), ("wave", 1), ("WAVE", 1), ("Bow", 2), ("bow", 3), ("name:7", 4), ("name:Wave", 1)],
)
def test_an_action_by_its_name(name: int | str, action_id: int) -> None:
    async def use(board: Board) -> None:
        assert (await board.action(name)).action_id == action_id

    used(use)


@pytest.mark.parametrize(
    ("name", "servo_id"), [("hip", 1), ("HIP", 1), ("3", 3), ("name:3", 2), ("name:all", 3), (2, 2)]
)
def test_a_servo_by_its_name(name: str, servo_id: int) -> None:
    async def use(board: Board) -> None:
        assert (await board.servo(name)).servo_id == servo_id
        await board.set_servo(name, start=True, hold=True)
        await board.release(name)
        await board.set_angle_unit("adc", name)
        assert board.unit_of(servo_id) == "adc"

    sent = used(use).executed_of(SetServoParameterRequest)
    assert sent == [SetServoParameterRequest(servo_id, 1, 1), SetServoParameterRequest(servo_id, 0, 0)]


def test_accents_count_however_they_are_written() -> None:
    async def use(board: Board) -> None:
        assert (await board.action("cafe\u0301")).action_id == 8

    used(use, stored=Project(actions=(Action(8, "Caf\u00e9"),)))


def test_targets_by_name_and_by_id() -> None:
    async def use(board: Board) -> None:
        await board.move({"hip": 30, "name:3": -10, "3": 5}, duration=0.1, wait=True)
        await board.move({"all": 0}, duration=0.1)
        async for _ in board.follow({"hip": 0}, 0.1):
            pass

    fake = used(use)
    steps = [{step.servo_id: step.degree for step in one.steps} for one in fake.executed_of(ExecuteActionRequest)]  # type: ignore[attr-defined]
    assert steps == [{1: 30, 2: -10, 3: 5}, {1: 0, 2: 0, 3: 0}]
    assert len(fake.executed_of(QueryServoParameterRequest)) == 2, "once for each call"


def test_everything_that_takes_the_id_of_a_record_takes_its_name() -> None:
    async def use(board: Board) -> None:
        await board.run_action("Wave")
        await board.run_macro("dance")
        assert await board.macro("Dance") == DANCE
        assert await board.joystick_table("Pad") == PAD
        await board.set_active_joystick_table("pad")
        assert await button_id(board, "a") == 7
        assert await button_id(board, "9") == 9
        await board.delete_joystick_table("Pad")
        await board.delete_macro("Dance")
        await board.delete_action("Wave")
        assert (await board.macros(), await board.joystick_tables()) == ((), ())

    assert used(use).executed_of(DeleteActionRequest) == [DeleteActionRequest(1)]


def test_release_all() -> None:
    fake = used(lambda board: board.release("all"))
    assert fake.executed_of(SetServoParameterRequest) == [SetServoParameterRequest(255, 0, 0)]


# --- what is sent -------------------------------------------------------------------------------------------------


def test_an_id_costs_nothing_and_a_name_one_query() -> None:
    async def use(board: Board) -> None:
        await board.action(1)
        await board.action("1")
        await board.action("Wave")
        await board.delete_action("Wave")

    assert [packet for _, packet in used(use).sent] == [
        QueryActionRequest(1),
        QueryActionRequest(1),
        QueryActionListRequest(),
        QueryActionRequest(1),
        QueryActionListRequest(),
        DeleteActionRequest(1),
    ]


def test_a_name_is_looked_up_each_time() -> None:
    async def use(board: Board) -> None:
        assert (await board.servo("hip")).servo_id == 1
        await board.add_servo_parameters([ServoParameter(1, 0, "foot"), ServoParameter(2, 0, "hip")])
        assert (await board.servo("hip")).servo_id == 2

    assert len(used(use).executed_of(AddServoParameterRequest)) == 1


@pytest.mark.parametrize(
    "use",
    [
        lambda board: board.move({"hip": 30}, duration=0.1),
        lambda board: board.run_action("Wave"),
        lambda board: board.run_macro("Dance"),
        lambda board: board.set_servo("hip", start=True, hold=True),
    ],
)
async def test_a_stop_while_a_name_is_looked_up_comes_first(use: Use) -> None:
    fake = PipedBoard(servos=3)
    fake.storage.contents = contents_of(STORED)
    async with opened(fake) as board:
        answer = fake._answer

        def stop_meanwhile() -> None:
            board.connection.stops.stop()
            answer()

        fake._answer = stop_meanwhile  # type: ignore[method-assign]
        with pytest.raises(RequestError, match="a stop came first"):
            await use(board)
    for motion in (ExecuteActionRequest, ExecuteActionExRequest, ExecuteMacroRequest, SetServoParameterRequest):
        assert not fake.executed_of(motion)


# --- what is not clear --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("use", "text"),
    [
        (lambda board: board.action("Wav"), "the board has no action 'Wav'; did you mean action 1 'Wave'?"),
        (lambda board: board.delete_action("wvae"), "the board has no action 'wvae'; did you mean action 1 'Wave'?"),
        (lambda board: board.run_macro("Sleep"), "the board has no macro 'Sleep'; there is macro 1 'Dance'"),
        (lambda board: board.run_macro("9"), "the board has no macro 9; there is macro 1 'Dance'"),
        (
            lambda board: board.move({"hipp": 3}, duration=1),
            "the board has no servo 'hipp'; did you mean servo 1 'hip'?",
        ),
        (
            lambda board: board.servo("elbow"),
            "the board has no servo 'elbow'; there is servo 1 'hip', servo 2 '3' and servo 3 'all'",
        ),
        (lambda board: board.servo("all"), "'all' stands for all servos, whose states `servos` returns"),
        (lambda board: board.action(""), "the board has no action ''; there is action 1 'Wave', action 2 'Bow'"),
        (lambda board: button_id(board, "C"), "the board has no button 'C'; there is button 7 'A' and button 9 'B'"),
    ],
)
def test_an_unknown_name(use: Use, text: str) -> None:
    assert failure(use, NotFound).startswith(text)


@pytest.mark.parametrize(
    ("use", "text"),
    [
        (
            lambda board: board.delete_action("Twice"),
            "'Twice' may be action 5 'Twice' or action 6 'Twice'; give the id",
        ),
        (lambda board: board.run_action("BOW"), "'BOW' may be action 2 'Bow' or action 3 'bow'; give the id"),
    ],
)
def test_a_name_of_several(use: Use, text: str) -> None:
    assert failure(use, AmbiguousName) == text


def test_a_servo_that_is_given_twice() -> None:
    assert "servo 1 is given twice: as 'hip' and as 'all'" in failure(
        lambda board: board.move({"hip": 3, "all": 4}, duration=1), EncodeError
    )
    assert "servo 1 is given twice: as 'hip' and as '1'" in failure(
        lambda board: board.move({"hip": 3, "1": 4}, duration=1), EncodeError
    )


def test_a_long_list_is_cut() -> None:
    many = Project(actions=tuple(Action(number, f"pose {number}") for number in range(1, 300)))
    text = failure(lambda board: board.action("x" * 100_000), NotFound, stored=many)
    assert text.endswith("there is action 1 'pose 1', action 2 'pose 2', action 3 'pose 3', action 4 'pose 4', "
                         "action 5 'pose 5' and 294 more")  # fmt: skip
    assert len(text) < 400


def test_boards_without_anything() -> None:
    nothing = Project()
    assert failure(lambda board: board.action("x"), NotFound, stored=nothing).endswith("; there are no actions")
    assert failure(lambda board: board.servo("x"), NotFound, stored=nothing).endswith("; no servo of it has a caption")
    button = failure(lambda board: button_id(board, "A"), NotFound, stored=nothing)
    assert button == "no button is captioned 'A': the board has no active joystick table"


# --- hostile captions ---------------------------------------------------------------------------------------------

HOSTILE = ("\x1b[2J", "\u202eevaW", "\udcff\udc9b", "\u2028x", "name:all")


@pytest.mark.parametrize("caption", HOSTILE)
def test_a_hostile_caption_can_be_named_and_is_shown_escaped(caption: str) -> None:
    entries = QueryActionListResponse((ActionEntry(1, caption),))
    fake = used(lambda board: board.delete_action(f"name:{caption}"), (QueryActionListRequest, entries))
    assert fake.executed_of(DeleteActionRequest) == [DeleteActionRequest(1)]
    text = failure(lambda board: board.delete_action("y"), NotFound, (QueryActionListRequest, entries))
    assert text.startswith("the board has no action 'y'; there is action 1 '")


def test_no_caption_stands_for_all_servos_or_for_no_record() -> None:
    """A board may report parameters of the servo 255, and a record with the id 0."""
    both = QueryServoParameterResponse((ServoParameter(255, 0, "hip"), ServoParameter(3, 0, "knee")))
    text = failure(lambda board: board.release("hip"), NotFound, (QueryServoParameterRequest, both))
    assert text == "the board has no servo 'hip'; there is servo 3 'knee'"
    zero = QueryActionListResponse((ActionEntry(0, "Wave"),))
    assert "there are no actions" in failure(
        lambda board: board.run_action("Wave"), NotFound, (QueryActionListRequest, zero)
    )


def test_an_id_with_two_captions_is_not_named_by_either() -> None:
    """A board that appends records with a known id runs one of them."""
    entries = QueryActionListResponse((ActionEntry(1, "Wave"), ActionEntry(1, "Bow")))
    text = failure(lambda board: board.run_action("Bow"), AmbiguousName, (QueryActionListRequest, entries))
    assert text == "the board lists action 1 'Wave' and action 1 'Bow', so it is unknown which of them has this id"


def test_what_is_listed_twice_is_not_ambiguous() -> None:
    entries = QueryActionListResponse((ActionEntry(1, "Wave"), ActionEntry(1, "Wave")))
    fake = used(lambda board: board.delete_action("Wave"), (QueryActionListRequest, entries))
    assert fake.executed_of(DeleteActionRequest) == [DeleteActionRequest(1)]
    assert not fake.executed_of(QueryMacroListRequest)
    assert not fake.executed_of(QueryServoListRequest)
