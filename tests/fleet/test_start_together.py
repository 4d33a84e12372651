"""Boards behind bridges that start a run at the same moment, and what a stop or an idle servo does to that."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from servolink.control import Runnable
from servolink.fleet import client as fleet_client
from servolink.fleet import together
from servolink.fleet.controller import Controller
from servolink.fleet.start_servos import start_servos
from servolink.fleet.stop_boards import stop_all
from servolink.protocol import Action, Macro, MacroCommand, Step
from tests.fleet.bridged import LIMIT, bridged, run
from tests.fleet.mosquitto import Broker, needs_broker

pytestmark = [*needs_broker, pytest.mark.usefixtures("user")]


def test_boards_start_together_when_they_are_told_to(broker: Broker) -> None:
    async def main() -> None:
        async with bridged(broker, "run") as (far, hub):
            await hub.board.add_action(Action(7, "Wave", (Step(1, 60, 10),)))
            wave = {"type": "action", "id": "Wave"}
            await far.call("prepare", params={"start": "s1", "run": wave})
            assert hub.lease is not None
            await far.publish("servolink/rex/start", {"id": "other"})
            await far.publish("servolink/_fleet/start", {"id": "s1"})
            await far.until(lambda: "servolink/rex/log" in far.heard)
            assert json.loads(far.heard["servolink/rex/log"][0].payload)["text"].endswith("prepared for other")
            started = (await far.result("s1"))["result"]
            assert 0 <= started["after"] < 120
            await far.publish("servolink/_fleet/start", {"id": "s1"})  # nothing is prepared any more
            await far.call("prepare", params={"start": "s2", "run": wave})
            await far.call("cancel", params={"start": "s2"})
            error = await far.failure("cancel", params={"start": "s2"})
            assert error["data"]["kind"] == "NotFound"
            error = await far.failure("prepare", params={"start": "s3", "run": {"type": "macro", "id": "None"}})
            assert error["data"]["kind"] == "NotFound"
            await hub.board.add_macro(Macro(8, "Alone", (MacroCommand(9, total_interval=10),)))
            error = await far.failure("prepare", params={"start": "s3", "run": {"type": "macro", "id": "Alone"}})
            assert "runs action 9, which could not be read" in error["message"]
            assert len(await far.results("s1")) == 1
            for echo, topic in (("e1", "servolink/_fleet/echo"), ("e2", "servolink/rex/echo")):
                await far.publish(topic, {"id": echo})
                assert (await far.result(echo))["result"]["monotonic"] > started["monotonic"]

    run(main())


def test_a_stop_before_the_moment_cancels_the_start(broker: Broker, monkeypatch: pytest.MonkeyPatch) -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        at, call_at = loop.time() + 0.9, loop.call_at
        moments: list[float] = []
        timers: list[Callable[[], object]] = []
        """What happens at these moments, which come after the stop however slow this machine is."""

        def held(when: float, callback: Callable[..., object], *arguments: Any, **options: Any) -> asyncio.TimerHandle:
            if when in {at - 0.05, at}:
                moments.append(when)
                timers.append(partial(callback, *arguments))
                when += 60
            return call_at(when, callback, *arguments, **options)

        monkeypatch.setattr(loop, "call_at", held)
        async with bridged(broker, "run") as (far, hub):
            await hub.board.add_action(Action(7, "Wave", (Step(1, 60, 10),)))
            wave = {"type": "action", "id": "Wave"}
            await far.call("prepare", params={"start": "s1", "run": wave})
            await far.publish("servolink/rex/start", {"id": "s1", "at": at})
            await far.until(lambda: bool(timers))
            await far.publish("servolink/rex/stop", {"id": "now"})
            assert (await far.result("now"))["ok"]
            timers[0]()
            await far.until(lambda: len(timers) == 2)
            timers[1]()
            error = (await far.result("s1"))["error"]
            assert error["data"]["kind"] == "MotionRefused"
            assert "stopped since this was prepared" in error["message"]
            await far.call("prepare", params={"start": "s2", "run": wave}, id="later")
            await far.publish("servolink/rex/start", {"id": "s2", "at": loop.time() + LIMIT})
            assert "at must be at most 1 s ahead" in (await far.result("s2"))["error"]["message"]
            assert moments == [at - 0.05, at], "first the line is kept free"

    run(main())


def test_the_servos_that_do_not_move_are_named_before_a_start(broker: Broker) -> None:
    async def main() -> None:
        async with bridged(broker, "run", hz=200.0) as (far, hub):
            await hub.board.add_action(Action(7, "Wave", (Step(1, 60, 10),)))
            await hub.board.stop()
            await hub.board.set_servo(2, start=True, hold=True)

            def idle() -> list[int]:
                frames = far.heard.get("servolink/rex/servos", [])
                servos = json.loads(frames[-1].payload)["servos"] if frames else []
                return [servo["servo_id"] for servo in servos if not servo["is_start"]]

            await far.until(lambda: idle() == [1, 3, 4])
            found = await far.call("prepare", params={"start": "s1", "run": {"type": "action", "id": 7}})
            assert found == {"seconds": 0.1, "idle_servos": [1, 3, 4]}

    run(main())


async def until_pulse(controller: Controller, *, but: str | None = None) -> str:
    """Return the word of the board's pulse, when it is another than `but`."""
    async with asyncio.timeout(LIMIT):
        while (seen := controller.roster.get("rex")) is None or seen.pulse in {None, but}:
            await asyncio.sleep(0.01)
    assert seen.pulse is not None
    return seen.pulse


