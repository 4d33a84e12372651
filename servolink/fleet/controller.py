"""Controller: one program's connection with the broker of a fleet, through which it sees boards and commands them."""

from __future__ import annotations

import asyncio
import getpass
import logging
import secrets
import socket
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractAsyncContextManager, contextmanager, suppress
from typing import TYPE_CHECKING, Any, Self

import msgspec
from msgspec import Struct

from servolink.errors import ConnectionLost, OpenError, OutcomeUnknown, RequestTimeout, ServolinkError
from servolink.escaping import escape
from servolink.fleet.exchange import Exchange, OnStep, failure_of
from servolink.fleet.roster import BoardSeen, Roster
from servolink.fleet.topics import CONTENT_TYPE, DEFAULT_EXPIRY, MOST_BYTES, MOTION, Command, FleetTopic, Result, Topics

if TYPE_CHECKING:
    from aiomqtt import Client
    from paho.mqtt.properties import Properties

Connect = Callable[[], "AbstractAsyncContextManager[Client]"]
"""Returns a connection with the broker, which begins when it is entered."""
OnChange = Callable[[BoardSeen], None]
"""Called with a board of which something but the servos has changed."""

PATIENCE = 10.0
"""Seconds in which a board must answer, or send the next step of a long command."""
_BACK_OFF = (0.2, 10.0)  # seconds until the next try to connect: at first, and at most
_QUIET, _MOST_SETTLING = 0.05, 2.0  # seconds without news after which all retained messages have come
_RESULT = msgspec.json.Decoder(Result)
_logger = logging.getLogger(__name__)


