"""The client's side of a shared board: joining the hub, its notices, and requests to it."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager, suppress
from typing import Any

import msgspec
from msgspec import Raw
from msgspec.structs import replace

from servolink.boards import BoardProfile, ProfileInUse
from servolink.connection import Connection, ConnectionOptions, SendPoints
from servolink.control import (
    BoardState,
    ConnectionNow,
    Greeting,
    HoldNotice,
    HoldStatus,
    LeaseNotice,
    LeaseStatus,
    RefusedNotice,
    Role,
    ShareTransport,
    StoppedNotice,
    StreamBegun,
    StreamSent,
    Tighten,
    Welcome,
    open_channel,
)
from servolink.errors import ConnectionLost, MotionRefused, OpenError, Reason, RequestRefused, ServolinkError, escape
from servolink.motion import STOPPED, MotionLimits, Ticket
from servolink.protocol import Packet

_OF_THE_BOARD = ("caption_encoding", "depth", "write_depth")
"""The options in a profile that count through a hub too; it settles the others with the board."""
_LIMIT = 5.0  # seconds for immediate answers of the hub
_logger = logging.getLogger(__name__)


class HubLink:
    """Takes the lease before a motion, for a refusal with a reason, and waits during exclusive use by others."""

    def __init__(self, connection: Connection, welcome: Welcome) -> None:
        self._connection = connection
        self._welcome = welcome
        self._has_lease = False
        self._mover: str | None = None  # another program with the lease
        self._holds = 0  # transfers of this program under way
        self.has_lost_board = False
        """Whether the hub has lost the board, and is reconnecting."""
        self._lost = ""  # description of the loss, for people
        self._refused: RefusedNotice | None = None  # of the latest motion, or of another packet since
        self._beats: asyncio.Task[None] | None = None
        self.on_board: Callable[[bool], None] = lambda has_lost_board: None
        """Called with `has_lost_board` when the hub loses or finds the board."""

    async def open(self, greeting: Greeting) -> None:
        """Connect to the control interface of the hub. Raise OpenError with the remedy."""
        dead_man = ShareTransport.dead_man
        rpc = Greeting(
            wants="rpc", who=greeting.who, role=greeting.role, session=self._welcome.session, dead_man=dead_man
        )
        self._channel, welcome = await open_channel(self._welcome.name, rpc)
        self._acknowledge(welcome.stops)
        early: list[tuple[str, Raw]] = []  # perhaps newer than the state, and read before
        self._channel.on_notification = lambda *notification: early.append(notification)
        self._channel.on_end = self._end
        try:
            state = await self._channel.call("board.state", timeout=_LIMIT)
        except BaseException:
            await self._channel.close()
            raise
        board = msgspec.json.decode(state, type=BoardState)
        self._learn_lease(board.lease)
        self._learn_hold(board.hold)
        self._learn_upstream(board)
        self._connection.opener.unsupported |= frozenset(board.unanswered)
        for notification in early:
            self._hear(*notification)
        self._channel.on_notification = self._hear
        self._connection.preparations += (self._take_lease_for,)
        gates = self._connection.gates

        def refuse_lost(packet: Packet, ticket: Ticket) -> ServolinkError | None:
            # Queries pass: the board may come back in time.
            lost = (
                ConnectionLost(f"{type(packet).__name__} was not sent: {self._lost}") if self.has_lost_board else None
            )
            return lost or gates.line(packet, ticket)

        self._connection.gates = replace(gates, line=refuse_lost, role=self._refuse_role, lease=self._refuse_lease)
        if dead_man is not None:
            self._beats = asyncio.create_task(self._beat(dead_man / 4))

    async def close(self) -> None:
        """Disconnect: the hub frees the lease and the board. Motions go on to their end."""
        if self._beats is not None:
            self._beats.cancel()
            self._channel.tell("lease.give")  # or the hub would stop what a program with a dead-man time moves
        await self._channel.close()

    async def _beat(self, pause: float) -> None:
        while self._channel.ended is None:
            self._channel.tell("lease.beat")
            await asyncio.sleep(pause)

    async def take_lease(self, *, force: bool = False) -> None:
        """Take the lease, with `force` from another program too. Raise MotionRefused with the name of the holder."""
        await self._channel.call("lease.take", timeout=_LIMIT, force=force)
        self._has_lease, self._mover = True, None

    def stream(self, hz: float, gap: float, limits: MotionLimits, *, any_angle: bool) -> SendPoints:
        """Return a function to stream set-points through the hub, which shortens them to `limits` and its own."""
        number: int | None = None
        freely = {"any_angle": True} if any_angle else {}  # unknown to hubs of earlier versions

        async def send_points(angles: Mapping[int, float], until: float) -> Mapping[int, int]:
            nonlocal number
            if number is None:
                # With its first set-point, since the hub needs no streams without any.
                begun = await self._channel.call(
                    "stream.begin", hz=hz, gap=gap, limits=Tighten.messages(limits), **freely
                )
                number = msgspec.json.decode(begun, type=StreamBegun).stream
            targets = {str(servo_id): angle for servo_id, angle in angles.items()}
            sent = await self._channel.call("stream.send", stream=number, targets=targets)
            return {int(servo_id): angle for servo_id, angle in msgspec.json.decode(sent, type=StreamSent).sent.items()}

        return send_points

    async def catch_up(self) -> None:
        """Return when all is heard that the hub has told by now, since its answers keep the order."""
        await self._channel.call("board.state", timeout=_LIMIT)

    def refusal_of(self, packet: Packet) -> MotionRefused | None:
        """Return why the hub has not sent a motion, if it has said so since the latest motion was prepared."""
        refused = self._refused
        if refused is None or refused.packet != type(packet).__name__:
            return None
        return MotionRefused(refused.reason, reason=Reason(refused.cause))

    async def stop(self) -> None:
        """Stop all servos, and return when the hub has read all of them as stopped. Raise OutcomeUnknown otherwise."""
        await self._channel.call("stop")

    @asynccontextmanager
    async def exclusive(self, reason: str) -> AsyncIterator[None]:
        """Take exclusive use of the board in this context, after other programs; readers only wait."""
        self._holds += 1
        try:
            if self._holds == 1 and self._welcome.role == "edit":
                await self._channel.call("board.hold", reason=reason)
            yield
        finally:
            self._holds -= 1
            if not self._holds and self._welcome.role == "edit":
                self._channel.tell("board.release")

    @asynccontextmanager
    async def moving(self) -> AsyncIterator[None]:
        """Hold the lease while stored records turn servos.

        Raise MotionRefused, which names the holder, if another program has it, and RequestRefused without the role.
        """
        if lacking := self._lacking(Role.EDIT, "changing what is stored"):
            raise lacking
        had_lease = self._has_lease
        if not had_lease:
            await self.take_lease()
        try:
            yield
        finally:
            if not had_lease:
                self._channel.tell("lease.give")

    async def _take_lease_for(self, packet: Packet, ticket: Ticket) -> None:
        """Take the lease before a motion, and try it. Raise MotionRefused that names another holder, or a fall."""
        if not self._has_lease and packet.is_motion:
            await self.take_lease()
        if packet.is_motion:
            self._refused = None
        if self._welcome.has_forecast and packet.is_motion:  # a frame that is refused would only be logged
            await self._channel.call("motion.check", frame=self._connection.codec.encode(packet).hex())

    def _refuse_role(self, packet: Packet, ticket: Ticket) -> RequestRefused | None:
        """Refuse packets for higher roles: the hub would not send them, and could not always report the refusal."""
        return self._lacking(Role.needed_for(packet), type(packet).__name__)

    def _refuse_lease(self, packet: Packet, ticket: Ticket) -> MotionRefused | None:
        """Refuse a motion while another program holds the lease; the hub takes a free lease."""
        if self._mover is None or not packet.is_motion:
            return None
        name = escape(self._welcome.name)
        return MotionRefused(
            f"the servos of {name} are moved by {escape(self._mover)}: wait until it is free, or take it over with "
            f"`servolink share --take {name}`",
            reason=Reason.LEASE,
        )

    def _lacking(self, needed: Role, what: str) -> RequestRefused | None:
        """Return the error if `what` needs a higher role than the program's."""
        name, role = escape(self._welcome.name), self._welcome.role
        if Role.parse(role) >= needed:
            return None
        return RequestRefused(
            f"nothing was sent: {what} needs the role {needed}, and this program has the role {role}; "
            f"connect to share://{name}?role={needed}",
            reason=Reason.ROLE,
        )

    def _hear(self, method: str, params: Raw) -> None:
        """Take a notification of the hub; log unreadable ones."""
        try:
            if method == "lease":
                notice = msgspec.json.decode(params, type=LeaseNotice)
                self._learn_lease(notice.lease)
                if notice.event == "asked for" and self._has_lease:
                    _logger.warning("%s asks for the right to move the servos", escape(notice.by or "another program"))
            elif method == "hold":
                self._learn_hold(msgspec.json.decode(params, type=HoldNotice).hold)
            elif method == "connection":
                self._learn_upstream(msgspec.json.decode(params, type=ConnectionNow))
            elif method == "stopped":
                stopped = msgspec.json.decode(params, type=StoppedNotice)
                cause = Reason.STOP if stopped.stalled is None else Reason.STALL
                # It ends waiting motions and playing, as a stop of this program.
                self._connection.stops.stop(escape(stopped.reason) or STOPPED, cause)
                self._acknowledge(stopped.number)
            elif method == "refused":
                self._refused = refused = msgspec.json.decode(params, type=RefusedNotice)
                _logger.warning("%s was not sent to the board: %s", escape(refused.packet), escape(refused.reason))
        except (msgspec.MsgspecError, UnicodeDecodeError) as error:
            _logger.warning("a notification of the hub cannot be read: %s", escape(str(error)))

    def _acknowledge(self, stop: int | None) -> None:
        """Acknowledge a stop among the frames: those before it move nothing any more. None from an earlier hub."""
        if stop is not None:
            with suppress(ConnectionLost):  # which the connection reports itself
                self._connection.send_aside(StoppedNotice.heard(stop))

    def _learn_lease(self, lease: LeaseStatus | None) -> None:
        had_lease = self._has_lease
        self._has_lease = lease is not None and lease.session == self._welcome.session
        self._mover = None if lease is None or self._has_lease else lease.who or "another program"
        if had_lease and not self._has_lease and lease is not None:
            _logger.warning("%s moves the servos from now on, not this program", escape(lease.who))

    def _learn_hold(self, hold: HoldStatus | None) -> None:
        if hold is None or hold.session == self._welcome.session:
            self._connection.resume()
            return
        reason = f"{hold.who} has exclusive use of the board{f' ({hold.reason})' if hold.reason else ''}"
        _logger.warning("waiting: %s", escape(reason))
        self._connection.suspend(reason)

    def _learn_upstream(self, upstream: BoardState | ConnectionNow) -> None:
        self.has_lost_board = upstream.state == "lost"
        self._lost = f"the hub {self._welcome.name} has lost its board and tries to get it back"
        if upstream.another:
            self._lost += f" ({upstream.another})"
        self._connection.explain_silence(self._lost if self.has_lost_board else "")
        self.on_board(self.has_lost_board)

    def _end(self) -> None:
        """End the connection too: without the hub's word a program could wait for ever."""
        if self._connection.ended is None:
            self._connection.answers.lost(ConnectionLost(f"the hub of {self._welcome.name} has closed the connection"))


