"""Board: every command of the protocol, against a virtual board; and how a board is opened and closed."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from servolink.client.board import Board
from servolink.client.connecting import connect
from servolink.errors import EncodeError, NotFound, Rejected
from servolink.protocol import (
    PACKETS,
    Action,
    ActionEntry,
    Button,
    Command,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    JoystickTable,
    JoystickTableEntry,
    Macro,
    MacroCommand,
    MacroCommandType,
    MacroEntry,
    Packet,
    QueryMemorySizeRequest,
    QueryMemorySizeResponse,
    QueryProjectIDRequest,
    QueryProjectIDResponse,
    QueryServoRequest,
    Request,
    ServoParameter,
    Step,
    TransmissionModeSettingRequest,
    TransmissionModeSettingResponse,
)
from servolink.virtual import VirtualBoard, VirtualTransport
from tests.client.piped_board import PipedBoard, lie, now, opened
from tests.virtual_time import run

ACTION = Action(7, "wave", (Step(1, 30, 50), Step(2, -30, 100)))
MACRO = Macro(3, "greet", (MacroCommand(7, total_interval=1000), MacroCommand(500, type=1, total_interval=500)))
TABLE = JoystickTable(5, "walk", (Button(2**32 - 1, "A", 3, 0, 3, 1), Button(2, "B")))


# --- the 32 commands ----------------------------------------------------------------------------------------------


async def use_settings(board: Board) -> None:
    await board.set_transmission_mode(1)
    memory = await board.memory()
    assert 0 < memory.size <= (memory.total_size or 0)
    assert 0 < (await board.battery() or 0) <= 100
    await board.send_dummy_data(bytes(range(256)) * 255)
    await board.write_project_id(9)
    await board.add_action(ACTION)
    await board.clear_all_data()
    assert await board.actions() == ()


async def use_servos(board: Board) -> None:
    assert await board.servo_ids() == (1, 2, 3)
    assert [servo.servo_id for servo in await board.servos()] == [1, 2, 3]
    assert (await board.servo(3)).servo_id == 3
    await board.set_servo(1, start=False, hold=True)
    assert not (await board.servo(1)).is_start
    await board.set_servo(255, start=True, hold=True)
    await board.set_angle_unit("degree")
    assert await board.move({1: 40}, duration=0.5, wait=True) == 0.5
    assert (await board.servo(1)).angle == 40
    assert await board.move({1: -50}, speed=90, wait=True) == 1.0
    await board.stop()
    await board.release()
    assert not (await board.servo(1)).is_hold


async def use_actions(board: Board) -> None:
    await board.add_action(ACTION)
    assert await board.actions() == (ActionEntry(7, "wave"),)
    assert await board.action(7) == ACTION
    await board.run_action(7)
    await asyncio.sleep(1.1)
    assert [servo.angle for servo in (await board.servos())[:2]] == [30, -30]
    with pytest.raises(NotFound, match="no action 8"):
        await board.action(8)
    with pytest.raises(NotFound, match="no action 8"):
        await board.run_action(8)
    with pytest.raises(NotFound, match="no action 0"):
        await board.action(0)
    await board.delete_action(7)
    assert await board.actions() == ()
    with pytest.raises(Rejected, match=r"refused DeleteActionRequest\(action_id=7\): it may have no such action"):
        await board.delete_action(7)


async def use_macros(board: Board) -> None:
    await board.add_action(ACTION)
    await board.add_macro(MACRO)
    assert await board.macros() == (MacroEntry(3, "greet"),)
    assert await board.macro(3) == MACRO
    await board.run_macro(3)
    await asyncio.sleep(2)
    assert (await board.servo(1)).angle == 30
    with pytest.raises(NotFound, match="no macro 4"):
        await board.macro(4)
    await board.delete_macro(3)
    with pytest.raises(Rejected, match="may have no such macro"):
        await board.delete_macro(3)
    with pytest.raises(NotFound, match=r"^the board has no macro 3; there are no macros$"):
        await board.run_macro(3)
    await board.add_macro(Macro(4, "itself", (MacroCommand(4, MacroCommandType.MACRO),)))
    with pytest.raises(Rejected, match="may run itself, or something that is not stored"):
        await board.run_macro(4)


async def use_parameters(board: Board) -> None:
    assert await board.servo_parameters() == ()
    parameters = (ServoParameter(1, -5, "hip"), ServoParameter(2, 5, "knee"))
    await board.add_servo_parameters(list(parameters))
    assert await board.servo_parameters() == parameters
    with pytest.raises(Rejected, match="the servo absent"):
        await board.add_servo_parameters([ServoParameter(200)])
    assert await board.project_id() == 0
    await board.write_project_id(-4711)
    assert await board.project_id() == -4711


async def use_joystick(board: Board) -> None:
    assert await board.active_joystick_table() is None
    await board.add_joystick_table(TABLE)
    assert await board.joystick_tables() == (JoystickTableEntry(5, "walk"),)
    assert await board.joystick_table(5) == TABLE
    await board.set_active_joystick_table(5)
    assert await board.active_joystick_table() == 5
    with pytest.raises(NotFound, match="no joystick table 6"):
        await board.joystick_table(6)
    with pytest.raises(Rejected, match="no such joystick table"):
        await board.set_active_joystick_table(6)
    async with board.button_events():
        pass
    await board.delete_joystick_table(5)
    with pytest.raises(Rejected, match="no such joystick table"):
        await board.delete_joystick_table(5)


CHAPTERS = (use_settings, use_servos, use_actions, use_macros, use_parameters, use_joystick)


@pytest.mark.parametrize("byte_order", ["little", "big"])
@pytest.mark.parametrize("use", CHAPTERS)
async def test_each_command_does_what_it_says(use: Any, byte_order: Any) -> None:
    url = f"virtual://?servos=3&byte_order={byte_order}"
    async with connect(url, byte_order=byte_order) as board:
        await use(board)
        assert board.url == url
        assert board.stats.timeouts == board.stats.undecodable == board.stats.unsolicited == 0


def test_every_request_and_command_of_the_document_has_been_sent_by_these_tests() -> None:
    async def main() -> set[type[Packet]]:
        sent: set[type[Packet]] = set()
        for use in CHAPTERS:
            fake = PipedBoard(servos=3)
            async with opened(fake) as board:
                await use(board)
            sent |= {type(packet) for _, packet in fake.sent}
        return sent

    sent = run(main())
    assert sent == {declared for declared in PACKETS.values() if issubclass(declared, (Request, Command))}
    assert len(sent) == 31


async def test_a_button_press_on_the_board_arrives_as_an_event() -> None:
    virtual = VirtualBoard(2)
    async with connect(VirtualTransport(virtual)) as board, board.button_events() as events:
        virtual.press_button(4, now())
        event = await anext(events)
        assert (event.button_id, event.kind) == (4, "press")


async def test_several_commands_at_once_give_each_its_own_answer() -> None:
    async with connect("virtual://?servos=5") as board:
        await board.write_project_id(12)
        servo_ids, project_id, battery, servos = await asyncio.gather(
            board.servo_ids(), board.project_id(), board.battery(), board.servos()
        )
        assert (len(servo_ids), project_id, len(servos)) == (5, 12, 5)
        assert battery is not None
        assert battery > 0


async def test_a_bad_line_costs_time_and_not_rightness() -> None:
    async with connect("virtual://?servos=5&seed=6&flip=0.001&drop=0.001&delay=0.05", patience=10) as board:
        for _ in range(100):
            assert await board.servo_ids() == (1, 2, 3, 4, 5)
            assert [servo.servo_id for servo in (await board.request(QueryServoRequest(255))).servos] == [
                1,
                2,
                3,
                4,
                5,
            ]
        assert board.stats.retries > 0


async def test_any_packet_can_be_sent() -> None:
    async with connect("virtual://?servos=2") as board:
        assert await board.request(QueryProjectIDRequest(), timeout=0.5) == QueryProjectIDResponse(0)
        await board.send(ExecuteActionRequest((Step(1, 20, 10),)))
        await asyncio.sleep(0.2)
        assert (await board.request(QueryServoRequest(1))).servos[0].angle == 20


async def test_a_board_that_tells_only_its_free_memory() -> None:
    fake = PipedBoard()
    fake.plan(QueryMemorySizeRequest, lie(QueryMemorySizeResponse(100)))
    async with opened(fake) as board:
        memory = await board.memory()
        assert (memory.size, memory.total_size) == (100, None)


async def test_a_mode_that_the_board_does_not_take_is_rejected() -> None:
    fake = PipedBoard()
    fake.plan(TransmissionModeSettingRequest, lie(TransmissionModeSettingResponse(0)))
    async with opened(fake) as board:
        with pytest.raises(Rejected, match=r"asked for .*mode 1 and is in mode 0"):
            await board.set_transmission_mode(1)


async def test_too_much_is_refused_before_anything_is_sent() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        with pytest.raises(EncodeError, match=r"65536 bytes are outside 0\.\.65535"):
            await board.send_dummy_data(bytes(65536))
        with pytest.raises(EncodeError, match="action_caption"):
            await board.add_action(Action(1, "x" * 33))
        assert fake.sent == []


@pytest.mark.parametrize("timeout", [0, -1, float("nan"), float("inf"), 10**400])
async def test_a_time_limit_that_is_none_is_refused_before_anything_is_sent(timeout: float) -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        with pytest.raises(ValueError, match=r"timeout must be 0\.001\.\.3600 seconds"):
            await board.request(QueryProjectIDRequest(), timeout=timeout)
        assert fake.sent == []


async def test_what_is_answered_and_what_is_not_are_sent_by_their_own_method() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        with pytest.raises(TypeError, match="the board does not answer ExecuteActionExRequest; use send"):
            await board.request(ExecuteActionExRequest(1))  # type: ignore[arg-type]
        with pytest.raises(TypeError, match="the board answers QueryProjectIDRequest; use request"):
            await board.send(QueryProjectIDRequest())  # type: ignore[arg-type]
        assert fake.sent == []


@pytest.mark.parametrize("method", ["request", "send"])
@pytest.mark.parametrize(
    ("packet", "words"),
    [
        (QueryProjectIDRequest, r"QueryProjectIDRequest is a class and not a packet; write QueryProjectIDRequest\(\)$"),
        (QueryServoRequest, r"write QueryServoRequest\(servo_id\)$"),
        (QueryProjectIDResponse(3), "QueryProjectIDResponse is sent by the board only; pass a request, such as "),
        ("3.2.1", r"packet must be a packet, such as QueryServoListRequest\(\), not '3.2.1'"),
    ],
)
async def test_what_is_no_packet_for_a_board_is_refused_with_what_to_pass(method: str, packet: Any, words: str) -> None:
    async with opened(PipedBoard()) as board:
        with pytest.raises(TypeError, match=words):
            await getattr(board, method)(packet)


def test_an_angle_unit_that_does_not_exist_is_refused() -> None:
    with pytest.raises(ValueError, match="angle_unit must be 'degree', 'adc' or None, not 'radian'"):
        connect("virtual://", angle_unit="radian")  # type: ignore[arg-type]
