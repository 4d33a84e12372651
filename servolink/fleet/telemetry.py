"""Telemetry: state, readings and log of a board, sent to the broker.

`servos` is sent with QoS 0, one message after the other, and the hub gets its acknowledgement only then: whatever the
network is slow to take is left out, and the next message is the present. Events and the state are kept until the
broker has them.
"""

from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import version
from ipaddress import ip_address
from typing import Any, NoReturn

import msgspec
from msgspec import UNSET, Raw, Struct

from servolink.control import (
    Battery,
    ButtonPressed,
    HubStatus,
    ProblemNotice,
    RecordList,
    RefusedNotice,
    ServoList,
    decode,
    encode,
)
from servolink.errors import ConnectionLost, ServolinkError, escape
from servolink.fleet.broker import BrokerConnection
from servolink.fleet.broker_messages import Publication
from servolink.fleet.hub_session import HubError, HubSession, result_of
from servolink.fleet.outbox import Outbox
from servolink.fleet.policy import BoardPolicy
from servolink.fleet.topics import BoardNow, EventNow, LogLine, Stored, Topics, readable
from servolink.transports import NetworkPlace

STATE_SECONDS = 5.0
"""Seconds between queries of the hub's state, besides each reported change."""
BATTERY_SECONDS = 30.0
CATALOG_SECONDS = 60.0
"""How often the list of stored actions and macros is read."""

_LEAST_PAUSE = 0.2  # seconds from a change to the state message
_MOST_PROBLEMS = 5
_FULL = 100  # percent; a higher charge cannot be true
_MOST_LINES = 10  # of the log in a second


class _Number(Struct):
    number: int


