"""Server for Foxglove: a hub or a recording, live; published targets move the robot where a person allows that."""

from __future__ import annotations

import asyncio
import re
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from threading import BoundedSemaphore
from typing import Any, Final, TypeAlias

import foxglove  # pyright: ignore[reportMissingImports]
from foxglove.websocket import Capability, ServerListener, StatusLevel  # pyright: ignore[reportMissingImports]

from servolink.errors import ServolinkError, escape
from servolink.gateways.foxglove.live_channels import SCENE, LiveChannels
from servolink.gateways.supervisor import Supervisor
from servolink.support import Tasks, read_json
from servolink.transports import NetworkPlace, Stranger, Strangers, forward, listen

MOVE: Final = "/servolink/move"
"""Channel on which programs publish targets: an object with degrees by servo, id or caption."""

_MOST_BYTES = 65_536  # of a published target
_MOST_CHANNELS = 256  # on which programs publish targets
_MOST_WAITING = 64  # messages that the event loop has not taken yet; further messages are dropped
_HANDSHAKE_LIMIT = 10.0  # seconds until a program must have sent its handshake
_END_OF_HEAD = b"\r\n\r\n"
_UPGRADE = re.compile(rb"\r\nupgrade: *websocket *\r\n", re.IGNORECASE)
_FILES = 3  # of a program: its connection, and both ends of the connection with the server of the SDK

Ask: TypeAlias = Callable[[str], Awaitable[bool]]
"""Asks a person a question, and returns whether the answer is yes."""


class PublishedTargets(ServerListener):  # type: ignore[misc,unused-ignore]  # without the SDK it is Any
    """Listener to the programs of the server: draws the scene for each, and moves the robot to published targets.

    The server calls its methods on threads of its own.
    """

    def __init__(self, channels: LiveChannels, supervisor: Supervisor | None, speed: float, ask: Ask) -> None:
        """Move at `speed` (degrees per second), after asking; without a supervisor, targets are ignored."""
        self.server: Any = None
        """Server that tells the programs of refusals; None before its start."""
        self._channels = channels
        self._supervisor = supervisor
        self._speed = speed
        self._ask = ask
        self._loop = asyncio.get_running_loop()
        self._tasks = Tasks()
        self._moving: tuple[int, asyncio.Task[None]] | None = None  # client, and the motion for it
        self._to_move: set[tuple[int, int]] = set()  # client and channel
        self._waiting = BoundedSemaphore(_MOST_WAITING)

    def on_subscribe(self, client: Any, channel: Any) -> None:
        """Draw the scene for a program that begins to listen; no scene is logged before."""
        if channel.topic == SCENE:
            self._channels.draw_scene(time.time_ns())

    def on_client_advertise(self, client: Any, channel: Any) -> None:
        """Note a channel on which a program will publish targets."""
        if channel.topic == MOVE:
            self._loop.call_soon_threadsafe(self._note, client.id, channel.id)

    def on_client_unadvertise(self, client: Any, client_channel_id: int) -> None:
        """Stop the motion of a program that closes the channel or disconnects."""
        self._loop.call_soon_threadsafe(self._leave, client.id, client_channel_id)

    def on_message_data(self, client: Any, client_channel_id: int, data: bytes) -> None:
        """Take a message published by a program, on any topic; a flood of messages waits in no queue."""
        if self._waiting.acquire(blocking=False):
            self._loop.call_soon_threadsafe(self._take, client.id, client_channel_id, bytes(data[: _MOST_BYTES + 1]))

    async def close(self) -> None:
        """Stop the motion under way."""
        await self._tasks.close()

    def _note(self, client: int, channel: int) -> None:
        if len(self._to_move) < _MOST_CHANNELS:
            self._to_move.add((client, channel))

    def _leave(self, client: int, channel: int) -> None:
        if (client, channel) not in self._to_move:
            return
        self._to_move.discard((client, channel))
        if self._moving is not None and self._moving[0] == client:
            self._moving[1].cancel()

    def _take(self, client: int, channel: int, data: bytes) -> None:
        self._waiting.release()
        if (client, channel) not in self._to_move or self._supervisor is None:
            return
        if self._moving is not None and not self._moving[1].done():
            self._tell("a target was ignored: a motion is asked for, or under way")
            return
        self._moving = client, self._tasks.begin(self._move(self._supervisor, data))

    async def _move(self, supervisor: Supervisor, data: bytes) -> None:
        try:
            motion = await supervisor.check_move(_targets_in(data), None, self._speed)
            question = supervisor.ask(motion)
            yes = await self._ask(question.text)
            await supervisor.perform(supervisor.answer(question.number, is_yes=yes))
        except (ServolinkError, ValueError) as error:
            self._tell(f"nothing was moved, or not to its end: {error}")

    def _tell(self, text: str) -> None:
        """Tell all programs; Foxglove shows the text among the problems."""
        if self.server is not None:
            self.server.publish_status(escape(text), StatusLevel.Warning, "move")


def _targets_in(data: bytes) -> dict[str, float]:
    """Return the targets in a message. Raise ValueError for anything else."""
    targets = read_json(data) if len(data) <= _MOST_BYTES else None
    if not isinstance(targets, dict) or not all(type(angle) in (int, float) for angle in targets.values()):
        raise ValueError(f'{MOVE}: a target must be degrees by servo, such as {{"1": 45, "left knee": 10}}')
    return targets


@asynccontextmanager
async def serving(
    listener: PublishedTargets, context: Any, host: str, port: int, *, may_move: bool
) -> AsyncIterator[int]:
    """Serve a Foxglove context in this context; yield the port. Raise OpenError for an address in use."""
    capabilities = [Capability.ClientPublish] if may_move else []
    server = foxglove.start_server(
        name="servolink",
        host="127.0.0.1",
        port=0,
        capabilities=capabilities,
        supported_encodings=["json"] if may_move else None,
        server_listener=listener,
        context=context,
    )
    listener.server = server

    async def converse(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, stranger: Stranger) -> None:
        with suppress(OSError, EOFError, asyncio.LimitOverrunError):
            head = await reader.readuntil(_END_OF_HEAD)
            if _UPGRADE.search(head) and stranger.admit("foxglove", Strangers.most_connections(), files=_FILES):
                await forward(reader, writer, ("127.0.0.1", server.port), begin=head)

    try:
        # The server of the SDK has no limit of connections, and gets connections after a handshake only.
        async with listen(converse, host, port, seconds=_HANDSHAKE_LIMIT) as place:
            yield NetworkPlace.parse(place)[1]
    finally:
        await listener.close()
        listener.server = None
        await asyncio.to_thread(server.stop)
