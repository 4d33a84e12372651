"""Bridge between the hub of a board and the broker."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from functools import partial

from msgspec import Raw

from servolink.errors import OpenError
from servolink.fleet.access import BrokerAccess
from servolink.fleet.answers import Answers
from servolink.fleet.broker import BrokerConnection, Denied
from servolink.fleet.broker_messages import Publication, Received
from servolink.fleet.command_log import CommandLog
from servolink.fleet.commands import CommandHandler, Level
from servolink.fleet.home_assistant import Announcer, HomeAssistant
from servolink.fleet.hub_session import HubSession
from servolink.fleet.mqtt_client import MqttOptions
from servolink.fleet.outbox import Outbox
from servolink.fleet.policy import BoardPolicy
from servolink.fleet.pulse import Pulse, PulseLink, StopBarrier
from servolink.fleet.ready_run import ReadyRun
from servolink.fleet.stop_handler import StopHandler
from servolink.fleet.telemetry import Telemetry
from servolink.fleet.topics import OFFLINE, ONLINE, BoardTopic, Topics
from servolink.motion import StopCounter
from servolink.support import SleepCounter

SESSION_SECONDS = 300
"""Seconds for which the broker keeps commands for a board after a lost connection; most expire long before."""
_HEARD: tuple[BoardTopic, ...] = ("cmd", "pulse", "available")


class Bridge:
    """Bridge between a broker and a board that a hub of this machine shares."""

    def __init__(
        self,
        hub_name: str,
        board: str,
        access: BrokerAccess,
        topics: Topics,
        policy: BoardPolicy,
        command_log: CommandLog,
        *,
        hz: float,
    ) -> None:
        """Connect the board shared as `hub_name`, as `board`; `hz` is the rate of servo states in Hz."""
        self.board = board
        self.hub = HubSession(hub_name, policy, f"the fleet at {access.address}")
        will = Publication(topics.board(board, "available"), OFFLINE, 1, retain=True, content_type="text/plain")
        identifier = access.identifier(f"{topics.prefix}/{board}")
        options = MqttOptions(identifier, will=will, session_seconds=SESSION_SECONDS, acknowledges=True)
        self.broker = BrokerConnection(access, options)
        self.broker.subscriptions = [(topics.board(board, kind), 1) for kind in _HEARD]
        self.broker.on_message = self._receive
        self.broker.on_connect = self._begin
        self.broker.on_problem = partial(self._log, "error")
        self.outbox = Outbox(self.broker)
        stops = StopCounter(SleepCounter())
        self.prepared = ReadyRun(self.hub, stops)
        self.telemetry = Telemetry(
            topics, board, policy, self.hub, self.broker, self.outbox, hz, may_send=self.prepared.is_none
        )
        self.hub.on_connect = self.telemetry.begin
        self.hub.on_notification = self._hear
        self.hub.on_lost = self.telemetry.hub_lost
        self._topics = topics
        self._policy = policy
        self._announcer: Announcer | None = None
        self._birth_topic: str | None = None  # of Home Assistant, which may have forgotten the board
        self._available = will
        self._has_joined = False
        self._has_left = False
        self.pulse = Pulse(self._send_pulse)
        self._link = PulseLink(self.pulse)
        self.barrier = StopBarrier(self.pulse)
        """Barrier that is raised by each stop."""
        self.stops = StopHandler(self.hub, self.prepared, self.barrier, stops)
        self._answers = Answers(board, topics, self.outbox, command_log, on_problem=self.telemetry.problem)
        self.commands = CommandHandler(
            board, policy, self.hub, command_log, self._answers, self.prepared, self.stops, self.barrier, self._log
        )
        self.commands.on_change = self.telemetry.look_again

    def announce(self, home_assistant: HomeAssistant, kept: Mapping[str, bytes]) -> None:
        """Announce the board to Home Assistant; `kept` holds earlier documents retained by the broker, by topic."""
        self._announcer = Announcer(
            home_assistant, self._topics, self._policy, self.telemetry, self.outbox, self.broker, kept
        )
        self._birth_topic = home_assistant.birth_topic
        self.broker.subscriptions.append((self._birth_topic, 1))

    def follow(self, policy: BoardPolicy) -> None:
        """Allow from now on what `policy` allows; what is under way ends with the session of the hub."""
        if policy == self._policy:
            return
        self._policy = policy
        self.commands.follow(policy)
        self.telemetry.follow(policy)
        if self._announcer is not None:
            self._announcer.follow(policy)
        self.hub.follow(policy)
        self._log("info", f"the policy has changed: {policy.allow} is allowed from afar")

    def start(self, group: asyncio.TaskGroup) -> None:
        """Begin, in tasks of `group`. OpenError of the first attempt to reach broker or hub ends the group."""
        self.commands.finish_interrupted()
        for task in (
            self.hub.run(),
            self._run_broker(),
            self.outbox.run(),
            self.pulse.run(),
            self.telemetry.send_servos(),
            self.telemetry.send_state(),
        ):
            group.create_task(task)
        if self._announcer is not None:
            group.create_task(self._announcer.send_vitals())

    async def _run_broker(self) -> None:
        """Connect to the broker once the hub is there: commands that waited at the broker come at once."""
        await self.hub.has_begun.wait()
        await self.broker.run()

    async def leave(self) -> None:
        """Answer commands under way, and publish the board as unavailable."""
        await self.stops.close()
        await self.commands.close()
        self._has_left = True
        self.outbox.put(self._available)
        await self.outbox.flush()

    async def _begin(self) -> None:
        """Publish the board as available, on a new connection. Raise OpenError if the broker denies the first one."""
        self._link.begin()
        if self.barrier.is_up:
            self.barrier.put_up()
            self.barrier.send_word()
        try:
            await self.broker.send(self._available._replace(payload=ONLINE))
        except Denied as error:  # later, the connection reports it: an access list can be corrected meanwhile
            if not self._has_joined:
                raise OpenError(f"{self.board} has not joined: {error}") from error
        self._resend()
        self._has_joined = True

    def _resend(self) -> None:
        """Send again what is retained; before the board has joined, no document, which comes with the first facts."""
        self.telemetry.resend()
        if self._has_joined and self._announcer is not None:
            self._announcer.resend()

    async def _send_pulse(self, word: str, qos: int) -> None:
        topic = self._topics.board(self.board, "pulse")
        await self.broker.send(Publication(topic, word, qos, retain=True, content_type="text/plain"))

    def _receive(self, message: Received) -> None:
        if message.topic == self._topics.board(self.board, "pulse"):
            self._link.heard(message.payload)
            self.barrier.heard(message.payload)
            if self.pulse.shows_another(message.payload):
                self.telemetry.problem(
                    f"another program has joined as {self.board}, too, and each takes the other's place: give one of "
                    "the boards another name, with --name"
                )
            self.broker.acknowledge(message)
        elif message.topic == self._available.topic:
            if message.payload != ONLINE.encode() and not self._has_left:  # of a former connection, or of somebody else
                self.outbox.put(self._available._replace(payload=ONLINE))
            self.broker.acknowledge(message)
        elif message.topic == self._birth_topic:
            if message.payload == ONLINE.encode() and not message.is_retained:  # else before the board has joined
                self._resend()
            self.broker.acknowledge(message)
        else:
            self.commands.receive(message, self._link, partial(self.broker.acknowledge, message))

    def _hear(self, name: str, params: Raw) -> None:
        if name == "stopped":
            self.stops.stopped_here()
        self.telemetry.hear(name, params)

    def _log(self, level: Level, text: str) -> None:
        self.telemetry.log(level, text)
