"""MqttThread: one MQTT connection, which a thread of its own reads and writes, so that any event loop can use it.

paho-mqtt speaks the protocol. All that it reports is handed to the event loop: one wake-up brings all that has come.
The thread is not that of paho's `loop_start`, which ends without a word when a broker sends what paho cannot read.
"""

from __future__ import annotations

import asyncio
import logging
import socket
import ssl
import threading
from collections import deque
from collections.abc import Awaitable, Callable, Coroutine
from contextlib import suppress
from dataclasses import dataclass
from selectors import EVENT_READ, EVENT_WRITE, DefaultSelector
from types import TracebackType
from typing import Any, NamedTuple, Self, TypeVar

from paho.mqtt import client as paho
from paho.mqtt.enums import CallbackAPIVersion, MQTTErrorCode
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode
from paho.mqtt.subscribeoptions import SubscribeOptions

from servolink.errors import ConnectionLost
from servolink.escaping import escape
from servolink.fleet.access import BrokerAccess
from servolink.fleet.topics import CONTENT_TYPE, MOST_BYTES

T = TypeVar("T")

KEEPALIVE = 10
"""Seconds without a message after which the broker must answer a ping."""

_LIMIT = 10.0  # seconds for the broker to answer
_GOODBYE = 1.0  # seconds for the thread to say that the connection ends
_LARGEST = 2 * MOST_BYTES  # bytes: a command that is too long arrives, and is answered
_MOST_EVENTS = 32
"""Events that wait for the event loop: with more, nothing is read, and the broker holds back what a flood brings."""
_WRONG_LOGIN = {4, 5, 134, 135}  # reason codes; the small ones are those of MQTT 3
_NO_PING = 141
_LOST = "the connection was lost"


class Received(NamedTuple):
    """A message from the broker."""

    topic: str
    payload: bytes
    qos: int
    is_retained: bool
    is_duplicate: bool
    packet_id: int
    """MQTT packet identifier, for the acknowledgement."""
    expiry: int | None
    """Seconds that were left when the broker sent the message; None for no limit."""
    response_topic: str | None
    correlation: bytes | None


class Publication(NamedTuple):
    """A message to send."""

    topic: str
    payload: bytes | str
    qos: int = 0
    retain: bool = False
    expiry: int | None = None
    """Seconds after which the broker drops the message."""
    response_topic: str | None = None
    correlation: bytes | None = None
    content_type: str = CONTENT_TYPE


@dataclass(frozen=True, slots=True)
class ConnectionOptions:
    """Identity of a connection, and how the broker treats it."""

    identifier: str
    """The broker keeps one connection for each identifier; a new one ends the one before."""
    will: Publication | None = None
    """Message that the broker sends if the connection is lost."""
    session_seconds: int = 0
    """Seconds after a loss for which the broker keeps messages."""
    acknowledges: bool = False
    """Whether messages with QoS 1 are acknowledged by calls of `acknowledge`, instead of at once."""
    sees_retained: bool = True
    """Whether `is_retained` says how a message was sent; else it says that the message was kept by the broker."""


