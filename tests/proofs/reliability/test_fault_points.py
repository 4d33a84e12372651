"""A fault at the first operation, the second, and so on to the last: each ends in a result or in one typed error."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Coroutine
from contextlib import suppress
from itertools import product
from typing import Any, Literal

import pytest

from servolink import Action, Board, Button, JoystickTable, Macro, MacroCommand, Project, ServoParameter, Step, connect
from servolink.errors import ConnectionLost, OpenError, ServolinkError
from servolink.protocol import WriteProjectIDRequest
from servolink.transports import Faults, FaultyTransport, Receiver, Transport, WrappedTransport
from servolink.virtual import VirtualBoard, VirtualTransport
from tests.plugged import plugged
from tests.project.pulled import contents_of
from tests.sampling import every, sampled, some
from tests.virtual_time import VirtualTimeLoop, run

Fault = Literal["none", "unplugged", "EIO", "partial", "swallowed"]
Command = Callable[[Board], Awaitable[object]]

FAULTS: tuple[Fault, ...] = ("unplugged", "EIO", "partial", "swallowed")
ACTION = Action(1, "wave", (Step(1, 10, 5),))
MACRO = Macro(1, "dance", (MacroCommand(1),))
TABLE = JoystickTable(1, "pad", (Button(1, "A"),))
PARAMETER = ServoParameter(1, 3, "arm")
PROJECT = Project(actions=(ACTION,), macros=(MACRO,))
STOCK = contents_of(Project(0, (PARAMETER,), (ACTION,), (MACRO,), (TABLE,)))
MANY = 500


async def button_events(board: Board) -> None:
    async with board.button_events():
        pass


async def nothing(board: Board) -> None:
    """Open and close only."""


async def watch(board: Board) -> None:
    async with board.watch() as readings:
        for _ in range(3):
            await anext(readings)


COMMANDS: dict[str, Command] = {
    "nothing": nothing,
    "set_transmission_mode": lambda board: board.set_transmission_mode(1),
    "clear_all_data": lambda board: board.clear_all_data(),
    "memory": lambda board: board.memory(),
    "battery": lambda board: board.battery(),
    "send_dummy_data": lambda board: board.send_dummy_data(bytes(100)),
    "servo_ids": lambda board: board.servo_ids(),
    "servos": lambda board: board.servos(),
    "watch": watch,
    "servo": lambda board: board.servo(2),
    "set_servo": lambda board: board.set_servo(1, start=True, hold=True),
    "set_angle_unit": lambda board: board.set_angle_unit("adc", 1),
    "move": lambda board: board.move({1: 20, 2: 30}, duration=0.5),
    "move at a speed and wait": lambda board: board.move({1: 20}, speed=90, wait=True),
    "run_action": lambda board: board.run_action(1),
    "run an action by name and wait": lambda board: board.run_action("wave", wait=True),
    "run a macro by name and wait": lambda board: board.run_macro("dance", wait=True),
    "play": lambda board: board.play(PROJECT, "dance"),
    "move by name": lambda board: board.move({"all": 20}, duration=0.5),
    "delete by name": lambda board: board.delete_macro("dance"),
    "stop": lambda board: board.stop(),
    "release": lambda board: board.release(),
    "actions": lambda board: board.actions(),
    "action": lambda board: board.action(1),
    "add_action": lambda board: board.add_action(ACTION),
    "delete_action": lambda board: board.delete_action(1),
    "macros": lambda board: board.macros(),
    "macro": lambda board: board.macro(1),
    "add_macro": lambda board: board.add_macro(MACRO),
    "delete_macro": lambda board: board.delete_macro(1),
    "run_macro": lambda board: board.run_macro(1),
    "servo_parameters": lambda board: board.servo_parameters(),
    "add_servo_parameters": lambda board: board.add_servo_parameters((PARAMETER,)),
    "project_id": lambda board: board.project_id(),
    "write_project_id": lambda board: board.write_project_id(9),
    "took_effect": lambda board: board.took_effect(WriteProjectIDRequest(9)),
    "joystick_tables": lambda board: board.joystick_tables(),
    "joystick_table": lambda board: board.joystick_table(1),
    "add_joystick_table": lambda board: board.add_joystick_table(TABLE),
    "delete_joystick_table": lambda board: board.delete_joystick_table(1),
    "active_joystick_table": lambda board: board.active_joystick_table(),
    "set_active_joystick_table": lambda board: board.set_active_joystick_table(1),
    "button_events": button_events,
}


class FailingTransport(WrappedTransport):
    """Fails at its operation number `at`: opening, sending, receiving and closing all count."""

    def __init__(self, board: VirtualBoard, fault: Fault, at: int) -> None:
        super().__init__(VirtualTransport(board))
        self.operations = 0
        self.opening = 0
        """How many of them it took until the connection was open."""
        self.fault = fault
        self._at = at

    async def open(self, receiver: Receiver) -> None:
        if self._fails() and self.fault in {"unplugged", "EIO"}:
            raise OpenError("it cannot be opened: EIO")
        await super().open(receiver)

    async def send(self, data: bytes) -> None:
        if not self._fails():
            await super().send(data)
        elif self.fault == "EIO":
            asyncio.get_running_loop().call_soon(self._break, "EIO")
            raise ConnectionLost("EIO")
        elif self.fault != "swallowed":
            if self.fault == "partial":
                await super().send(data[: len(data) // 2])
            self._break("unplugged")
            raise self._lost()

    async def close(self) -> None:
        if self._fails():
            self._break("unplugged while it was being closed")
        await super().close()

    def data(self, chunk: bytes, /) -> None:
        if not self._fails():
            super().data(chunk)
        elif self.fault in {"partial", "EIO"}:
            super().data(chunk[: len(chunk) // 2])
        if self._operation_failed() and self.fault in {"unplugged", "EIO"}:
            self._break("it is gone")

    def _fails(self) -> bool:
        self.operations += 1
        return self._operation_failed()

    def _operation_failed(self) -> bool:
        return self.fault != "none" and self.operations == self._at


def stocked_board() -> VirtualBoard:
    """Return a board with something of everything."""
    board = VirtualBoard(servos=3)
    board.storage.contents = STOCK
    return board


async def assert_answers_are_right(board: Board) -> None:
    for project_id in (77, 78):
        await board.write_project_id(project_id)
        assert await board.project_id() == project_id
    assert await board.servo_ids() == (1, 2, 3)
    assert (await board.servo(2)).servo_id == 2
    assert (await board.memory()).total_size


async def session(transport: FailingTransport, command: Command) -> None:
    """Connect, do something, close."""
    async with connect(transport, patience=1.5) as board:
        transport.opening = transport.operations
        await command(board)


def operations(command: Command) -> tuple[int, int]:
    """Return how many operations there are without a fault: to open, and in all."""

    async def main() -> tuple[int, int]:
        transport = FailingTransport(stocked_board(), "none", 0)
        await session(transport, command)
        return transport.opening, transport.operations

    return run(main())


@pytest.mark.parametrize(("name", "fault"), sampled(product(COMMANDS, FAULTS), len(COMMANDS)))
def test_a_fault_at_any_operation_ends_in_a_result_or_a_typed_error(name: str, fault: Fault) -> None:
    async def main(at: int) -> None:
        virtual = stocked_board()
        begun = asyncio.get_running_loop().time()
        with suppress(ServolinkError):
            await session(FailingTransport(virtual, fault, at), COMMANDS[name])
        assert asyncio.get_running_loop().time() - begun < 30
        async with connect(VirtualTransport(virtual)) as board:
            await assert_answers_are_right(board)

    opening, count = operations(COMMANDS[name])
    assert count > opening > 2
    # To open is the same for all of them: "nothing" is enough to try that.
    for at in range(1 if name == "nothing" else opening + 1, count + 1):
        run(main(at))


class SteppedLoop(VirtualTimeLoop):
    """Cancels `victim` before its turn number `at`, counted from `watch`."""

    def __init__(self) -> None:
        self.turns = 0
        self._at = 0
        self._victim: asyncio.Task[Any] | None = None
        super().__init__()

    def watch(self, victim: asyncio.Task[Any], at: int) -> None:
        self.turns, self._victim, self._at = 0, victim, at

    def _run_once(self) -> None:
        self.turns += 1
        if self._victim is not None and self.turns == self._at:
            self._victim.cancel()
        super()._run_once()  # type: ignore[misc]  # asyncio's own, since its beginning


async def cancelled(what: Coroutine[Any, Any, object], at: int) -> bool:
    """Cancel `what` at a turn of the loop; tell whether it was still running then."""
    loop = asyncio.get_running_loop()
    assert isinstance(loop, SteppedLoop)
    task = loop.create_task(what)
    loop.watch(task, at)
    await asyncio.wait((task,))
    if not task.cancelled() and (error := task.exception()) is not None:
        raise error
    return task.cancelled()


def unhurried(board: VirtualBoard) -> Transport:
    """Return a connection on which there is a moment between question and answer."""
    return FaultyTransport(VirtualTransport(board), Faults(delay=1.0, delay_time=0.004), sent=False)


def run_stepped(main: Coroutine[Any, Any, bool]) -> bool:
    async def exclusive() -> bool:
        result = await main
        await asyncio.sleep(5)
        left = asyncio.all_tasks() - {asyncio.current_task()}
        assert not left, f"tasks left behind: {left}"
        return result

    with asyncio.Runner(loop_factory=SteppedLoop) as runner:
        return runner.run(exclusive())


def cancel_everywhere(scene: Callable[[int], Coroutine[Any, Any, bool]]) -> int:
    """Cancel at the first turn, the second, and so on, until there is nothing left to cancel; return how many."""
    for at in range(1, MANY):
        if not run_stepped(scene(at)):
            return at - 1
    raise AssertionError(f"still running after {MANY} turns of the loop")


@pytest.mark.parametrize("name", [name for name in COMMANDS if name != "nothing"])
def test_a_command_can_be_cancelled_anywhere_and_the_next_answers_are_right(name: str) -> None:
    async def scene(at: int) -> bool:
        async with connect(unhurried(stocked_board()), patience=1.5) as board:

            async def command() -> None:
                await COMMANDS[name](board)

            was_cancelled = await cancelled(command(), at)
            await assert_answers_are_right(board)
        return was_cancelled

    assert cancel_everywhere(scene) >= 1


def test_connecting_can_be_cancelled_anywhere() -> None:
    async def scene(at: int) -> bool:
        virtual = stocked_board()

        async def opening() -> None:
            async with connect(VirtualTransport(virtual)):
                pass

        was_cancelled = await cancelled(opening(), at)
        async with connect(VirtualTransport(virtual)) as board:
            await assert_answers_are_right(board)
        assert virtual.sessions == []
        return was_cancelled

    cancel_everywhere(scene)


def test_closing_can_be_cancelled_anywhere_and_done_again() -> None:
    async def scene(at: int) -> bool:
        virtual = stocked_board()
        board = await connect(unhurried(virtual))
        reading = board.button_events()
        async with reading:
            was_cancelled = await cancelled(board.close(), at)
            await board.close()
        assert virtual.sessions == []
        with pytest.raises(ConnectionLost):
            await board.memory()
        return was_cancelled

    cancel_everywhere(scene)


@every(3)
@pytest.mark.parametrize("fault", FAULTS)
def test_a_board_that_comes_back_by_itself_survives_a_fault_at_any_operation(
    fault: Fault, step: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[FailingTransport] = []

    async def main(at: int) -> bool:
        virtual = stocked_board()

        def create(url: str) -> FailingTransport:
            made.append(FailingTransport(virtual, "none" if made else fault, at))
            return made[-1]

        made.clear()
        url = plugged(monkeypatch, create)
        try:
            board = await connect(url, reconnect=True, patience=1.5)
        except ServolinkError:
            return True
        with suppress(ServolinkError):
            await board.servos()
        with suppress(ServolinkError):
            await board.move({1: 20}, speed=90, wait=True)
        happened = made[0].operations >= at
        made[0].fault = "none"
        await asyncio.sleep(20)
        await assert_answers_are_right(board)
        await board.close()
        return happened

    points = next(at for at in some(1, MANY, step) if not run(main(at))) - 1
    assert points > 10
