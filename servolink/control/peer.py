"""JSON-RPC 2.0 for one program: messages in, messages out, for any transport and any methods.

Batches are refused: a program need not wait for a response before it sends the next request, so they would add nothing.
Params are given by name only. A request without id is carried out and not answered, as the specification says.
"""

from __future__ import annotations

import asyncio
import inspect
import json
import logging
import re
from collections import deque
from collections.abc import Callable, Coroutine, Mapping
from contextlib import AbstractAsyncContextManager, AsyncExitStack, nullcontext, suppress
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, NamedTuple, TypeVar, cast, get_args, get_origin, get_type_hints

import msgspec
from msgspec import Raw, Struct
from msgspec.structs import asdict

from servolink.control.error_codes import Code, ErrorObject, RpcError, is_defect
from servolink.control.notifications import NAMES
from servolink.control.rights import Origin, Scope, Touches
from servolink.errors import EncodeError, escape, quote
from servolink.protocol import convert, quote_json
from servolink.support import computed, read_json

MOST_WAITING = 64
"""Waiting requests, and unread responses, allowed to one program."""
MOST_HELD = 2 * 1024 * 1024
"""Bytes of waiting requests allowed to one program."""
MOST_BEGUN = 128
"""Followed outcomes of requests of one program that were begun at once; further outcomes are not followed."""
MOST_NOTIFICATIONS = 256
"""Notifications kept for a program that does not read; the oldest are dropped and counted."""

_MOST_ID = 2**53  # JavaScript rounds larger integers
_LONGEST_ID = 128
_PIECE = 64  # records encoded at once
_NOT_ASCII = re.compile(r"[^\x00-\x7f]+")
_NOT_BY_CODEC = (b"\xc2", b"\xc3", b"\xf0", b"\xf1", b"\xf2", b"\xf3", b"\xf4")
"""First bytes of the characters up to U+00FF and beyond U+FFFF, which Python's codec writes otherwise than JSON."""
_FIELDS = ("jsonrpc", "method", "params", "id")

_logger = logging.getLogger(__name__)

C = TypeVar("C")
S = TypeVar("S", bound=Struct)
T = TypeVar("T")
Handler = Callable[..., Any]


@dataclass(frozen=True, slots=True)
class Method(Generic[C]):
    """A method: its types and its docstring are the reference."""

    name: str
    params: type[Struct]
    result: Any
    role: int
    scope: Scope
    handler: Handler
    in_order: bool
    """Whether the method waits for earlier `in_order` requests of the same program."""
    is_urgent: bool
    """Whether the method is carried out regardless of the number of waiting requests."""
    reports: bool
    """Whether the handler takes a third argument, a callback for its progress."""
    is_coroutine: bool
    """Whether the handler is carried out beside others or in its turn, not at once."""
    finishes: bool
    """Whether the method is carried out to the end although the program is gone: it keeps data."""

    @property
    def summary(self) -> str:
        """Docstring of the method, for the reference."""
        return inspect.cleandoc(self.handler.__doc__ or "")


class Methods(dict[str, Method[C]]):
    """A table of methods by name."""

    def add(
        self,
        name: str,
        role: int,
        *,
        touches: Touches,
        from_afar: bool = False,
        in_order: bool = False,
        is_urgent: bool = False,
        finishes: bool = False,
    ) -> Callable[[Handler], Handler]:
        """Return a decorator that adds a handler, which is called with the context and the params.

        Doors refuse calls by what the method `touches`, and calls from afar unless `from_afar`.

        A function is carried out at once, a coroutine beside others or in its turn. A function that returns a coroutine
        has begun at once, whatever waits; the coroutine returns what came of it.
        """

        def added(handler: Handler) -> Handler:
            hints = get_type_hints(handler, include_extras=True)
            returned = hints["return"]
            count = len(inspect.signature(handler).parameters)
            self[name] = Method(
                name,
                hints["params"],
                get_args(returned)[-1] if get_origin(returned) is Coroutine else returned,
                role,
                Scope(touches, from_afar),
                handler,
                in_order,
                is_urgent,
                reports=count == 3,
                is_coroutine=inspect.iscoroutinefunction(handler),
                finishes=finishes,
            )
            return handler

        return added


class RpcRequest(NamedTuple):
    """Request; the id is None if no response is wanted."""

    method: str
    params: dict[str, Any]
    request_id: int | str | None


