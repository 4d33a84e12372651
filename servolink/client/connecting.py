"""`connect`: from an address to a connected board."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Generator
from contextlib import suppress
from types import TracebackType
from typing import TYPE_CHECKING, Any, NoReturn

from msgspec.structs import replace

from servolink.boards import BoardProfile, ProfileFile, ProfileInUse, hub_of, resolve_board, resolve_url
from servolink.client.board import Board
from servolink.client.hub_link import join_hub, open_link
from servolink.client.identity_guard import IdentityGuard
from servolink.client.session import Session, set_mode
from servolink.connection import (
    BoardSharing,
    Connection,
    ConnectionOptions,
    Stats,
    Taps,
    TransmissionMode,
    options_in,
)
from servolink.control import ShareTransport
from servolink.errors import (
    ConnectionLost,
    OpenError,
    ProfileError,
    Reason,
    RequestError,
    RequestTimeout,
    TransportUnavailable,
    escape,
    quote,
)
from servolink.motion import INTERVAL_UNIT, AngleLimits, AngleUnit, MotionPlanner, SpeedCap, motion_limits
from servolink.protocol import ByteOrder, QueryProjectIDRequest
from servolink.support import Pauses, Reconnecting
from servolink.transports import PortTracker, Transport, create

_HOW = (
    "use `async with servolink.connect(...) as board:` or `board = await servolink.connect(...)`, or servolink.sync "
    "without async"
)
_AFTER_RESET = 0.3  # seconds


class connect:  # noqa: N801 - reads as the function it stands for
    """`async with connect(url) as board:` opens a board and closes it again; `await connect(url)` only opens it.

    Connecting begins with a handshake: a few queries that prove that no response to an earlier program is
    outstanding. The options up to `write_depth` can also stand in the address
    (`serial:///dev/ttyACM0?byte_order=big`). Arguments come first, then the address, then the profile; limits of
    the profile only tighten those given. An address or a profile can also have `answers_twice=yes`, for a board
    that answers requests twice, `late_copies=yes`, for a line that brings copies of responses later, and
    `ignore_extra=yes`, for responses longer than documented. Two boards on one line are refused with every option.

    Args:
        url: Address (`serial:///dev/ttyACM0`, `tcp://host:port`, `virtual://`), device path, name given by
            `servolink use`, or transport; None for the only board that `discover` finds.
        byte_order: "little" unless given.
        caption_encoding: "utf-8" unless given.
        transmission_mode: When to set mode 1 (3.1.1), which this protocol needs: "auto", if the board does not
            answer; 1, always; "keep", never.
        patience: Time to ask for one response, 0.001..3600 seconds, repeats included, from the first sending; 3
            unless given.
        depth: Most queries under way at once, 1..64; 1 unless given, for a board that does not queue them. As many
            are used as make responses come faster.
        write_depth: Most requests under way while the board is changed, 1..64; 1 unless given.
        angle_unit: Unit set on all servos before the first command with an angle; None leaves the units unchanged.
        angle_limits: Degrees, for all servos or by servo id, not by caption: a new caption must not lift a limit.
        speed_cap: Degrees per second, for all servos or by servo id.
        soft_start: Highest speed of the first movement of each servo, degrees per second (see `Board.move`).
        reconnect: Whether to restore a lost connection to the same board in the background. Waiting requests fail
            all the same, and no movement is repeated (see `Board.states`).
        handshake: False to begin the handshake with the first request, so that a `stop` can come first.
        profile: Profile of the board (see `servolink board show`), or its name; None for the profile of the board's
            name, also for the address of a named board.

    Raises:
        OpenError: The address cannot be opened, or no board answers; the text gives the remedy.
        TransportUnavailable: A library is missing, or the address is written wrongly.
        ProfileError: The profile is damaged; the text names the file and the line.
        WrongBoard: Later, from a method that moves or changes a board other than that of the profile.
    """

    def __init__(
        self,
        url: str | Transport | None = None,
        *,
        byte_order: ByteOrder | None = None,
        caption_encoding: str | None = None,
        transmission_mode: TransmissionMode | None = None,
        patience: float | None = None,
        depth: int | None = None,
        write_depth: int | None = None,
        angle_unit: AngleUnit | None = "degree",
        angle_limits: AngleLimits | None = None,
        speed_cap: SpeedCap | None = None,
        soft_start: float | None = None,
        reconnect: bool = False,
        handshake: bool = True,
        profile: BoardProfile | str | None = None,
    ) -> None:
        given = {
            "byte_order": byte_order,
            "caption_encoding": caption_encoding,
            "transmission_mode": transmission_mode,
            "patience": patience,
            "depth": depth,
            "write_depth": write_depth,
        }
        self._options: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
        ConnectionOptions(**self._options)  # checks the options; those in the address are known later
        if angle_unit not in ("degree", "adc", None):
            raise ValueError(f"angle_unit must be 'degree', 'adc' or None, not {quote(angle_unit)}")
        _check_url(url)
        _check_profile(profile)
        if reconnect:
            _refuse_transport(url, "reconnect")
        self._url = url
        self._reconnect = reconnect
        self._handshake = handshake
        self._profile = profile
        self._angle_unit: AngleUnit | None = angle_unit
        self._limits = motion_limits(angle_limits, speed_cap, soft_start, "an argument")
        self._is_entered = False  # by `async with`, from before the board is open
        self._board: Board | None = None
        self.taps = Taps()
        """Listeners to bytes and requests, from the first byte on."""

    if not TYPE_CHECKING:  # a type checker would accept every attribute

        def __getattr__(self, name: str) -> NoReturn:
            """Raise AttributeError; for an attribute of boards, explain how to get a board."""
            if not name.startswith("_") and hasattr(Board, name):
                raise AttributeError(f"{name!r} belongs to a connected board, and nothing is connected yet: {_HOW}")
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

        def __enter__(self) -> NoReturn:
            """Raise TypeError with the way to open a board."""
            raise TypeError(f"servolink.connect cannot be used with `with` alone: {_HOW}")

        def __exit__(self, *error: object) -> None:
            """Do nothing; `with` needs the method to call `__enter__`."""

    def __repr__(self) -> str:
        """Return the address and how to open the board, for code that has forgotten to await."""
        url = self._url if self._url is None or isinstance(self._url, str) else self._url.url
        return f"<connect{escape(f' {url}' if url else '')}, nothing is connected yet: {_HOW}>"

    async def open(self) -> Board:
        """Open the board, as `await connect(...)` does."""
        if self._url is not None and not isinstance(self._url, str):
            transport = create(self._url)
            options, profile = await self._prepare(transport, None, self._options)
            self._log_text(transport.url, options)
            connection = await self._open_connection(transport, options, Stats(), profile)
            return self._board_on(Session(connection, None, profile))
        address, name = await self._resolve()
        stats, device = Stats(), create(address)
        try:
            options, profile = await self._prepare(device, name, options_in(address) | self._options)
            self._log_text(address, options)
            connection = await self._open_despite_reset(device, address, options, stats, profile)
        except OpenError as error:
            await _name_hub(address, error)
            raise
        if not self._reconnect:
            return self._board_on(Session(connection, None, profile))

        port = PortTracker(address)

        async def reopen() -> Connection:
            return await self._open_connection(create(await port.url()), options, stats, profile)

        session = Session(connection, reopen, profile)
        board = self._board_on(session)
        try:
            await port.learn()
            if "QueryProjectID" not in session.unanswered:
                try:
                    await board.project_id()  # to recognise the board after a loss
                except RequestTimeout as error:
                    await session.note_unanswered(QueryProjectIDRequest(), error)
        except BaseException as error:
            await board.close()
            if isinstance(error, RequestTimeout):
                raise OpenError(str(error), reason=Reason.NO_RESPONSE) from None
            raise
        return board

    def _log_text(self, url: str, options: ConnectionOptions) -> None:
        """Log the text between frames, if anybody reads that log: a second parser takes time."""
        self.taps.log_text(url, options.byte_order)

    def _board_on(self, session: Session) -> Board:
        if session.profile is None:
            return Board(session, self._angle_unit, MotionPlanner(self._limits))
        limits = self._limits.tightened(session.profile.limits)
        interval_unit = session.profile.settings.interval_unit or INTERVAL_UNIT
        return Board(session, self._angle_unit, MotionPlanner(limits, interval_unit))

    async def _resolve(self) -> tuple[str, str | None]:
        """Return address and name of the board."""
        assert self._url is None or isinstance(self._url, str)  # noqa: S101 - narrows the type

        if self._profile is not None:  # the board need not be recognised
            return await resolve_url(self._url), None
        found = await resolve_board(self._url)
        return found.url, found.name

    def _profile_of(self, name: str | None) -> ProfileInUse | None:
        """Return the profile given, or else that of the board `name`. Raise ProfileError if it cannot be used."""
        if (profile := self._profile or name) is None:
            return None

        if not isinstance(profile, str):
            return ProfileInUse(name, profile)
        if (found := ProfileFile(profile).load()) is not None:
            return ProfileInUse(profile, found)
        if self._profile is None:
            return None
        names = ", ".join(ProfileFile.names()) or "none"
        raise ProfileError(f"{profile} has no profile (known: {names}); `servolink doctor {profile} --learn` makes one")

    async def _prepare(
        self, transport: Transport, name: str | None, given: dict[str, Any]
    ) -> tuple[ConnectionOptions, ProfileInUse | None]:
        """Return the options of the connection, with those `given` first, and the profile, which a hub knows."""
        if (hub := _hub_on(transport)) is None:
            profile = self._profile_of(name)
            return ConnectionOptions(**(_options_in(profile) | given)), profile

        return await join_hub(hub, given, self._profile_of(None))

    async def _open_despite_reset(
        self, device: Transport, address: str, options: ConnectionOptions, stats: Stats, profile: ProfileInUse | None
    ) -> Connection:
        """Open a connection, and once more if it ends meanwhile: the first opening resets some boards."""
        try:
            return await self._open_connection(device, options, stats, profile)
        except OpenError as error:
            if not isinstance(error.__cause__, ConnectionLost) or _hub_on(device) is not None:
                raise
        await asyncio.sleep(_AFTER_RESET)
        try:
            return await self._open_connection(create(address), options, stats, profile)
        except OpenError as error:
            raise OpenError(
                f"{error}; the connection ended during a first opening: the board may reset when its port is "
                "opened, so wait until it has started and try again, or check cable and power",
                reason=error.reason,
            ) from error

    async def _open_connection(
        self, transport: Transport, options: ConnectionOptions, stats: Stats, profile: ProfileInUse | None
    ) -> Connection:
        if (hub := _hub_on(transport)) is not None:
            hub.greeting.byte_order = options.byte_order
        connection = Connection(
            transport,
            options,
            unsupported=(profile and profile.settings.unsupported) or (),
            through_hub=hub is not None,
            stats=stats,
            taps=self.taps,
        )
        guard = _guard(connection, profile)
        try:
            await connection.open(handshake=hub is None)  # with a hub a session begins clean
            if hub is not None:
                connection.hub = await _link_to(hub, connection)
            if self._handshake:
                await connection.shake_hands()
            if options.transmission_mode == 1 and connection.opener.mode_answered != 1:
                await set_mode(connection, 1)
            if guard is not None and self._handshake:
                await guard.warn()
        except BaseException as error:
            await connection.close()
            if isinstance(error, RequestError):
                reason = Reason.NO_RESPONSE if isinstance(error, RequestTimeout) else error.reason
                raise OpenError(str(error), reason=reason) from None
            if isinstance(error, ConnectionLost):
                raise OpenError(str(error)) from error
            if isinstance(error, OpenError):
                _shorten_traceback(error)
            raise
        return connection

    def __await__(self) -> Generator[Any, None, Board]:
        """Open the board. The caller closes it."""
        return self.open().__await__()

    async def __aenter__(self) -> Board:
        """Open the board. Raise RuntimeError inside another `async with` of the same object."""
        if self._is_entered:
            raise RuntimeError("this `connect(...)` is used by another `async with`; call connect again for each")
        self._is_entered = True
        try:
            self._board = await self.open()
        except BaseException:
            self._is_entered = False
            raise
        return self._board

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Close the board and free the port."""
        board, self._board, self._is_entered = self._board, None, False
        if board is not None:
            await board.close()