class Controller:
    """Sees the boards of a fleet and commands them, across restarts of the broker."""

    def __init__(self, connect: Connect, topics: Topics, *, with_servos: bool = False) -> None:
        """Enter it to connect. `with_servos` subscribes to the states of all servos, which come ten times a second."""
        self.topics = topics
        self.roster = Roster()
        self.who = sender()
        self.reconnects = 0
        """How often the connection was lost and is back."""
        self.on_change: OnChange | None = None
        """Called with each board of which something but the servos has changed; it must not raise."""
        self._connect = connect
        self._reply_to = f"{topics.prefix}/_fleet/reply/{secrets.token_hex(8)}"
        self._kinds = ("available", "state", "log", *(("servos",) if with_servos else ()))
        self._exchanges: dict[str, Exchange] = {}
        self._client: Client | None = None
        self._up = asyncio.Event()
        self._lost: Exception | None = None
        self._heard = 0.0  # when the latest message of a board came, but for its servos
        self._task: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        """Connect with the broker. Raise OpenError, which says what to do, if that fails."""
        self._task = asyncio.create_task(self._run())
        up = asyncio.create_task(self._up.wait())
        await asyncio.wait((self._task, up), return_when=asyncio.FIRST_COMPLETED)
        if not self._up.is_set():
            up.cancel()
            await self._task  # raises
        return self

    async def __aexit__(self, *_: object) -> None:
        """Disconnect."""
        if self._task is not None:
            self._task.cancel()
            with suppress(asyncio.CancelledError, ServolinkError):
                await self._task

    @property
    def is_connected(self) -> bool:
        """Whether the connection with the broker stands."""
        return self._up.is_set()

    # --- commands -----------------------------------------------------------------------------------------------

    async def call(
        self,
        board: str,
        method: str,
        params: Mapping[str, Any] | Struct | None = None,
        *,
        patience: float = PATIENCE,
        expires: int = DEFAULT_EXPIRY,
        on_step: OnStep | None = None,
    ) -> Any:
        """Return the result of a method of a board, which carries it out once at most. Raise the error it reports.

        A motion that has not reached the board after `expires` seconds is not carried out. If nothing comes for
        `patience` seconds, raise OutcomeUnknown for what changes or moves something, RequestTimeout for all else.
        """
        topic, message_id = self.topics.board(board, "cmd"), new_id()
        command = Command(message_id, method, dict(_plain(params)), self.who)
        payload = msgspec.json.encode(command)
        if len(payload) > MOST_BYTES:
            raise ServolinkError(f"{board}: {method} is longer than {MOST_BYTES >> 20} MiB, the most that is sent")
        loop = asyncio.get_running_loop()
        begun = loop.time()
        with self.exchange(message_id, board=board, on_step=on_step) as exchange:
            sent = -1
            while not exchange.results:
                left = expires - (loop.time() - begun) if method in MOTION else float(expires)
                if sent != self.reconnects and left > 0:
                    # Also after a reconnection: the command, or its result, may have been lost with the connection.
                    # The board knows its id and does not carry it out twice.
                    await self.publish(topic, payload, message_id, expires=left, deadline=exchange.heard + patience)
                    sent = self.reconnects
                if not await exchange.wait(exchange.heard + patience):
                    raise _silence(board, method, patience)
            result = exchange.results[board]
        if (failure := failure_of(result)) is not None:
            raise failure
        return result.result

    @contextmanager
    def exchange(
        self, message_id: str, *, board: str | None = None, on_step: OnStep | None = None
    ) -> Iterator[Exchange]:
        """Yield what collects the results with the id `message_id`, of one `board` or of any."""
        exchange = self._exchanges[message_id] = Exchange(message_id, board=board, on_step=on_step)
        try:
            yield exchange
        finally:
            del self._exchanges[message_id]

    async def send_to_all(self, topic: FleetTopic, payload: Struct, message_id: str, *, expires: float) -> None:
        """Send one message to all boards at once. Raise ConnectionLost if the broker does not take it."""
        deadline = asyncio.get_running_loop().time() + expires
        await self.publish(
            self.topics.fleet(topic), msgspec.json.encode(payload), message_id, expires=expires, deadline=deadline
        )

    async def publish(self, topic: str, payload: bytes, message_id: str, *, expires: float, deadline: float) -> None:
        """Send a message with QoS 1, as soon as there is a connection. Raise ConnectionLost after `deadline`."""
        from aiomqtt import MqttError

        properties = self._properties(message_id, expires)
        while True:
            client = await self._connected(deadline)
            try:
                await client.publish(topic, payload, qos=1, properties=properties)
            except MqttError as error:
                self._lost = error
                if asyncio.get_running_loop().time() >= deadline:
                    raise ConnectionLost(f"the broker did not take a message: {error}") from error
                self._down(client)
            else:
                return

    async def settle(self) -> None:
        """Wait until what the broker has kept of all boards has come."""
        loop = asyncio.get_running_loop()
        deadline, message_id = loop.time() + _MOST_SETTLING, new_id()
        with self.exchange(message_id) as marker:
            # Sent to this program itself: it comes behind what the subscriptions have brought. A broker that sends
            # in another order is given some quiet time.
            result = msgspec.json.encode(Result(id=message_id, board="-", ok=True))
            await self.publish(self._reply_to, result, message_id, expires=_MOST_SETTLING, deadline=deadline)
            await marker.until(("-",), deadline)
        while (quiet_at := self._heard + _QUIET) > loop.time() and loop.time() < deadline:  # noqa: ASYNC110
            await asyncio.sleep(quiet_at - loop.time())

    def _properties(self, message_id: str, expires: float) -> Properties:
        from paho.mqtt.packettypes import PacketTypes
        from paho.mqtt.properties import Properties

        properties = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]
        properties.ResponseTopic = self._reply_to
        properties.CorrelationData = message_id.encode()
        properties.MessageExpiryInterval = max(1, round(expires))
        properties.ContentType = CONTENT_TYPE
        return properties

    # --- the connection -----------------------------------------------------------------------------------------

    async def _connected(self, deadline: float) -> Client:
        try:
            async with asyncio.timeout_at(deadline):
                await self._up.wait()
        except TimeoutError:
            raise ConnectionLost(
                f"the broker is gone ({self._lost}); its machine and the network need a look"
            ) from None
        assert self._client is not None  # noqa: S101 - narrows the type
        return self._client

    async def _run(self) -> None:
        """Keep the connection. Raise OpenError if the first one fails."""
        from aiomqtt import MqttError

        pause, most = _BACK_OFF
        while True:
            try:
                async with self._connect() as client:
                    pause = _BACK_OFF[0]
                    await self._serve(client)
            except (MqttError, OpenError) as error:
                if self._lost is None and self._client is None:
                    raise OpenError(str(error)) from error
                self._lost = error
                _logger.info("the connection with the broker is lost: %s", escape(str(error)))
            finally:
                self._up.clear()
            await asyncio.sleep(pause)
            pause = min(most, pause * 2)

    async def _serve(self, client: Client) -> None:
        client.pending_calls_threshold = 10**6  # many boards are commanded at once; it would warn of that
        replies = [(self._reply_to, 1)]
        boards = [(self.topics.board("+", kind), 0 if kind == "servos" else 1) for kind in self._kinds]
        await client.subscribe(replies + boards)
        if self._client is not None:
            self.reconnects += 1
        self._client = client
        self._up.set()
        for exchange in self._exchanges.values():
            exchange.wake()
        async for message in client.messages:
            self._receive(message.topic.value, message.payload)

    def _down(self, client: Client) -> None:
        """Wait for another connection: this one is broken, although it may not have ended yet."""
        if client is self._client:
            self._up.clear()

    def _receive(self, topic: str, payload: Any) -> None:
        if topic == self._reply_to:
            self._take_result(payload)
        elif (parsed := self.topics.parse(topic)) is not None:
            now = asyncio.get_running_loop().time()
            if (changed := self.roster.take(*parsed, payload, now)) is not None:
                self._heard = now
                if self.on_change is not None:
                    self.on_change(changed)

    def _take_result(self, payload: bytes) -> None:
        try:
            result = _RESULT.decode(payload)
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
            _logger.warning("a result cannot be read: %s", escape(str(error))[:200])
            return
        exchange = self._exchanges.get(result.id or "")
        if exchange is not None:
            exchange.take(result)


def _plain(params: Mapping[str, Any] | Struct | None) -> dict[str, Any]:
    return dict(msgspec.to_builtins(params or {}))


def _silence(board: str, method: str, patience: float) -> ServolinkError:
    """Return the error for a command that was not answered."""
    from servolink.hub.control.session import METHODS
    from servolink.hub.roles import Role

    known = METHODS.get(method)
    text = f"{board} has not answered {method} within {patience:g} s"
    if known is not None and known.role == Role.WATCH:
        return RequestTimeout(f"{text}: its machine, or the network, may be slow or away; try again")
    return OutcomeUnknown(f"{text}: it may have been done or not; look at the board before sending it again")


def new_id() -> str:
    """Return an id that no other message has."""
    return secrets.token_urlsafe(12)


def sender() -> str:
    """Return what people call this program: the user and the machine."""
    try:
        user = getpass.getuser()
    except (KeyError, OSError):
        user = "somebody"
    return f"{user} on {socket.gethostname()}"[:60]
