"""The access list of docs/how-to/fleet-classroom.md: only a robot says what it is and does, and that it has stopped.

Modules: servolink.fleet.topics, servolink.fleet.controller, servolink.fleet.answers.
"""

from __future__ import annotations

import asyncio
import json
import signal
import socket
import sys
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from servolink.errors import RequestTimeout
from servolink.fleet import connect, controller
from servolink.fleet.broker import BrokerConnection, Denied
from servolink.fleet.broker_messages import Publication, Received
from servolink.fleet.client import Fleet
from servolink.fleet.home_assistant import HomeAssistant
from servolink.fleet.mqtt_client import MqttOptions
from servolink.fleet.topics import OFFLINE, Topics
from tests import processes
from tests.fleet.access_list import PASSWD, as_user, broker_with, page_lists
from tests.fleet.bridged import run, running
from tests.fleet.mosquitto import Broker, needs_broker
from tests.fleet.stand_in import StandIn, stand_ins

pytestmark = [*needs_broker, pytest.mark.skipif(not PASSWD, reason="mosquitto_passwd is not installed")]

EARLIER = "pattern read servolink/_fleet/#\npattern write servolink/_fleet/reply/#\n"
"""The lines that the list ended in before."""
EVERYTHING = (
    *("#", "servolink/#", "servolink/+/stop", "servolink/rex/#", "servolink/_fleet/#", "servolink/_fleet/stop"),
    *("servolink/+/result/#", "servolink/+/result/teacher/#", "servolink/rex/cmd", "$share/g/servolink/+/stop"),
    "homeassistant/#",
)
OF_REX = ("available", "state", "servos", "vitals", "event", "log", "pulse", "result")
TO_REX = ("cmd", "press", "start", "stop", "echo")


@pytest.fixture
def broker(tmp_path: Path) -> Any:
    found = broker_with(tmp_path, page_lists()[0])
    yield found
    found.end()


class Eve:
    """A user with the password of one robot, who knows all that is not kept from her, and the teacher's secrets."""

    def __init__(self, broker: Broker, user: str) -> None:
        self.heard: list[Received] = []
        will = Publication("servolink/rex/available", OFFLINE, 1, retain=True)
        # The identifier of a bridge without a password: with it, she would take the connection of the board over.
        identifier = "servolink/rex" if user == "eve" else f"{user}-1"
        self.broker = BrokerConnection(as_user(broker, user), MqttOptions(identifier, will=will))
        self.broker.subscriptions = [(topic, 1) for topic in EVERYTHING]
        self.broker.on_message = self.heard.append

    async def is_denied(self, topic: str, payload: str, **options: Any) -> bool:
        try:
            await self.broker.send(Publication(topic, payload, 1, **options))
        except Denied:
            return True
        return False


@asynccontextmanager
async def eve_at(broker: Broker, user: str = "eve") -> AsyncIterator[Eve]:
    eve = Eve(broker, user)
    async with running(eve.broker.run()):
        await eve.broker.until_connected()
        yield eve


@asynccontextmanager
async def classroom(broker: Broker) -> AsyncIterator[tuple[Fleet, StandIn, Eve]]:
    """Yield the teacher, rex and eve."""
    async with AsyncExitStack() as stack:
        (rex,) = await stack.enter_async_context(stand_ins(broker, "rex", access=as_user(broker, "rex")))
        teacher = await stack.enter_async_context(connect(as_user(broker, "teacher"), groups={}))
        eve = await stack.enter_async_context(eve_at(broker))
        yield teacher, rex, eve


def confirmation(command: Received, board: str) -> str:
    result = {"pulse": "aaaaaaaa-1"}
    return json.dumps({"id": json.loads(command.payload)["id"], "board": board, "ok": True, "result": result})


def test_mosquitto_has_no_warning_for_the_lists_of_the_page(tmp_path: Path) -> None:
    lists = page_lists()
    assert len(lists) == 3
    for number, access in enumerate((lists[0], "".join(lists))):
        (folder := tmp_path / str(number)).mkdir()
        broker = broker_with(folder, access)
        broker.end()
        warnings = [line for line in broker.log().splitlines() if "Warning" in line or "Error" in line]
        assert [line for line in warnings if "should not be run as root" not in line] == []


