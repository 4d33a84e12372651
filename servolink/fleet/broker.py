"""BrokerConnection: connection of a program with a broker, renewed after each loss.

The reason that the broker gives for each refusal is passed on, so that a topic which it denies can be named.
"""

from __future__ import annotations

import asyncio
import secrets
import socket
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress
from random import Random

from servolink.errors import ConnectionLost, OpenError, escape
from servolink.fleet.access import BrokerAccess
from servolink.fleet.broker_messages import Publication, Received
from servolink.fleet.mqtt_client import MqttClient, MqttOptions
from servolink.support import Pauses, Reconnecting, reason

FIRST_PAUSE = 0.2
"""Seconds from a loss to the first attempt."""
LONGEST_PAUSE = 20.0
REMEDY = "correct its access list: that of docs/how-to/fleet-classroom.md has changed, with the topics of answers"
"""Remedy for a topic that the broker keeps from a program."""
_QUIET = 0.3  # seconds without a message after which the retained messages count as complete


class Denied(OpenError):
    """The broker does not allow a topic."""


class BrokerConnection:
    """Connection with a broker, renewed after each loss."""

    def __init__(self, access: BrokerAccess, options: MqttOptions) -> None:
        """Use `run`, in a separate task, after the functions are set."""
        self.access = access
        self.subscriptions: list[tuple[str, int]] = []
        """Topics and QoS, subscribed to on each connection; a later QoS of a topic holds for new messages only."""
        self.on_message: Callable[[Received], None] = lambda message: None
        """Called with each message."""
        self.on_connect: Callable[[], Awaitable[None]] | None = None
        """Awaited on each connection, when the topics are subscribed to."""
        self.on_state: Callable[[bool, str], None] = lambda is_connected, text: None
        """Called when the connection is there or lost, with the reason."""
        self.on_problem: Callable[[str], None] = lambda text: None
        """Called with a notice for people, such as a denied topic; once for each text."""
        self._options = options
        self._client: MqttClient | None = None
        self._was_connected = False
        self._ready = asyncio.Event()
        self._reported: set[str] = set()
        self._jitter = Random(options.identifier)  # noqa: S311 - not a secret

    @property
    def is_connected(self) -> bool:
        """Whether the connection is there."""
        return self._client is not None

    async def until_connected(self) -> None:
        """Return when the connection is there and `on_connect` has returned."""
        await self._ready.wait()

    async def run(self) -> None:
        """Connect, and again after each loss. Raise OpenError if the first attempt fails."""
        # With jitter, so that programs do not all reconnect together after a restart of the broker.
        pauses = Pauses(FIRST_PAUSE, LONGEST_PAUSE, lambda: self._jitter.uniform(0.5, 1))
        async for client in Reconnecting(self._open, pauses, self._may_come_back):
            self._was_connected = True
            pauses.restart()
            try:
                await asyncio.wait((client.ended,))
            finally:
                await self._drop(client)
            self._report_loss(client.ended.result())

    async def send(self, message: Publication) -> None:
        """Send a message; return when the system accepts the message or, with QoS 1, when the broker confirms.

        Raise ConnectionLost if there is no connection, or it is lost meanwhile: then the broker may have it or not.
        Raise Denied if the broker does not allow the topic, which it says for QoS 1 only.
        """
        if self._client is None:
            raise ConnectionLost(f"not connected to {self.access.address}")
        refusal = await self._client.publish(message)
        if refusal is not None:
            text = f"the broker does not allow writing to {escape(message.topic)}: {refusal}; {REMEDY}"
            self._report(text)
            raise Denied(text)

    def acknowledge(self, message: Received) -> None:
        """Acknowledge a message with QoS 1 at the broker, which then does not deliver the message again."""
        if self._client is not None:
            self._client.acknowledge(message)

    async def _open(self) -> MqttClient:
        """Return a connection with subscriptions to the topics."""
        client = MqttClient(self.access, self._options, self.on_message)
        try:
            await client.open()
            self._client = client
            await client.unless_lost(self._begin(client))
        except BaseException:
            await self._drop(client)
            raise
        return client

    async def _drop(self, client: MqttClient) -> None:
        """Close a connection, so that senders and subscribers wait for the next connection."""
        self._client = None
        self._ready.clear()
        await client.close()

    def _may_come_back(self, error: Exception) -> bool:
        """Return whether to connect again after an error. Raise OpenError for the first attempt."""
        if not isinstance(error, (OSError, ValueError, ConnectionLost)):
            return False
        if not self._was_connected:
            raise OpenError(f"{self.access.address}: {explain(error)}") from error
        self._report_loss(explain(error))
        return True

    def _report_loss(self, reason: str) -> None:
        self.on_state(False, f"{self.access.address}: {reason}")  # noqa: FBT003 - the only argument of its kind

    async def _begin(self, client: MqttClient) -> None:
        before = set[str]()
        for topic, qos in self.subscriptions:
            refusal = await client.subscribe(topic, qos, with_retained=topic not in before)
            before.add(topic)
            if refusal is not None:
                self._report(f"the broker does not allow reading {escape(topic)}: {refusal}; {REMEDY}")
        if self.on_connect is not None:
            await self.on_connect()
        self._ready.set()
        self.on_state(True, "")  # noqa: FBT003 - the only argument of its kind

    def _report(self, text: str) -> None:
        if text not in self._reported:
            self._reported.add(text)
            self.on_problem(text)


def explain(error: Exception) -> str:
    """Return the reason why a broker cannot be reached, with a remedy."""
    if isinstance(error, socket.gaierror | UnicodeError):
        return "there is no host of this name: correct the name, or write its IP address"
    if isinstance(error, TimeoutError):
        return "no answer: check the address, the network and the firewall"
    text = escape(reason(error)) or type(error).__name__
    if "CERTIFICATE_VERIFY_FAILED" in text:
        return f"the broker's certificate is not trusted ({text}): name the authority that has signed it with --ca"
    if "refused" in text.lower():
        return f"no broker listens there ({text}): start it, or correct the address"
    return text


async def retained(access: BrokerAccess, filters: Sequence[str]) -> dict[str, bytes]:
    """Return the retained messages of one or more topics. Raise OpenError if the broker does not answer."""
    found: dict[str, bytes] = {}
    heard = asyncio.Event()

    def take(message: Received) -> None:
        if message.is_retained:  # a program that sends all the time cannot prolong the wait
            found[message.topic] = message.payload
            heard.set()

    broker = BrokerConnection(access, MqttOptions(f"servolink-look-{secrets.token_hex(8)}", sees_retained=False))
    broker.on_message = take
    # A broker answers in order: after the second confirmation of the first topic, all retained messages are here. With
    # QoS 1 the broker would wait for acknowledgements in between.
    broker.subscriptions = [(each, 0) for each in (*filters, filters[0])]
    connection = asyncio.create_task(broker.run())
    connected = asyncio.create_task(broker.until_connected())
    try:
        await asyncio.wait((connection, connected), return_when=asyncio.FIRST_COMPLETED)
        if connection.done():
            await connection
        with suppress(TimeoutError):  # brokers of several machines may answer in another order
            while True:
                heard.clear()
                async with asyncio.timeout(_QUIET):
                    await heard.wait()
    finally:
        for task in (connection, connected):
            task.cancel()
        await asyncio.wait((connection, connected))
    return found