def parse(message: bytes | str) -> RpcRequest:
    """Return the request in `message`. Raise RpcError if there is none."""
    if len(message) > Peer.MOST_BYTES:
        raise RpcError(Code.PARSE_ERROR, f"the message is larger than {Peer.MOST_BYTES >> 20} MiB")
    try:
        value = read_json(message)
    except ValueError as error:
        raise RpcError(Code.PARSE_ERROR, f"the message {error}") from None
    if isinstance(value, list):
        raise RpcError(Code.INVALID_REQUEST, "batches are not supported; send each request as a message of its own")
    if not isinstance(value, dict):
        raise RpcError(Code.INVALID_REQUEST, f"a request must be an object, not {quote_json(value)}")
    request_id = value.get("id")
    if wrong := _wrong_id(request_id) if "id" in value else "":
        raise RpcError(Code.INVALID_REQUEST, wrong)
    if wrong := _wrong_request(value):
        raise RpcError(Code.INVALID_REQUEST, wrong, request_id=request_id)
    return RpcRequest(value["method"], value.get("params", {}), request_id)


class _Id(Struct):
    """Id of a request, for a response to a message that is not read."""

    id: int | str | None = None


def _id_in(message: bytes | str) -> int | str | None:
    """Return the id in a message; None without a valid id."""
    with suppress(msgspec.MsgspecError, ValueError, RecursionError):
        request_id = msgspec.json.decode(message, type=_Id).id
        return None if _wrong_id(request_id) else request_id
    return None


def _wrong_id(value: Any) -> str:
    if isinstance(value, str):
        return f"id must have at most {_LONGEST_ID} characters" if len(value) > _LONGEST_ID else ""
    if type(value) is int and -_MOST_ID <= value <= _MOST_ID:
        return ""
    return f"id must be text or an integer of at most 2**53, not {quote_json(value)}"


def _wrong_request(value: dict[str, Any]) -> str:
    """Return the reason why an object is not a request; empty for a request."""
    if unknown := [key for key in value if key not in _FIELDS]:
        return f"{quote(unknown[0])} is not a field; the fields are {', '.join(_FIELDS)}"
    if value.get("jsonrpc") != "2.0":
        return '"jsonrpc" must be "2.0"'
    if not isinstance(value.get("method"), str):
        return "method must be text"
    if not isinstance(value.get("params", {}), dict):
        return "params must be an object: they are given by name"
    return ""


def _escaped(characters: re.Match[str]) -> str:
    return json.dumps(characters[0])[1:-1]


def encode(value: Any) -> bytes:
    """Return `value` as JSON in ASCII, so that captions cannot control a terminal or a log."""
    with suppress(UnicodeEncodeError):  # a caption with a byte that is not text
        text = msgspec.json.encode(value)
        if text.isascii():
            return text
        if any(byte in text for byte in _NOT_BY_CODEC):
            return _NOT_ASCII.sub(_escaped, text.decode()).encode()
        return text.decode().encode("ascii", "backslashreplace")
    return json.dumps(msgspec.to_builtins(value), separators=(",", ":")).encode()


def decode(message: bytes | str | Raw, kind: type[T]) -> T:
    """Return JSON as a value of a type. Captions may have bytes that are not text, which the usual reader refuses."""
    try:
        return msgspec.json.decode(message, type=kind)
    except msgspec.DecodeError as error:
        text = message if isinstance(message, str) else bytes(message).decode()
        if "\\ud" not in text:
            raise
        try:
            return msgspec.convert(_with_raw(json.loads(text), kind), kind)
        except (json.JSONDecodeError, UnicodeEncodeError):
            raise error from None


def _with_raw(value: Any, kind: Any) -> Any:
    """Return a message with JSON for its parts that are read later, such as a result."""
    if not (isinstance(value, dict) and isinstance(kind, type)):
        return value
    raw = {name for name, hint in get_type_hints(kind).items() if Raw in (hint, *get_args(hint))}
    return {name: Raw(json.dumps(one).encode()) if name in raw else one for name, one in value.items()}


def encoded(result: S) -> S:
    """Return a large result as JSON, for a handler to return; call it in a thread.

    It is encoded in pieces, as each call of the encoder keeps the event loop waiting until its end.
    """
    return cast("S", Raw(_in_pieces(asdict(result))))


def _in_pieces(value: Any) -> bytes:
    if isinstance(value, dict):
        return b"{%b}" % b",".join(b"%b:%b" % (encode(key), _in_pieces(part)) for key, part in value.items())
    if isinstance(value, list | tuple) and len(value) > _PIECE:
        return b"[%b]" % b",".join(encode(value[at : at + _PIECE])[1:-1] for at in range(0, len(value), _PIECE))
    return encode(value)


