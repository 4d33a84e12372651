"""Boards that are no boards: each answers commands as it is told to, or does not."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from typing import Any

import msgspec
from aiomqtt import Client, ProtocolVersion, Will

from servolink.control.faults import ErrorData, ErrorObject
from servolink.fleet.topics import BoardNow, Command, Result, Stored, Topics
from tests.fleet.mosquitto import Broker

TOPICS = Topics()


class Refused(Exception):
    """A command that a board answers with an error of this kind."""

    def __init__(self, kind: str, text: str) -> None:
        super().__init__(text)
        self.kind = kind


def client_of(broker: Broker, **options: Any) -> Client:
    """Return a connection with the broker that begins when it is entered."""
    return Client("127.0.0.1", broker.port, protocol=ProtocolVersion.V5, **options)


class StandIn:
    """A board that answers each command with what `answers` has for its method, after `delay` seconds."""

    def __init__(self, name: str, client: Client, **known: Any) -> None:
        self.name = name
        self.now = BoardNow(
            board=name, host="here", version="0.1.0", connection="connected", allow="edit", at=0.0, **known
        )
        self.answers: dict[str, Callable[[dict[str, Any]], Any]] = {"stop": lambda params: {}}
        self.commands: list[Command] = []
        self.stops = 0
        self.is_silent = False
        self.copies = 1
        self.delay = 0.0
        self._client = client
        self._answering: set[asyncio.Task[None]] = set()

    async def announce(self) -> None:
        await self._client.publish(TOPICS.board(self.name, "available"), "online", 1, retain=True)
        await self._client.publish(TOPICS.board(self.name, "state"), msgspec.json.encode(self.now), 1, retain=True)

    async def serve(self) -> None:
        """Answer each command in a task of its own, until this is cancelled."""
        try:
            await self._serve()
        finally:
            for task in self._answering:
                task.cancel()
            await asyncio.gather(*self._answering, return_exceptions=True)

    async def _serve(self) -> None:
        async for message in self._client.messages:
            if message.topic.value.endswith("/cmd"):
                command = msgspec.json.decode(message.payload, type=Command)
                self.commands.append(command)
                self._begin(command, message)
            elif message.topic.value.endswith(("/stop", "/start", "/echo")):
                given = msgspec.json.decode(message.payload)
                method = message.topic.value.rpartition("/")[2]
                self.stops += method == "stop"
                command = Command(given["id"], method, given)
                self._begin(command, message)

    def _begin(self, command: Command, message: Any) -> None:
        task = asyncio.get_running_loop().create_task(self._answer(command, message))
        self._answering.add(task)
        task.add_done_callback(self._answering.discard)

    async def _answer(self, command: Command, message: Any) -> None:
        if self.is_silent:
            return
        await asyncio.sleep(self.delay)
        result = Result(id=command.id, board=self.name, ok=True, result={})
        try:
            found = self.answers[command.method](command.params)
            result = Result(id=command.id, board=self.name, ok=True, result=found)
        except Refused as error:
            told = ErrorObject(1, str(error), ErrorData(error.kind, ""))
            result = Result(id=command.id, board=self.name, ok=False, error=told)
        except KeyError:
            return
        for _ in range(self.copies):
            await self._client.publish(message.properties.ResponseTopic, msgspec.json.encode(result), 1)


@asynccontextmanager
async def stand_ins(broker: Broker, *names: str, **known: Any) -> AsyncIterator[list[StandIn]]:
    """Yield boards that have an action 1 `Bow` and a macro 2 `Wave`."""
    async with AsyncExitStack() as stack:
        boards = []
        for name in names:
            will = Will(TOPICS.board(name, "available"), "offline", 1, retain=True)
            client = await stack.enter_async_context(client_of(broker, will=will))
            stored = {"actions": (Stored(1, "Bow"),), "macros": (Stored(2, "Wave"),)}
            board = StandIn(name, client, **(stored | known))
            topics = [TOPICS.board(name, "cmd"), TOPICS.board(name, "stop")]
            topics += [TOPICS.fleet("start"), TOPICS.fleet("stop"), TOPICS.fleet("echo")]
            await client.subscribe([(topic, 1) for topic in topics])
            await board.announce()
            task = asyncio.create_task(board.serve())
            stack.push_async_callback(_end, task)
            boards.append(board)
        yield boards


async def _end(task: asyncio.Task[None]) -> None:
    task.cancel()
    with suppress(asyncio.CancelledError):
        await task
