"""MqttClient: MQTT connection on the event loop, for every kind of loop.

paho-mqtt speaks the protocol, and is called in the event loop only. Received bytes are split here, and paho-mqtt is
fed with the packets other than PUBLISH. Messages are handled in the turn in which they came: nothing can fill up, and
the broker's flow control holds back a flood.
"""

from __future__ import annotations

import asyncio
import logging
import socket
import ssl
import threading
from collections.abc import Awaitable, Callable, Coroutine
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, TypeVar

from paho.mqtt import client as paho
from paho.mqtt.enums import CallbackAPIVersion, MQTTErrorCode
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode
from paho.mqtt.subscribeoptions import SubscribeOptions

from servolink.errors import ConnectionLost
from servolink.escaping import escape
from servolink.fleet.access import BrokerAccess
from servolink.fleet.publish_packets import (
    PUBLISH,
    PacketBuffer,
    Publication,
    Received,
    message_in,
    packed_properties,
)
from servolink.fleet.topics import MOST_BYTES
from servolink.platforms.socket_watch import SocketWatch, ThreadedSocketWatch, watch_socket

T = TypeVar("T")

KEEPALIVE = 10
"""Seconds without a message after which the broker must answer a ping."""

_LIMIT = 10.0  # seconds for the broker to answer
_LARGEST = 2 * MOST_BYTES  # bytes: a command beyond the size limit arrives, and is answered
_MOST_AT_ONCE = 16 * 1024  # bytes read before other work has a turn
_WRONG_LOGIN = {4, 5, 134, 135}  # reason codes; the small ones are from MQTT 3
_NO_PING = 141
_LOST = "the connection was lost"


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
    """Whether messages with QoS 1 are acknowledged by calls of `acknowledge`, instead of at once."""
    sees_retained: bool = True
    """Whether `is_retained` holds the sender's flag; else the flag shows that the broker kept the message."""


