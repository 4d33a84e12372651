"""Robots of a studio: boards shared by the studio itself, and the change of all pages to another board."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from importlib.resources import files
from itertools import count
from typing import Any, TypeAlias

import msgspec

from servolink.boards import running_hubs
from servolink.client import Board
from servolink.control import Greeting, HubStatus, RpcChannel, open_channel
from servolink.errors import OpenError, Reason, ServolinkError, escape
from servolink.hub import serve_board
from servolink.project import ProjectFile
from servolink.protocol import ALL_SERVOS, RECORD_TYPES, SetServoParameterRequest
from servolink.support import Tasks
from servolink.twin import PhysicsProcess

Stop: TypeAlias = Callable[[int], Awaitable[None]]
VIRTUAL = "virtual://?servos=16"
"""Address of a new virtual board with the demo: some actions, macros and buttons."""
_SHARED = "share://"
_STOP_LIMIT = 2.0  # seconds
_STOP = SetServoParameterRequest(ALL_SERVOS, 0, 1)


class Robots:
    """Boards shared by the studio, until they are given back or the studio ends."""

    def __init__(self, forecast: str | None = None, **options: Any) -> None:
        """Open boards with the `options` of `connect`; try motions on the twin of the project file `forecast`."""
        self._options = options
        self._shared: dict[str, tuple[asyncio.Task[None], asyncio.Event, Stop]] = {}  # by the name of the hub
        self._forecast = forecast

    def __contains__(self, name: str) -> bool:
        """Return whether the studio shares the board of the hub `name`."""
        return name in self._shared

    async def open(self, address: str) -> str:
        """Return the name of the hub for a board, which is shared from here unless a hub shares it.

        Raise OpenError or InvalidAddress if the board cannot be opened.
        """
        if address.startswith(_SHARED):
            name = address.removeprefix(_SHARED).partition("?")[0]
            async with _talking(name):
                return name
        opened: asyncio.Future[tuple[str, Stop]] = asyncio.get_running_loop().create_future()
        end = asyncio.Event()
        # In a separate task: the board stays open after the request of the page that opens it.
        task = asyncio.create_task(self._share(address, opened, end))
        try:
            await asyncio.wait((task, opened), return_when=asyncio.FIRST_COMPLETED)
        except asyncio.CancelledError:
            task.cancel()
            await asyncio.wait((task,))
            raise
        if not opened.done():
            await task  # raises the error
        name, stop = opened.result()
        self._shared[name] = task, end, stop
        task.add_done_callback(lambda _: self._shared.pop(name, None))
        return name

    async def stop(self, name: str, frames: int) -> None:
        """Stop all servos of a board shared from here, first with so many stop frames in a row.

        Raise ServolinkError if that is not confirmed.
        """
        _, _, stop = self._shared[name]
        await stop(frames)

    async def stop_all(self) -> None:
        """Stop all servos of all boards shared from here. Raise ServolinkError if a board does not confirm that."""
        await asyncio.gather(*(self.stop(name, 0) for name in self._shared))

    async def give_back(self, name: str) -> None:
        """End the sharing of a board and free its port. No effect for a board shared by another program."""
        if name in self._shared:
            task, end, _ = self._shared[name]
            end.set()
            await asyncio.wait((task,))

    async def close(self) -> None:
        """Give all boards back."""
        for name in list(self._shared):
            await self.give_back(name)

    async def _share(self, address: str, opened: asyncio.Future[tuple[str, Stop]], end: asyncio.Event) -> None:
        forecast = None
        if self._forecast is not None:
            forecast = await asyncio.to_thread(PhysicsProcess.checker, self._forecast)
        served = serve_board(address, name=_name_for(address), guard=True, forecast=forecast, **self._options)
        async with served as (hub, _):
            if address == VIRTUAL:
                await _store_demo(hub.board)

            async def stop(frames: int) -> None:
                stopping = hub.begin_stop("studio")  # cancels motions at once
                for _ in range(frames):
                    await hub.board.connection.send_stop(_STOP)
                await Tasks.shared_result(stopping)

            opened.set_result((hub.name, stop))
            await end.wait()


def _name_for(address: str) -> str | None:
    """Return a free name for the hub of a virtual board; None for the name of any other board."""
    if not address.startswith("virtual:"):
        return None
    taken = {hub.url for hub in running_hubs()}
    names = (f"virtual-{number}" if number > 1 else "virtual" for number in count(1))
    return next(name for name in names if f"{_SHARED}{name}" not in taken)


async def _store_demo(board: Board) -> None:
    """Store the demo on a new virtual board."""
    demo = ProjectFile.parse((files("servolink.studio") / "demo.servolink.json").read_bytes()).project
    for kind in RECORD_TYPES:
        for record in getattr(demo, kind.field):
            await board.request(kind.add(record))
    await board.add_servo_parameters(demo.servo_parameters)
    await board.set_active_joystick_table(1)


@asynccontextmanager
async def _talking(name: str) -> AsyncIterator[RpcChannel]:
    """Connect to the hub `name`, to read and to stop. Raise OpenError, with a remedy, if no such hub is running."""
    channel, _ = await open_channel(name, Greeting(wants="rpc", who="studio: changing the robot", role="watch"))
    try:
        yield channel
    finally:
        await channel.close()


async def stop_before_leaving(name: str) -> bool:
    """Stop all servos of the board of the hub `name`; return whether the board confirms it.

    Raise OpenError while a program has exclusive use of the board, such as to write a project.
    """
    hold = None
    with suppress(ServolinkError):  # the hub has ended, the board is lost, or it does not confirm
        async with _talking(name) as hub:
            hold = msgspec.json.decode(await hub.call("status", timeout=_STOP_LIMIT), type=HubStatus).hold
            if hold is None:
                await hub.call("stop", timeout=_STOP_LIMIT)
                return True
    if hold is not None:
        text = f"{name} is in exclusive use by {hold.who} ({hold.reason}); change the robot when that is done"
        raise OpenError(escape(text), reason=Reason.IN_USE)
    return False
