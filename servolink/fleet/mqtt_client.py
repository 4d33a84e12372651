"""MqttClient: MQTT connection of paho-mqtt, whose messages are handled in the event loop.

paho-mqtt reads and writes in a thread of its own, as `loop_start` does on all systems; a `HandOver` brings to the
event loop what the thread has received. Sending is safe from the event loop: paho-mqtt queues packets for its thread.
"""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Awaitable, Callable, Coroutine
from contextlib import suppress
from copy import copy
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, TypeVar

from paho.mqtt import client as paho
from paho.mqtt.enums import CallbackAPIVersion, MQTTErrorCode
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode
from paho.mqtt.subscribeoptions import SubscribeOptions

from servolink.errors import ConnectionLost, escape
from servolink.fleet.access import BrokerAccess
from servolink.fleet.broker_messages import Publication, Received
from servolink.fleet.hand_over import HandOver
from servolink.fleet.topics import MOST_BYTES

T = TypeVar("T")

KEEPALIVE = 10
"""Seconds without a message after which the broker must answer a ping."""

_LIMIT = 10.0  # seconds for the broker to answer
_FAREWELL = 0.5  # seconds for the last packets at the end
_LARGEST = 2 * MOST_BYTES  # bytes: a command beyond the size limit arrives, and is answered
_ROOM = 128 * 1024  # bytes of messages that wait for the event loop
_OVERHEAD = 512  # bytes that a message takes beside its payload
_WRONG_LOGIN = {4, 5, 134, 135}  # reason codes; the small ones are from MQTT 3
_NO_PING = 141
_LOST = "the connection was lost"
_logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class MqttOptions:
    """Identity of a connection, and settings for the broker."""

    identifier: str
    """Identifier of the client; at the broker, a new connection ends an earlier one with the same identifier."""
    will: Publication | None = None
    """Message that the broker sends if the connection is lost."""
    session_seconds: int = 0
    """Seconds for which the broker keeps messages after a loss."""
    acknowledges: bool = False
    """Whether messages with QoS 1 are acknowledged by calls of `acknowledge`, instead of when they are handed over."""
    sees_retained: bool = True
    """Whether `is_retained` holds the sender's flag; else the flag shows that the broker kept the message."""


