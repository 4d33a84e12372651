"""A hub that has lost its board: a request of which nothing was sent ends with ConnectionLost."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from servolink.client import connect
from servolink.control import ConnectionNow
from servolink.errors import ConnectionLost
from servolink.hub import share
from servolink.protocol import Action
from servolink.virtual import VirtualBoard
from tests.client.sockets import Socket
from tests.hub.control_program import RpcFailed, Shared
from tests.hub.door_hub import on_hub, sharing, until
from tests.plugged import plugged

REQUESTS: list[tuple[str, dict[str, Any]]] = [
    ("move", {"targets": {"1": 30}, "duration": 0.1}),
    ("move", {"targets": {"hip": 30}, "duration": 0.1}),
    ("move", {"targets": {"all": 30}, "duration": 0.1}),
    ("move", {"targets": {"1": 30}, "speed": 20}),
    ("move", {"targets": {"1": 30}, "duration": 0.1, "start": True, "wait": True}),
    ("release", {"servo": "all"}),
    ("servo.set", {"servo": 1, "start": True, "hold": True}),
    ("run", {"type": "action", "id": 1}),
    ("run", {"type": "macro", "id": 1}),
    ("servos.list", {}),
    ("servos.list", {"unit": "adc"}),
    ("servos.parameters", {}),
    ("battery", {}),
    ("board.facts", {}),
    ("project.export", {}),
]


@pytest.mark.parametrize("is_used", [False, True])
@pytest.mark.parametrize("limits", [{}, {"angle_limits": (-90, 90), "speed_cap": 100, "soft_start": 20}])
async def test_what_is_asked_while_the_board_is_lost_was_not_sent(
    monkeypatch: pytest.MonkeyPatch, limits: dict[str, Any], is_used: bool
) -> None:
    virtual = VirtualBoard()
    socket = Socket(virtual)
    url = plugged(monkeypatch, socket.transport)
    async with (
        connect(url, reconnect=True, angle_unit=None, **limits) as board,
        share(board, name="rex") as hub,
        Shared(hub, virtual).program("page") as page,
    ):
        await page.call("status")
        if is_used:
            await page.call("move", targets={"1": 10}, duration=0.1, wait=True)
            await page.call("servos.list")
        socket.pull()
        assert (await page.until("connection"))["state"] == "lost"
        for method, params in REQUESTS:
            with pytest.raises(RpcFailed) as failed:
                await page.call(method, **params)
            assert (method, params, failed.value.kind) == (method, params, "ConnectionLost")
        socket.plug(virtual)
        assert (await page.until("connection", 2))["state"] == "connected"
        await page.call("move", targets={"1": 20}, duration=1, wait=True)
        assert (await page.call("servos.list"))["servos"][0]["angle"] == 20


async def test_watching_goes_on_when_the_board_is_back(monkeypatch: pytest.MonkeyPatch) -> None:
    virtual = VirtualBoard()
    socket = Socket(virtual)
    url = plugged(monkeypatch, socket.transport)
    async with (
        connect(url, reconnect=True, angle_unit=None) as board,
        share(board, name="rex") as hub,
        Shared(hub, virtual).program("page") as page,
    ):
        await page.call("servos.watch", hz=10)
        await page.until("servos")
        socket.pull()
        await page.until("connection")
        await asyncio.sleep(5)
        count = len(page.of("servos"))
        page.tell("servos.ack", number=count)
        socket.plug(virtual)
        await page.until("connection", 2)
        await page.until("servos", count + 1)
        assert page.of("problem") == []


def test_a_program_with_a_board_of_its_own_sends_nothing_to_a_lost_board() -> None:
    async def main(hub: Any, _: object) -> None:
        interface = Shared(hub, VirtualBoard()).interface
        async with sharing(hub, interface.open_channel), connect("share://rex") as board:
            await board.move({1: 10}, duration=0.05, wait=True)
            hub.tell(ConnectionNow("lost"))
            await until(lambda: board.connection.hub is not None and board.connection.hub.has_lost_board)
            with pytest.raises(
                ConnectionLost, match="ExecuteActionRequest was not sent: the hub rex has lost its board"
            ):
                await board.move({1: 20}, duration=0.05)
            with pytest.raises(ConnectionLost):
                await board.add_action(Action(1, "one"))
            hub.tell(ConnectionNow("connected"))
            await until(lambda: board.connection.hub is not None and not board.connection.hub.has_lost_board)
            await board.move({1: 20}, duration=0.05, wait=True)
        await interface.close()

    on_hub(main)


@pytest.mark.parametrize(
    ("method", "params", "kind"),
    [
        ("servo.set", {"servo": 1, "start": True, "hold": True}, "OutcomeUnknown"),
        ("battery", {}, "ConnectionLost"),
    ],
)
async def test_a_change_that_was_sent_before_the_loss_is_unknown(
    monkeypatch: pytest.MonkeyPatch, method: str, params: dict[str, Any], kind: str
) -> None:
    virtual = VirtualBoard()
    socket = Socket(virtual)
    url = plugged(monkeypatch, socket.transport)
    async with (
        connect(url, reconnect=True, angle_unit=None) as board,
        share(board, name="rex") as hub,
        Shared(hub, virtual).program("page") as page,
    ):
        await page.call("servos.list")
        (line,) = virtual.sessions
        monkeypatch.setattr(line, "receive", lambda data, now: None)
        asking = page.begin(method, **params)
        await asyncio.sleep(0.01)
        socket.pull()
        with pytest.raises(RpcFailed) as failed:
            await asking
        assert failed.value.kind == kind