@pytest.mark.parametrize("list_of", ["the page", "the page before"])
def test_nobody_confirms_for_another_robot_even_with_all_that_the_robot_was_told(tmp_path: Path, list_of: str) -> None:
    broker = broker_with(tmp_path, page_lists()[0] + (EARLIER if list_of == "the page before" else ""))

    async def main() -> None:
        async with classroom(broker) as (teacher, rex, eve):
            assert list((await teacher.stop()).stopped) == ["rex"]
            rex.is_silent = True
            for on in ("all", "rex"):
                rex.heard.clear()
                stopping = asyncio.create_task(teacher.stop(on, patience=1.5))
                while not rex.heard:
                    await asyncio.sleep(0.01)
                stop = rex.heard[0]
                assert stop.response_topic is not None
                await eve.is_denied(stop.response_topic, confirmation(stop, "rex"))
                reader = stop.response_topic.removeprefix("servolink/rex/")
                for kind in (reader, reader.removesuffix("-0"), f"{reader}-0", "result"):
                    assert await eve.is_denied(f"servolink/rex/{kind}", confirmation(stop, "rex"))
                    assert not await eve.is_denied(f"servolink/eve/{kind}", confirmation(stop, "rex"))
                    assert await eve.is_denied(f"servolink/_fleet/{kind}", confirmation(stop, "rex"))
                    await eve.is_denied(
                        f"servolink/_fleet/{kind.replace('result', 'reply')}", confirmation(stop, "rex")
                    )
                stopped = await stopping
                assert (stopped.stopped, stopped.failed, stopped.silent) == ({}, {}, ("rex",))

    run(main())
    broker.end()


def test_no_other_user_reads_commands_and_answers_or_says_anything_of_a_robot(broker: Broker) -> None:
    async def main() -> None:
        async with classroom(broker) as (teacher, rex, eve):
            rex.answers["battery"] = lambda params: {"percent": 50.0}
            assert await teacher.call("rex", "battery") == {"percent": 50.0}
            assert (await teacher.stop()).is_complete
            said = {"board": "rex", "connection": "lost"}
            for kind in (*OF_REX, *TO_REX):
                assert await eve.is_denied(f"servolink/rex/{kind}", json.dumps(said), retain=True)
            for topic in ("stop", "start", "echo"):
                assert await eve.is_denied(f"servolink/_fleet/{topic}", json.dumps({"id": "x"}))
            assert await eve.is_denied("homeassistant/device/rex/servolink_rex/config", "{}", retain=True)
            before = rex.now
            state = json.dumps({**said, "host": "x", "version": "1", "allow": "watch", "at": 0.0})
            assert not await eve.is_denied("servolink/eve/state", state)
            assert [(one.name, one.is_online) for one in await teacher.list()] == [("eve", False), ("rex", True)]
            assert teacher.controller.roster["rex"].now == before
            assert {message.topic.split("/")[1] for message in eve.heard} == {"eve"}
            stops = rex.stops
        async with classroom(broker) as (teacher, rex, eve):
            assert eve.broker._client is not None
            eve.broker._client.socket.shutdown(socket.SHUT_RDWR)  # lost: the broker sends her last will, or would
            await eve.broker.until_connected()
            await teacher.list()
            assert teacher.controller.roster["rex"].is_online
            assert stops == 1

    run(main())


def test_whoever_may_only_watch_and_stop_hears_the_answers_to_that_and_no_others(tmp_path: Path) -> None:
    broker = broker_with(tmp_path, "".join(page_lists()))

    async def main() -> None:
        async with classroom(broker) as (teacher, rex, _), eve_at(broker, "pupil") as pupil:
            async with connect(as_user(broker, "pupil"), groups={}, may_move=False) as fleet:
                told: list[str] = []
                fleet.controller.broker.on_problem = told.append
                assert [one.name for one in await fleet.list()] == ["rex"]
                assert list((await fleet.stop()).stopped) == ["rex"]
                assert told == []
                with pytest.raises(Denied, match="servolink/rex/cmd: not authorized"):
                    await fleet.call("rex", "battery")
            assert list((await teacher.stop()).stopped) == ["rex"]
            for kind in (*OF_REX, "result/pupil/x", "result/teacher/x", "cmd", "press", "start", "echo"):
                assert await pupil.is_denied(f"servolink/rex/{kind}", "{}")
            results = {message.topic.rpartition("/")[0] for message in pupil.heard if "/result" in message.topic}
            assert results == {"servolink/rex/result/pupil", "servolink/_fleet/result/pupil"}
            assert not any(message.topic.endswith("/stop") for message in pupil.heard)
            assert rex.commands == []

    run(main())
    broker.end()


def test_a_board_of_an_earlier_version_answers_where_the_new_list_lets_it(broker: Broker) -> None:
    async def main() -> None:
        async with classroom(broker) as (teacher, rex, _):
            rex.answer_at = "servolink/rex/result"  # it knows no other response topic
            rex.answers["battery"] = lambda params: {"percent": 50.0}
            assert await teacher.call("rex", "battery") == {"percent": 50.0}
            assert list((await teacher.stop()).stopped) == ["rex"]

    run(main())


