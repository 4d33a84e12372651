"""The doors through which a robot is moved and stopped: each opened as programs of users open it.

The doors "shell" and "fleet" lead through other processes, in real time.
"""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from functools import partial
from itertools import count
from typing import Any, NamedTuple

import aiohttp
import msgspec

from benchmarks.fleet_processes import broker
from servolink.client import connect
from servolink.control import ErrorObject, Greeting, open_channel
from servolink.errors import OutcomeUnknown, RequestRefused
from servolink.fleet import BoardPolicy, BrokerAccess, FleetFile, LocalBoard, LocalFleet, Topics
from servolink.fleet import connect as connect_fleet
from servolink.gateways import supervised
from servolink.hub import serve_board
from servolink.studio import serve_studio, studio_for
from tests.processes import start_async
from tests.proofs.reliability.stop_movements import BY_FLEET, BY_LIBRARY, BY_MODEL, BY_RPC, BY_SHELL, Call

_HUB = "share://robot"
REAL = {"shell", "fleet"}
"""Doors that need real time."""
UNHEARD = {"model", *REAL}
"""Doors whose users hear of no stops: what they ask for may be on its way through several programs."""
_SPEED_CAP = 720.0  # degrees per second, of what models move


class Door(NamedTuple):
    """An open door."""

    move: Callable[[str], Awaitable[object]]
    """Makes a movement, and returns at its end."""
    look: Callable[[], Awaitable[object]]
    """Reads all servos."""
    stop: Callable[[], Awaitable[object]]
    """Stops all servos, and returns when that is confirmed."""


@asynccontextmanager
async def library(address: str, **options: Any) -> AsyncIterator[Door]:
    """Use the library, in a program of its own."""
    async with connect(address, reconnect=True, **options) as board:
        yield Door(lambda movement: BY_LIBRARY[movement](board), board.servos, board.stop)


@asynccontextmanager
async def control(_: str, **__: Any) -> AsyncIterator[Door]:
    """Use the control interface of the hub."""
    channel, _welcome = await open_channel("robot", Greeting(wants="rpc", who="program", role="edit"))

    async def call(method: str, /, **params: Any) -> Any:
        return msgspec.json.decode(await channel.call(method, **params))

    try:
        yield _rpc_door(call)
    finally:
        await channel.close()


@asynccontextmanager
async def page(_: str, **__: Any) -> AsyncIterator[Door]:
    """Open a page of the studio."""
    async with (
        studio_for(_HUB) as studio,
        serve_studio(studio, "127.0.0.1", 0) as (gate, _port),
        aiohttp.ClientSession() as http,
        http.ws_connect(f"{gate.address}/ws", origin=gate.address) as socket,
    ):
        await socket.send_json({"token": gate.new_token("edit"), "who": "page"})
        welcome = json.loads(await socket.receive_str())
        opened_page = _Page(socket)
        await opened_page.tell("stop.heard", number=welcome["stops"])
        listening = asyncio.create_task(opened_page.listen())
        try:
            yield _rpc_door(opened_page.call)
        finally:
            listening.cancel()
            await asyncio.wait((listening,))


