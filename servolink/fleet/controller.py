"""Controller: connection of a program with the broker of a fleet, to observe and command boards."""

from __future__ import annotations

import asyncio
import logging
import math
import secrets
import socket
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any, Self

import msgspec
from msgspec import Struct

from servolink.control import Role, decode, encode
from servolink.errors import ConnectionLost, OutcomeUnknown, RequestTimeout, ServolinkError, escape
from servolink.fleet.access import BrokerAccess
from servolink.fleet.broker import REMEDY, BrokerConnection
from servolink.fleet.broker_messages import Publication, Received
from servolink.fleet.mqtt_client import MqttOptions
from servolink.fleet.pending_command import OnStep, PendingCommand, failure_of
from servolink.fleet.roster import BoardSeen, Roster
from servolink.fleet.topics import (
    DEFAULT_EXPIRY,
    MOST_BYTES,
    UNREADABLE,
    BoardCommand,
    BoardResult,
    BoardTopic,
    Echo,
    Topics,
    scope_of,
)
from servolink.hub import METHODS
from servolink.support import login_name

OnChange = Callable[[BoardSeen], None]
"""Called with a board after any change except in the servos."""

PATIENCE = 10.0
"""Seconds until a board must answer, or send the next step of a long command."""
_KEPT = 60  # seconds for which the broker keeps results for a program after a lost connection
_PAUSE = 0.05  # seconds until the next attempt after a message could not be sent
_QUIET, _MOST_SETTLING = 0.05, 2.0  # seconds of silence after the last retained message
_logger = logging.getLogger(__name__)