class MqttThread:
    """One connection with a broker, as a context manager; all methods are for the event loop."""

    def __init__(
        self, access: BrokerAccess, options: ConnectionOptions, on_message: Callable[[Received], None]
    ) -> None:
        """Call `on_message` in the event loop with each message; an error that it raises is logged."""
        self.client = _new_client(access, options)
        self.ended: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        """Why the connection has ended; not done as long as it lasts."""
        self._loop = asyncio.get_running_loop()
        self._access = access
        self._options = options
        self._on_message = on_message
        self._connected: asyncio.Future[None] = self._loop.create_future()
        self._answers: dict[int, asyncio.Future[ReasonCode]] = {}
        self._events: deque[tuple[Callable[..., None], tuple[Any, ...]]] = deque()
        self._is_loop_woken = False
        self._has_room = threading.Event()
        self._is_closing = False
        self._alarm, self._alarm_end = socket.socketpair()
        for sock in (self._alarm, self._alarm_end):
            sock.settimeout(0)
        self._thread = threading.Thread(target=self._run, name=f"mqtt {options.identifier}", daemon=True)

    async def __aenter__(self) -> Self:
        """Connect. Raise OSError or ValueError if that fails."""
        self._thread.start()
        try:
            await _limited(self._connected)
        except BaseException:
            await self._close()
            raise
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Disconnect. Wherever an answer of the broker is waited for, ConnectionLost is raised."""
        await self._close()

    async def unless_lost(self, work: Coroutine[Any, Any, None]) -> None:
        """Do some work. Raise ConnectionLost as soon as the connection ends."""
        task = asyncio.ensure_future(work)
        try:
            await asyncio.wait((task, self.ended), return_when=asyncio.FIRST_COMPLETED)
            if not task.done():
                raise ConnectionLost(await self.ended)
        finally:
            task.cancel()
            await asyncio.wait((task,))
        await task

    async def subscribe(self, topic: str, qos: int) -> str | None:
        """Subscribe to a topic. Return why the broker refuses, None if it does not."""
        options = SubscribeOptions(qos, retainAsPublished=self._options.sees_retained)
        code, packet_id = self.client.subscribe(topic, options=options)
        return await _limited(self._answer(code, packet_id))

    async def publish(self, message: Publication) -> str | None:
        """Send a message. Return why the broker refuses it, None if it does not.

        Without QoS it is sent when the system has it. Raise ConnectionLost if the connection ends before.
        """
        info = self.client.publish(*message[:4], properties=_properties(message))
        return await self._answer(info.rc, info.mid)

    def acknowledge(self, message: Received) -> None:
        """Acknowledge a message."""
        self.client.ack(message.packet_id, message.qos)

    async def _answer(self, code: MQTTErrorCode, packet_id: int | None) -> str | None:
        if code != MQTTErrorCode.MQTT_ERR_SUCCESS or packet_id is None or self.ended.done():
            raise ConnectionLost(f"the connection with the broker is lost: {paho.error_string(code)}")
        future = self._answers[packet_id] = self._loop.create_future()
        try:
            answer = await future
        finally:
            self._answers.pop(packet_id, None)
        return str(answer).lower() if answer.is_failure else None

    async def _close(self) -> None:
        self._is_closing = True
        self._has_room.set()
        self.client.disconnect()
        if self.client.socket() is not None:  # else the thread may be connecting, which takes seconds
            await asyncio.wait((self.ended,), timeout=_GOODBYE)
        sock: Any = self.client.socket()
        if sock is not None:
            with suppress(OSError):
                sock.shutdown(socket.SHUT_RDWR)
        self._finish(_LOST)

    # --- events, in the event loop -------------------------------------------------------------------------------

    def _take_events(self) -> None:
        self._is_loop_woken = False
        for _ in range(len(self._events)):  # those that come meanwhile have another turn
            function, arguments = self._events.popleft()
            function(*arguments)
        self._has_room.set()

    def _receive(self, message: paho.MQTTMessage) -> None:
        try:
            self._on_message(_received(message))
        except Exception:  # it would end the connection
            _logger.exception("a message could not be handled")
            self.client.ack(message.mid, message.qos)

    def _take_answer(self, packet_id: int, code: ReasonCode) -> None:
        future = self._answers.get(packet_id)
        if future is not None and not future.done():
            future.set_result(code)

    def _begin(self, refusal: Exception | None) -> None:
        if self._connected.done():
            return
        if refusal is None:
            self._connected.set_result(None)
        else:
            self._connected.set_exception(refusal)

    def _finish(self, reason: str, error: Exception | None = None) -> None:
        self._begin(error or ConnectionError("the connection was closed before the broker answered"))
        if not self.ended.done():
            self.ended.set_result(reason)
        for future in self._answers.values():
            if not future.done():
                future.set_exception(ConnectionLost("the connection with the broker was lost"))

    # --- the thread ----------------------------------------------------------------------------------------------

    def _run(self) -> None:
        client, error = self.client, None
        client.on_socket_register_write = lambda *_: self._ring()  # without it, paho would write in the event loop
        client.on_socket_open = _send_at_once
        client.on_connect = lambda _client, _data, _flags, code, _properties: self._post(self._begin, _refusal(code))
        client.on_subscribe = lambda _client, _data, packet_id, codes, _properties: self._post(
            self._take_answer, packet_id, codes[0]
        )
        client.on_publish = lambda _client, _data, packet_id, code, _properties: self._post(
            self._take_answer, packet_id, code
        )
        client.on_message = lambda _client, _data, message: self._post_message(message)
        client.on_disconnect = lambda _client, _data, flags, code, _properties: self._post(
            self._finish, _ending(flags, code)
        )
        try:
            client.connect(
                self._access.address.host,
                self._access.address.port,
                KEEPALIVE,
                clean_start=not self._options.session_seconds,
                properties=_connect_properties(self._options),
            )
            if self._is_closing:
                client.disconnect()
            self._serve()
        except Exception as raised:  # noqa: BLE001 - whatever a broker makes paho raise, the connection is lost
            error = raised
        finally:
            with suppress(RuntimeError):  # the event loop has ended
                self._post(self._finish, _LOST, error)
            for sock in (self._alarm, self._alarm_end, client.socket()):
                if sock is not None:
                    sock.close()
            client.on_message = client.on_connect = client.on_subscribe = client.on_publish = None
            client.on_disconnect = client.on_socket_register_write = None  # they refer to this, which refers to it

    def _serve(self) -> None:
        client = self.client
        with DefaultSelector() as selector:
            selector.register(self._alarm_end, EVENT_READ)
            sock: Any = client.socket()
            selector.register(sock, EVENT_READ)
            while (
                client.loop_write() == MQTTErrorCode.MQTT_ERR_SUCCESS
                and client.loop_misc() == MQTTErrorCode.MQTT_ERR_SUCCESS
            ):
                selector.modify(sock, EVENT_READ | EVENT_WRITE if client.want_write() else EVENT_READ)
                is_pending = isinstance(sock, ssl.SSLSocket) and sock.pending()
                ready = {key.fileobj for key, _ in selector.select(0 if is_pending else 1)}
                if self._alarm_end in ready:
                    self._alarm_end.recv(4096)
                if (is_pending or sock in ready) and client.loop_read() != MQTTErrorCode.MQTT_ERR_SUCCESS:
                    return

    def _ring(self) -> None:
        """Wake the thread: there is something to write."""
        with suppress(OSError):  # rung often already; or the connection has ended
            self._alarm.send(b"\0")

    def _post(self, function: Callable[..., None], *arguments: Any) -> None:
        self._events.append((function, arguments))
        if not self._is_loop_woken:
            self._is_loop_woken = True
            self._loop.call_soon_threadsafe(self._take_events)

    def _post_message(self, message: paho.MQTTMessage) -> None:
        self._post(self._receive, message)
        while not self._is_closing:
            self._has_room.clear()
            if len(self._events) < _MOST_EVENTS:
                return
            self._has_room.wait()


_logger = logging.getLogger(__name__)


def _new_client(access: BrokerAccess, options: ConnectionOptions) -> paho.Client:
    client = paho.Client(
        CallbackAPIVersion.VERSION2,
        options.identifier,
        protocol=paho.MQTTv5,
        reconnect_on_failure=False,
        manual_ack=options.acknowledges,
    )
    if access.user is not None:
        client.username_pw_set(access.user, access.password)
    if access.tls is not None:
        client.tls_set_context(access.tls)
    if (will := options.will) is not None:
        client.will_set(*will[:4], properties=_properties(will))
    return client


def _send_at_once(client: paho.Client, data: Any, sock: Any) -> None:
    """Have messages sent at once, not when the broker has confirmed the one before, up to 40 ms later."""
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)


def _refusal(code: ReasonCode) -> Exception | None:
    if not code.is_failure:
        return None
    if code.value in _WRONG_LOGIN:
        return ConnectionError("the broker does not let this program in: correct user and password")
    return ConnectionError(f"the broker refuses the connection: {escape(str(code)).lower()}")


def _ending(flags: paho.DisconnectFlags, code: ReasonCode) -> str:
    is_silent = code.value == _NO_PING and not flags.is_disconnect_packet_from_server
    return _no_answer(KEEPALIVE) if is_silent else _LOST


def _no_answer(seconds: float) -> str:
    return f"the broker has not answered for {seconds:g} s"


async def _limited(answer: Awaitable[T]) -> T:
    """Return an answer of the broker. Raise TimeoutError if there is none in time."""
    try:
        async with asyncio.timeout(_LIMIT):
            return await answer
    except TimeoutError:
        raise TimeoutError(_no_answer(_LIMIT)) from None


def _received(message: paho.MQTTMessage) -> Received:
    properties: Any = message.properties
    return Received(
        message.topic,
        bytes(message.payload),
        message.qos,
        message.retain,
        message.dup,
        message.mid,
        getattr(properties, "MessageExpiryInterval", None),
        getattr(properties, "ResponseTopic", None),
        getattr(properties, "CorrelationData", None),
    )


def _connect_properties(options: ConnectionOptions) -> Properties:
    properties = _new_properties(PacketTypes.CONNECT)
    properties.MaximumPacketSize = _LARGEST
    if options.session_seconds:
        properties.SessionExpiryInterval = options.session_seconds
    return properties


def _properties(message: Publication) -> Properties:
    properties = _new_properties(PacketTypes.PUBLISH)
    properties.ContentType = message.content_type
    if message.expiry is not None:
        properties.MessageExpiryInterval = message.expiry
    if message.response_topic is not None:
        properties.ResponseTopic = message.response_topic
    if message.correlation is not None:
        properties.CorrelationData = message.correlation
    return properties


def _new_properties(packet_type: int) -> Properties:
    return Properties(packet_type)  # type: ignore[no-untyped-call] # its attributes are made as it runs
