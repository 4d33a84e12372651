"""Transport for `virtual://`, a virtual board inside the program, on the same event loop."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar, cast

from servolink.errors import OpenError, ServolinkError, TransportUnavailable
from servolink.protocol import ByteOrder, Codec
from servolink.support import call_at
from servolink.transports import Address, BaseTransport, Faults, FaultyTransport
from servolink.virtual.board import VirtualBoard
from servolink.virtual.hardware import Hardware
from servolink.virtual.kind import BoardKind
from servolink.virtual.state_file import StateFile

SAVE_AFTER = 0.5
"""Seconds from a change of the storage to the saving."""

_logger = logging.getLogger(__name__)


class AttachedSession(Protocol):
    """Conversation of a host with a board; times are those of the event loop."""

    def receive(self, data: bytes, now: float) -> None:
        """Receive bytes from the host."""

    def detach(self, now: float) -> None:
        """Detach the host."""


class ServedBoard(Protocol):
    """Board that can be driven and served, such as `VirtualBoard`."""

    def attach(
        self, send: Callable[[bytes], None], unsent: Callable[[], int], unplugged: Callable[[], None]
    ) -> AttachedSession:
        """Attach a host (see `VirtualBoard.attach`)."""
        ...

    def detach(self, *sessions: Any, now: float | None = None) -> None:
        """Detach sessions of this board together."""

    def advance(self, now: float) -> None:
        """Execute all events due until `now`."""

    def next_due(self, now: float) -> float | None:
        """Return the time for the next call of `advance`; None if nothing will happen."""
        ...

    def watch(self, changed: Callable[[], None]) -> None:
        """Call `changed` when `next_due` may have changed."""

    def unwatch(self, changed: Callable[[], None]) -> None:
        """Undo `watch`."""


B = TypeVar("B", bound=ServedBoard)

BOARDS: dict[str, ServedBoard] = {}
"""Boards of this program at an address of their own: `virtual://NAME`."""


class BoardDriver:
    """Driver of a board: calls `advance` at each due time. Several drivers for the same board are harmless."""

    def __init__(self, board: ServedBoard) -> None:
        """Start immediately, on the running loop, until `stop`."""
        self._board = board
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        self._due = 0.0  # loop time of the timer
        board.advance(self._loop.time())
        board.watch(self._schedule)
        self._schedule()

    def stop(self) -> None:
        """Stop advancing the board."""
        self._board.unwatch(self._schedule)
        self._cancel()

    def _schedule(self) -> None:
        due = self._board.next_due(self._loop.time())
        if self._timer is not None and self._due == due:
            return
        self._cancel()
        if due is not None:
            self._due, self._timer = due, call_at(self._loop, due, self._wake, due)

    def _wake(self, due: float) -> None:
        self._timer = None
        # A timer may fire a little early: nothing would be due, and the board would wait for the next event.
        self._board.advance(max(due, self._loop.time()))
        self._schedule()

    def _cancel(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


class StateSaver:
    """Saver of the storage of a board, shortly after each change, so that a killed program loses little."""

    def __init__(self, board: Hardware, file: StateFile) -> None:
        """Start immediately, on the running loop, until `stop`; `file` is the state file of `board`."""
        self._board = board
        self._file = file
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        board.watch(self._changed)

    def stop(self) -> None:
        """Stop saving after changes."""
        self._board.unwatch(self._changed)
        if self._timer is not None:
            self._timer.cancel()

    def _changed(self) -> None:
        if self._timer is None and self._file.is_outdated:
            self._timer = self._loop.call_later(SAVE_AFTER, self._save)

    def _save(self) -> None:
        self._timer = None
        try:
            self._file.save()
        except ServolinkError as error:  # saving is tried again after the next change, and at the end
            _logger.warning("%s", error)


def from_address(address: Address) -> BoardTransport[Any] | FaultyVirtualTransport:
    """Return a transport to a new board for `virtual://?servos=16&seed=1&drop=0.01&state=FILE...`.

    `byte_order` applies to the board, and by default also to the connection. `twin=FILE` gives the board the body of a
    project. `virtual://NAME` leads to the board of this name in `BOARDS`, and its only options are faults of the line.
    """
    board = BOARDS.get(address.host)
    if (address.host and board is None) or address.port or address.path.strip("/"):
        raise address.refusal("a virtual board has no host or path, only options: virtual://?servos=16")
    seed = address.integer("seed", 0, 0, 2**63 - 1)
    faults = Faults.from_address(address)
    transport = _virtual(address, seed) if board is None else BoardTransport(board, address.url)
    address.refuse_unknown()
    return transport if faults == Faults() else FaultyVirtualTransport(transport, faults, seed=seed)


def _virtual(address: Address, seed: int) -> VirtualTransport:
    servos = address.integer("servos", 16, 0, Hardware.MAX_SERVOS)
    codec = Codec(cast("ByteOrder", address.choice("byte_order", "little", ("little", "big"))))
    kind = _kind_in(address)
    project = address.text("twin", "")
    if "twin" in address.options:
        given = servos if "servos" in address.options else None
        board = _with_body(project, servos=given, seed=seed, codec=codec, kind=kind)
    else:
        board = VirtualBoard(servos, seed, codec, kind)
    state = address.text("state", "")
    if not state:
        return VirtualTransport(board, address.url)

    return VirtualTransport(board, address.url, Path(state))


def _with_body(path: str, **options: Any) -> VirtualBoard:
    """Return a new board with the body of a project. Raise TransportUnavailable if the body is impossible here."""
    read_board = import_module("servolink.twin.board").read_board  # by name: the twin is made of virtual boards
    try:
        return cast("VirtualBoard", read_board(path, **options))
    except ServolinkError as error:
        raise TransportUnavailable(str(error)) from error


def _kind_in(address: Address) -> BoardKind:
    """Return the kind of board described by the options of `address`."""
    given = {}
    texts = {name: address.text(name, "") for name in BoardKind.__struct_fields__}
    if texts.keys().isdisjoint(address.options):
        return BoardKind.DEFAULT
    for option in BoardKind.options():
        if option.name in address.options:
            try:
                given[option.name] = option.read(texts[option.name])
            except ValueError as error:
                raise address.refusal(f"option {option.name} {error}") from None
    return BoardKind(**given)


class BoardTransport(BaseTransport, Generic[B]):
    """Transport to a board in the same program; any number of transports may lead to the same board."""

    def __init__(self, board: B, url: str = "virtual://") -> None:
        """Lead to `board`, named `url` in errors."""
        super().__init__(url)
        self.board = board
        self._session: AttachedSession | None = None
        self._driver: BoardDriver | None = None
        self._on_line: list[tuple[bytes, float]] = []  # sent by the host, with times; not yet received by the board
        self._pending: list[bytes] = []
        self._unsent = 0  # bytes sent by the board and not yet delivered to the receiver

    def unplug(self) -> None:
        """Unplug the board: the connection and all undelivered bytes are lost immediately."""
        self._lose(ConnectionError("it was unplugged"))

    async def _open(self) -> None:
        """Attach to the board."""
        self.board.advance(asyncio.get_running_loop().time())  # what the host finds begins now, not at time 0
        self._session = self.board.attach(self._receive, lambda: self._unsent, self.unplug)
        self._driver = BoardDriver(self.board)

    def _send(self, data: bytes) -> None:
        if self._session is not None:
            self._exchange_soon()
            self._on_line.append((data, asyncio.get_running_loop().time()))

    async def _close(self) -> None:
        """Detach from the board."""
        self._abort()

    def _abort(self) -> None:
        if self._session is not None and self._driver is not None:
            session, driver, self._session, self._driver = self._session, self._driver, None, None
            driver.stop()
            self._pass_on(session)  # such as a stop right before the end
            session.detach(asyncio.get_running_loop().time())

    def _receive(self, data: bytes) -> None:
        self._exchange_soon()
        self._pending.append(data)
        self._unsent += len(data)

    def _exchange_soon(self) -> None:
        # Later, never from within send(): a real board works beside the host, and cannot respond before the host has
        # finished sending. Of many boards on one loop, the work of the first does not delay what is sent to the others.
        if not self._on_line and not self._pending:
            asyncio.get_running_loop().call_soon(self._exchange)

    def _exchange(self) -> None:
        try:
            if self._session is not None:
                self._pass_on(self._session)
        except Exception as error:  # noqa: BLE001 - any bug of the board
            self._lose(error)
        if self._pending:
            chunk = b"".join(self._pending)
            self._pending.clear()
            self._deliver(chunk)
            self._unsent -= len(chunk)  # not before: a failed receiver has received nothing

    def _pass_on(self, session: AttachedSession) -> None:
        """Let the board receive everything that the host has sent, as of the time of sending."""
        try:
            for data, sent_at in self._on_line:
                session.receive(data, sent_at)
        finally:
            self._on_line.clear()


class VirtualTransport(BoardTransport[VirtualBoard]):
    """Transport to a virtual board in the same program, perhaps with a state file."""

    def __init__(self, board: VirtualBoard, url: str = "virtual://", state: Path | None = None) -> None:
        """Lead to `board`, named `url` in errors; `state` is a file, loaded at opening and saved until closing."""
        super().__init__(board, url)
        self._state = state
        self._file: StateFile | None = None
        self._saver: StateSaver | None = None

    async def _open(self) -> None:
        """Attach to the board. Raise OpenError if the state file cannot be loaded, or is used by another board."""
        if self._state is not None:
            try:
                self._file = StateFile(self.board, self._state)
            except ServolinkError as error:
                raise OpenError(str(error)) from error
            self._saver = StateSaver(self.board, self._file)
        await super()._open()

    async def _close(self) -> None:
        """Detach from the board. Raise ServolinkError if the state cannot be saved."""
        await super()._close()  # first: with the last host a board may lose power, and part of a write
        if self._file is not None and self._saver is not None:
            file, saver, self._file, self._saver = self._file, self._saver, None, None
            saver.stop()
            with file:
                file.save()


class FaultyVirtualTransport(FaultyTransport):
    """Bad line to a board in the same program."""

    def __init__(self, inner: BoardTransport[Any], faults: Faults, *, seed: int) -> None:
        """Wrap `inner` with faults drawn from `seed`."""
        super().__init__(inner, faults, seed=seed)
        self.board = inner.board
        self._line = inner

    def _break(self, reason: str) -> None:
        super()._break(reason)
        self._line.unplug()  # immediately: during the turn of the loop for closing a response would arrive
