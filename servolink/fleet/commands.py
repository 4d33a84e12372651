"""Commands from remote programs: carried out once, in time, and within the policy, with an answer to each.

A command passes these in their order: it is read and checked, its age is known, it is not one that came before, there
is room for it, it is noted on the disk, its turn comes. Only then the hub gets it, which checks it like any other.
"""

from __future__ import annotations

import asyncio
import hashlib
import math
import time
from collections import OrderedDict
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Any, Literal, NamedTuple, TypeAlias

import msgspec
from msgspec import Raw

from servolink.control import Code, Origin, Role, RpcError, Touches
from servolink.errors import EncodeError, OutcomeUnknown, ServolinkError, escape
from servolink.fleet.answers import Answers, Sender
from servolink.fleet.broker_messages import Received
from servolink.fleet.command_log import MOST_KEPT, CommandLog, LogEntry
from servolink.fleet.hub_session import HubSession, result_of
from servolink.fleet.policy import BoardPolicy
from servolink.fleet.pulse import PulseLink, StopBarrier
from servolink.fleet.ready_run import ReadyRun
from servolink.fleet.stop_handler import StopHandler
from servolink.fleet.topics import METHODS as OWN
from servolink.fleet.topics import MOST_BYTES, BoardCommand, Cancel, Prepare, needs_pulse, scope_of
from servolink.hub import METHODS
from servolink.motion import Ticket
from servolink.protocol import convert
from servolink.support import Tasks, read_json, reason, seconds_asleep, time_with_sleep

MOST_WAITING = 64
"""Most unfinished commands of a board; further commands are answered with `busy`."""
LONGEST_MOTION = 60
"""Seconds until a motion command must arrive, whatever expiry the message has."""

Level: TypeAlias = Literal["info", "warning", "error"]
Log: TypeAlias = Callable[[Level, str], None]

_IN_ORDER = {name for name, method in METHODS.items() if method.in_order or method.scope.touches} | set(OWN)
"""Methods that change something: carried out in order, and refused if a stop was sent later."""
_INTERRUPTED = "the command was interrupted, and the outcome is unknown; the command is not repeated"


class _Accepted(NamedTuple):
    """Accepted command, to be carried out."""

    command: BoardCommand
    sender: Sender
    ticket: Ticket
    acknowledge: Callable[[], None]


class _Refused(NamedTuple):
    """Refused command, which stays refused when the broker delivers another copy."""

    digest: str
    answer: str


