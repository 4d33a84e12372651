"""Commands from afar: each is carried out once, in time, and answered, whatever comes.

Modules: servolink.fleet.answers, servolink.fleet.hub_session, servolink.fleet.pulse, servolink.fleet.ready_run.
"""

from __future__ import annotations

import asyncio
import errno
import json
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

import pytest
from msgspec import Raw

from servolink.control import Greeting, Reply, Runnable, open_channel
from servolink.errors import MotionRefused
from servolink.fleet import commands, pulse
from servolink.fleet.broker_messages import Received
from servolink.fleet.command_log import CommandLog
from servolink.fleet.hub_session import HubSession
from servolink.fleet.policy import BoardPolicy
from servolink.fleet.ready_run import ReadyRun
from servolink.fleet.topics import Prepare
from servolink.hub import serve_board
from servolink.motion import StopCounter
from servolink.protocol import Action, Step
from tests.fleet.bridged import Far, bridged, far_away, joined, run
from tests.fleet.mosquitto import Broker, needs_broker

pytestmark = [*needs_broker, pytest.mark.usefixtures("user")]

MOVE = {"targets": {"1": 60}, "duration": 0.05}
CMD = "servolink/rex/cmd"


class Calls:
    """Counts what the hub was asked to do, and can hold it back."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.methods: list[str] = []
        self.may_go = asyncio.Event()
        self.may_go.set()
        ask = HubSession.ask

        async def counted(session: HubSession, method: str, *rest: Any) -> Any:
            if method not in {"status", "battery", "records.list", "servos.list", "buttons.subscribe"}:
                self.methods.append(method)
                if method != "stop":
                    await self.may_go.wait()
            return await ask(session, method, *rest)

        monkeypatch.setattr(HubSession, "ask", counted)


def test_a_command_that_comes_twice_is_carried_out_once(broker: Broker, monkeypatch: pytest.MonkeyPatch) -> None:
    async def main() -> None:
        async with bridged(broker) as (far, _):
            calls = Calls(monkeypatch)
            for _ in range(3):
                await far.send("move", params=MOVE, id="once")
            assert (await far.results("once"))[0]["ok"]
            await far.call("project.backups")
            await far.send("move", params=MOVE, id="once")
            await far.call("project.backups")
            assert calls.methods.count("move") == 1
            assert len(await far.results("once")) == 1
            await far.send("release", id="once")
            answers = await far.results("once", 2)
            assert answers[1]["error"]["message"] == "the id once was used for another command"
            assert calls.methods.count("release") == 0

    run(main())


@asynccontextmanager
async def desk(broker: Broker) -> AsyncIterator[tuple[Far, Callable[..., None]]]:
    """Yield a program far away, and what gives the board a command past the broker, in this very turn of the loop."""
    async with (
        serve_board("virtual://?servos=4", name="rex"),
        far_away(broker) as far,
        joined(broker, BoardPolicy("edit")) as fleet,
    ):
        (bridge,) = fleet.bridges

        def give(command_id: str, method: str, expiry: int | None = 10, **params: Any) -> None:
            payload = json.dumps({"id": command_id, "method": method, "params": params}).encode()
            message = Received(CMD, payload, 1, False, False, 0, expiry, None, None)
            bridge.commands.receive(message, bridge._link, lambda: None)

        yield far, give


def test_copies_that_come_in_one_turn_are_carried_out_once(broker: Broker, monkeypatch: pytest.MonkeyPatch) -> None:
    async def main() -> None:
        async with desk(broker) as (far, give):
            calls = Calls(monkeypatch)
            for expiry in (10, 10, None):  # brokers have delivered copies without their expiry
                give("once", "move", expiry, **MOVE)
            give("once", "release")
            answers = await far.results("once", 2)
            assert [answer["ok"] for answer in answers] == [False, True]
            assert answers[0]["error"]["message"] == "the id once was used for another command"
            await far.call("project.backups")
            assert calls.methods == ["move", "project.backups"]
            assert len(await far.results("once")) == 2

    run(main())


def test_a_command_that_was_refused_is_refused_again_when_it_could_be_done(
    broker: Broker, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def main() -> None:
        async with desk(broker) as (far, give):
            calls = Calls(monkeypatch)
            with monkeypatch.context() as full:
                full.setattr(commands, "MOST_WAITING", 0)
                give("busy", "move", **MOVE)
            with monkeypatch.context() as full:
                full.setattr(CommandLog, "_write", _full)
                give("unnoted", "move", **MOVE)
                await far.result("unnoted")
            give("endless", "move", None, **MOVE)  # as a broker delivers it that has lost the expiry
            for command_id, text in (
                ("busy", "0 commands of rex wait already"),
                ("unnoted", "cannot be noted"),
                ("endless", "needs a message expiry"),
            ):
                give(command_id, "move", **MOVE)
                first, second = await far.results(command_id, 2)
                assert first == second
                assert text in second["error"]["message"]
            give("busy", "release")
            assert "was used for another command" in (await far.results("busy", 3))[-1]["error"]["message"]
            assert calls.methods == []

    run(main())


def _full(command_log: CommandLog, lines: list[bytes]) -> None:
    raise OSError(errno.ENOSPC, "No space left on device")


def test_a_retained_command_is_never_carried_out(broker: Broker, monkeypatch: pytest.MonkeyPatch) -> None:
    async def main() -> None:
        async with bridged(broker) as (far, _):
            calls = Calls(monkeypatch)
            await far.send("move", params=MOVE, id="kept", retain=True)
            answer = await far.result("kept")
            assert answer["error"]["message"].startswith("retained commands are not carried out")
            await far.publish("servolink/_fleet/start", {"id": "s"}, retain=True)
        calls.methods.clear()
        async with bridged(broker) as (far, _):
            await far.results("kept")
            await far.publish(CMD, b"", retain=True)
            await far.call("project.backups")
            assert calls.methods == ["project.backups"]

    run(main())


def test_what_moves_must_expire_and_come_in_time(broker: Broker, monkeypatch: pytest.MonkeyPatch) -> None:
    async def main() -> None:
        async with bridged(broker) as (far, _):
            calls = Calls(monkeypatch)
            error = await far.failure("move", params=MOVE, expiry=None)
            assert error["message"] == "move needs a message expiry: a robot must not move late"
            error = await far.failure("move", params=MOVE, pulse="of another life")
            assert error["message"].startswith("the command has expired")
            await far.until(lambda: "servolink/rex/pulse" in far.heard)
            word = far.heard["servolink/rex/pulse"][-1].payload.decode()
            await far.call("move", params=MOVE, pulse=word)
            monkeypatch.setattr(pulse, "SLACK", -10.0)
            error = await far.failure("move", params=MOVE)
            assert error["message"].startswith("the command has expired")
            assert calls.methods == ["move"]

    run(main())


NOT_FROM_AFAR: dict[str, dict[str, Any]] = {
    "stream.begin": {},
    "stream.send": {"stream": 1, "targets": {"1": 60}},
    "move.end": {},
    "run.start": {},
    "limits.tighten": {"speed_cap": 1},
    "rename": {"who": "the teacher"},
    "question.show": {},
    "question.answer": {"number": 1, "is_yes": True},
    "tap.start": {},
    "recorder.start": {},
    "recorder.list": {},
    "line.test": {},
    "board.mode": {"mode": 0},
    "studio.limits.save": {"servo": 1, "low": None, "high": None},
}


@pytest.mark.parametrize("way", ["cmd", "press"])
def test_what_is_not_declared_for_a_fleet_is_refused_before_the_hub_hears_of_it(
    broker: Broker, monkeypatch: pytest.MonkeyPatch, way: str
) -> None:
    async def main() -> None:
        async with bridged(broker) as (far, _):
            calls = Calls(monkeypatch)
            for method, params in NOT_FROM_AFAR.items():
                if way == "cmd":
                    error = await far.failure(method, params=params)
                else:
                    at = f"servolink/rex/result/{method.replace('.', '-')}"
                    await far.publish("servolink/rex/press", {"method": method, "params": params}, response_topic=at)
                    await far.until(lambda at=at: at in far.heard)  # type: ignore[misc]
                    error = json.loads(far.heard[at][-1].payload)["error"]
                assert error["message"] == f"there is no method '{method}' from afar"
            assert calls.methods == []

    run(main())


def test_set_points_that_waited_at_the_broker_move_nothing(broker: Broker) -> None:
    async def main() -> None:
        async with serve_board("virtual://?servos=4", name="rex") as (hub, _), far_away(broker) as far:
            async with joined(broker, BoardPolicy("edit")):
                await far.call("move", params={"targets": {"1": 0}, "duration": 0.01, "wait": True})
            sent = [await far.send("stream.begin", expiry=None)]
            sent += [await far.send("stream.send", params=NOT_FROM_AFAR["stream.send"], expiry=None) for _ in range(5)]
            async with joined(broker, BoardPolicy("edit")):
                answers = [await far.result(each) for each in sent]
                assert {answer["ok"] for answer in answers} == {False}
                assert (await hub.board.servos())[0].angle == 0

    run(main())


@pytest.mark.parametrize(
    ("method", "params"), [("project.apply", {"project": {"version": 1}}), ("project.rollback", {})]
)
def test_what_turns_servos_by_their_corrections_must_expire_and_show_a_pulse(
    broker: Broker, monkeypatch: pytest.MonkeyPatch, method: str, params: dict[str, Any]
) -> None:
    async def main() -> None:
        async with serve_board("virtual://?servos=4", name="rex"), far_away(broker) as far:
            calls = Calls(monkeypatch)
            async with joined(broker, BoardPolicy("edit")):
                await far.until(lambda: "servolink/rex/pulse" in far.heard)
                word = far.heard["servolink/rex/pulse"][-1].payload.decode()
                error = await far.failure(method, params=params, expiry=None, pulse=word)
                assert error["message"] == f"{method} needs a message expiry: a robot must not move late"
                error = await far.failure(method, params=params)
                assert error["message"].startswith(f"{method} needs a pulse")
                await far.result(await far.send(method, params=params, pulse=word))
                assert calls.methods == [method]
            queued = await far.send(method, params=params, expiry=60, pulse=word)  # the broker keeps it
            async with joined(broker, BoardPolicy("edit")):
                assert (await far.result(queued))["error"]["message"].startswith("the command has expired")
                assert calls.methods == [method]

    run(main())


def test_a_command_that_waits_too_long_for_its_turn_expires(broker: Broker, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(commands, "LONGEST_MOTION", 0)

    async def main() -> None:
        async with bridged(broker) as (far, _):
            calls = Calls(monkeypatch)
            calls.may_go.clear()
            first = await far.send("records.delete", params={"type": "action", "id": 1})
            second = await far.send("move", params=MOVE)
            calls.may_go.set()
            await far.result(first)
            assert (await far.result(second))["error"]["message"].startswith("the command has expired")

    run(main())


@pytest.mark.parametrize("topic", ["servolink/rex/stop", "servolink/_fleet/stop", CMD])
def test_what_was_sent_before_a_stop_is_not_begun_when_it_comes_long_after(
    broker: Broker, monkeypatch: pytest.MonkeyPatch, topic: str
) -> None:
    async def main() -> None:
        async with bridged(broker) as (far, _):
            calls = Calls(monkeypatch)
            await far.until(lambda: "servolink/rex/pulse" in far.heard)
            word = far.heard["servolink/rex/pulse"][-1].payload.decode()
            await far.publish(topic, {"id": "s1"} | ({"method": "stop"} if topic == CMD else {}))
            over = (await far.result("s1"))["result"]
            for method in ("release", "records.delete"):
                error = await far.failure(method, pulse=word)
                assert error["message"] == "the board was stopped before this began"
            assert (await far.call("battery", pulse=word))["percent"] == 100
            assert calls.methods == ["stop"]
            await far.call("release", pulse=over["pulse"])
            await far.call("release")

    run(main())


@asynccontextmanager
async def held() -> AsyncIterator[None]:
    """Have a program of the board's machine hold the board alone."""
    importer, _ = await open_channel("rex", Greeting(wants="rpc", who="importer", role="edit"))
    await importer.call("board.hold", reason="an import")
    try:
        yield
    finally:
        await importer.close()


