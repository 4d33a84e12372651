"""Messages from a hub, for a recorder in a separate process: killing the recorder harms no other program."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import msgspec
from msgspec import Raw

from servolink.client import Servo
from servolink.control import (
    Greeting,
    RpcChannel,
    ServoNow,
    ServosFrame,
    TapFrame,
    TapItem,
    Tapping,
    Welcome,
    open_channel,
    this_program,
)
from servolink.errors import DecodeError, RequestTimeout, ServolinkError, escape
from servolink.motion import in_unit
from servolink.recorder.channels import Event, ProblemFound, decode
from servolink.recorder.readings import ReadingsFeed, Take

_LIMIT = 5.0  # seconds for the hub to answer
_LAST_LIMIT = 10.0  # the limit at the end, when the hub may still have much to send
_logger = logging.getLogger(__name__)


class _TappedItem(TapItem, frozen=True):
    message: Raw


class _HubFrame(TapFrame, frozen=True):
    items: tuple[_TappedItem, ...]


class HubSource:
    """Tap of a hub, as received by the recorder."""

    def __init__(self, channel: RpcChannel, welcome: Welcome, tapped: Tapping) -> None:
        self.welcome = welcome
        self.tapped = tapped
        self.ended = asyncio.Event()
        """Set when the hub has ended."""
        self._channel = channel
        self._now = asyncio.get_running_loop().time
        self._take: Take | None = None
        self._readings: ReadingsFeed | None = None
        self._early: list[tuple[str, Raw]] = []  # notifications received before `begin`
        self._shift = self._now() - tapped.seconds  # both clocks are most likely the same
        channel.on_notification = self._hear
        channel.on_end = self._end

    async def begin(self, take: Take, readings: ReadingsFeed) -> None:
        """Pass messages on to `take` from now on, beginning with the messages since the tap was opened."""
        self._take, self._readings = take, readings
        take(self._now(), Event("connection", self.tapped.state))
        early, self._early = self._early, []
        for name, params in early:
            self._hear(name, params)
        if readings.hz:
            try:
                await self._channel.call("servos.watch", timeout=_LIMIT, hz=readings.hz)
            except ServolinkError as error:  # the hub repeats the query without a new request
                readings.failed(error)

    async def end(self) -> None:
        """Receive the messages up to now, then end the tap."""
        try:
            await self._channel.call("tap.stop", timeout=_LAST_LIMIT)
        except RequestTimeout:
            if self._take is not None:
                text = "the end is missing: this computer was too busy to record all messages of the hub"
                self._take(self._now(), ProblemFound("recorder", text))
        except ServolinkError:
            pass  # the hub is gone
        self._channel.on_notification = self._channel.on_end = None

    def _hear(self, name: str, params: Raw) -> None:
        if self._take is None:
            self._early.append((name, params))
            return
        try:
            if name == "tap":
                self._hear_tap(self._take, msgspec.json.decode(params, type=_HubFrame))
            elif name == "servos" and self._readings is not None:
                frame = msgspec.json.decode(params, type=ServosFrame)
                self._channel.tell("servos.ack", number=frame.number)
                self._readings.read(frame.seconds + self._shift, list(map(_servo, frame.servos)), frame.missed)
        except (msgspec.MsgspecError, UnicodeDecodeError, DecodeError) as error:
            _logger.warning("a notification of the hub cannot be read: %s", escape(str(error)))

    def _hear_tap(self, take: Take, frame: _HubFrame) -> None:
        for item in frame.items:
            take(item.seconds + self._shift, decode(item.channel, bytes(item.message)))

    def _end(self) -> None:
        if self._take is not None:
            text = "the hub has ended or disconnected the recorder"
            self._take(self._now(), Event("connection", "lost", text=text))
        self.ended.set()


@asynccontextmanager
async def tapping(name: str, *, wire_only: bool = False) -> AsyncIterator[HubSource]:
    """Tap the hub `name` in this context. Raise OpenError, or Rejected for a hub of an older version."""
    channel, welcome = await open_channel(name, Greeting(wants="rpc", who=this_program(), role="watch"))
    try:
        tapped: Any = await channel.call("tap.start", timeout=_LIMIT, wire_only=wire_only)
        yield HubSource(channel, welcome, msgspec.json.decode(tapped, type=Tapping))
    finally:
        await channel.close()


def _servo(servo: ServoNow) -> Servo:
    angle = servo.angle if servo.angle_unit is None else in_unit(servo.angle, servo.angle_unit)
    return Servo(
        servo.servo_id,
        angle,
        servo.current_raw,
        servo.temperature_raw,
        servo.servo_type,
        servo.is_start,
        servo.is_hold,
        servo.doubt,
    )
