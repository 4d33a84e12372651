"""Session: one board across all connections to the board, used by all parts of `Board`."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, AsyncIterator, Awaitable, Callable, Coroutine
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from typing import Any, TypeVar

from servolink.boards import ProfileInUse
from servolink.client.board_identity import BoardIdentity
from servolink.client.reconnect import Reconnector
from servolink.connection import PacketConnection, Stats, lost
from servolink.control import ConnectionState
from servolink.errors import (
    ConnectionLost,
    MotionRefused,
    Reason,
    Rejected,
    RequestRefused,
    RequestTimeout,
    ServolinkError,
    ServoStalled,
    escape,
    quote,
)
from servolink.motion import Ticket
from servolink.protocol import (
    ClearAllDataRequest,
    Codec,
    Command,
    Packet,
    Query,
    QueryProjectIDRequest,
    QueryProjectIDResponse,
    QueryServoListRequest,
    Request,
    Response,
    Result,
    TransmissionModeSettingRequest,
    WriteProjectIDRequest,
)
from servolink.support import check_seconds

R = TypeVar("R", bound=Response)


class ConnectionStates:
    """The state of a connection, for any number of readers."""

    def __init__(self) -> None:
        """Start in the state `connected`."""
        self.now: ConnectionState = "connected"
        self._readers: list[asyncio.Queue[ConnectionState]] = []

    def change(self, state: ConnectionState) -> None:
        """Pass a new state to every reader; `closed` is final."""
        if self.now not in {state, "closed"}:
            self.now = state
            for reader in self._readers:
                with suppress(RuntimeError):  # the reader's loop has ended, and nobody can be woken
                    reader.put_nowait(state)

    async def read(self) -> AsyncGenerator[ConnectionState, None]:
        """Yield the present state and then each change, up to `closed`."""
        reader: asyncio.Queue[ConnectionState] = asyncio.Queue()
        reader.put_nowait(self.now)
        self._readers.append(reader)
        try:
            state: ConnectionState | None = None
            while state != "closed":
                state = await reader.get()
                yield state
        finally:
            self._readers.remove(reader)


class Session:
    """Sends requests to a board; holds the state to restore when a lost connection is replaced."""

    def __init__(
        self,
        connection: PacketConnection,
        reopen: Callable[[], Awaitable[PacketConnection]] | None = None,
        profile: ProfileInUse | None = None,
    ) -> None:
        """Use `connection`; replace a lost connection with `reopen`, which opens another to the same board.

        `profile` is what is known of the board.
        """
        self.connection = connection
        """Present connection, replaced after a loss."""
        self.profile = profile
        """Known facts of the board; None without a profile."""
        self.identity = BoardIdentity()
        self.losses = 0
        """How often the board was lost, by this connection or by a hub."""
        self._enders: list[Callable[[ConnectionLost], None]] = []
        self._restorers: list[Callable[[PacketConnection], Awaitable[None]]] = []
        self._mode: int | None = None  # transmission mode set by this session; None if unchanged
        self._unanswered = connection.unsupported  # names of queries
        self._states = ConnectionStates()
        self.loop = asyncio.get_running_loop()
        """Event loop of the connection."""
        self._ended: ConnectionLost | None = None
        self._reconnector: Reconnector | None = None
        if reopen is not None:
            self._reconnector = Reconnector(lambda: self._open_again(reopen), self._resume, self._found_another)
        connection.answers.on_end = self._connection_ended
        self._follow_state(connection)

    @property
    def url(self) -> str:
        """The address of the board."""
        return self.connection.url

    @property
    def codec(self) -> Codec:
        """Byte order and caption encoding."""
        return self.connection.codec

    @property
    def stats(self) -> Stats:
        """Counters since the board was connected, across reconnects."""
        return self.connection.stats

    @property
    def unanswered(self) -> frozenset[str]:
        """Names of queries that the board does not answer (see `Board.unanswered`)."""
        known = (self.profile and self.profile.settings.unsupported) or ()
        return self.connection.unsupported.union(self._unanswered, known)

    @property
    def state(self) -> ConnectionState:
        """Present state of the connection to the board."""
        return self._states.now

    def states(self) -> AsyncGenerator[ConnectionState, None]:
        """Yield the present state, then each change up to `closed`."""
        return self._states.read()

    def restore_with(self, restore: Callable[[PacketConnection], Awaitable[None]]) -> None:
        """Call `restore` with each new connection before use; `restore` raises on failure."""
        self._restorers.append(restore)

    def end_with(self, end: Callable[[ConnectionLost], None]) -> None:
        """Call `end` when the connection is lost for good, or closed; at once after the end."""
        self._enders.append(end)
        if self._ended is not None:
            end(self._ended)

    # --- motions ------------------------------------------------------------------------------------------------

    def ticket(self) -> Ticket:
        """Return a ticket for a motion requested now, valid until a stop or a loss of the connection."""
        return self.connection.stops.ticket()

    def check_goes_on(self, name: str, packet: Packet, ticket: Ticket) -> None:
        """Raise the error of an ended motion that began with `packet`: a loss, a stop, or another program.

        `name` says what is moving, such as `action 3`.
        """
        stops = self.connection.stops
        if not stops.issued(ticket) or self.state != "connected":
            raise ConnectionLost(f"{name} was started, and the connection was lost before it was over")
        if not stops.holds(ticket):
            if stops.cause is Reason.STALL:
                raise ServoStalled(
                    f"{name} was started, and then ended by the guard: {stops.reason}", packet, reason=Reason.STALL
                )
            raise RequestRefused(f"{name} was started, and then ended by a stop", packet, reason=Reason.STOP)
        if refusal := self.connection.gates.lease(packet, ticket):
            raise MotionRefused(f"{name} was started, and then interrupted: {refusal}") from refusal

    async def check_refused(self, packet: Packet, ticket: Ticket) -> None:
        """Raise the reason why a motion was refused, if a hub tells one: a stop, a loss, another program, a forecast.

        The refusal may come first, as it comes on another connection than what the hub tells.
        """
        if (hub := self.connection.hub) is None:
            return
        with suppress(ServolinkError):  # if the hub says nothing, the refusal itself is the error
            await hub.catch_up()
        if refusal := self.connection.gates.refusal(packet, ticket) or hub.refusal_of(packet):
            raise refusal

    # --- requests -----------------------------------------------------------------------------------------------

    def request(
        self,
        packet: Request[R],
        *,
        timeout: float | None = None,
        unchecked: bool = False,
        ticket: Ticket | None = None,
    ) -> Coroutine[Any, Any, R]:
        """Return a coroutine to send `packet` and return the response (see `Board.request`)."""
        if not isinstance(packet, Request):
            raise _wrong_packet(packet)
        if timeout is not None:
            check_seconds("timeout", timeout)
        return self.connection.request(packet, timeout=timeout, unchecked=unchecked, ticket=ticket)

    async def find(self, query: Query[R]) -> R | None:
        """Return the response to a short query; None from a board that answers other queries only.

        Not every opening asks each of them. Raise RequestTimeout for a board that answers nothing.
        """
        if query.short_name in self.unanswered:
            return None
        try:
            return await self.request(query)
        except RequestTimeout as error:
            await self.note_unanswered(query, error)
            return None

    async def note_unanswered(self, query: Query[Any], error: RequestTimeout) -> None:
        """Count a short query with this error as unanswered, also after a loss, if the board answers another one.

        Raise `error` if the board has answered the query before, or answers nothing now.
        """
        if query in self.connection.answered:
            raise error
        # The programs of a hub have no opening of their own, and each board with servos lists these.
        try:
            await self.request(next(iter(self.connection.answered), QueryServoListRequest()))
        except (RequestTimeout, ConnectionLost):
            raise error from None
        self._unanswered |= {query.short_name}

    async def send(self, packet: Command, *, ticket: Ticket | None = None) -> None:
        """Send a packet without a response (see `Board.send`)."""
        if not isinstance(packet, Command):
            raise _wrong_packet(packet)
        await self.connection.send(packet, ticket=ticket)

    async def command(self, packet: Request[Result], likely_cause: str) -> None:
        """Send a command whose response is success or failure. Raise Rejected with `likely_cause` on failure."""
        if not (await self.request(packet)).result:
            raise Rejected(f"{self.url} refused {packet.described}: {likely_cause}", packet)

    # --- commands that change restored settings or the project id of the board ------------------------------------

    async def set_transmission_mode(self, mode: int) -> None:
        """Set the transmission mode (3.1.1). Raise Rejected if the board stays in another."""
        await set_mode(self.connection, mode)
        self._mode = mode

    @asynccontextmanager
    async def transfer(self, reason: str, *, moves: bool = False) -> AsyncIterator[None]:
        """Return a context for a large transfer; on a shared board, with a `reason`, also with exclusive use.

        With `moves`, servos may turn: raise MotionRefused at once if another program moves a shared board.
        """
        connection = self.connection
        async with AsyncExitStack() as stack:
            if connection.hub is not None and reason:
                await stack.enter_async_context(connection.hub.exclusive(reason))
                if moves:
                    await stack.enter_async_context(connection.hub.moving())
            stack.enter_context(connection.bulk())
            yield

    async def clear_all_data(self) -> None:
        """Delete everything stored on the board (3.1.2)."""
        async with self.transfer("deleting everything"):
            await self._clear_all_data()

    async def _clear_all_data(self) -> None:
        with self.identity.changing(self.connection, 0):
            await self.command(ClearAllDataRequest(), "its data was not deleted")
        self.identity.changes_now(self.loop.time())
        self.identity.add(0)  # some boards keep the project id, others reset it to 0
        if self._reconnector is not None:
            # Only to recognise the board later; the data is deleted, so a failure here is not a failure of the call.
            with suppress(ServolinkError):
                await self.find_project_id()

    async def project_id(self) -> int:
        """Return the project id of the board (3.3.13)."""
        changes = self.identity.changes
        return self._learn_id(await self.request(QueryProjectIDRequest()), changes)

    async def find_project_id(self) -> int | None:
        """Return the project id of the board; None for a board that answers other queries only."""
        changes = self.identity.changes
        response = await self.find(QueryProjectIDRequest())
        return None if response is None else self._learn_id(response, changes)

    def _learn_id(self, response: QueryProjectIDResponse, changes: int) -> int:
        """Learn the id in a response to a query sent when the identity had changed so many times; return the id."""
        self.identity.learn(response.project_id, changes)
        return response.project_id

    async def write_project_id(self, project_id: int) -> None:
        """Write the project id (3.3.12). Raise Rejected if the board refuses."""
        with self.identity.changing(self.connection, project_id):
            await self.command(WriteProjectIDRequest(project_id), "it was not written")
        self.identity.changes_now(self.loop.time())
        self.identity.set(project_id)
        if self._reconnector is not None:
            # Only to recognise the board later: some boards store less of the id.
            with suppress(ServolinkError):
                if (found := await self.find(QueryProjectIDRequest())) is not None:
                    self.identity.add(found.project_id)

    # --- loss and end -------------------------------------------------------------------------------------------

    def is_at_home(self) -> bool:
        """Return True in the event loop of the connection, False after the end of that loop.

        Raise RuntimeError in another loop before that end: tasks of one loop cannot be awaited in another.
        """
        loop, home = asyncio.get_running_loop(), self.loop
        if loop is not home and not home.is_closed():
            raise RuntimeError(
                f"{escape(self.url)} was connected in {home!r} and cannot be closed in {loop!r}: close it in the first "
                "one; from another thread, with asyncio.run_coroutine_threadsafe(board.close(), loop)"
            )
        return loop is home

    async def stop_reconnecting(self) -> None:
        """Stop replacing lost connections by new connections."""
        if self._reconnector is not None:
            await self._reconnector.stop()

    async def close(self) -> None:
        """Close the connection and free the port."""
        self.connection.answers.on_end = self._end
        try:
            await self.connection.close()
        finally:
            self._end(lost(self.url, None))
            self._states.change("closed")

    def _connection_ended(self, error: ConnectionLost) -> None:
        self.identity.lost(self.loop.time())
        self.losses += 1
        self._states.change("lost")
        if self._reconnector is None or not self._reconnector.start():
            self._end(error)

    def _found_another(self, text: str) -> None:
        self.connection.on_another(text)

    def _follow_state(self, connection: PacketConnection) -> None:
        """Report the new connection; for a shared board, the state of the hub's connection."""
        if connection.hub is None:
            self._states.change("connected")
        else:
            connection.hub.on_board = self._hub_tells
            self._hub_tells(connection.hub.has_lost_board)

    def _hub_tells(self, has_lost_board: bool) -> None:  # noqa: FBT001 - called by the link to the hub
        if self.connection.ended is None:
            self.losses += has_lost_board
            self._states.change("lost" if has_lost_board else "connected")

    def _end(self, error: ConnectionLost) -> None:
        self._ended = error
        for end in self._enders:
            end(error)

    async def _open_again(self, reopen: Callable[[], Awaitable[PacketConnection]]) -> PacketConnection:
        await self.connection.close()  # after an end by silence the port is still open
        return await reopen()

    async def _resume(self, connection: PacketConnection) -> None:
        """Restore the session on a new connection, then use the connection. Raise the error of a failure."""
        connection.answers.on_end = self._connection_ended
        # First this protocol, if a mode was ever set: a restarted board in mode 0 would not answer the check.
        if self._mode is not None:
            await set_mode(connection, 1)
        # First, as another board may be plugged in at this address.
        if QueryProjectIDRequest().short_name not in self._unanswered:
            await self.identity.check(connection)
        # Before the swap: a caller who sees `connected` must find units and events as they were.
        for restore in self._restorers:
            await restore(connection)
        self.connection = connection
        # Last, because a board in mode 0 answers nothing any more.
        if self._mode not in (None, 1):
            await set_mode(connection, self._mode)
        if connection.ended is not None:  # lost again meanwhile, before this session handled the end
            raise connection.ended.copy()
        self.stats.reconnects += 1
        self._follow_state(connection)


def _wrong_packet(packet: object) -> TypeError:
    """Return the error for a wrong argument of `request` or `send`: the other kind of packet, or no packet."""
    if isinstance(packet, type) and issubclass(packet, Packet):
        fields = ", ".join(packet.__struct_fields__)
        return TypeError(f"{packet.__name__} is a class and not a packet; write {packet.__name__}({fields})")
    name = type(packet).__name__
    if isinstance(packet, Request):
        return TypeError(f"the board answers {name}; use request")
    if isinstance(packet, Command):
        return TypeError(f"the board does not answer {name}; use send")
    if isinstance(packet, Response):
        return TypeError(f"{name} is sent by the board only; pass a request, such as QueryServoListRequest()")
    return TypeError(f"packet must be a packet, such as QueryServoListRequest(), not {quote(packet)}")


async def set_mode(connection: PacketConnection, mode: int) -> None:
    """Set the transmission mode (3.1.1). Raise Rejected if the board stays in another."""
    request = TransmissionModeSettingRequest(mode)
    response = await connection.request(request)
    if response.result != mode:
        raise Rejected(f"the board was asked for mode {mode} and is in mode {response.result}", request)