@pytest.mark.parametrize(
    ("method", "params"),
    [("move", MOVE), ("release", {}), ("prepare", {"start": "s1", "run": {"type": "action", "id": 1}})],
)
def test_what_waits_in_the_hub_expires_there_and_is_not_begun_after_a_stop(
    broker: Broker, monkeypatch: pytest.MonkeyPatch, method: str, params: dict[str, Any]
) -> None:
    async def main() -> None:
        async with bridged(broker) as (far, hub):
            await hub.board.add_action(Action(1, "Bow", (Step(1, 60, 10),)))
            async with held():
                with monkeypatch.context() as hurry:
                    hurry.setattr(commands, "LONGEST_MOTION", 0.5)  # busy machines need some of it on the way
                    late = await far.failure(method, params=params)
                assert "the time by which it was to begin has passed" in late["message"]
                calls = Calls(monkeypatch)
                waiting = await far.send(method, params=params)
                while not calls.methods:
                    await asyncio.sleep(0.01)
                await far.publish("servolink/rex/stop", b"")
                assert (await far.result("stop"))["ok"]
                assert "a stop came first" in (await far.result(waiting))["error"]["message"]
            assert all(servo.is_hold for servo in await hub.board.servos())
            assert hub.lease is None

    run(main())


def test_nothing_is_prepared_if_a_stop_comes_meanwhile() -> None:
    class Hub:
        told: tuple[str, ...] = ()

        async def ask(self, method: str, params: object) -> Reply:
            stops.stop()
            prepared.forget()
            return Reply(Raw(b'{"seconds": null, "servos": []}'))

        def tell(self, method: str) -> None:
            self.told += (method,)

    hub, stops = Hub(), StopCounter()
    prepared = ReadyRun(hub, stops)  # type: ignore[arg-type]

    async def main() -> None:
        with pytest.raises(MotionRefused, match="was stopped while this was prepared"):
            await prepared.prepare(Prepare("s1", Runnable("action", 1)), stops.ticket(until=60.0))
        assert not prepared.is_for("s1")
        assert hub.told == ("lease.give",)

    run(main())