def test_a_list_that_keeps_answers_away_is_named_and_keeps_no_stop_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(controller, "_MOST_SETTLING", 0.2)
    deaf = (
        "user teacher\ntopic read servolink/+/available\ntopic write servolink/#\n\npattern readwrite servolink/%u/#\n"
    )
    broker = broker_with(tmp_path, deaf)

    async def main() -> None:
        async with classroom(broker) as (teacher, rex, _):
            stopped = await teacher.stop(patience=1.0)
            assert (rex.stops > 0, stopped.stopped, stopped.silent) == (True, {}, ())
            told = "the broker brings this program nothing at servolink/+/result/teacher/"
            assert stopped.failed["rex"].startswith(told)
            with pytest.raises(RequestTimeout, match=r"the broker brings this program nothing.*that of .* has changed"):
                await teacher.call("rex", "battery", patience=0.1)

    run(main())
    broker.end()


def test_a_list_that_denies_the_marker_of_a_program_is_named_and_keeps_no_stop_away(tmp_path: Path) -> None:
    broker = broker_with(
        tmp_path,
        "user teacher\ntopic read servolink/+/available\ntopic read servolink/+/state\ntopic write servolink/+/stop\n"
        f"{EARLIER}\npattern readwrite servolink/%u/#\n",
    )

    async def main() -> None:
        told: list[str] = []
        async with classroom(broker) as (teacher, rex, _):
            teacher.controller.broker.on_problem = told.append
            stopped = await teacher.stop(patience=0.5)
            assert (rex.stops, stopped.silent) == (1, ("rex",))
            with pytest.raises(Denied, match=r"that of docs/how-to/fleet-classroom\.md has changed"):
                await teacher.list()
        assert [text.partition(": ")[0].rpartition("/")[0] for text in told] == [
            "the broker does not allow writing to servolink/_fleet/result/teacher"
        ]

    run(main())
    broker.end()


def test_home_assistant_presses_and_stops_and_answers_for_nobody(tmp_path: Path) -> None:
    broker = broker_with(tmp_path, "".join(page_lists()))
    document = HomeAssistant().topic(Topics(), "rex")

    async def main() -> None:
        async with classroom(broker) as (_, rex, eve), eve_at(broker, "homeassistant") as home:
            for kind in ("press", "stop"):
                assert not await home.is_denied(f"servolink/rex/{kind}", "{}")
            for kind in (*OF_REX, "result/teacher/x", "cmd", "start", "echo"):
                assert await home.is_denied(f"servolink/rex/{kind}", "{}")
            while not rex.heard:
                await asyncio.sleep(0.01)  # the broker may thank the sender first
            assert rex.heard[0].topic == "servolink/rex/stop"
            assert await eve.is_denied(document, "{}", retain=True)
            assert not await eve.is_denied(HomeAssistant().topic(Topics(), "eve"), "{}", retain=True)
            async with eve_at(broker, "rex") as rex_itself:
                assert not await rex_itself.is_denied(document, "{}", retain=True)

    run(main())
    broker.end()


@pytest.mark.slow
def test_a_robot_that_stands_still_has_not_stopped_whatever_another_robot_says(
    broker: Broker, user: Path, tmp_path: Path
) -> None:
    def command(name: str, *words: str) -> list[str]:
        secret = tmp_path / f"{name}.password"
        secret.touch(0o600)
        secret.write_text(f"pw{name}\n", encoding="utf-8")
        return [sys.executable, "-m", "servolink", "fleet", *words, "--user", name, "--password-file", str(secret)]

    rex = processes.start(command("rex", "join", broker.url, "virtual://?servos=2", "--name", "rex"))
    assert rex.stdout is not None
    assert rex.stdout.readline().startswith("joined rex ")

    async def main() -> None:
        async with eve_at(broker) as eve:
            for words in (["stop"], ["stop", "--on", "rex"]):
                stop = command("teacher", *words, "--broker", broker.url, "--within", "2")
                ended = await asyncio.to_thread(processes.run, stop)
                assert (ended.returncode, ended.stdout[:15]) == (0, "stopped 1 board")
                rex.send_signal(signal.SIGSTOP)
                try:
                    stopping = asyncio.create_task(asyncio.to_thread(processes.run, stop))
                    while not stopping.done():
                        for message in [each for each in eve.heard if each.response_topic]:
                            await eve.is_denied(str(message.response_topic), confirmation(message, "rex"))
                        await asyncio.sleep(0.01)
                finally:
                    rex.send_signal(signal.SIGCONT)
                ended = await stopping
                assert (ended.returncode, ended.stdout) == (1, "")
                assert ended.stderr == "servolink: no answer, and may still move: rex\n"
            assert eve.heard == []
            assert "already connected" not in broker.log()

    run(main())
    processes.finish(rex, signal.SIGINT)