class Peer(Generic[C]):
    """Carries out the requests of one program."""

    MOST_BYTES: ClassVar[int] = 1024 * 1024
    """Bytes of the longest message that a program may send."""
    MOST_READING: ClassVar[int] = 8
    """Requests without changes carried out at the same time for one program."""
    LARGE: ClassVar[int] = 16 * 1024
    """Bytes of the longest message read by the event loop; a thread reads longer messages, so that a stop passes."""

    def __init__(
        self,
        methods: Mapping[str, Method[C]],
        context: Callable[[], C],
        send: Callable[[bytes], None],
        abort: Callable[[str], None],
        *,
        role: int,
        origin: Origin = Origin.HERE,
        reading: asyncio.Semaphore | None = None,
    ) -> None:
        """Call `send` with each message, and `abort` with the reason if the program must be disconnected.

        `context` returns what each request is carried out with; it is called when the request is received. The scope of
        a method says whether `origin` may call it. Programs with the same semaphore `reading` have `MOST_READING`
        together.
        """
        self.is_paused = False
        """Whether the program is slower to read than the hub to write."""
        self.dropped = 0
        """Notifications that were dropped because the program read too slowly."""
        self._methods = methods
        self._context = context
        self._send = send
        self._abort = abort
        self._role = role
        self._origin = origin
        self._tasks: set[asyncio.Task[Any]] = set()
        self._finishing: set[asyncio.Task[Any] | None] = set()  # tasks that closing does not cancel
        self._begun = 0
        self._held = 0  # bytes of the requests that wait
        self._waiting = 0
        self._unread = 0  # messages sent since the program stopped reading
        self._order = asyncio.Lock()
        self._reading = reading or asyncio.Semaphore(self.MOST_READING)
        self._room = asyncio.Event()
        self._room.set()
        self._notifications: deque[bytes] = deque()
        self._is_closed = False

    def receive(self, message: bytes | str) -> None:
        """Take one message; never raises."""
        if self._is_closed:
            return
        if len(message) > self.LARGE:
            self._receive_large(message)
            return
        try:
            request = parse(message)
        except RpcError as error:
            self._refuse(error)
            return
        try:
            method, params = self._checked(request)
            if method.is_coroutine:
                carrying_out = self._carry_out(self._context(), request, method, params)
                self._start(carrying_out, len(message), is_urgent=method.is_urgent, finishes=method.finishes)
            elif inspect.iscoroutine(result := method.handler(self._context(), params)):
                self._follow(request, result)
            else:
                self._respond(request, result)
        except Exception as error:  # noqa: BLE001 - whatever a method raises is an answer
            self._fail(request, error)

    def _receive_large(self, message: bytes | str) -> None:
        try:
            self._start(self._carry_out_large(self._context(), message), len(message), finishes=True)
        except RpcError as error:
            error.request_id = _id_in(message)
            self._refuse(error)

    def notify(self, name: str, params: Struct | dict[str, Any]) -> None:
        """Send a notification; while the program does not read, keep it."""
        if self._is_closed:
            return
        message = encode({"jsonrpc": "2.0", "method": name, "params": params})
        if not self.is_paused:
            self._send(message)
            return
        self._notifications.append(message)
        if len(self._notifications) > MOST_NOTIFICATIONS:
            self._notifications.popleft()
            self.dropped += 1

    def tell(self, notification: Struct) -> None:
        """Send a notification of the control interface."""
        self.notify(NAMES[type(notification)], notification)

    def pause(self) -> None:
        """Send as little as possible from now on: the program does not read."""
        self.is_paused = True
        self._room.clear()

    def resume(self) -> None:
        """Send what was kept: the program reads again."""
        self.is_paused, self._unread = False, 0
        while self._notifications and not self.is_paused:  # sending may pause again after a response
            self._send(self._notifications.popleft())
        if not self.is_paused:
            self._room.set()

    async def close(self) -> None:
        """End every request, after carrying out requests that keep data, and send nothing more."""
        self._is_closed = True
        self._room.set()
        for task in self._tasks - self._finishing:
            task.cancel()
        if self._tasks:
            await asyncio.wait(self._tasks)

    def _checked(self, request: RpcRequest) -> tuple[Method[C], Struct]:
        """Return method and params. Raise RpcError if the call is not allowed."""
        method = self._methods.get(request.method)
        if method is None:
            raise RpcError(Code.METHOD_NOT_FOUND, f"there is no method {quote(request.method)}")
        if method.role > self._role:
            raise RpcError(
                Code.FORBIDDEN,
                f"{method.name} needs the role {method.role}, and this program has the role {self._role}",
                remedy=f"connect with the role {method.role}",
            )
        method.scope.check(method.name, self._origin)
        try:
            return method, convert(request.params, method.params)
        except EncodeError as error:
            raise RpcError(Code.INVALID_PARAMS, str(error), path=error.path) from None

    def _start(
        self, carrying_out: Coroutine[Any, Any, None], size: int, *, is_urgent: bool = False, finishes: bool = False
    ) -> None:
        busy = ""
        if not is_urgent and (self._waiting >= MOST_WAITING or self._held + size > MOST_HELD):
            busy = f"{self._waiting} requests of this program wait already"
        if is_urgent and len(self._tasks) >= 2 * MOST_WAITING:
            busy = f"{len(self._tasks)} requests of this program are under way already"
        if busy:
            carrying_out.close()
            raise RpcError(Code.BUSY, busy)
        self._waiting += not is_urgent
        self._held += size
        task = asyncio.get_running_loop().create_task(carrying_out)
        self._tasks.add(task)
        if finishes:
            self._finishing.add(task)

        def ended(task: asyncio.Task[None]) -> None:
            self._tasks.discard(task)
            self._finishing.discard(task)
            self._waiting -= not is_urgent
            self._held -= size

        task.add_done_callback(ended)

    def _follow(self, request: RpcRequest, outcome: Coroutine[Any, Any, object]) -> None:
        """Respond after the end of a request that has begun at once."""
        if self._begun >= MOST_BEGUN:
            outcome.close()
            raise RpcError(
                Code.BUSY,
                f"this {request.method} was carried out, but no outcome is reported: {self._begun} earlier requests of "
                "this program still wait for outcomes",
            )
        self._begun += 1
        task = asyncio.get_running_loop().create_task(outcome)
        self._tasks.add(task)

        def ended(task: asyncio.Task[Any]) -> None:
            self._tasks.discard(task)
            self._begun -= 1
            if task.cancelled():
                return
            try:
                self._respond(request, task.result())
            except Exception as error:  # noqa: BLE001 - as in `receive`
                self._fail(request, error)

        task.add_done_callback(ended)

    async def _carry_out_large(self, context: C, message: bytes | str) -> None:
        """Read a large message in a thread, in turn with requests in order, and carry out the request."""
        async with AsyncExitStack() as turn:
            await turn.enter_async_context(self._order)
            try:
                request = await computed(parse)(message)
            except RpcError as error:
                self._refuse(error)
                return
            try:
                method, params = await computed(self._checked)(request)
            except Exception as error:  # noqa: BLE001 - as in `receive`
                self._fail(request, error)
                return
            if not method.finishes:
                self._finishing.discard(asyncio.current_task())
                if self._is_closed:
                    return
            if method.in_order:
                await self._carry_out(context, request, method, params, turn=nullcontext())
                return
        await self._carry_out(context, request, method, params)

    async def _carry_out(
        self,
        context: C,
        request: RpcRequest,
        method: Method[C],
        params: Struct,
        turn: AbstractAsyncContextManager[object] | None = None,
    ) -> None:
        """Carry out a request in turn, and respond; `turn` replaces the turn of the method."""
        try:
            async with turn or self._turn(method):
                if not method.is_urgent:
                    await self._room.wait()  # or a program that does not read could fill the memory with responses
                report = (self._reporter(request),) if method.reports else ()
                result = method.handler(context, params, *report)
                self._respond(request, await result if inspect.isawaitable(result) else result)
        except Exception as error:  # noqa: BLE001 - as in `receive`
            self._fail(request, error)

    def _turn(self, method: Method[C]) -> AbstractAsyncContextManager[object]:
        """Return what a request waits for; both kinds are granted in the order of the requests."""
        if method.is_urgent or not method.is_coroutine:
            return nullcontext()
        return self._order if method.in_order else self._reading

    def _reporter(self, request: RpcRequest) -> Callable[[Struct], None]:
        """Return a function that sends the progress of a request."""

        def report(progress: Struct) -> None:
            self.notify("progress", {"id": request.request_id, **msgspec.to_builtins(progress)})

        return report

    def _refuse(self, error: RpcError) -> None:
        self._write({"id": error.request_id, "error": ErrorObject.of(error)})

    def _respond(self, request: RpcRequest, result: Any) -> None:
        if request.request_id is not None:
            self._write({"id": request.request_id, "result": {} if result is None else result})

    def _fail(self, request: RpcRequest, error: Exception) -> None:
        if is_defect(error):
            _logger.error("%s failed", escape(request.method), exc_info=error)
        if request.request_id is not None:
            self._write({"id": request.request_id, "error": ErrorObject.of(error)})

    def _write(self, response: dict[str, Any]) -> None:
        if self._is_closed:
            return
        self._unread += self.is_paused
        if self._unread > MOST_WAITING:
            self._is_closed = True
            self._abort(f"{MOST_WAITING} responses wait unread")
            return
        self._send(encode({"jsonrpc": "2.0", **response}))
