"""A real broker, a real bridge and a program that commands, while the broker and the network between them fail.

Modules: servolink.fleet.client, servolink.fleet.outbox, servolink.fleet.roster.
"""

from __future__ import annotations

import asyncio
import json
import resource
import signal
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path

import pytest

from servolink.client import Board, connect
from servolink.errors import OutcomeUnknown, RequestTimeout, ServolinkError
from servolink.fleet import broker as broker_module
from servolink.fleet import connect as connect_fleet
from servolink.fleet import mqtt_client, roster
from servolink.fleet.access import BrokerAccess
from servolink.fleet.client import Fleet
from servolink.fleet.join import LocalBoard, LocalFleet
from servolink.fleet.pending_command import PendingCommand
from servolink.fleet.policy import BoardPolicy, FleetFile
from servolink.hub import serve_board
from tests.fleet.bridged import LIMIT, TOPICS, Far, bridged, far_away, run, running
from tests.fleet.mosquitto import OPEN, Broker, needs_broker
from tests.fleet.patience import patience_ends
from tests.fleet.proxy import Proxy, proxy_to
from tests.fleet.test_commands import Calls

pytestmark = [*needs_broker, pytest.mark.usefixtures("user")]

MOVE = {"targets": {"1": 20}, "duration": 0.1}
START = "servo.set", {"servo": "all", "start": True, "hold": True}


@pytest.fixture(autouse=True)
def _soon_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(broker_module, "FIRST_PAUSE", 0.02)
    monkeypatch.setattr(broker_module, "LONGEST_PAUSE", 0.1)


@asynccontextmanager
async def board_and_fleet(url: str, far_url: str, name: str = "rex") -> AsyncIterator[tuple[Fleet, Board]]:
    """Yield a fleet through `far_url` whose board, joined through `url`, is read beside it."""
    async with serve_board("virtual://?servos=4", name=name), connect(f"share://{name}") as board:
        joining = LocalFleet(BrokerAccess.of(url), TOPICS, FleetFile(BoardPolicy("edit")), hz=0.0)
        ready = asyncio.Event()
        async with running(joining.join([LocalBoard(name, name)], ready.set)):
            await ready.wait()
            async with connect_fleet(far_url, groups={}) as fleet:
                fleet.controller.patience = LIMIT
                await fleet.list()
                yield fleet, board


async def started_soon(fleet: Fleet) -> None:
    """Start all servos, as soon as a word of the pulse has come that is later than a stop at the board."""
    async with asyncio.timeout(LIMIT):
        while True:
            with suppress(ServolinkError):
                await fleet.controller.call("rex", *START)
                return
            await asyncio.sleep(0.01)


async def until_online(fleet: Fleet, *names: str) -> None:
    """Wait until boards are back."""
    async with asyncio.timeout(LIMIT):
        while fleet.controller.roster.online != names:
            await asyncio.sleep(0.01)
        await fleet.list()


# --- the broker -------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_everybody_comes_back_after_the_broker_was_killed(broker: Broker, monkeypatch: pytest.MonkeyPatch) -> None:
    async def main() -> None:
        async with board_and_fleet(broker.url, broker.url) as (fleet, board):
            calls = Calls(monkeypatch)
            for _ in range(3):
                broker.end(signal.SIGKILL)
                sent = asyncio.create_task(fleet.call("rex", "move", MOVE, patience=8.0))
                await asyncio.sleep(0)
                broker.start()
                await until_online(fleet, "rex")
                with_result = await asyncio.gather(sent, return_exceptions=True)
                assert isinstance(with_result[0], dict | ServolinkError)
            assert calls.methods.count("move") <= 3, "none was carried out twice"
            assert (await fleet.call("rex", "move", MOVE | {"wait": True}))["seconds"] == pytest.approx(0.1)
            assert (await board.servo(1)).angle == 20

    run(main())


def test_a_stop_in_the_moment_of_a_restart_reaches_the_board(broker: Broker) -> None:
    async def main() -> None:
        async with board_and_fleet(broker.url, broker.url) as (fleet, board):
            await fleet.call("rex", "move", {"targets": {"1": 90}, "duration": 60})
            broker.end(signal.SIGKILL)
            stopping = asyncio.create_task(fleet.stop(patience=LIMIT))
            await asyncio.sleep(0)
            broker.start()
            assert (await stopping).is_complete
            await until_online(fleet, "rex")
            assert list((await fleet.stop(patience=LIMIT)).stopped) == ["rex"]
            assert not (await board.servo(1)).is_start

    run(main())


