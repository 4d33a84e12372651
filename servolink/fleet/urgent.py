"""Urgent: separate connection for stops and starts of all boards of a machine, undisturbed by floods of commands.

Stops of one board come this way too, and so does the message that starts several boards together: it arrives once for
all boards of a machine. A press comes this way because the broker keeps nothing for this connection while it is lost.
"""

from __future__ import annotations

import asyncio
import os
import secrets
import socket
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec

from servolink.fleet.access import BrokerAccess
from servolink.fleet.answers import Answers, Sender
from servolink.fleet.bridge import Bridge
from servolink.fleet.broker import BrokerConnection
from servolink.fleet.mqtt_client import MqttOptions
from servolink.fleet.outbox import Outbox
from servolink.fleet.publish_packets import Received
from servolink.fleet.pulse import PulseLink
from servolink.fleet.stop_handler import read_stop
from servolink.fleet.topics import UNREADABLE, Command, Echo, Echoed, Press, Start, Started, Topics
from servolink.tasks import Tasks

_PRESS_SECONDS = 5
_LEAD = 0.1
"""Seconds from a message that names no moment to the start."""


class Urgent:
    """The connection for stops, starts and echoes."""

    def __init__(self, access: BrokerAccess, topics: Topics, bridges: Sequence[Bridge]) -> None:
        self._topics = topics
        name = f"{topics.prefix}/_fleet/{socket.gethostname()}-{os.getpid()}"
        self.broker = BrokerConnection(access, MqttOptions(name, sees_retained=False))
        self._outbox = Outbox(self.broker)
        self._bridges: Mapping[str, Bridge] = {bridge.board: bridge for bridge in bridges}
        self._answers = {name: Answers(name, topics, self._outbox) for name in self._bridges}
        self._link = PulseLink(bridges[0].pulse)
        self._pulse_topic = topics.board(bridges[0].board, "pulse")
        self._tasks = Tasks()
        self.broker.subscriptions = [
            (topics.fleet("stop"), 1),
            (topics.fleet("start"), 1),
            (topics.fleet("echo"), 0),
            (self._pulse_topic, 0),
            *((topics.board(name, "stop"), 1) for name in self._bridges),
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
        if message.topic == self._topics.fleet("echo"):
            if (echo := _read(message.payload, Echo)) is not None:
                for name in set(self._answers) & set(echo.boards or self._answers):
                    self._answers[name].succeed(echo.id, sender, Echoed(received))
        elif message.topic == self._topics.fleet("start"):
            if (start := _read(message.payload, Start)) is not None:
                self._start(start, sender, received)
        elif message.topic.endswith("/press"):
            self._press(message)
        else:
            self._stop(message, sender)

    def _stop(self, message: Received, sender: Sender) -> None:
        command_id = read_stop(message.payload).id
        found = self._topics.parse(message.topic)
        for name in self._bridges if found is None else [found[0]]:
            self._bridges[name].stops.stop(command_id, sender, self._answers[name])

    def _press(self, message: Received) -> None:
        """Carry out a command without an id, which expires soon."""
        name, _ = self._topics.parse(message.topic) or ("", "")
        try:
            press = msgspec.json.decode(message.payload, type=Press)
        except UNREADABLE as error:
            self._bridges[name].telemetry.log("warning", f"a press cannot be read: {error}")
            return
        command = Command(f"press-{secrets.token_hex(8)}", press.method, press.params, press.who)
        asked = message._replace(payload=msgspec.json.encode(command), expiry=_PRESS_SECONDS)
        self._bridges[name].commands.receive(asked, self._link, lambda: None)

    async def _begin(self) -> None:
        self._link.begin()

    def _start(self, start: Start, sender: Sender, received: float) -> None:
        for name, bridge in self._bridges.items():
            if bridge.prepared.is_for(start.id):
                at = start.at.get(name, received + _LEAD)
                self._tasks.begin(self._begin_prepared(bridge, start.id, at, sender, received))
            elif not start.at or name in start.at:  # else the start names other boards of the fleet
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