class CommandHandler:
    """Receiver of the commands of a board."""

    def __init__(
        self,
        board: str,
        policy: BoardPolicy,
        hub: HubSession,
        command_log: CommandLog,
        answers: Answers,
        prepared: ReadyRun,
        stops: StopHandler,
        barrier: StopBarrier,
        log: Log,
    ) -> None:
        """Accept commands within `policy`, and note the commands in `command_log`."""
        self.on_change: Callable[[], None] = lambda: None
        """Called when a command may have changed the stored content of the board."""
        self._board = board
        self._role = Role.parse(policy.allow)
        self._hub = hub
        self._command_log = command_log
        self._answers = answers
        self._prepared = prepared
        self._stops = stops
        self._barrier = barrier
        self._log = log
        self._tasks = Tasks()
        self._order = asyncio.Lock()
        self._refused_retained: OrderedDict[str, None] = OrderedDict()
        self._refused: OrderedDict[str, _Refused] = OrderedDict()

    def follow(self, policy: BoardPolicy) -> None:
        """Accept commands within `policy` from now on."""
        self._role = Role.parse(policy.allow)

    def finish_interrupted(self) -> None:
        """Answer the commands that an earlier program was carrying out when killed."""
        for entry in self._command_log.unfinished():
            sender = Sender(entry.response_topic, entry.correlation)
            if entry.answer is None:
                self._answers.fail(entry.id, sender, OutcomeUnknown(_INTERRUPTED))
            else:
                self._answers.repeat(entry.id, sender, entry.answer)

    def receive(self, message: Received, link: PulseLink, acknowledge: Callable[[], None]) -> None:
        """Take a command that came on a connection with `link`; never raises.

        `acknowledge` is called when it need not be delivered again.
        """
        if message.is_retained and not message.payload:  # retained message removed by somebody
            acknowledge()
            return
        sender = Sender(message.response_topic, message.correlation, message.qos)
        digest = _digest(message.payload)
        command_id: str | None = None
        try:
            value = _read(message)
            command_id = _id_in(value)
            command: BoardCommand = _converted(value, BoardCommand)
            if self._is_repeated(message, command, digest, sender):
                acknowledge()
                return
            if command.method == "stop":
                self._stops.stop(command.id, sender, self._answers)
                acknowledge()
                return
        except Exception as error:  # noqa: BLE001 - whatever is wrong with a message is an answer
            # The broker sends no more than the acknowledgements allow: a backlog cannot outrun the answers.
            self._answers.refuse(command_id, sender, error, acknowledge)
            self._log("warning", f"a command was refused: {error}")
            return
        try:
            accepted = _Accepted(command, sender, self._checked(message, command, link), acknowledge)
            noted = self._note(command, digest, sender)  # known from now on: copies may come in the same loop turn
        except Exception as error:  # noqa: BLE001 - likewise
            self._refuse(command.id, digest, sender, error, acknowledge)
            self._log("warning", f"a command was refused: {error}")
            return
        self._tasks.begin(self._carry_out(accepted, digest, noted))

    async def close(self) -> None:
        """End commands under way; a command that has begun is answered as interrupted."""
        await self._tasks.close()
        for entry in self._command_log.unfinished():
            if entry.answer is None:
                sender = Sender(entry.response_topic, entry.correlation)
                self._answers.fail(entry.id, sender, OutcomeUnknown(_INTERRUPTED))

    # --- checks ------------------------------------------------------------------------------------------------

    def _is_repeated(self, message: Received, command: BoardCommand, digest: str, sender: Sender) -> bool:
        """Return whether a command came before, and must not be judged again. A refused command stays refused."""
        if message.is_retained:
            if command.id in self._refused_retained:
                return True
            self._refused_retained[command.id] = None
            if len(self._refused_retained) > MOST_WAITING:
                self._refused_retained.popitem(last=False)
            raise RpcError(
                Code.INVALID_REQUEST,
                "retained commands are not carried out: they would come again with every connection",
                remedy="remove it, by an empty retained message, and send commands that are not retained",
            )
        before = self._command_log.find(command.id) or self._refused.get(command.id)
        if before is None:
            return False
        if before.digest != digest:
            raise RpcError(Code.INVALID_REQUEST, f"the id {command.id} was used for another command")
        if isinstance(before, _Refused):
            self._answers.repeat(command.id, sender, before.answer)
            return True
        self._log("info", f"{escape(command.method)} {command.id} was delivered again, and is not repeated")
        return True

    def _checked(self, message: Received, command: BoardCommand, link: PulseLink) -> Ticket:
        """Return the ticket of a command. Raise RpcError for a forbidden command."""
        self._check_method(command.method)
        if command.method in _IN_ORDER and self._barrier.rejects(command.pulse):
            raise _stopped()
        now = time_with_sleep()
        expiry: float | None = message.expiry
        scope = scope_of(command.method)
        if scope.moves:
            if expiry is None:
                raise RpcError(
                    Code.INVALID_REQUEST,
                    f"{command.method} needs a message expiry: a robot must not move late",
                    remedy="send it with the property message-expiry-interval, such as 10 seconds",
                )
            if needs_pulse(scope) and command.pulse is None:
                raise RpcError(
                    Code.INVALID_REQUEST,
                    f"{command.method} needs a pulse: servos turn when their corrections change, and must not late",
                    remedy="put the latest word of the topic pulse into the command",
                )
            expiry = min(expiry, LONGEST_MOTION)
        if expiry is not None and now > link.latest(expiry, command.pulse):
            raise _expired()
        if len(self._tasks) >= MOST_WAITING:
            raise RpcError(Code.BUSY, f"{len(self._tasks)} commands of {self._board} wait already")
        return self._stops.counter.ticket(until=math.inf if expiry is None else now + expiry, who=command.who)

    def _check_method(self, name: str) -> None:
        scope_of(name).check(name, Origin.AFAR)
        needed = _role(name)
        if needed > self._role:
            raise RpcError(
                Code.FORBIDDEN,
                f"{name} is not allowed from afar: it needs {needed}, and {self._board} allows {self._role}",
                remedy=f'on its machine, write allow = "{needed}" for {self._board} in fleet.toml',
            )

    # --- carrying out ------------------------------------------------------------------------------------------

    async def _carry_out(self, accepted: _Accepted, digest: str, noted: Awaitable[None]) -> None:
        command, sender = accepted.command, accepted.sender
        try:
            await noted
        except (OSError, ValueError) as error:
            self._refuse(command.id, digest, sender, _not_noted(error))
            return
        finally:
            accepted.acknowledge()
        try:
            result = await self._done(accepted)
        except Exception as error:  # noqa: BLE001 - whatever a command raises is an answer
            self._answers.fail(command.id, sender, error)
        else:
            self._answers.succeed(command.id, sender, result)

    def _note(self, command: BoardCommand, digest: str, sender: Sender) -> Awaitable[None]:
        """Make a command known, and return the awaitable of the log entry."""
        entry = LogEntry(command.id, digest, time.time(), sender.response_topic, sender.correlation)
        try:
            return self._command_log.note(entry, only_reads=_role(command.method) is Role.WATCH)
        except OSError as error:
            raise _not_noted(error) from error

    def _refuse(
        self,
        command_id: str,
        digest: str,
        sender: Sender,
        error: Exception,
        on_sent: Callable[[], None] | None = None,
    ) -> None:
        """Refuse a command, for good: a sender told so may send another, and both would be carried out."""
        answer = self._answers.refuse(command_id, sender, error, on_sent)
        self._refused[command_id] = _Refused(digest, answer)
        if len(self._refused) > MOST_KEPT:
            self._refused.popitem(last=False)

    async def _done(self, accepted: _Accepted) -> Any:
        """Return the result of a command, in turn. Raise RpcError for a failure."""
        command = accepted.command
        async with self._turn(accepted):
            self._check_ticket(accepted)
            if command.method == "prepare":
                return await self._prepared.prepare(_converted(command.params, Prepare), accepted.ticket)
            if command.method == "cancel":
                return self._prepared.cancel(_converted(command.params, Cancel).start)
            # The hub keeps the time as well: there a motion may have to wait once more.
            scope, params = scope_of(command.method), command.params
            if scope.moves and not needs_pulse(scope):
                params = params | {"until": accepted.ticket.until - seconds_asleep()}
            reply = await self._hub.ask(command.method, params, self._reporter(command.id, accepted.sender))
            if Touches.BOARD in scope.touches:
                self.on_change()
            return result_of(reply)

    def _check_ticket(self, accepted: _Accepted) -> None:
        """Raise RpcError for a command that must not begin any more."""
        if accepted.command.method in _IN_ORDER and not self._stops.counter.holds(accepted.ticket):
            raise _stopped()
        if time_with_sleep() > accepted.ticket.until:
            raise _expired()

    @asynccontextmanager
    async def _turn(self, accepted: _Accepted) -> AsyncIterator[None]:
        """Wait for the commands before this one, or for a stop. Read-only commands need not wait."""
        if accepted.command.method not in _IN_ORDER:
            yield
            return
        turn = asyncio.ensure_future(self._order.acquire())
        stop = asyncio.ensure_future(self._stops.until_stopped(accepted.ticket))
        try:
            await asyncio.wait((turn, stop), return_when=asyncio.FIRST_COMPLETED)
            yield
        finally:
            stop.cancel()
            if turn.done() and not turn.cancelled():
                self._order.release()
            turn.cancel()

    def _reporter(self, command_id: str, sender: Sender) -> Callable[[Raw], None]:
        def report(params: Raw) -> None:
            progress = {name: value for name, value in msgspec.json.decode(params).items() if name != "id"}
            self._answers.report(command_id, sender, progress)

        return report