async def _link_to(hub: ShareTransport, connection: Connection) -> BoardSharing | None:
    """Tie a connection to the control interface of its hub; None for a hub without one."""
    return await open_link(connection, hub)


def _check_url(url: object) -> None:
    """Raise TypeError unless `url` is an address, a transport or None."""
    if url is None or isinstance(url, str):
        return

    if not isinstance(url, Transport):
        raise TypeError(f"url must be an address as text, a transport or None, not {quote(url)}")


def _check_profile(profile: object) -> None:
    """Raise TypeError unless `profile` is a profile, a name or None."""
    if profile is None or isinstance(profile, str):
        return

    if not isinstance(profile, BoardProfile):
        raise TypeError(f"profile must be a BoardProfile, the name of a board or None, not {quote(profile)}")


def _guard(connection: Connection, profile: ProfileInUse | None) -> IdentityGuard | None:
    """Guard a connection whose profile identifies the board; None without such a profile."""
    if profile is None or profile.profile.identity is None:
        return None

    guard = IdentityGuard(connection, profile)
    connection.preparations += (guard.prepare,)
    connection.gates = replace(connection.gates, identity=guard.refusal)
    return guard


def _options_in(profile: ProfileInUse | None) -> dict[str, Any]:
    """Return the options of the connection in a profile."""
    if profile is None:
        return {}
    settings = {name: getattr(profile.settings, name, None) for name in ConnectionOptions.__struct_fields__}
    return {name: value for name, value in settings.items() if value is not None}


