"""Server for Foxglove: a hub or a recording, live; published targets move the robot where a person allows that."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from threading import BoundedSemaphore
from typing import Any, Final, TypeAlias

import foxglove  # pyright: ignore[reportMissingImports]
from foxglove.websocket import Capability, ServerListener, StatusLevel  # pyright: ignore[reportMissingImports]

from servolink.errors import OpenError, ServolinkError
from servolink.escaping import escape
from servolink.gateways.live_channels import SCENE, LiveChannels
from servolink.gateways.supervisor import Supervisor
from servolink.json_text import read_json
from servolink.recorder.hub_source import tapping
from servolink.recorder.reading import Recording
from servolink.recorder.readings import ReadingsFeed
from servolink.tasks import Tasks

MOVE: Final = "/servolink/move"
"""Channel on which programs publish targets: an object with degrees by servo, id or caption."""
HZ: Final = 25.0
"""Readings of the servos per second."""

_MOST_BYTES = 65_536  # of a published target
_MOST_CHANNELS = 256  # on which programs publish targets
_MOST_WAITING = 64  # messages that the event loop has not taken yet; further messages are dropped
_LONGEST_PAUSE = 1.0  # seconds between two messages of a recording; longer silences are cut short

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
    try:
        server = foxglove.start_server(
            name="servolink",
            host=host,
            port=port,
            capabilities=capabilities,
            supported_encodings=["json"] if may_move else None,
            server_listener=listener,
            context=context,
        )
    except RuntimeError as error:
        raise OpenError(f"cannot listen at {host}:{port}: {error}; try another port, or 0") from error
    listener.server = server
    try:
        yield server.port
    finally:
        await listener.close()
        listener.server = None
        await asyncio.to_thread(server.stop)


async def follow_hub(hub: str, channels: LiveChannels) -> None:
    """Log all that a hub tells, until the hub ends. Raise OpenError without such a hub."""
    loop = asyncio.get_running_loop()

    def take(seconds: float, message: Any) -> None:
        channels.take(time.time_ns() - round((loop.time() - seconds) * 1e9), message)

    async with tapping(hub) as source:
        await source.begin(take, ReadingsFeed(take, HZ))
        await source.ended.wait()


async def follow_recording(recording: Recording, channels: LiveChannels, speed: float) -> None:
    """Log the messages of a recording with their own times, at `speed` times its pace, once."""
    loop = asyncio.get_running_loop()
    due, before = loop.time(), 0.0
    for entry in recording.entries():
        due += min((entry.seconds - before) / speed, _LONGEST_PAUSE)
        before = entry.seconds
        if (pause := due - loop.time()) > 0:
            await asyncio.sleep(pause)
        channels.take(entry.time, entry.message)