def test_a_run_starts_the_servos_that_it_moves_if_asked_to(broker: Broker) -> None:
    async def main() -> None:
        async with bridged(broker, "move") as (_, hub), fleet_client.connect(broker.url) as fleet:
            controller, runs = fleet.controller, {"rex": Runnable("macro", 8)}
            controller.patience = LIMIT
            await controller.settle()
            await hub.board.add_action(Action(7, "Wave", (Step(1, 60, 10), Step(3, 60, 10))))
            await hub.board.add_macro(Macro(8, "Twice", (MacroCommand(7, 0, loop=2),)))
            word = await until_pulse(controller)
            await hub.board.stop()
            await hub.board.set_servo(4, start=False, hold=False)
            await until_pulse(controller, but=word)
            assert (await together.run_together(controller, runs)).started == ("rex",)
            assert not any(servo.is_start for servo in await hub.board.servos()), "not asked to"
            ran = await together.run_together(controller, runs, start=True)
            assert (ran.started, ran.failed, ran.idle_servos) == (("rex",), {}, {})
            servos = await hub.board.servos()
            assert [servo.servo_id for servo in servos if servo.is_start and servo.is_hold] == [1, 3]
            assert not servos[3].is_hold

    run(main())


def test_no_servo_is_started_for_a_run_after_a_stop(broker: Broker, monkeypatch: pytest.MonkeyPatch) -> None:
    async def stop_first(controller: Controller, board: str, *arguments: Any) -> None:
        assert (await stop_all(controller, [board], patience=LIMIT)).is_complete
        await start_servos(controller, board, *arguments)

    monkeypatch.setattr(together, "start_servos", stop_first)

    async def main() -> None:
        async with bridged(broker, "move") as (_, hub), fleet_client.connect(broker.url) as fleet:
            controller = fleet.controller
            controller.patience = LIMIT
            await hub.board.add_action(Action(7, "Wave", (Step(1, 60, 10),)))
            await until_pulse(controller)
            ran = await together.run_together(controller, {"rex": Runnable("action", 7)}, start=True)
            assert ran.started == ()
            assert "the board was stopped before this began" in ran.failed["rex"]
            assert not any(servo.is_start for servo in await hub.board.servos())

    run(main())


def test_servos_are_not_sent_while_a_start_is_waited_for(broker: Broker) -> None:
    async def main() -> None:
        async with bridged(broker, "run", hz=200.0) as (far, hub):

            def sent() -> int:
                return len(far.heard.get("servolink/rex/servos", []))

            await hub.board.add_action(Action(7, "Wave", (Step(1, 60, 10),)))
            for is_started in (False, True):
                before = sent()
                await far.until(lambda count=before: sent() > count)  # type: ignore[misc]
                await far.call("prepare", params={"start": "s1", "run": {"type": "action", "id": 7}})
                before, read = sent(), hub.board.stats.frames_received
                while hub.board.stats.frames_received < read + 4:
                    await asyncio.sleep(0.01)
                assert sent() <= before + 1, "that one was under way"
                if is_started:
                    await far.publish("servolink/_fleet/start", {"id": "s1"})
                else:
                    await far.call("cancel", params={"start": "s1"})
                await far.until(lambda count=before + 1: sent() > count)  # type: ignore[misc]

    run(main())