@pytest.mark.slow
def test_a_full_broker_loses_nothing_silently(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    broker = Broker(tmp_path, [*OPEN, "max_queued_messages 5", "max_inflight_messages 1"])
    broker.start()

    async def main() -> None:
        async with board_and_fleet(broker.url, broker.url) as (fleet, _):
            asked = [asyncio.create_task(fleet.call("rex", "board.state")) for _ in range(200)]

            def is_over(pending: PendingCommand) -> bool:
                return pending.board == "rex" and any(each.done() and not each.exception() for each in asked)

            patience_ends(monkeypatch, is_over)
            for each in asked:
                each.add_done_callback(lambda each: fleet.controller.wake())
            found = await asyncio.gather(*asked, return_exceptions=True)
            assert all(isinstance(one, (dict, RequestTimeout, ServolinkError)) for one in found)
            assert any(isinstance(one, dict) for one in found)
            assert (await fleet.stop(patience=LIMIT)).is_complete

    run(main())
    broker.end()


# --- the network ------------------------------------------------------------------------------------------------------


@asynccontextmanager
async def network(broker: Broker, *, of_board: bool) -> AsyncIterator[tuple[Proxy, Fleet, Board]]:
    """Yield a network, between the broker and the board or the other program, that can be cut."""
    async with proxy_to(broker) as proxy:
        urls = (proxy.url, broker.url) if of_board else (broker.url, proxy.url)
        async with board_and_fleet(*urls) as (fleet, board):
            yield proxy, fleet, board


@pytest.mark.parametrize("of_board", [False, True])
def test_everybody_comes_back_after_the_network_was_cut(broker: Broker, of_board: bool) -> None:
    async def main() -> None:
        async with network(broker, of_board=of_board) as (proxy, fleet, _):
            before = proxy.connections
            proxy.cut()
            asked = asyncio.create_task(fleet.call("rex", "battery", patience=LIMIT))
            await asyncio.sleep(0.1)
            proxy.flow()
            await until_online(fleet, "rex")
            assert proxy.connections > before
            assert (await asked)["percent"] > 0

    run(main())


@pytest.mark.slow
@pytest.mark.parametrize("of_board", [False, True])
def test_a_movement_that_a_stalled_network_brings_late_is_not_made(
    broker: Broker, monkeypatch: pytest.MonkeyPatch, of_board: bool
) -> None:
    monkeypatch.setattr("servolink.fleet.pulse.SLACK", 0.0)
    monkeypatch.setattr("servolink.fleet.pulse.INTERVAL", 0.05)

    async def main() -> None:
        async with network(broker, of_board=of_board) as (proxy, fleet, board):
            calls = Calls(monkeypatch)
            async with asyncio.timeout(LIMIT):
                while fleet.controller.roster["rex"].pulse is None:  # by which the board sees how old a command is
                    await asyncio.sleep(0.01)
            proxy.hold()
            with pytest.raises(OutcomeUnknown):
                await fleet.controller.call("rex", "move", MOVE, expires=1, patience=1.3)
            proxy.flow()
            await until_online(fleet, "rex")
            await fleet.call("rex", "battery")
            assert "move" not in calls.methods
            assert abs((await board.servo(1)).angle) < 10

    run(main())


@pytest.mark.parametrize("where", ["far away", "at the board"])
def test_a_command_that_a_stalled_network_brings_after_a_stop_is_not_carried_out(
    broker: Broker, monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    async def main() -> None:
        async with (
            network(broker, of_board=False) as (proxy, fleet, board),
            connect_fleet(broker.url, groups={}) as other,
        ):
            other.controller.patience = LIMIT
            calls = Calls(monkeypatch)
            async with asyncio.timeout(LIMIT):
                while fleet.controller.roster["rex"].pulse is None:
                    await asyncio.sleep(0.01)
            proxy.hold()
            late = asyncio.create_task(fleet.controller.call("rex", "release", expires=60))
            await asyncio.sleep(0)
            if where == "far away":
                assert (await other.stop(patience=LIMIT)).is_complete
                await other.call("rex", *START)  # at once
            else:
                await board.stop()
                await started_soon(other)
            proxy.flow()
            with pytest.raises(ServolinkError, match="the board was stopped before this began"):
                await late
            assert "release" not in calls.methods
            assert (await board.servo(1)).is_hold

    run(main())


@pytest.mark.slow
def test_boards_come_back_after_a_network_that_was_silent(broker: Broker, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mqtt_client, "KEEPALIVE", 1)

    async def main() -> None:
        async with network(broker, of_board=True) as (proxy, fleet, _):
            proxy.hold()
            async with asyncio.timeout(LIMIT):  # the broker has to notice, by the lack of keep-alives
                while fleet.controller.roster.online:
                    await asyncio.sleep(0.05)
            assert (await fleet.stop(patience=LIMIT)).offline == ("rex",)
            proxy.cut()
            proxy.flow()
            await until_online(fleet, "rex")
            assert list((await fleet.stop(patience=LIMIT)).stopped) == ["rex"]

    run(main())


# --- order, floods and clocks -----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_start_that_overtakes_what_it_starts_starts_nothing(broker: Broker, monkeypatch: pytest.MonkeyPatch) -> None:
    async def main() -> None:
        async with bridged(broker) as (far, _):
            calls = Calls(monkeypatch)
            await far.publish("servolink/_fleet/start", {"id": "s1"})
            action = {"type": "action", "record": {"action_id": 1, "action_caption": "Bow", "steps": []}}
            await far.call("records.put", params=action | {"record": {**action["record"], "steps": [_STEP]}})  # type: ignore[dict-item]
            params = {"start": "s1", "run": {"type": "action", "id": 1}, "expires": 0.2}
            assert await far.call("prepare", params=params)
            await asyncio.sleep(0.25)
            await far.publish("servolink/_fleet/start", {"id": "s1"})
            await far.call("board.state")
            assert "run.start" not in calls.methods

    run(main())


_STEP = {"servo_id": 1, "degree": 10, "interval_ms": 100}


@pytest.mark.slow
def test_ten_thousand_commands_that_waited_are_all_answered_and_none_is_late(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    broker = Broker(tmp_path, [*OPEN, "max_queued_messages 20000"])
    broker.start()
    count = 10_000

    async def main() -> None:
        async with (
            proxy_to(broker) as proxy,
            far_away(broker) as far,
            board_and_fleet(proxy.url, broker.url) as (fleet, _),
        ):
            calls = Calls(monkeypatch)
            proxy.cut()
            for start in range(0, count, 100):
                await asyncio.gather(*(_backlog(far, number) for number in range(start, start + 100)))
            before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            proxy.flow()
            await far.until(lambda: "servolink/rex/result" in far.heard)
            assert list((await fleet.stop(patience=LIMIT)).stopped) == ["rex"]
            assert len(far.heard["servolink/rex/result"]) < count, "a stop does not wait for the backlog"
            await far.until(lambda: len(far.heard["servolink/rex/result"]) >= count)
            grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
            assert grown < 100_000, "kilobytes"
            answered = _answered(far)
            assert len(answered) == len(set(answered)) == count
            assert "move" not in calls.methods

    run(main())
    broker.end()


async def _backlog(far: Far, number: int) -> None:
    """Send a question, or a movement that is made known as an old one."""
    command: dict[str, object] = {"id": f"b{number}", "method": "board.state"}
    if number % 2:
        command |= {"method": "move", "params": MOVE, "pulse": "of-before-1"}
    await far.publish(TOPICS.board("rex", "cmd"), command, expiry=300)


def _answered(far: Far) -> list[str]:
    found = [json.loads(each.payload) for each in far.heard.get("servolink/rex/result", [])]
    return [each["id"] for each in found if each.get("id", "").startswith("b") and "ok" in each]


def test_clocks_that_jump_repeat_and_delay_nothing(broker: Broker, monkeypatch: pytest.MonkeyPatch) -> None:
    async def main() -> None:
        async with bridged(broker) as (far, _):
            calls = Calls(monkeypatch)
            real = time.time
            for jump in (86400 * 400, -86400 * 400, 0):
                monkeypatch.setattr(time, "time", lambda jump=jump: real() + jump)
                name = f"at{abs(jump)}{jump < 0}"
                await far.send("move", params=MOVE, id=name)
                assert (await far.result(name))["ok"]
                await far.send("move", params=MOVE, id=name)
            await far.call("board.state")
            assert calls.methods.count("move") == 3

    run(main())


# --- who writes what does not belong there ----------------------------------------------------------------------------


@pytest.mark.slow
def test_names_and_payloads_that_are_no_boards_are_left_out(broker: Broker, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(roster, "MOST_BOARDS", 20)

    async def main() -> None:
        async with far_away(broker) as far:
            names = [
                "\x1b[2J"[1:],
                "a b",
                "ünïcode",
                "x" * 300,
                "_fleet",
                "com1",
                "a\u202eb",
                *map("n{}".format, range(30)),
            ]
            for name in names:
                await far.publish(f"servolink/{name}/available", b"online", retain=True)
            for payload in (b"", b"\xff", b"{", b"[" * 100_000, b'{"board":1}', b"null"):
                await far.publish("servolink/n0/state", payload, retain=True)
                await far.publish("servolink/n0/log", payload)
                await far.publish("servolink/n0/servos", payload)
            async with connect_fleet(broker.url, groups={}, servos=True) as fleet:
                for payload in (b"", b"\xff", b"{", b"[" * 100_000, b'{"id":null,"board":"n0"}', b"null"):
                    await far.publish(f"servolink/n0/{fleet.controller._reader}", payload)
                boards = await fleet.list()
                assert len(boards) == 20
                assert all(board.name.startswith("n") for board in boards)
                assert fleet.controller.roster.refused == 10
                state = fleet.controller.roster["n0"]
                assert state.problem.startswith("its state cannot be read")
                assert state.servos is None
                assert any("were too long, or of boards beyond" in one.observation for one in await fleet.doctor())

    run(main())


def test_a_result_of_another_board_or_command_is_not_taken(broker: Broker) -> None:
    async def main() -> None:
        async with far_away(broker) as far, connect_fleet(broker.url, groups={}) as fleet:
            asked = asyncio.create_task(fleet.call("rex", "battery", patience=LIMIT))
            await far.until(lambda: "servolink/rex/cmd" in far.heard)
            message = far.heard["servolink/rex/cmd"][0]
            for board, name in (("fido", json.loads(message.payload)["id"]), ("rex", "other")):
                result = {"id": name, "board": board, "ok": True, "result": {"percent": 1.0}}
                await far.publish(str(message.response_topic), result)
            await fleet.list()  # its marker comes behind them
            assert not asked.done()
            asked.cancel()

    run(main())
