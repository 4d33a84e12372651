"""Urgent: separate connection for stops and starts of all boards of a machine, undisturbed by floods of commands.

Starts, echoes and stops of one board come this way too. A press does because the broker keeps nothing for this
connection while it is lost.
"""

from __future__ import annotations

import asyncio
import secrets
import socket
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec

from servolink.fleet.access import BrokerAccess
from servolink.fleet.answers import Answers, Sender
from servolink.fleet.bridge import Bridge
from servolink.fleet.broker import BrokerConnection
from servolink.fleet.broker_messages import Received
from servolink.fleet.mqtt_client import MqttOptions
from servolink.fleet.outbox import Outbox
from servolink.fleet.pulse import PulseLink
from servolink.fleet.stop_handler import read_stop
from servolink.fleet.topics import UNREADABLE, BoardCommand, Echo, Echoed, FleetTopic, Press, Start, Started, Topics
from servolink.support import Tasks

_OF_ALL: Mapping[FleetTopic, int] = {"stop": 1, "start": 1, "echo": 0}
"""QoS of the topics of all boards, which each board has for itself as well."""
_PRESS_SECONDS = 5
_LEAD = 0.1
"""Seconds from a message that names no moment to the start."""


class Urgent:
    """The connection for stops, starts and echoes."""

    def __init__(self, access: BrokerAccess, topics: Topics, bridges: Sequence[Bridge]) -> None:
        self._topics = topics
        # A random word, because whoever knows the identifier of a connection can end the connection.
        name = f"{topics.prefix}/_fleet/{socket.gethostname()}-{secrets.token_hex(8)}"
        self.broker = BrokerConnection(access, MqttOptions(name, sees_retained=False))
        self._outbox = Outbox(self.broker)
        self._bridges: Mapping[str, Bridge] = {bridge.board: bridge for bridge in bridges}
        self._answers = {
            name: Answers(name, topics, self._outbox, on_problem=bridge.telemetry.problem)
            for name, bridge in self._bridges.items()
        }
        self._link = PulseLink(bridges[0].pulse)
        self._pulse_topic = topics.board(bridges[0].board, "pulse")
        self._tasks = Tasks()
        self.broker.subscriptions = [
            *((topics.fleet(kind), qos) for kind, qos in _OF_ALL.items()),
            (self._pulse_topic, 0),
            *((topics.board(name, kind), qos) for name in self._bridges for kind, qos in _OF_ALL.items()),
            *((topics.board(name, "press"), 0) for name in self._bridges),
        ]
        self.broker.on_connect = self._begin
        self.broker.on_message = self._receive

    def begin(self, group: asyncio.TaskGroup) -> None:
        """Begin, in tasks of `group`."""
        group.create_task(self.broker.run())
        group.create_task(self._outbox.run())

    async def leave(self) -> None:
        """Send the queued answers."""
        await self._outbox.flush()

    def _receive(self, message: Received) -> None:
        received = asyncio.get_running_loop().time()
        if message.topic == self._pulse_topic:
            self._link.heard(message.payload)
            return
        if message.is_retained:  # nobody knows the age of the message
            return
        sender = Sender(message.response_topic, message.correlation)
        found = self._topics.parse(message.topic)
        names = tuple(self._bridges) if found is None else (found[0],)
        kind = message.topic.rpartition("/")[2]
        if kind == "echo":
            self._echo(names, message, sender, received)
        elif kind == "start":
            # The clock of a machine is its own, so a moment for all boards has no meaning.
            self._start(names, message, sender, received, is_for_one=found is not None)
        elif kind == "press":
            self._press(names[0], message)
        else:
            self._stop(names, message, sender)

    def _echo(self, names: Sequence[str], message: Received, sender: Sender, received: float) -> None:
        if (echo := _read(message.payload, Echo)) is not None:
            for name in names:
                self._answers[name].succeed(echo.id, sender, Echoed(received))

    def _stop(self, names: Sequence[str], message: Received, sender: Sender) -> None:
        command_id = read_stop(message.payload).id
        for name in names:
            self._bridges[name].stops.stop(command_id, sender, self._answers[name])

    def _press(self, name: str, message: Received) -> None:
        """Carry out a command without an id, which expires soon."""
        try:
            press = msgspec.json.decode(message.payload, type=Press)
        except UNREADABLE as error:
            self._bridges[name].telemetry.log("warning", f"a press cannot be read: {error}")
            return
        command = BoardCommand(f"press-{secrets.token_hex(8)}", press.method, press.params, press.who)
        asked = message._replace(payload=msgspec.json.encode(command), expiry=_PRESS_SECONDS)
        self._bridges[name].commands.receive(asked, self._link, lambda: None)

    async def _begin(self) -> None:
        self._link.begin()

    def _start(
        self, names: Sequence[str], message: Received, sender: Sender, received: float, *, is_for_one: bool
    ) -> None:
        start = _read(message.payload, Start)
        if start is None:
            return
        at = start.at if is_for_one and start.at is not None else received + _LEAD
        for name in names:
            bridge = self._bridges[name]
            if bridge.prepared.is_for(start.id):
                self._tasks.begin(self._begin_prepared(bridge, start.id, at, sender, received))
            else:
                bridge.telemetry.log("info", f"a start was not for {name}: nothing is prepared for {start.id}")

    async def _begin_prepared(self, bridge: Bridge, start: str, at: float, sender: Sender, received: float) -> None:
        answers = self._answers[bridge.board]
        try:
            moment = (await bridge.prepared.start(at)).monotonic
        except Exception as error:  # noqa: BLE001 - whatever prevents it is an answer
            answers.refuse(start, sender, error)
        else:
            answers.succeed(start, sender, Started(bridge.telemetry.now.host, round(moment - received, 6), moment))


def _read(payload: bytes, kind: Any) -> Any:
    try:
        return msgspec.json.decode(payload, type=kind)
    except UNREADABLE:
        return None
