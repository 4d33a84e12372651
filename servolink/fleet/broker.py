"""Wire: one connection with a broker, which comes back by itself.

`aiomqtt` connects, and ties paho-mqtt to the event loop. Messages are passed to a function in the turn in which they
came, not through its queue: nothing can fill up, and the broker's flow control holds back what a flood brings. What is
sent is answered by the broker's own reason, so that a topic which it denies is known.
"""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Awaitable, Callable, Coroutine
from dataclasses import dataclass
from random import Random
from typing import Any, NamedTuple, NoReturn

import aiomqtt
from aiomqtt.exceptions import MqttConnectError
from paho.mqtt import client as paho
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode
from paho.mqtt.subscribeoptions import SubscribeOptions

from servolink.errors import ConnectionLost, OpenError
from servolink.escaping import escape
from servolink.fleet.access import BrokerAccess
from servolink.fleet.topics import CONTENT_TYPE, MOST_BYTES

FIRST_PAUSE = 0.2
"""Seconds from a loss to the first attempt; each further pause is twice as long."""
LONGEST_PAUSE = 20.0
KEEPALIVE = 10
"""Seconds without a message after which the broker is asked whether it is there."""

_LIMIT = 10.0  # seconds for the broker to answer
_ABOVE_MOST = 2 * MOST_BYTES  # bytes: a command that is too long arrives, and is answered
_FAILURE = 128  # reason codes from here on
_NOT_AUTHORIZED = 135
_PROTOCOL = aiomqtt.ProtocolVersion.V5

_logger = logging.getLogger(__name__)
_quiet = logging.getLogger(f"{__name__}.mqtt")
_quiet.setLevel(logging.CRITICAL)  # what matters is raised, and said once


class Received(NamedTuple):
    """A message."""

    topic: str
    payload: bytes
    qos: int
    is_retained: bool
    is_duplicate: bool
    number: int
    """By which it is acknowledged."""
    expiry: int | None
    """Seconds that were left when the broker sent it; None for no limit."""
    response_topic: str | None
    correlation: bytes | None


class Publication(NamedTuple):
    """A message to send."""

    topic: str
    payload: bytes | str
    qos: int = 0
    retain: bool = False
    expiry: int | None = None
    """Seconds after which the broker drops it."""
    response_topic: str | None = None
    correlation: bytes | None = None
    content_type: str = CONTENT_TYPE


class Denied(OpenError):
    """The broker does not allow a topic."""


@dataclass(frozen=True, slots=True)
class WireOptions:
    """Who connects, and how."""

    identifier: str
    """The broker keeps one connection for each; a new one ends the one before."""
    will: Publication | None = None
    """What the broker sends if the connection is lost."""
    session_seconds: int = 0
    """How long the broker keeps what comes meanwhile, after a loss."""
    acknowledges: bool = False
    """Whether messages with QoS 1 are acknowledged by calls of `acknowledge`, instead of at once."""
    sees_retained: bool = True
    """Whether `is_retained` says how a message was sent; else it says that the message was kept by the broker."""


