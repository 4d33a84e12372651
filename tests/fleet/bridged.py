"""A virtual board, its hub, a bridge and a program far away, all on the loop of a test, with a real broker."""

from __future__ import annotations

import asyncio
import itertools
import json
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from servolink.fleet import broker as broker_module
from servolink.fleet.access import BrokerAccess
from servolink.fleet.broker import BrokerConnection
from servolink.fleet.broker_messages import Publication, Received
from servolink.fleet.join import LocalBoard, LocalFleet
from servolink.fleet.mqtt_client import MqttOptions
from servolink.fleet.policy import BoardPolicy, FleetFile
from servolink.fleet.topics import Topics
from servolink.hub import Hub, serve_board
from tests.fleet.mosquitto import Broker

TOPICS = Topics()
LIMIT = 120.0  # seconds, however busy the machine is


class Far:
    """A program that sees and commands the board through the broker alone."""

    def __init__(self, broker: Broker, name: str = "far") -> None:
        self.heard: dict[str, list[Received]] = {}
        self.broker = BrokerConnection(BrokerAccess.of(broker.url), MqttOptions(name))
        self.broker.subscriptions = [("servolink/#", 1), ("homeassistant/#", 1)]
        self.broker.on_message = self._hear
        self._news = asyncio.Event()
        self._ids = itertools.count(1)

    async def send(self, method: str, board: str = "rex", **options: Any) -> str:
        """Send a command and return its id; `options` are its parts, and those of a publication."""
        command_id: str = options.pop("id", f"c{next(self._ids)}")
        command = {"id": command_id, "method": method, "params": options.pop("params", {})}
        if pulse := options.pop("pulse", None):
            command["pulse"] = pulse
        await self.publish(TOPICS.board(board, "cmd"), command, **{"expiry": 10, **options})
        return command_id

    async def publish(self, topic: str, payload: Mapping[str, Any] | bytes, **options: Any) -> None:
        content = payload if isinstance(payload, bytes) else json.dumps(payload).encode()
        await self.broker.send(Publication(topic, content, 1, **options))

    async def result(self, command_id: str | None, topic: str = "servolink/rex/result") -> dict[str, Any]:
        """Return the result of a command, when it has come."""
        found: dict[str, Any] = (await self.results(command_id, topic=topic))[0]
        return found

    async def results(self, command_id: str | None, count: int = 1, *, topic: str = "servolink/rex/result") -> Any:
        """Return the results with this id, when there are `count`."""

        def found() -> list[Any]:
            all_of_them = [json.loads(each.payload) for each in self.heard.get(topic, [])]
            return [each for each in all_of_them if each["id"] == command_id and "ok" in each]

        await self.until(lambda: len(found()) >= count)
        return found()

    async def call(self, method: str, **options: Any) -> Any:
        """Return what a method returns. Raise AssertionError if it fails."""
        answer = await self.result(await self.send(method, **options))
        assert answer["ok"], answer
        return answer["result"]

    async def failure(self, method: str, **options: Any) -> dict[str, Any]:
        """Return the error with which a method fails."""
        answer = await self.result(await self.send(method, **options))
        assert not answer["ok"], answer
        error: dict[str, Any] = answer["error"]
        return error

    async def state(self, fits: Callable[[dict[str, Any]], bool] = lambda state: True) -> dict[str, Any]:
        """Return the latest state of the board that fits."""

        def found() -> list[dict[str, Any]]:
            states = [json.loads(each.payload) for each in self.heard.get("servolink/rex/state", [])]
            return [state for state in states[-1:] if fits(state)]

        await self.until(lambda: bool(found()))
        return found()[0]

    async def until(self, is_so: Callable[[], bool]) -> None:
        """Wait until something is so."""
        async with asyncio.timeout(LIMIT):
            while not is_so():
                self._news.clear()
                await self._news.wait()

    def _hear(self, message: Received) -> None:
        self.heard.setdefault(message.topic, []).append(message)
        self._news.set()


@asynccontextmanager
async def running(task: Awaitable[Any]) -> AsyncIterator[asyncio.Task[Any]]:
    """Run something beside what is in this context."""
    made = asyncio.ensure_future(task)
    try:
        yield made
    finally:
        made.cancel()
        with suppress(asyncio.CancelledError):
            await made


@asynccontextmanager
async def far_away(broker: Broker, name: str = "far") -> AsyncIterator[Far]:
    """Yield a program that is connected with the broker."""
    far = Far(broker, name)
    async with running(far.broker.run()):
        await far.broker.until_connected()
        yield far


@asynccontextmanager
async def joined(broker: Broker, policy: BoardPolicy, *, hub: str = "rex", **options: Any) -> AsyncIterator[LocalFleet]:
    """Yield a fleet of the board that `hub` shares, when it has joined."""
    fleet = LocalFleet(BrokerAccess.of(broker.url), TOPICS, FleetFile(policy), **{"hz": 0.0, **options})
    ready = asyncio.Event()
    async with running(fleet.join([LocalBoard(hub, hub)], ready.set)) as joining:
        waiting = asyncio.ensure_future(ready.wait())
        await asyncio.wait((joining, waiting), return_when=asyncio.FIRST_COMPLETED)
        waiting.cancel()
        if joining.done():
            await joining
        yield fleet


@asynccontextmanager
async def bridged(
    broker: Broker, allow: Any = "edit", *, url: str = "virtual://?servos=4", **options: Any
) -> AsyncIterator[tuple[Far, Hub]]:
    """Yield a program far away and the hub of the board that it sees."""
    policy = options.pop("policy", None) or BoardPolicy(allow)
    async with serve_board(url, name="rex") as (hub, _), far_away(broker) as far, joined(broker, policy, **options):
        yield far, hub


@pytest.fixture
def user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user of this machine who has no files yet."""
    for name in ("XDG_RUNTIME_DIR", "XDG_DATA_HOME", "XDG_CONFIG_HOME"):
        folder = tmp_path / name
        folder.mkdir(mode=0o700)
        monkeypatch.setenv(name, str(folder))
    monkeypatch.setattr(broker_module, "_QUIET", 0.05)
    return tmp_path


def run(main: Awaitable[None]) -> None:
    """Run a test."""

    async def limited() -> None:
        async with asyncio.timeout(2 * LIMIT):
            await main

    asyncio.run(limited())