class _Page:
    """What the code of a page does with its socket."""

    def __init__(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        self._socket = socket
        self._numbers = count(1)
        self._answers: dict[int, asyncio.Future[Any]] = {}

    async def call(self, method: str, /, **params: Any) -> Any:
        """Return the result of a method."""
        number = next(self._numbers)
        answer = self._answers[number] = asyncio.get_running_loop().create_future()
        await self._socket.send_json({"jsonrpc": "2.0", "id": number, "method": method, "params": params})
        return await answer

    async def tell(self, method: str, /, **params: Any) -> None:
        """Call a method without waiting for it."""
        await self._socket.send_json({"jsonrpc": "2.0", "method": method, "params": params})

    async def listen(self) -> None:
        """Take the answers, and acknowledge stops."""
        async for message in self._socket:
            told = json.loads(message.data)
            if told.get("method") == "stopped":
                await self.tell("stop.heard", number=told["params"]["number"])
            answer = self._answers.pop(told.get("id"), None)
            if answer is None or answer.done():
                continue
            if "error" in told:
                answer.set_exception(msgspec.convert(told["error"], ErrorObject).as_error())
            else:
                answer.set_result(told["result"])


@asynccontextmanager
async def model(_: str, **__: Any) -> AsyncIterator[Door]:
    """Use the tools for language models; no person is asked. Raise ImportError without the extra mcp."""
    from mcp import Client

    from servolink.gateways.models import ModelTools

    async with supervised("robot", may_move=True, speed_cap=_SPEED_CAP, log=lambda _: None) as supervisor:
        server = ModelTools(supervisor, None, asks=False).server()
        async with Client(server) as client:

            async def call(method: str, /, **params: Any) -> Any:
                result = await client.call_tool(method, params)
                if result.is_error:
                    raise RequestRefused(str(result.content))
                return result

            yield Door(lambda movement: BY_MODEL[movement](call), partial(call, "servos"), partial(call, "stop"))


@asynccontextmanager
async def shell(address: str, **_: Any) -> AsyncIterator[Door]:
    """Run commands."""

    async def run(*arguments: str) -> None:
        command = (sys.executable, "-m", "servolink", "--board", address, *arguments)
        program = await start_async(*command, stdout=asyncio.subprocess.DEVNULL)
        try:
            _, text = await program.communicate()
        except asyncio.CancelledError:
            program.kill()
            await program.wait()
            raise
        if program.returncode:
            raise RequestRefused(text.decode())

    yield Door(lambda movement: run(*BY_SHELL[movement]), partial(run, "servos"), partial(run, "stop"))


@asynccontextmanager
async def fleet(_: str, **__: Any) -> AsyncIterator[Door]:
    """Command the robot through a broker."""
    ready = asyncio.Event()
    with broker() as url:
        local = LocalFleet(BrokerAccess.of(url), Topics(), FleetFile(BoardPolicy("edit")), hz=0.0)
        joining = asyncio.create_task(local.join([LocalBoard("robot", "robot")], ready.set))
        try:
            await ready.wait()
            async with connect_fleet(url, groups={}) as far:

                async def call(method: str, /, **params: Any) -> Any:
                    return await far.call("robot", method, params)

                async def stop() -> None:
                    stopped = await far.stop()
                    if not stopped.is_complete:
                        raise OutcomeUnknown(f"not confirmed: {stopped}")

                yield Door(lambda movement: BY_FLEET[movement](call, far), partial(call, "servos.list"), stop)
        finally:
            joining.cancel()
            await asyncio.wait((joining,))


def _rpc_door(call: Call) -> Door:
    return Door(lambda movement: BY_RPC[movement](call), lambda: call("servos.list"), lambda: call("stop"))


_DOORS: Mapping[str, Callable[..., AbstractAsyncContextManager[Door]]] = {
    "library": library,
    "control interface": control,
    "page": page,
    "model": model,
    "shell": shell,
    "fleet": fleet,
}
"""Doors to a robot that a hub shares."""
MOVEMENTS: Mapping[str, tuple[str, ...]] = {
    "board": tuple(BY_LIBRARY),
    "library": tuple(BY_LIBRARY),
    "control interface": tuple(BY_RPC),
    "page": tuple(BY_RPC),
    "model": tuple(BY_MODEL),
    "shell": tuple(BY_SHELL),
    "fleet": tuple(BY_FLEET),
}
"""Movements of each door; "board" is the library without a hub."""


@asynccontextmanager
async def opened(
    address: str, mover: str, stopper: str, options: Mapping[str, Any]
) -> AsyncIterator[tuple[Door, Door]]:
    """Yield the doors of the program that moves the robot at `address`, and of the one that stops it."""
    if mover == "board":
        async with library(address, **options) as door:
            yield door, door
        return
    async with serve_board(address, name="robot", **options), _DOORS[mover](_HUB, **options) as moving:
        if stopper == mover:
            yield moving, moving
            return
        async with _DOORS[stopper](_HUB) as stopping:
            yield moving, stopping