class Wire:
    """One connection with a broker."""

    def __init__(self, access: BrokerAccess, options: WireOptions) -> None:
        """Use `run`, in a task of its own, after the functions are set."""
        self.access = access
        self.subscriptions: list[tuple[str, int]] = []
        """Topics and QoS, subscribed to on each connection."""
        self.on_message: Callable[[Received], None] = lambda message: None
        """Called with each message, in the turn in which it came."""
        self.on_connect: Callable[[], Awaitable[None]] | None = None
        """Awaited on each connection, when the topics are subscribed to."""
        self.on_state: Callable[[bool, str], None] = lambda is_connected, text: None
        """Called when the connection is there or lost, with the reason."""
        self.on_problem: Callable[[str], None] = lambda text: None
        """Called with what people should look at, such as a topic that is denied; once for each text."""
        self._options = options
        self._client: _Client | None = None
        self._ready = asyncio.Event()
        self._told: set[str] = set()
        self._jitter = Random(options.identifier)  # noqa: S311 - not a secret

    @property
    def is_connected(self) -> bool:
        """Whether the connection is there."""
        return self._client is not None

    async def until_connected(self) -> None:
        """Return when the connection is there and `on_connect` has returned."""
        await self._ready.wait()

    async def run(self) -> NoReturn:
        """Connect, and again after each loss. Raise OpenError if the first attempt fails."""
        was_connected, pause = False, FIRST_PAUSE
        while True:
            try:
                async with self._new_client() as client:
                    self._client = client
                    try:
                        await client.unless_lost(self._begin(client))
                        was_connected, pause = True, FIRST_PAUSE
                        await client.until_lost()
                    finally:
                        self._client = None
                        self._ready.clear()
                        client.fail_all()
            except (aiomqtt.MqttError, OSError, ValueError, ConnectionLost) as error:
                text = f"{self.access.address}: {explain(error)}"
                if not was_connected:
                    raise OpenError(text) from error
                self.on_state(False, text)  # noqa: FBT003 - the only argument of its kind
            await asyncio.sleep(pause * self._jitter.uniform(0.5, 1))  # not all at once, after the broker has restarted
            pause = min(2 * pause, LONGEST_PAUSE)

    async def send(self, message: Publication) -> None:
        """Send a message; return when the system has it or, with QoS 1, when the broker has it.

        Raise ConnectionLost if there is no connection, or it is lost meanwhile: then the broker may have it or not.
        Raise Denied if the broker does not allow the topic, which it says for QoS 1 only.
        """
        if self._client is None:
            raise ConnectionLost(f"there is no connection with {self.access.address}")
        refusal = await self._client.send(message)
        if refusal is not None:
            text = f"the broker does not allow writing to {escape(message.topic)}: {refusal}; correct its access list"
            self._tell(text)
            raise Denied(text)

    def acknowledge(self, message: Received) -> None:
        """Tell the broker that a message with QoS 1 need not be delivered again."""
        if self._client is not None:
            self._client.acknowledge(message)

    def _new_client(self) -> _Client:
        return _Client(self.access, self._options, self.on_message)

    async def _begin(self, client: _Client) -> None:
        for topic, qos in self.subscriptions:
            refusal = await client.listen(topic, qos)
            if refusal is not None:
                self._tell(f"the broker does not allow reading {escape(topic)}: {refusal}; correct its access list")
        if self.on_connect is not None:
            await self.on_connect()
        self._ready.set()
        self.on_state(True, "")  # noqa: FBT003 - the only argument of its kind

    def _tell(self, text: str) -> None:
        if text not in self._told:
            self._told.add(text)
            self.on_problem(text)


class _Client(aiomqtt.Client):
    """Passes each message to a function, and knows what the broker answers to what was sent."""

    def __init__(self, access: BrokerAccess, options: WireOptions, on_message: Callable[[Received], None]) -> None:
        will = options.will
        super().__init__(
            access.address.host,
            access.address.port,
            username=access.user,
            password=access.password,
            tls_context=access.tls,
            identifier=options.identifier,
            protocol=_PROTOCOL,
            clean_start=not options.session_seconds,
            properties=_connect_properties(options),
            will=will and aiomqtt.Will(will.topic, will.payload, will.qos, will.retain, _properties(will)),
            keepalive=KEEPALIVE,
            timeout=_LIMIT,
            logger=_quiet,
            # Or a message waits up to 40 ms for the broker to confirm the one before: an acknowledgement, usually.
            socket_options=[(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)],
        )
        self._client.manual_ack_set(options.acknowledges)
        self._receive = on_message
        self._sees_retained = options.sees_retained
        self._sent: dict[int, asyncio.Future[str | None]] = {}

    async def until_lost(self) -> None:
        """Return or raise when the connection ends."""
        await asyncio.shield(self._disconnected)

    async def unless_lost(self, work: Coroutine[Any, Any, None]) -> None:
        """Do some work. Raise the reason as soon as the connection ends: aiomqtt would wait for its answers."""
        task = asyncio.ensure_future(work)
        try:
            await asyncio.wait((task, self._disconnected), return_when=asyncio.FIRST_COMPLETED)
            if not task.done():
                await self.until_lost()
                raise ConnectionLost("the connection with the broker was lost")
        finally:
            task.cancel()
            await asyncio.wait((task,))
        await task

    async def listen(self, topic: str, qos: int) -> str | None:
        """Subscribe to a topic. Return why the broker refuses, None if it does not."""
        [code] = await self.subscribe(topic, options=SubscribeOptions(qos, retainAsPublished=self._sees_retained))
        return _refusal(code)

    async def send(self, message: Publication) -> str | None:
        """Send a message. Return why the broker refuses it, None if it does not."""
        info = self._client.publish(*message[:4], properties=_properties(message))
        if info.rc != paho.MQTT_ERR_SUCCESS:
            raise ConnectionLost(f"the connection with the broker is lost: {paho.error_string(info.rc)}")
        if info.is_published():
            return None
        future: asyncio.Future[str | None] = asyncio.get_running_loop().create_future()
        self._sent[info.mid] = future
        try:
            return await future
        finally:
            self._sent.pop(info.mid, None)

    def acknowledge(self, message: Received) -> None:
        """Acknowledge a message."""
        self._client.ack(message.number, message.qos)

    def fail_all(self) -> None:
        """Raise ConnectionLost wherever an answer of the broker is waited for."""
        for future in self._sent.values():
            if not future.done():
                future.set_exception(ConnectionLost("the connection with the broker was lost"))

    def _on_message(self, client: paho.Client, userdata: Any, message: paho.MQTTMessage) -> None:
        try:
            self._receive(_received(message))
        except Exception:  # it would end the connection
            _logger.exception("a message could not be handled")
            client.ack(message.mid, message.qos)

    def _on_disconnect(
        self,
        client: paho.Client,
        userdata: Any,
        flags: paho.DisconnectFlags,
        reason_code: ReasonCode,
        properties: Properties | None = None,
    ) -> None:
        if self._connected.done():
            super()._on_disconnect(client, userdata, flags, reason_code, properties)
        else:  # aiomqtt would wait for the broker's answer, ten seconds long
            self._connected.set_exception(aiomqtt.MqttError("the connection was closed before the broker answered"))

    def _on_socket_register_write(self, client: paho.Client, userdata: Any, sock: Any) -> None:
        """Have the loop write to the socket, unless it is closed by then.

        aiomqtt would give the loop its number for the next turn. A connection that is lost in this one has closed it.
        """

        def write() -> None:
            try:
                client.loop_write()
            except Exception as error:  # noqa: BLE001 - as aiomqtt does: the connection is lost
                if not self._disconnected.done():
                    self._disconnected.set_exception(error)

        def watch() -> None:
            if sock.fileno() >= 0:
                self._loop.add_writer(sock.fileno(), write)

        self._loop.call_soon_threadsafe(watch)  # the first time in the thread that connects

    def _on_publish(
        self, client: paho.Client, userdata: Any, mid: int, reason_code: ReasonCode, properties: Properties
    ) -> None:
        future = self._sent.get(mid)
        if future is not None and not future.done():
            future.set_result(_refusal(reason_code))