class Controller:
    """Observer and commander of a fleet's boards, across restarts of the broker."""

    def __init__(
        self, access: BrokerAccess, topics: Topics, *, with_servos: bool = False, may_move: bool = True
    ) -> None:
        """Enter the controller to connect. `with_servos` subscribes to the states of all servos, sent at 10 Hz.

        `may_move` subscribes to the pulses, sent at 1 Hz, which commands that move or write need.
        """
        self.topics = topics
        self.roster = Roster()
        self.who = sender()
        self.patience = PATIENCE
        """Seconds until a board must answer, unless a call sets another time."""
        self.connections = 0
        """Number of connections with the broker so far."""
        self.no_answers = ""
        """Reason why no board can be heard, as far as known; empty for none."""
        self.on_change: OnChange | None = None
        """Function called with each changed board (not for servo frames); must not raise."""
        options = MqttOptions(f"servolink-fleet-{secrets.token_hex(8)}", session_seconds=_KEPT, sees_retained=False)
        self.broker = BrokerConnection(access, options)
        # Another word than in the identifier: each board is told it, and could take the connection over.
        word = secrets.token_hex(8)
        self._reader, self._reader_at_once = (topics.reader(access.user, each) for each in (word, f"{word}-0"))
        self._marker = topics.fleet(self._reader)
        # Boards joined by an earlier version answer at `result` itself.
        self._results = {"result": 1, self._reader: 1, self._reader_at_once: 0}
        kinds: list[BoardTopic] = ["available", "state", "log"]
        if may_move:
            kinds.append("pulse")
        if with_servos:
            kinds.append("servos")
        at_most_once = {"log", "pulse", "servos"}
        # Retained messages have QoS 0: a broker queues few of QoS 1 for a program, often 1,000, and drops the others.
        kept = [(topics.board("+", kind), 0) for kind in kinds]
        news = [(topics.board("+", kind), 1) for kind in kinds if kind not in at_most_once]
        replies = [(f"{topics.prefix}/+/{kind}", qos) for kind, qos in self._results.items()]
        self.broker.subscriptions = [*replies, *kept, *news]
        self.broker.on_message = self._receive
        self.broker.on_connect = self._connected_again
        self._pending: dict[str, PendingCommand] = {}
        self._may_move = may_move
        self._heard = 0.0  # arrival of the latest retained message, except those of servos and pulses
        self._task: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        """Connect with the broker. Raise OpenError with a remedy on failure."""
        self._task = asyncio.create_task(self.broker.run())
        connected = asyncio.create_task(self.broker.until_connected())
        try:
            await asyncio.wait((self._task, connected), return_when=asyncio.FIRST_COMPLETED)
        except asyncio.CancelledError:
            await self.__aexit__()
            raise
        finally:
            connected.cancel()
        if self._task.done():
            await self._task  # raises
        return self

    async def __aexit__(self, *_: object) -> None:
        """Disconnect."""
        if self._task is not None:
            self._task.cancel()
            with suppress(asyncio.CancelledError, ServolinkError):
                await self._task

    # --- commands -----------------------------------------------------------------------------------------------

    async def call(
        self,
        board: str,
        method: str,
        params: Mapping[str, Any] | Struct | None = None,
        *,
        patience: float | None = None,
        expires: int = DEFAULT_EXPIRY,
        on_step: OnStep | None = None,
        pulse: str | None = None,
    ) -> Any:
        """Return the result of a method, carried out once at most by a board. Raise the reported error.

        A motion or transfer that has not reached the board after `expires` seconds is not carried out. If nothing comes
        for `patience` seconds (10), raise OutcomeUnknown for what changes or moves something, RequestTimeout for all
        else. `pulse` is the latest word of the board when a person asked for this; without it, that of now.
        """
        topic, message_id = self.topics.board(board, "cmd"), new_id()
        patience = self.patience if patience is None else patience
        seen = self.roster.get(board)
        needs_word = scope_of(method).moves
        if needs_word and not self._may_move:
            raise ServolinkError(f"{board}: this program has connected without `may_move`, which {method} needs")
        word = pulse or (seen.pulse if seen is not None and needs_word else None)
        command = BoardCommand(message_id, method, _plain(params), self.who, word)
        payload = encode(command)
        if len(payload) > MOST_BYTES:
            raise ServolinkError(f"{board}: {method} is longer than {MOST_BYTES >> 20} MiB, the most that is sent")
        loop = asyncio.get_running_loop()
        begun = loop.time()
        with self.pending_command(message_id, board=board, on_step=on_step) as pending:
            sent = 0
            while not pending.results:
                left = expires - (loop.time() - begun) if needs_word else float(expires)
                if sent != self.connections and left > 0:
                    # Also after a reconnection: the command, or the result, may have been lost with the connection.
                    # The board knows the id and does not carry out the command twice.
                    try:
                        await self.publish(topic, payload, expires=left, deadline=pending.heard + patience)
                    except ConnectionLost as error:
                        raise _unsent(board, method, error) from error
                    sent = self.connections
                if not await pending.wait(pending.heard + patience):
                    raise _silence(board, method, patience, self.no_answers)
            result = pending.results[board]
        if (failure := failure_of(result)) is not None:
            raise failure
        return result.result

    @contextmanager
    def pending_command(
        self, message_id: str, *, board: str | None = None, on_step: OnStep | None = None
    ) -> Iterator[PendingCommand]:
        """Yield the collector of results with the id `message_id`, of `board` or of any board."""
        pending = self._pending[message_id] = PendingCommand(message_id, board=board, on_step=on_step)
        try:
            yield pending
        finally:
            del self._pending[message_id]

    async def echo(self, topic: str, message_id: str, *, expires: float) -> None:
        """Have boards answer at once. Raise ConnectionLost if the broker is gone for `expires` seconds."""
        deadline, payload = asyncio.get_running_loop().time() + expires, msgspec.json.encode(Echo(message_id))
        await self.publish(topic, payload, qos=0, expires=expires, deadline=deadline, at_once=True)

    async def publish(
        self,
        topic: str,
        payload: bytes,
        *,
        expires: float,
        deadline: float,
        qos: int = 1,
        at_once: bool = False,
    ) -> None:
        """Send a message, as soon as there is a connection. Raise ConnectionLost after `deadline`.

        The board of the topic answers below its own `result`, which shows who answers. With `at_once` the answer comes
        with QoS 0, for messages to many boards: thousands of answers come together. Raise OpenError if the broker does
        not allow the topic.
        """
        reader = self._reader_at_once if at_once else self._reader
        loop, ends = asyncio.get_running_loop(), asyncio.get_running_loop().time() + expires
        lost: ConnectionLost | None = None
        try:
            async with asyncio.timeout_at(deadline):
                while True:
                    await self.broker.until_connected()
                    left = max(1, math.ceil(ends - loop.time()))
                    message = Publication(
                        topic,
                        payload,
                        qos,
                        expiry=left,
                        response_topic=f"{topic.rpartition('/')[0]}/{reader}",
                    )
                    try:
                        return await self.broker.send(message)
                    except ConnectionLost as error:
                        lost = error
                    await asyncio.sleep(_PAUSE)
        except TimeoutError:
            raise ConnectionLost(
                f"the broker at {self.broker.access.address} is gone, or does not take what is sent; look at its "
                "machine and at the network"
            ) from lost

    async def settle(self, patience: float = _MOST_SETTLING) -> None:
        """Wait for the retained messages of all boards, but not much longer than usual.

        Raise ConnectionLost if the broker is gone for `patience` seconds.
        """
        loop, message_id = asyncio.get_running_loop(), new_id()
        with self.pending_command(message_id) as marker:
            # Sent to this program itself: arrives after the messages of the subscriptions. A broker that sends
            # in another order is given some quiet time.
            result = msgspec.json.encode(BoardResult(id=message_id, board="-", ok=True))
            gone = loop.time() + patience
            await self.publish(self._marker, result, expires=patience, deadline=gone)
            deadline = loop.time() + _MOST_SETTLING
            is_deaf = await marker.until(("-",), deadline)  # mosquitto accepts subscriptions that its list denies
            text = f"the broker brings this program nothing at {self.topics.prefix}/+/{self._reader}"
            self.no_answers = f"{text}: unless it is slow, {REMEDY}" if is_deaf else ""
        # Nothing tells of silence.
        while (quiet_at := self._heard + _QUIET) > loop.time() and loop.time() < deadline:  # noqa: ASYNC110 - see above
            await asyncio.sleep(quiet_at - loop.time())

    def wake(self) -> None:
        """Wake all waits for results, to check the connection and the time again."""
        for pending in self._pending.values():
            pending.wake()

    # --- called by the connection -------------------------------------------------------------------------------

    async def _connected_again(self) -> None:
        self.connections += 1
        self.wake()

    def _receive(self, message: Received) -> None:
        if message.topic == self._marker:
            self._take_result("-", message.payload)
        elif (parsed := self.topics.parse(message.topic)) is not None:
            if parsed[1] in self._results:
                self._take_result(parsed[0], message.payload)
                return
            now = asyncio.get_running_loop().time()
            if (changed := self.roster.take(*parsed, message.payload, now)) is not None:
                if message.is_retained:  # later messages are not counted: a large fleet always has news
                    self._heard = now
                if self.on_change is not None:
                    self.on_change(changed)

    def _take_result(self, board: str, payload: bytes) -> None:
        """Take a result from the topic of `board`; one that names another board is a forgery, or a fault."""
        try:
            result = decode(payload, BoardResult)
        except UNREADABLE as error:
            _logger.warning("a result cannot be read: %s", escape(str(error))[:200])
            return
        pending = self._pending.get(result.id or "")
        if pending is None:
            return
        if result.board != board:
            _logger.warning("a result from %s says that it is from %s", board, escape(result.board)[:80])
            return
        if isinstance(result.result, dict) and isinstance(word := result.result.get("pulse"), str):
            # Result of a stop, which may overtake the new word. Commands with an older word are refused.
            self.roster.hear_pulse(result.board, word)
        pending.take(result)


def _plain(params: Mapping[str, Any] | Struct | None) -> dict[str, Any]:
    return dict(msgspec.to_builtins(params or {}))


def _silence(board: str, method: str, patience: float, reason: str) -> ServolinkError:
    """Return the error for a command without an answer, with the `reason` if known."""
    text = f"{board} has not answered {method} within {patience:g} s"
    if reason:
        text = f"{text} ({reason})"
    if _only_reads(method):
        return RequestTimeout(f"{text}: its machine, or the network, may be slow or away; try again")
    return OutcomeUnknown(f"{text}: the outcome is unknown; look at the board before sending the command again")


def _unsent(board: str, method: str, error: ConnectionLost) -> ServolinkError:
    """Return the error for a command without the broker's confirmation."""
    if _only_reads(method):
        return error
    return OutcomeUnknown(f"{board}: {method} may have been done or not: {error}")


def _only_reads(method: str) -> bool:
    return method in METHODS and METHODS[method].role == Role.WATCH


def new_id() -> str:
    """Return an id that no other message has."""
    return secrets.token_urlsafe(12)


def sender() -> str:
    """Return the name of this program for people: the user and the machine."""
    return f"{login_name() or 'somebody'} on {socket.gethostname()}"[:60]