def _role(method: str) -> Role:
    """Return the role required by a method."""
    return Role(METHODS[method].role) if method in METHODS else Role.RUN


def _read(message: Received) -> Any:
    """Return the JSON value in a message. Raise RpcError if there is none."""
    if len(message.payload) > MOST_BYTES:
        raise RpcError(Code.PARSE_ERROR, f"the message is larger than {MOST_BYTES >> 20} MiB")
    try:
        return read_json(message.payload)
    except ValueError as error:
        raise RpcError(Code.PARSE_ERROR, f"the message {error}") from None


def _converted(value: Any, kind: Any) -> Any:
    try:
        return convert(value, kind)
    except EncodeError as error:
        raise RpcError(Code.INVALID_PARAMS, str(error), path=error.path) from None


def _id_in(value: Any) -> str | None:
    """Return the command id of a message, or None for a message without a valid id."""
    found = value.get("id") if isinstance(value, dict) else None
    try:
        return msgspec.convert({"id": found, "method": ""}, BoardCommand).id
    except msgspec.ValidationError:
        return None


def _not_noted(error: Exception) -> ServolinkError:
    return ServolinkError(f"the command cannot be noted, so it is not carried out: {reason(error)}")


def _stopped() -> RpcError:
    return RpcError(
        Code.INVALID_REQUEST,
        "the board was stopped before this began",
        remedy="send the command again, if still wanted",
    )


def _expired() -> RpcError:
    return RpcError(
        Code.INVALID_REQUEST,
        "the command has expired on the way, or before its turn; nothing was done",
        remedy="send the command again, if still wanted",
    )


def _digest(payload: bytes) -> str:
    return hashlib.blake2b(payload, digest_size=8).hexdigest()