def test_a_flood_is_answered_with_busy_and_holds_no_stop_up(broker: Broker, monkeypatch: pytest.MonkeyPatch) -> None:
    async def main() -> None:
        async with bridged(broker) as (far, _):
            calls = Calls(monkeypatch)
            calls.may_go.clear()
            sent = [await far.send("release") for _ in range(commands.MOST_WAITING + 10)]
            answers = [await far.result(each) for each in sent[commands.MOST_WAITING :]]
            assert {answer["error"]["data"]["kind"] for answer in answers} == {"busy"}
            await far.publish("servolink/rex/stop", b"")
            assert (await far.result("stop"))["ok"]
            calls.may_go.set()
            answers = [await far.result(each) for each in sent[1 : commands.MOST_WAITING]]
            assert {answer["ok"] for answer in answers} == {False}
            assert calls.methods.count("release") == 1

    run(main())


HOSTILE: list[tuple[bytes, str | None, str]] = [
    (b"", None, "is not JSON"),
    (b"\xff\xfe", None, "is not text in UTF-8"),
    (b"[" * 100_000, None, "nested too deeply"),
    (b"[]", None, "must be an object"),
    (b'{"method": "battery"}', None, "'id' is missing"),
    (b'{"id": 7, "method": "battery"}', None, "id: must be text"),
    (b'{"id": "a/b", "method": "battery"}', None, "id:"),
    (b'{"id": "a", "id": "b", "method": "battery"}', None, "is a duplicate key"),
    (b'{"id": "1"}', "1", "'method' is missing"),
    (b'{"id": "2", "method": "battery", "params": []}', "2", "params: must be an object"),
    (b'{"id": "3", "method": "battery", "params": {"x": NaN}}', None, "NaN"),
    (b'{"id": "4", "method": "battery", "more": 1}', "4", "more"),
    (b'{"id": "5", "method": "no\\u001bthing"}', "5", "there is no method 'no\\x1bthing'"),
    (b'{"id": "6", "method": "battery", "params": {"x": 1}}', "6", "'x'"),
    (b'{"id": "7", "method": "prepare", "params": {"x": 1}}', "7", "needs a message expiry"),
    (b'{"id": "8", "method": "battery", "who": "' + b"x" * (1024 * 1024) + b'"}', None, "larger than 1 MiB"),
]