class MqttClient:
    """Connection with a broker, over TCP or TLS."""

    def __init__(self, access: BrokerAccess, options: MqttOptions, on_message: Callable[[Received], None]) -> None:
        """Call `on_message` with each message; errors of the callback are logged."""
        self._loop = asyncio.get_running_loop()
        self.ended: asyncio.Future[str] = self._loop.create_future()
        """Reason of the connection's end; pending while the connection lasts."""
        self._access = access
        self._options = options
        self._on_message = on_message
        self._connected: asyncio.Future[None] = self._loop.create_future()
        self._answers: dict[int, asyncio.Future[ReasonCode]] = {}
        self._hand_over = HandOver(_ROOM)
        self._is_closed = False
        self._has_ended = asyncio.Event()
        self._client = self._new_client()

    async def open(self) -> None:
        """Connect. Raise OSError or ValueError on failure; then call `close`, too."""
        self._client.connect_async(
            self._access.address.host,
            self._access.address.port,
            KEEPALIVE,
            clean_start=not self._options.session_seconds,
            properties=_properties(
                PacketTypes.CONNECT,
                MaximumPacketSize=_LARGEST,
                SessionExpiryInterval=self._options.session_seconds or None,
            ),
        )
        self._client.loop_start()
        await _limited(self._connected)

    async def close(self) -> None:
        """Disconnect. Wherever an answer of the broker is waited for, ConnectionLost is raised."""
        self._is_closed = True
        self._finish(_LOST)
        self._hand_over.close()
        self._client.disconnect()
        try:
            if self.socket is not None:  # the thread sends the last packets
                async with asyncio.timeout(_FAREWELL):
                    await self._has_ended.wait()
        except TimeoutError:
            pass
        finally:
            if (sock := self.socket) is not None:  # the broker takes nothing any more
                with suppress(OSError):
                    sock.shutdown(socket.SHUT_RDWR)

    @property
    def socket(self) -> Any:
        """Socket of the connection; None after the end."""
        return self._client.socket()

    async def unless_lost(self, work: Coroutine[Any, Any, None]) -> None:
        """Do some work. Raise ConnectionLost as soon as the connection ends."""
        task = asyncio.ensure_future(work)
        try:
            await asyncio.wait((task, self.ended), return_when=asyncio.FIRST_COMPLETED)
            if not task.done():
                raise ConnectionLost(self.ended.result())
        finally:
            task.cancel()
            await asyncio.wait((task,))
        await task

    async def subscribe(self, topic: str, qos: int, *, with_retained: bool = True) -> str | None:
        """Subscribe to a topic, with its retained messages or without. Return the reason for a refusal, else None."""
        options = SubscribeOptions(
            qos,
            retainAsPublished=self._options.sees_retained,
            retainHandling=SubscribeOptions.RETAIN_SEND_ON_SUBSCRIBE
            if with_retained
            else SubscribeOptions.RETAIN_DO_NOT_SEND,
        )
        code, packet_id = self._client.subscribe(topic, options=options)
        return await _limited(self._answer(code, packet_id))

    async def publish(self, message: Publication) -> str | None:
        """Send a message. Return the broker's reason for a refusal, else None.

        Without QoS it is sent when the system has it. Raise ConnectionLost if the connection ends before, as it does
        without an answer: mosquitto drops confirmations for a program that is behind, and only a new connection helps.
        """
        info = self._client.publish(*message[:4], properties=_message_properties(message))
        try:
            return await _limited(self._answer(info.rc, info.mid))
        except TimeoutError as error:
            self._finish(str(error))
            raise ConnectionLost(str(error)) from None

    def acknowledge(self, message: Received) -> None:
        """Acknowledge a message."""
        self._client.ack(message.packet_id, message.qos)

    async def _answer(self, code: MQTTErrorCode, packet_id: int | None) -> str | None:
        if code != MQTTErrorCode.MQTT_ERR_SUCCESS or packet_id is None or self.ended.done():
            raise ConnectionLost(f"the connection with the broker is lost: {paho.error_string(code)}")
        future = self._answers[packet_id] = self._loop.create_future()
        try:
            answer = await future
        finally:
            self._answers.pop(packet_id, None)
        return str(answer).lower() if answer.is_failure else None

    def _accept(self, refusal: Exception | None) -> None:
        if self._connected.done():
            return
        if refusal is None:
            self._connected.set_result(None)
        else:
            self._connected.set_exception(refusal)

    def _finish(self, reason: str, error: Exception | None = None) -> None:
        """End all waits for the broker: for the connection with `error`, for answers with ConnectionLost."""
        if not self.ended.done():
            self.ended.set_result(reason)
        self._accept(error or ConnectionError("the connection was closed before the broker answered"))
        for future in self._answers.values():
            if not future.done():
                future.set_exception(ConnectionLost("the connection with the broker was lost"))

    def _receive(self, message: Received) -> None:
        if self._is_closed:
            return
        try:
            self._on_message(message)
        except Exception:  # an error would end the connection
            _logger.exception("a message could not be handled")
            self.acknowledge(message)

    def _take(self, packet_id: int, code: ReasonCode) -> None:
        future = self._answers.get(packet_id)
        if future is not None and not future.done():
            future.set_result(code)

    def _end(self, error: Exception | None) -> None:
        self._has_ended.set()
        self._finish(_LOST, error)

    # --- in the thread of paho-mqtt ------------------------------------------------------------------------------

    def _new_client(self) -> paho.Client:
        put = self._hand_over.put
        client = _ThreadedClient(
            CallbackAPIVersion.VERSION2,
            self._options.identifier,
            protocol=paho.MQTTv5,
            reconnect_on_failure=False,
            manual_ack=self._options.acknowledges,
        )
        client.on_end = lambda error: put(partial(self._end, error))
        client.on_socket_open = self._opened
        client.on_connect = lambda _client, _data, _flags, code, _properties: put(partial(self._accept, _refusal(code)))
        client.on_subscribe = lambda _client, _data, packet_id, codes, _properties: put(
            partial(self._take, packet_id, codes[0])
        )
        client.on_publish = lambda _client, _data, packet_id, code, _properties: put(
            partial(self._take, packet_id, code)
        )
        client.on_disconnect = lambda _client, _data, flags, code, _properties: put(
            partial(self._finish, _ending(flags, code))
        )
        client.on_message = self._hear
        if self._access.user is not None:
            client.username_pw_set(self._access.user, self._access.password)
        if self._access.tls is not None:
            client.tls_set_context(self._access.tls)
        if (will := self._options.will) is not None:
            properties = _properties(PacketTypes.WILLMESSAGE, ContentType=will.content_type)
            client.will_set(*will[:4], properties=properties)
        return client

    def _opened(self, _client: object, _data: object, sock: Any) -> None:
        if self._is_closed:  # meanwhile
            raise ConnectionAbortedError(_LOST)
        # Or a message waits up to 40 ms for the broker to confirm an earlier message: usually an acknowledgement.
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def _hear(self, _client: object, _data: object, message: paho.MQTTMessage) -> None:
        received = _received(message)
        parts = received.topic, received.payload, received.response_topic, received.correlation
        size = _OVERHEAD + sum(len(part) for part in parts if part)
        is_stop = received.topic.rpartition("/")[2] == "stop"
        self._hand_over.put(partial(self._receive, received), size, is_stop=is_stop)