async def open_link(connection: Connection, transport: ShareTransport) -> HubLink | None:
    """Tie an open connection to the control interface of its hub; None for a hub without one. Raise OpenError."""
    welcome = await transport.greet()  # known from the greeting on opening
    if not welcome.has_control:
        return None
    link = HubLink(connection, welcome)
    await link.open(transport.greeting)
    return link


async def join_hub(
    transport: ShareTransport, given: dict[str, Any], profile: ProfileInUse | None
) -> tuple[ConnectionOptions, ProfileInUse | None]:
    """Greet the hub; return the options of the connection, with those `given` first, and the profile of the board.

    Without `profile`, the profile is the hub's. Raise OpenError, and leave nothing open, if the hub lets nobody in.
    """
    transport.greeting.byte_order = given.get("byte_order", "little")
    welcome = await transport.greet()
    try:
        found = msgspec.json.decode(welcome.profile, type=BoardProfile | None)
        if profile is None and found is not None:
            profile = ProfileInUse(welcome.name, found)
        options: dict[str, Any] = {"patience": welcome.patience}
        if profile is not None:
            settings = {name: getattr(profile.settings, name) for name in _OF_THE_BOARD}
            options |= {name: value for name, value in settings.items() if value is not None}
        return ConnectionOptions(**(options | given)), profile
    except msgspec.MsgspecError as error:
        await transport.close()
        raise OpenError(f"{transport.url}: the hub has a profile of another version: {error}") from error
    except BaseException:
        await transport.close()
        raise
