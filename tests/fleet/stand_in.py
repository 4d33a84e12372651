"""Boards that are no boards: each answers commands as it is told to, or does not."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Any

import msgspec

from servolink.control import ErrorData, ErrorObject
from servolink.fleet.access import BrokerAccess
from servolink.fleet.broker import BrokerConnection
from servolink.fleet.broker_messages import Publication, Received
from servolink.fleet.mqtt_client import MqttOptions
from servolink.fleet.topics import BoardCommand, BoardNow, BoardResult, FleetTopic, Stored, Topics
from servolink.support import Tasks
from tests.fleet.bridged import running
from tests.fleet.mosquitto import Broker

TOPICS = Topics()


class Refused(Exception):
    """A command that a board answers with an error of this kind."""

    def __init__(self, kind: str, text: str) -> None:
        super().__init__(text)
        self.kind = kind


class StandIn:
    """A board that answers each command with what `answers` has for its method, after `delay` seconds."""

    def __init__(self, name: str, broker: BrokerConnection, **known: Any) -> None:
        self.name = name
        self.now = BoardNow(
            board=name, host="here", version="0.1.0", connection="connected", allow="edit", at=0.0, **known
        )
        self.answers: dict[str, Callable[[dict[str, Any]], Any]] = {"stop": lambda params: {}}
        self.commands: list[BoardCommand] = []
        self.stops = 0
        self.is_silent = False
        self.heard: list[Received] = []
        self.answer_at: str | None = None
        self.copies = 1
        self.delay = 0.0
        self.loop = asyncio.get_running_loop()
        self._broker = broker
        self._answering = Tasks()
        broker.on_message = self._receive

    async def publish(self, topic: str, payload: bytes | str) -> None:
        """Send a message that the broker keeps."""
        await self._broker.send(Publication(topic, payload, 1, retain=True))

    async def announce(self) -> None:
        await self.publish(TOPICS.board(self.name, "available"), "online")
        await self.publish(TOPICS.board(self.name, "state"), msgspec.json.encode(self.now))

    async def close(self) -> None:
        """End the answers that are under way."""
        await self._answering.close()

    def _receive(self, message: Received) -> None:
        """Answer each command in a task of its own."""
        self.heard.append(message)
        if message.topic.endswith("/cmd"):
            command = msgspec.json.decode(message.payload, type=BoardCommand)
            self.commands.append(command)
        else:
            given = msgspec.json.decode(message.payload)
            method = message.topic.rpartition("/")[2]
            self.stops += method == "stop"
            command = BoardCommand(given["id"], method, given)
        self._answering.begin(self._answer(command, message))

    async def _answer(self, command: BoardCommand, message: Received) -> None:
        if self.is_silent:
            return
        await asyncio.sleep(self.delay)
        result = BoardResult(id=command.id, board=self.name, ok=True, result={})
        try:
            found = self.answers[command.method](command.params)
            result = BoardResult(id=command.id, board=self.name, ok=True, result=found)
        except Refused as error:
            told = ErrorObject(1, str(error), ErrorData(error.kind, ""))
            result = BoardResult(id=command.id, board=self.name, ok=False, error=told)
        except KeyError:
            return
        for _ in range(self.copies):
            topic = self.answer_at or message.response_topic or ""
            await self._broker.send(Publication(topic, msgspec.json.encode(result), 1))


@asynccontextmanager
async def stand_ins(
    broker: Broker, *names: str, access: BrokerAccess | None = None, **known: Any
) -> AsyncIterator[list[StandIn]]:
    """Yield boards that have an action 1 `Bow` and a macro 2 `Wave`."""
    access = access or BrokerAccess.of(broker.url)
    async with AsyncExitStack() as stack:
        boards = []
        for name in names:
            will = Publication(TOPICS.board(name, "available"), "offline", 1, retain=True)
            connection = BrokerConnection(access, MqttOptions(f"stand-in-{name}", will=will))
            kinds: tuple[FleetTopic, ...] = ("start", "stop", "echo")
            topics = [TOPICS.board(name, "cmd"), *(TOPICS.board(name, kind) for kind in kinds)]
            topics += [TOPICS.fleet(kind) for kind in kinds]
            connection.subscriptions = [(topic, 1) for topic in topics]
            stored = {"actions": (Stored(1, "Bow"),), "macros": (Stored(2, "Wave"),)}
            board = StandIn(name, connection, **(stored | known))
            stack.push_async_callback(board.close)
            await stack.enter_async_context(running(connection.run()))
            await connection.until_connected()
            await board.announce()
            boards.append(board)
        yield boards