def _received(message: paho.MQTTMessage) -> Received:
    told: Any = message.properties
    return Received(
        message.topic,
        bytes(message.payload),
        message.qos,
        message.retain,
        message.dup,
        message.mid,
        getattr(told, "MessageExpiryInterval", None),
        getattr(told, "ResponseTopic", None),
        getattr(told, "CorrelationData", None),
    )


def _refusal(code: Any) -> str | None:
    value = getattr(code, "value", code)
    return None if not isinstance(value, int) or value < _FAILURE else str(code).lower()


def _connect_properties(options: WireOptions) -> Any:
    properties = _new_properties(PacketTypes.CONNECT)
    properties.MaximumPacketSize = _ABOVE_MOST
    if options.session_seconds:
        properties.SessionExpiryInterval = options.session_seconds
    return properties


def _properties(message: Publication) -> Any:
    properties = _new_properties(PacketTypes.PUBLISH)
    properties.ContentType = message.content_type
    if message.expiry is not None:
        properties.MessageExpiryInterval = message.expiry
    if message.response_topic is not None:
        properties.ResponseTopic = message.response_topic
    if message.correlation is not None:
        properties.CorrelationData = message.correlation
    return properties


def _new_properties(packet_type: int) -> Any:
    return Properties(packet_type)  # type: ignore[no-untyped-call] # its attributes are made as it runs


def explain(error: Exception) -> str:
    """Return why a broker cannot be reached, and what to do."""
    if isinstance(error, aiomqtt.MqttCodeError) and getattr(error.rc, "value", error.rc) in {
        134,
        _NOT_AUTHORIZED,
        4,
        5,
    }:
        return "the broker does not let this program in: correct user and password"
    if isinstance(error, aiomqtt.MqttCodeError) and isinstance(error.rc, int) and error.rc == paho.MQTT_ERR_KEEPALIVE:
        return f"the broker has not answered for {KEEPALIVE} s"
    if isinstance(error, aiomqtt.MqttCodeError) and not isinstance(error, MqttConnectError):
        return "the connection was lost"
    text = escape(str(error)) or type(error).__name__
    if "CERTIFICATE_VERIFY_FAILED" in text:
        return f"the broker's certificate is not trusted ({text}): name the authority that has signed it with --ca"
    if "refused" in text.lower():
        return f"no broker listens there ({text}): start it, or correct the address"
    return text