def _shorten_traceback(error: OpenError) -> None:
    """Drop the frames of a self-explaining error: the system could not open a port or an address.

    Other causes keep theirs, because they are defects, such as a TypeError in a transport of another package.
    """
    chain: list[BaseException] = [error]
    while (cause := chain[-1].__cause__ or chain[-1].__context__) is not None and cause not in chain:
        chain.append(cause)
    if all(isinstance(one, (OpenError, OSError)) for one in chain):
        for one in chain:
            one.__traceback__ = None


def _hub_on(transport: Transport) -> ShareTransport | None:
    """Return the transport if a hub is at the other end."""
    if not getattr(transport, "is_shared", False):
        return None

    return transport if isinstance(transport, ShareTransport) else None


async def _name_hub(url: str, error: OpenError) -> None:
    """Raise an error with the name of the hub, if a hub uses the board that could not be opened."""
    if (hub := await asyncio.to_thread(hub_of, url)) is not None:
        raise OpenError(
            f"{error}. It is {hub.product}: use {hub.url} (`servolink share --status` shows its programs)"
        ) from error


def _refuse_transport(url: object, name: str) -> None:
    if not (url is None or isinstance(url, str)):
        raise ValueError(f"{name}: a transport can be opened only once; give an address")


async def reconnecting(url: str | None = None, **options: Any) -> AsyncGenerator[Board, None]:
    """Yield a connected board, and a newly connected one in each further round of the `async for` loop.

    After ConnectionLost, `continue` the loop; `break` ends it, and `contextlib.aclosing` around it then closes the last
    board at once. Takes the address and options of `connect`. Waits 0.1 to 5 s before each further connection, longer
    each time until a board has answered.
    """
    _refuse_transport(url, "reconnecting")
    pauses = Pauses()
    async for board in Reconnecting(connect(url, **options).open, pauses, _may_come_back):
        with suppress(OpenError, ConnectionLost):  # unplugged in the body of the `async with`
            try:
                yield board
            finally:
                await board.close()
            if board.stats.round_trips:
                pauses.restart()


def _may_come_back(error: Exception) -> bool:
    """Return whether the board may be plugged in later; waiting does not help against a wrong address."""
    return isinstance(error, (OpenError, ConnectionLost)) and not isinstance(error, TransportUnavailable)