class Telemetry:
    """Sender of the telemetry of a board."""

    def __init__(
        self,
        topics: Topics,
        board: str,
        policy: BoardPolicy,
        hub: HubSession,
        broker: BrokerConnection,
        outbox: Outbox,
        hz: float,
        may_send: asyncio.Event,
    ) -> None:
        """Send servo states at `hz` at most, none for 0, and only while `may_send` is set."""
        self.now = BoardNow(
            board=board,
            host=socket.gethostname(),
            version=version("servolink"),
            connection="lost",
            allow=policy.allow,
            at=0.0,
        )
        """Last known state of the board."""
        self.servo_ids: tuple[int, ...] = ()
        self.least_hz = 0.0
        """Rate of reading the servos in Hz, sent or not."""
        self.on_catalog: Callable[[], None] = lambda: None
        """Called when actions, macros or servos have changed."""
        self.on_line: Callable[[Any, str], None] = lambda level, text: None
        """Called with each line of the log, not escaped."""
        self._topics = topics
        self._hub = hub
        self._broker = broker
        self._outbox = outbox
        self._hz = hz
        self._may_send = may_send
        self.frame: Raw | None = None
        """The latest states of the servos, as JSON."""
        self._has_frame = asyncio.Event()
        self._news = asyncio.Event()
        self._catalog_due = self._battery_due = 0.0
        self._sent: BoardNow | None = None
        self._hears_buttons = False
        self._events = 0
        self._lines = 0
        self._left_out = 0
        self._second = 0.0

    async def begin(self) -> None:
        """Query a newly connected hub for everything. Raise ConnectionLost if the hub is gone again."""
        self._catalog_due = self._battery_due = 0.0
        if hz := self._hz or self.least_hz:
            await self._hub.ask("servos.watch", {"hz": hz})
        self._hears_buttons = False
        self._news.set()

    def follow(self, policy: BoardPolicy) -> None:
        """Publish what `policy` allows."""
        self._change(allow=policy.allow)

    def hub_lost(self, text: str) -> None:
        """Publish the loss of the hub."""
        self._change(connection="lost", lease=None, hold=None, programs=0)
        self.log("error", text)

    def look_again(self) -> None:
        """Read the list of stored records soon."""
        self._catalog_due = 0.0
        self._news.set()

    def resend(self) -> None:
        """Send the state soon, changed or not."""
        self._sent = None
        self._news.set()

    def hear(self, name: str, params: Raw) -> None:
        """Take a notification of the hub; never raises."""
        with suppress(msgspec.MsgspecError, UnicodeDecodeError):
            match name:
                case "servos":
                    self.frame = Raw(bytes(params))
                    self._has_frame.set()
                case "button":
                    self._event(msgspec.json.decode(params, type=ButtonPressed))
                case "problem":
                    self.problem(msgspec.json.decode(params, type=ProblemNotice).text)
                case "refused":
                    refused = msgspec.json.decode(params, type=RefusedNotice)
                    self.log("warning", f"{refused.packet} was not sent to the board: {refused.reason}")
                case "hold":  # an import, which changes the stored records
                    self.look_again()
                case "lease" | "connection" | "program":
                    self._news.set()
                case _:
                    pass

    def log(self, level: Any, text: str) -> None:
        """Send a line of the log, unless too many are sent."""
        now = asyncio.get_running_loop().time()
        if now - self._second >= 1:
            if self._left_out:
                self._line("warning", f"{self._left_out} lines were left out")
            self._second, self._lines, self._left_out = now, 0, 0
        self._lines += 1
        if self._lines > _MOST_LINES:
            self._left_out += 1
        else:
            self._line(level, text)

    def _line(self, level: Any, text: str) -> None:
        self.on_line(level, text)
        self._outbox.put(self._publication("log", LogLine(level, escape(text)[:500], _wall()), 0))

    async def send_servos(self) -> NoReturn:
        """Send the latest servo state, for each new state that the network accepts."""
        topic = self._topics.board(self.now.board, "servos")
        while True:
            await self._has_frame.wait()
            await self._broker.until_connected()
            await self._may_send.wait()
            self._has_frame.clear()
            frame = self.frame
            if frame is None:
                continue
            if self._hz:
                with suppress(ConnectionLost):
                    await self._broker.send(Publication(topic, bytes(frame)))
            self._hub.tell("servos.ack", number=msgspec.json.decode(frame, type=_Number).number)

    async def send_state(self) -> NoReturn:
        """Send the state after every change."""
        while True:
            with suppress(TimeoutError):
                async with asyncio.timeout(STATE_SECONDS):
                    await self._news.wait()
                    if self._sent is not None:  # changes are sent together, and after more urgent messages
                        await asyncio.sleep(_LEAST_PAUSE)
            self._news.clear()
            with suppress(ServolinkError, msgspec.MsgspecError):
                await self._look()
            if self._broker.is_connected and (
                self._sent is None or self._sent != msgspec.structs.replace(self.now, at=self._sent.at)
            ):
                self._sent = self.now = msgspec.structs.replace(self.now, at=_wall())
                self._outbox.put(self._publication("state", self.now, 1, retain=True))

    async def _look(self) -> None:
        """Query the hub for state that may have changed. Raise the error of the query."""
        if not self._hub.is_connected:
            return
        status = await self._ask("status", {}, HubStatus)
        self._change(
            connection=status.state,
            noise=status.noise,
            programs=len(status.programs),
            lease=status.lease and status.lease.who,
            hold=status.hold and status.hold.who,
            tcp=next(filter(None, map(_seen_from_afar, status.doors)), None),
        )
        now = asyncio.get_running_loop().time()
        if status.state != "connected" or status.hold is not None:  # the board could not be asked
            return
        if now >= self._battery_due:
            self._battery_due = now + BATTERY_SECONDS
            try:
                percent: float | None = (await self._ask("battery", {}, Battery)).percent
            except HubError:
                percent = None
            self._change(battery_percent=None if (percent or 0) > _FULL else percent)
        if now >= self._catalog_due:
            self._catalog_due = now + CATALOG_SECONDS
            await self._look_at_catalog()

    async def _look_at_catalog(self) -> None:
        if not self._hears_buttons:  # a board may refuse until it has a table of buttons
            self._hears_buttons = (await self._hub.ask("buttons.subscribe", {})).error is UNSET
        records = (await self._ask("records.list", {}, RecordList)).records
        servos = (await self._ask("servos.list", {}, ServoList)).servos
        before = self.now, self.servo_ids
        self.servo_ids = tuple(servo.servo_id for servo in servos)
        self._change(
            servos=len(servos),
            actions=tuple(Stored(one.id, readable(one.caption)) for one in records if one.type == "action"),
            macros=tuple(Stored(one.id, readable(one.caption)) for one in records if one.type == "macro"),
        )
        if (self.now, self.servo_ids) != before:
            self.on_catalog()

    async def _ask(self, method: str, params: object, kind: Any) -> Any:
        return decode(result_of(await self._hub.ask(method, params)), kind)

    def _change(self, **fields: Any) -> None:
        changed = msgspec.structs.replace(self.now, **fields)
        if changed != self.now:
            self.now = changed
            self._news.set()

    def _event(self, pressed: ButtonPressed) -> None:
        self._events += 1
        event = EventNow(pressed.button_id, pressed.event, pressed.kind, id=self._events, at=_wall())
        self._outbox.put(self._publication("event", event, 1))

    def problem(self, text: str) -> None:
        """Publish a notice for people, in the state and in the log."""
        problems = [*(each for each in self.now.problems if each != text), text]
        self._change(problems=tuple(problems[-_MOST_PROBLEMS:]))
        self.log("warning", text)

    def _publication(self, topic: Any, payload: Struct, qos: int, *, retain: bool = False) -> Publication:
        return Publication(self._topics.board(self.now.board, topic), encode(payload), qos, retain)


def _wall() -> float:
    return round(time.time(), 3)


def _seen_from_afar(door: str) -> str | None:
    """Return the address of a door of a hub for other machines; None for a door that they do not reach."""
    if not door.startswith("tcp://"):
        return None
    host, port = NetworkPlace.parse(door.removeprefix("tcp://"))
    address = ip_address(host)
    if address.is_loopback:
        return None
    return f"tcp://{NetworkPlace(socket.gethostname() if address.is_unspecified else host, port)}"