class _ThreadedClient(paho.Client):
    """Client of paho-mqtt that says how its thread ended."""

    on_end: Callable[[Exception | None], None]

    def loop_forever(self, timeout: float = 1.0, retry_first_connection: bool = False) -> MQTTErrorCode:  # noqa: FBT001, FBT002 - as in paho-mqtt
        """Connect, and read and write until the end; `loop_start` calls this in the thread."""
        error: Exception | None = None
        try:
            return super().loop_forever(timeout)  # an address that does not answer is tried again by others
        except Exception as raised:
            _logger.debug("the thread of paho-mqtt has ended", exc_info=True)
            error = raised
            return MQTTErrorCode.MQTT_ERR_UNKNOWN
        finally:
            if (sock := self.socket()) is not None:  # after an error
                sock.close()
            self.on_end(error)


def _received(message: paho.MQTTMessage) -> Received:
    try:
        topic = message.topic
    except UnicodeDecodeError:
        topic = "\ufffd"  # of no board
    properties = message.properties
    return Received(
        topic,
        bytes(message.payload),
        message.qos,
        bool(message.retain),
        bool(message.dup),
        message.mid,
        getattr(properties, "MessageExpiryInterval", None),
        getattr(properties, "ResponseTopic", None),
        getattr(properties, "CorrelationData", None),
    )


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


def _properties(packet_type: int, **values: object) -> Properties:
    properties = Properties(packet_type)  # type: ignore[no-untyped-call] # its attributes are made as it runs
    for name, value in values.items():
        if value is not None:
            setattr(properties, name, value)
    return properties


def _message_properties(message: Publication) -> Properties:
    """Return the properties of a message. Those that many messages share are made once."""
    properties = copy(_shared_properties(message.expiry, message.correlation, message.content_type))
    if message.response_topic is not None:
        properties.ResponseTopic = message.response_topic
    return properties


@lru_cache(maxsize=64)
def _shared_properties(expiry: int | None, correlation: bytes | None, content_type: str) -> Properties:
    return _properties(
        PacketTypes.PUBLISH, MessageExpiryInterval=expiry, CorrelationData=correlation, ContentType=content_type
    )
