"""Records are added without an id: the lowest free one is chosen, and references must lead to something.

Module: servolink.client.board_records.
"""

from __future__ import annotations

import asyncio

import pytest

from servolink import Action, Button, EncodeError, JoystickTable, Macro, MacroCommand, Rejected, Step, connect
from servolink.protocol import AddActionRequest, AddActionResponse, QueryActionListRequest
from tests.client.piped_board import PipedBoard, late, lie, opened

POSE = Action.pose("stand", {1: 0, 2: 0})


async def test_the_lowest_free_id_is_chosen_and_returned() -> None:
    async with connect("virtual://") as board:
        for taken in (1, 2, 4):
            await board.add_action(Action(taken, str(taken)))
        added = await board.add_action(POSE)
        assert added == Action(3, POSE.action_caption, POSE.steps)
        assert await board.action(3) == added
        assert (await board.add_action(POSE)).action_id == 5
        assert (await board.add_macro(Macro.of("walk", added))).macro_id == 1
        assert (await board.add_joystick_table(JoystickTable.of("pad"))).table_id == 1


async def test_an_id_that_is_given_is_kept_and_nothing_is_asked() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        assert await board.add_action(Action(9, "nine", (Step(1, 2, 3),))) == Action(9, "nine", (Step(1, 2, 3),))
        assert fake.sent_of(QueryActionListRequest) == []


@pytest.mark.parametrize("depth", [1, 4])
async def test_records_that_are_added_at_the_same_time_get_different_ids(depth: int) -> None:
    fake = PipedBoard()
    fake.plan(AddActionRequest, late(0.3))
    async with opened(fake, depth=depth) as board:
        added = await asyncio.gather(*(board.add_action(POSE) for _ in range(5)))
        assert sorted(action.action_id for action in added) == [1, 2, 3, 4, 5]
        assert len(await board.actions()) == 5


async def test_a_macro_that_calls_an_action_without_an_id_is_refused_with_the_cause() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        with pytest.raises(EncodeError, match=r"macro 'walk' refers to action 'stand', which has no id: add that"):
            await board.add_macro(Macro.of("walk", 0.5, POSE))
        with pytest.raises(EncodeError, match=r"no id: .* refer to the macro that add_macro returns"):
            await board.add_joystick_table(JoystickTable.of("pad", Button.of(1, press=Macro.of("walk"))))
        assert fake.sent == []
        stand = await board.add_action(POSE)
        walk = await board.add_macro(Macro.of("walk", 0.5, stand))
        assert walk.commands[1] == MacroCommand(stand.action_id)
        table = await board.add_joystick_table(JoystickTable.of("pad", Button.of(1, press=walk)))
        assert await board.joystick_table(table.table_id) == table


async def test_a_refused_record_names_the_likely_causes_and_a_wrong_type_is_refused_before() -> None:
    fake = PipedBoard()
    fake.plan(AddActionRequest, lie(AddActionResponse(0)))
    async with opened(fake) as board:
        with pytest.raises(Rejected, match="its memory may be full, or the id may be taken"):
            await board.add_action(Action(1, "stand"))
        with pytest.raises(TypeError, match=r"must be of type Action, not Macro\("):
            await board.add_action(Macro(1))  # type: ignore[arg-type]