class MqttClient:
    """Connection with a broker, over TCP or TLS."""

    def __init__(self, access: BrokerAccess, options: MqttOptions, on_message: Callable[[Received], None]) -> None:
        """Call `on_message` with each message; errors of the callback are logged."""
        self._loop = asyncio.get_running_loop()
        self.ended: asyncio.Future[str] = self._loop.create_future()
        """Reason of the connection's end; pending while the connection lasts."""
        self._client = _new_client(access, options)
        self._access = access
        self._options = options
        self._on_message = on_message
        self._connected: asyncio.Future[None] = self._loop.create_future()
        self._answers: dict[int, asyncio.Future[ReasonCode]] = {}
        self._watch: SocketWatch | ThreadedSocketWatch | None = None
        self._packets = PacketBuffer(_LARGEST)

    async def open(self) -> None:
        """Connect. Raise OSError or ValueError on failure; then call `close`, too."""
        # A daemon, because names and addresses that do not answer must not hold up the end of the program.
        threading.Thread(target=self._connect, name="servolink broker", daemon=True).start()
        await _limited(self._connected)

    def close(self) -> None:
        """Disconnect. Wherever an answer of the broker is waited for, ConnectionLost is raised."""
        self._client.disconnect()
        self._end_watch()
        if (sock := self.socket) is not None:  # the broker takes nothing any more
            sock.close()
        self._finish(_LOST)

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

        Without QoS it is sent when the system has it. Raise ConnectionLost if the connection ends before.
        """
        info = self._client.publish(*message[:4], properties=_PackedProperties(message))
        if not message.qos and info.rc == MQTTErrorCode.MQTT_ERR_SUCCESS and info.is_published():
            return None
        return await self._answer(info.rc, info.mid)

    def acknowledge(self, message: Received) -> None:
        """Acknowledge a message."""
        self._client.ack(message.packet_id, message.qos)
        self._flush()

    async def _answer(self, code: MQTTErrorCode, packet_id: int | None) -> str | None:
        if code != MQTTErrorCode.MQTT_ERR_SUCCESS or packet_id is None or self.ended.done():
            raise ConnectionLost(f"the connection with the broker is lost: {paho.error_string(code)}")
        self._flush()
        future = self._answers[packet_id] = self._loop.create_future()
        try:
            answer = await future
        finally:
            self._answers.pop(packet_id, None)
        return str(answer).lower() if answer.is_failure else None

    # --- beginning and end ---------------------------------------------------------------------------------------

    def _connect(self) -> None:
        """Connect, in a thread: looking up a name, connecting and TLS would hold up the event loop."""
        error: Exception | None = None
        try:
            self._client.connect(
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
        except Exception as raised:  # noqa: BLE001 - raised again where the connection is waited for
            error = raised
        with suppress(RuntimeError):  # the event loop has been closed
            self._loop.call_soon_threadsafe(self._begin, error)

    def _begin(self, error: Exception | None) -> None:
        """Take over the socket from the connecting thread."""
        client, sock = self._client, self.socket
        if error is not None or sock is None:
            self._finish(_LOST, error)
            return
        if self.ended.done():  # it was cancelled meanwhile
            self.close()
            return
        # Or a message waits up to 40 ms for the broker to confirm an earlier message: usually an acknowledgement.
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client.on_connect = lambda _client, _data, _flags, code, _properties: self._accept(_refusal(code))
        client.on_subscribe = lambda _client, _data, packet_id, codes, _properties: self._take(packet_id, codes[0])
        client.on_publish = lambda _client, _data, packet_id, code, _properties: self._take(packet_id, code)
        client.on_disconnect = lambda _client, _data, flags, code, _properties: self._finish(_ending(flags, code))
        client.on_socket_close = lambda _client, _data, _sock: self._end_watch()
        self._watch = watch_socket(sock, self._read, self._write)
        self._tick()

    def _tick(self) -> None:
        """Send a ping to the broker after a long silence."""
        if not self.ended.done():
            self._handle(self._client.loop_misc)
            self._loop.call_later(1.0, self._tick)

    def _accept(self, refusal: Exception | None) -> None:
        if self._connected.done():
            return
        if refusal is None:
            self._connected.set_result(None)
        else:
            self._connected.set_exception(refusal)

    def _end_watch(self) -> None:
        if self._watch is not None:
            self._watch.close()
            self._watch = None

    def _finish(self, reason: str, error: Exception | None = None) -> None:
        """End all waits for the broker: for the connection with `error`, for answers with ConnectionLost."""
        if not self.ended.done():
            self.ended.set_result(reason)
        self._accept(error or ConnectionError("the connection was closed before the broker answered"))
        for future in self._answers.values():
            if not future.done():
                future.set_exception(ConnectionLost("the connection with the broker was lost"))

    # --- reading and writing -------------------------------------------------------------------------------------

    def _read(self) -> None:
        """Handle the packets received so far, up to a limit in a turn of the event loop."""
        sock = self.socket
        if sock is None:
            return
        try:
            data = sock.recv(_MOST_AT_ONCE)
        except (BlockingIOError, InterruptedError, ssl.SSLWantReadError, ssl.SSLWantWriteError):
            return
        except OSError:
            data = b""
        if not data:
            self.close()
            return
        self._handle(lambda: self._take_packets(data))
        if isinstance(sock, ssl.SSLSocket) and self._watch is not None and sock.pending():  # unseen at the socket
            self._loop.call_soon(self._read)
        self._flush()

    def _take_packets(self, data: bytes) -> MQTTErrorCode:
        """Handle the packets that `data` completes. Raise an error for one that cannot be read."""
        for packet, content in self._packets.take(data):
            if packet[0] >> 4 == PUBLISH:
                self._receive(message_in(packet, content))
            elif (code := self._client.read_packet(packet)) != MQTTErrorCode.MQTT_ERR_SUCCESS:
                return code
            if self._watch is None:  # closed meanwhile
                break
        return MQTTErrorCode.MQTT_ERR_SUCCESS

    def _write(self) -> None:
        self._handle(self._client.loop_write)
        self._flush()

    def _flush(self) -> None:
        """Have the loop write the rest when the system takes more; usually there is none."""
        if self._watch is not None:
            self._watch.watch_writing(self._client.want_write())

    def _handle(self, work: Callable[[], MQTTErrorCode]) -> None:
        """Call a function of paho-mqtt, and close the connection on failure."""
        try:
            if work() == MQTTErrorCode.MQTT_ERR_SUCCESS:
                return
        except Exception:  # paho raises all kinds of errors for unreadable packets: the connection is lost
            _logger.debug("the broker sent what cannot be read", exc_info=True)
        self.close()

    def _receive(self, message: Received) -> None:
        is_over = not self._options.acknowledges
        try:
            self._on_message(message)
        except Exception:  # an error would end the connection
            _logger.exception("a message could not be handled")
            is_over = True
        if is_over and message.qos:
            self._client.ack(message.packet_id, message.qos)

    def _take(self, packet_id: int, code: ReasonCode) -> None:
        future = self._answers.get(packet_id)
        if future is not None and not future.done():
            future.set_result(code)


_logger = logging.getLogger(__name__)


class _PacketClient(paho.Client):
    """Client of paho-mqtt that is fed with packets, and does not read from its socket."""

    _fed = b""

    def read_packet(self, packet: bytes) -> MQTTErrorCode:
        """Handle a complete packet other than PUBLISH."""
        self._fed = packet
        return self.loop_read()

    def _sock_recv(self, bufsize: int) -> bytes:
        if not self._fed:
            raise BlockingIOError
        data, self._fed = self._fed[:bufsize], self._fed[bufsize:]
        return data


class _PackedProperties(Properties):
    """Properties of a message, packed at once: those of paho-mqtt take 30 µs for each message."""

    def __init__(self, message: Publication) -> None:
        object.__setattr__(self, "_packed", packed_properties(message))

    def pack(self) -> bytes:
        packed: bytes = object.__getattribute__(self, "_packed")
        return packed


def _new_client(access: BrokerAccess, options: MqttOptions) -> _PacketClient:
    client = _PacketClient(
        CallbackAPIVersion.VERSION2,
        options.identifier,
        protocol=paho.MQTTv5,
        reconnect_on_failure=False,
        manual_ack=True,
    )
    if access.user is not None:
        client.username_pw_set(access.user, access.password)
    if access.tls is not None:
        client.tls_set_context(access.tls)
    if (will := options.will) is not None:
        client.will_set(*will[:4], properties=_PackedProperties(will))
    return client


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