def test_hostile_payloads_are_refused_with_a_reason(broker: Broker) -> None:
    async def main() -> None:
        async with bridged(broker) as (far, _):
            unnamed = 0
            for payload, command_id, text in HOSTILE:
                await far.publish(CMD, payload)
                unnamed += command_id is None
                answer = (await far.results(command_id, 1 if command_id else unnamed))[-1]
                assert not answer["ok"]
                assert text in answer["error"]["message"]
            assert (await far.call("battery"))["percent"] == 100

    run(main())


@pytest.mark.parametrize("topic", ["pulse", "available", "state", "vitals", "servos", "event", "log"])
def test_hostile_payloads_on_any_topic_of_a_board_change_nothing(broker: Broker, topic: str) -> None:
    async def main() -> None:
        async with bridged(broker) as (far, hub):
            await far.call("move", params={"targets": {"1": 10}, "duration": 0.01, "wait": True})
            for payload, _, _ in HOSTILE:
                for retain in (False, True):
                    await far.publish(f"servolink/rex/{topic}", payload, retain=retain)
            assert (await far.call("battery"))["percent"] == 100
            await far.until(lambda: far.heard["servolink/rex/available"][-1].payload == b"online")
            assert (await hub.board.servos())[0].angle == 10

    run(main())


def test_nothing_is_done_that_cannot_be_noted(broker: Broker, monkeypatch: pytest.MonkeyPatch) -> None:
    async def main() -> None:
        async with bridged(broker) as (far, _):
            calls = Calls(monkeypatch)
            monkeypatch.setattr(CommandLog, "_write", _full)
            error = await far.failure("move", params=MOVE)
            assert error["message"] == (
                "the command cannot be noted, so it is not carried out: No space left on device"
            )
            assert calls.methods == []
            monkeypatch.undo()

    run(main())


def test_progress_comes_before_the_result(broker: Broker) -> None:
    async def main() -> None:
        async with bridged(broker) as (far, _):
            command = await far.send("project.export")
            assert (await far.result(command))["ok"]
            messages = [json.loads(each.payload) for each in far.heard["servolink/rex/result"]]
            assert "progress" in messages[0]
            assert messages[0]["progress"]["phase"] == "reading"

    run(main())


def test_what_is_under_way_when_the_bridge_ends_is_answered(broker: Broker) -> None:
    async def main() -> None:
        async with serve_board("virtual://?servos=4", name="rex") as (hub, _), far_away(broker) as far:
            async with joined(broker, BoardPolicy("edit")):
                command = await far.send("move", params={"targets": {"1": 90}, "duration": 20, "wait": True})
                while hub.lease is None:
                    await asyncio.sleep(0.01)
            answer = await far.result(command)
        assert answer["error"]["data"]["kind"] == "OutcomeUnknown"

    run(main())
