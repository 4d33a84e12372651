"""A board that a hub shares: who may move it, who has it alone, and what a program is told.

Modules: servolink.client.hub_link, servolink.connection.packet_connection.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from msgspec import Raw

from servolink.client import hub_link
from servolink.client.board import Board
from servolink.client.connecting import connect
from servolink.connection import Gates
from servolink.control import ConnectionNow, ConnectionState, ErrorData, ErrorObject, Greeting, RpcChannel, open_channel
from servolink.errors import (
    ConnectionLost,
    MotionRefused,
    OpenError,
    Reason,
    Rejected,
    RequestError,
    RequestRefused,
    RequestTimeout,
    ServoStalled,
    TargetNotReached,
)
from servolink.hub import ControlInterface, Hub
from servolink.project import BackupStore, Project, backup_for
from servolink.protocol import Action, ExecuteMacroRequest, Macro, MacroCommand, QueryActionListRequest, ServoParameter
from servolink.support import MIB
from servolink.virtual import BoardKind
from tests.hub.door_hub import on_hub, sharing, until

WAVE = Action.pose("Wave", {1: 30}, seconds=0.1, action_id=1)


@pytest.fixture(autouse=True)
def _backups_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))


@asynccontextmanager
async def controlled(hub: Hub) -> AsyncIterator[ControlInterface]:
    """Open the door of a hub, with its control interface."""
    interface = ControlInterface(hub)
    try:
        async with sharing(hub, interface.open_channel):
            yield interface
    finally:
        await interface.close()


def exclusive(board: Board) -> AbstractAsyncContextManager[None]:
    """Have a shared board alone."""
    assert board.connection.hub is not None
    return board.connection.hub.exclusive("testing")


def with_hub(use: Callable[[Hub], Awaitable[None]]) -> None:
    async def main(hub: Hub, virtual: object) -> None:
        async with controlled(hub):
            await use(hub)

    on_hub(main)


def test_a_refused_movement_is_an_error_that_names_the_holder() -> None:
    async def main(hub: Hub) -> None:
        async with connect("share://rex?role=move") as one, connect("share://rex") as other:
            await one.move({1: 60}, duration=0.05, wait=True)
            with pytest.raises(MotionRefused, match=r"moved by .* `servolink share --take rex`"):
                await other.move({1: 0}, duration=0.05)
            with pytest.raises(MotionRefused):
                await other.release()
            assert (await other.servo(1)).angle == 60
            await other.stop()
            await other.connection.hub.take_lease(force=True)  # type: ignore[union-attr]
            await other.set_servo("all", start=True, hold=True)
            await other.move({1: 0}, duration=0.05, wait=True)
            with pytest.raises(MotionRefused, match="moved by"):
                await one.move({1: 60}, duration=0.05)
            hub.leases.give(hub.lease.session if hub.lease else "")
            await one.move({1: 60}, duration=0.05)

    with_hub(main)


async def _move(board: Board) -> None:
    await board.move({1: 80}, duration=1.0, wait=True)


async def _run_action(board: Board) -> None:
    await board.run_action(1, wait=True)


async def _run_macro(board: Board) -> None:
    await board.run_macro(1, wait=True)


async def _play(board: Board) -> None:
    slow = Action.pose("Slow", {1: 80}, seconds=1.0, action_id=1)
    await board.play(Project(actions=(slow,)), "Slow")


@pytest.mark.parametrize("use", [_move, _run_action, _run_macro, _play])
def test_a_motion_whose_lease_is_taken_away_is_refused_with_the_reason(use: Callable[[Board], Awaitable[None]]) -> None:
    async def main(hub: Hub) -> None:
        async with connect("share://rex") as one, connect("share://rex") as other:
            slow = Action.pose("Slow", {1: 80}, seconds=1.0, action_id=1)
            await one.add_action(slow)
            await one.add_macro(Macro(1, "All", (MacroCommand.of(slow),)))
            await one.set_servo("all", start=True, hold=True)
            moving = asyncio.ensure_future(use(one))
            while (await other.servo(1)).angle < 5:
                assert not moving.done()
            await other.connection.hub.take_lease(force=True)  # type: ignore[union-attr]
            await other.move({1: 0}, duration=0.05)
            with pytest.raises(MotionRefused, match=r"interrupted: the servos of rex are moved by .* --take rex"):
                await moving

    with_hub(main)


def test_an_import_begins_only_if_it_may_turn_servos() -> None:
    async def main(hub: Hub) -> None:
        async with connect("share://rex") as one, connect("share://rex") as other:
            await one.write_project_id(7)
            await one.move({1: 60}, duration=0.05)
            with pytest.raises(MotionRefused, match="moved by"):
                await other.apply_project(Project(actions=(WAVE,)), replace=True)
            assert await other.project_id() == 7
            assert await other.actions() == ()
            await other.export_project()
            hub.leases.give(hub.lease.session if hub.lease else "")
            await other.apply_project(Project(actions=(WAVE,)), replace=True)
            await until(lambda: hub.lease is None)  # given back
            await one.rollback_project()

    with_hub(main)


def test_who_loses_the_lease_or_is_asked_for_it_is_told(caplog: pytest.LogCaptureFixture) -> None:
    async def main(hub: Hub) -> None:
        greeting = Greeting(wants="rpc", who="tablet\u202e")
        tablet, _ = await open_channel("rex", greeting)
        async with connect("share://rex") as board:
            await board.move({1: 60}, duration=0.05)
            await tablet.call("lease.ask")
            await until(lambda: "tablet\\u202e asks for the right to move the servos" in caplog.text)
            assert "moves the servos from now on" not in caplog.text
            await tablet.call("lease.take", force=True)
            await until(lambda: "tablet\\u202e moves the servos from now on" in caplog.text)
            await tablet.close()

    with_hub(main)


def test_an_import_has_the_board_alone_and_others_wait(caplog: pytest.LogCaptureFixture) -> None:
    async def main(hub: Hub) -> None:
        async with connect("share://rex") as one, connect("share://rex") as other:
            async with exclusive(one):
                await until(lambda: "waiting: " in caplog.text)
                with pytest.raises(RequestTimeout, match=r"has exclusive use .* \(testing\); try again later"):
                    await other.request(QueryActionListRequest(), timeout=0.05)
                asked = asyncio.create_task(other.servos())
                await other.stop()  # confirmed by the hub
                assert not asked.done()
                await one.apply_project(Project(actions=(WAVE,)))
            assert [servo.is_start for servo in await asked] == [False] * 3
            assert len(await other.actions()) == 1
            assert not await other.has_unfinished_import()
            backup = await backup_for(other, BackupStore())
            assert "share" not in backup.name
            await other.rollback_project()
            assert not await one.actions()
            await other.clear_all_data()
            await until(lambda: hub.exclusive_use is None)

    with_hub(main)


def test_what_waits_for_who_has_the_board_alone_is_not_sent_after_a_stop_of_somebody_else() -> None:
    async def main(hub: Hub) -> None:
        async with connect("share://rex") as one, connect("share://rex") as other, connect("share://rex") as third:
            await one.set_servo("all", start=False, hold=True)
            for stop in (third.stop, lambda: hub.stop("a page"), other.stop):
                async with exclusive(one):
                    await until(lambda: other.connection.is_suspended)
                    before = asyncio.create_task(other.set_servo(1, start=True, hold=True))
                    moving = asyncio.create_task(other.move({2: 60}, duration=0.05))
                    await asyncio.sleep(0.05)
                    await stop()
                    await asyncio.sleep(0.05)
                    after = asyncio.create_task(other.set_servo(3, start=True, hold=True))
                    await asyncio.sleep(0.05)
                for refused in (before, moving):
                    with pytest.raises(RequestError, match="a stop came first"):
                        await refused
                await after
                assert [servo.is_start for servo in await other.servos()] == [False, False, True]
                await third.stop()
                hub.leases.give(hub.lease.session if hub.lease else "")

    with_hub(main)


@pytest.mark.parametrize("by_program", [True, False])
def test_what_a_program_plays_ends_when_another_one_stops_the_board(by_program: bool) -> None:
    async def main(hub: Hub) -> None:
        async with connect("share://rex") as one, connect("share://rex") as other:
            await one.set_servo("all", start=True, hold=True)
            steps = [Action.pose(f"Step {angle}", {1: angle}, seconds=0.05, action_id=angle) for angle in range(1, 40)]
            macro = Macro(1, "All", tuple(MacroCommand.of(step) for step in steps))
            playing = asyncio.create_task(one.play(Project(actions=tuple(steps), macros=(macro,)), "All"))
            while (await other.servo(1)).angle < 5:
                await asyncio.sleep(0.01)
            await (other.stop() if by_program else hub.stop("a page"))
            hub.leases.give(hub.lease.session if hub.lease else "")
            await other.set_servo("all", start=True, hold=True)
            here = (await other.servo(1)).angle
            with pytest.raises(RequestError, match="ended by a stop"):
                await playing
            assert (await other.servo(1)).angle == here
            await one.request(QueryActionListRequest())

    with_hub(main)


def test_a_program_whose_motion_the_guard_of_the_hub_ends_gets_a_typed_error() -> None:
    async def main(hub: Hub) -> None:
        async with connect("share://rex") as one:
            await one.set_servo("all", start=True, hold=True)
            moving = asyncio.create_task(one.move({1: 60}, duration=30.0, wait=True))
            await until(lambda: hub.motions.courses.way(1) is not None)
            hub.stop_stalled(1, "servo 1 is stalled: for 0.3 s it has stood at 20 degrees")
            with pytest.raises(ServoStalled, match=r"ended by the guard: servo 1 is stalled: for 0\.3 s") as failed:
                await moving
            assert failed.value.reason is Reason.STALL
            await one.stop()
            with pytest.raises(RequestRefused) as refused:
                await one.move({1: 60}, duration=0.05)
            assert refused.value.reason is Reason.SERVO_STATE, "the stop after it has a reason of its own"

    with_hub(main)


def test_a_program_that_is_killed_frees_the_board_and_the_lease() -> None:
    async def main(hub: Hub) -> None:
        one = await connect("share://rex")
        async with connect("share://rex") as other:
            await one.move({1: 60}, duration=0.05)
            holding = exclusive(one)
            await holding.__aenter__()
            moving = asyncio.create_task(other.move({1: 0}, duration=0.05))
            await until(lambda: hub.exclusive_use is not None)
            one.connection.transport._pipe.abort()  # type: ignore[attr-defined]
            await moving
            await one.close()
            assert hub.exclusive_use is None
            await holding.__aexit__(None, None, None)

    with_hub(main)


def test_the_end_of_the_hub_ends_the_connection() -> None:
    async def main(hub: Hub, virtual: object) -> None:
        async with controlled(hub):
            board = await connect("share://rex")
            channel, _ = await open_channel("rex", Greeting(wants="rpc", who="tablet"))
            waiting = asyncio.create_task(channel.call("board.hold"))
            await waiting
        with pytest.raises(ConnectionLost):
            await board.servos()
        with pytest.raises(ConnectionLost, match="start it again"):
            await channel.call("status")
        channel.tell("status")
        await channel.close()
        await board.close()

    on_hub(main)


def test_a_program_finds_a_hub_that_was_started_again() -> None:
    async def main(hub: Hub, virtual: object) -> None:
        async with controlled(hub):
            board = await connect("share://rex", reconnect=True)
            states = board.states()
            await board.move({1: 60}, duration=0.05, wait=True)
            first = board.connection.hub
            assert await anext(states) == "connected"
        assert await anext(states) == "lost"
        async with controlled(hub):
            assert await anext(states) == "connected"
            assert board.connection.hub is not first
            await board.move({1: 0}, duration=0.05, wait=True)
            await board.close()

    on_hub(main)


def tell_state(hub: Hub, state: ConnectionState, another: str = "") -> None:
    """Do what the hub does when its own connection to the board is lost, or is back."""
    hub._state = state
    hub.tell(ConnectionNow(state, another))


def test_a_program_learns_that_the_hub_has_lost_the_board() -> None:
    async def main(hub: Hub) -> None:
        async with connect("share://rex") as board:
            states = board.states()
            assert await anext(states) == "connected"
            tell_state(hub, "lost")
            assert await anext(states) == "lost"
            async with connect("share://rex") as later:
                assert "lost" in repr(later)
                tell_state(hub, "connected")
                later_states = later.states()
                while await anext(later_states) == "lost":
                    pass
            assert await anext(states) == "connected"

    with_hub(main)


def test_an_error_says_that_the_hub_has_lost_the_board() -> None:
    async def use(hub: Hub, _: object) -> None:
        async with controlled(hub), connect("share://rex") as board:
            tell_state(hub, "lost", "it is another one")
            states = board.states()
            while await anext(states) != "lost":
                pass
            with pytest.raises(
                RequestTimeout, match=r"the hub rex has lost its board .* \(it is another one\); try ag"
            ):
                await board.request(QueryActionListRequest(), timeout=0.05)

    on_hub(use, BoardKind(unsupported=("QueryActionList",)))  # which answers as a board that is not there


def test_what_a_hub_tells_while_a_program_joins_is_not_older_than_what_it_answers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    call = RpcChannel.call

    async def call_and_hear(self: RpcChannel, method: str, **options: Any) -> Raw:
        result = await call(self, method, **options)
        if method == "board.state":
            assert self.on_notification is not None
            self.on_notification("connection", Raw(b'{"state": "lost"}'))
        return result

    async def main(hub: Hub) -> None:
        async with connect("share://rex") as board:
            assert "lost" in repr(board)

    monkeypatch.setattr(RpcChannel, "call", call_and_hear)
    with_hub(main)


def test_the_channel_alone_ends_the_connection_too() -> None:
    async def main(hub: Hub) -> None:
        async with connect("share://rex") as board:
            board.connection.hub._channel._pipe.abort()  # type: ignore[union-attr]
            await until(lambda: board.connection.ended)
            with pytest.raises(ConnectionLost, match="the hub of rex has closed the connection"):
                await board.servos()

    with_hub(main)


def test_a_hub_without_control_interface_shares_its_board_all_the_same() -> None:
    async def main(hub: Hub, virtual: object) -> None:
        async with sharing(hub), connect("share://rex") as board:
            assert board.connection.hub is None
            await board.move({1: 60}, duration=0.05, wait=True)
            with pytest.raises(OpenError, match="no control interface"):
                await open_channel("rex", Greeting(wants="rpc", who="tablet"))

    on_hub(main)


class Deaf:
    """A control interface that does not answer, or ends at once."""

    def __init__(self, abort: Callable[[str], None] | None) -> None:
        self._abort = abort

    def receive(self, message: bytes) -> None:
        if self._abort is not None:
            self._abort("as the test wants it")

    def pause(self) -> None:
        """Do nothing."""

    resume = pause

    async def close(self) -> None:
        """Do nothing."""


@pytest.mark.parametrize(("ends", "error"), [(True, "the hub of rex is gone"), (False, "has not answered board.state")])
def test_a_control_interface_that_does_not_work_is_an_error(
    ends: bool, error: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hub_link, "_LIMIT", 0.05)

    async def main(hub: Hub, virtual: object) -> None:
        async with sharing(hub, lambda *given: Deaf(given[-1] if ends else None)):
            with pytest.raises(OpenError, match=error):
                await connect("share://rex")
            await until(lambda: not hub.programs)

    on_hub(main)


def test_an_endless_message_ends_the_channel() -> None:
    async def main(hub: Hub) -> None:
        channel, _ = await open_channel("rex", Greeting(wants="rpc", who="tablet"))
        channel.data_received(bytes(64 * MIB + 1))
        await until(lambda: channel.ended)
        with pytest.raises(ConnectionLost):
            await channel.call("status")

    with_hub(main)


@pytest.mark.parametrize(
    ("role", "needed", "use"),
    [
        ("watch", "run", lambda board: board.request(ExecuteMacroRequest(1))),
        ("watch", "move", lambda board: board.move({1: 60}, duration=0.05)),
        ("run", "move", lambda board: board.move({1: 60}, duration=0.05)),
        ("run", "move", lambda board: board.release(1)),
        ("move", "edit", lambda board: board.add_action(WAVE)),
        ("move", "edit", lambda board: board.apply_project(Project(1))),
        ("move", "edit", lambda board: board.add_servo_parameters([ServoParameter(1, 3)])),
    ],
)
def test_what_the_role_does_not_allow_is_an_error_before_anything_is_sent(
    role: str, needed: str, use: Callable[[Board], Awaitable[object]]
) -> None:
    async def main(hub: Hub) -> None:
        async with connect(f"share://rex?role={role}") as board:
            with pytest.raises(RequestRefused, match=rf"the role {needed}, .* has the role {role}; .*role={needed}"):
                await use(board)
            assert hub.lease is None
            assert hub.status().programs[0].refused == 0
            await board.stop()

    with_hub(main)


def test_a_refusal_for_other_reasons_is_logged(caplog: pytest.LogCaptureFixture) -> None:
    async def main(hub: Hub) -> None:
        async with connect("share://rex?role=watch") as board:
            board.connection.preparations, board.connection.gates = (), Gates()  # which refuse it themselves
            with pytest.raises(Rejected):
                await board.add_action(WAVE)
            await until(lambda: "AddActionRequest was not sent to the board: AddActionRequest needs" in caplog.text)

    with_hub(main)


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        ("MotionRefused", MotionRefused),
        ("RequestTimeout", RequestTimeout),
        ("TargetNotReached", TargetNotReached),
        ("forbidden", RequestRefused),
        ("busy", RequestError),
        ("Any", RequestError),
        ("ServolinkError.__init__", RequestError),
    ],
)
def test_an_error_of_the_hub_is_one_of_the_library(kind: str, expected: type[Exception]) -> None:
    assert type(ErrorObject(0, "text", ErrorData(kind, "")).as_error()) is expected


def test_messages_that_are_not_from_a_hub_are_logged_and_change_nothing(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.WARNING)

    async def main(hub: Hub) -> None:
        async with connect("share://rex") as board:
            link = board.connection.hub
            channel = link._channel  # type: ignore[union-attr]
            for line in (b"", b"nonsense", b'"\xff"', b"[" * 5000, b'{"id": 99, "result": 1}', b'{"id": "x"}'):
                channel.data_received(line + b"\n")
            channel.data_received(b'{"method": "hold", "params": {"hold": 3}}\n{"method": "new", "params": {}}\n')
            channel.data_received(b'{"method": "lease", "params": {"by": "\xff"}}\n')
            channel.data_received(b'{"method": "ho')
            channel.data_received(b'ld", "params": {"hold": null}}\n')
            assert len(caplog.records) == 7
            await board.servos()

    with_hub(main)


def test_a_method_that_takes_too_long_is_given_up() -> None:
    async def main(hub: Hub) -> None:
        one, _ = await open_channel("rex", Greeting(wants="rpc", who="one"))
        other, _ = await open_channel("rex", Greeting(wants="rpc", who="other"))
        await one.call("board.hold")
        with pytest.raises(RequestTimeout, match=r"has not answered board\.hold within 0\.05 s"):
            await other.call("board.hold", timeout=0.05)
        await one.close()
        await one.close()
        await other.close()
        with pytest.raises(OpenError):
            await open_channel("rex", Greeting(wants="frames", who="one"))

    with_hub(main)
