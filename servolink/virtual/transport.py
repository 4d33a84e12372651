"""`virtual://`: a virtual board inside the program, on the same event loop."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import cast

from servolink.errors import ConnectionLost, OpenError
from servolink.escaping import escape
from servolink.protocol.codec import Codec
from servolink.transports.address import Address
from servolink.transports.base import Receiver
from servolink.transports.faults import Faults, FaultyTransport
from servolink.virtual.board import Session, VirtualBoard
from servolink.virtual.hardware import MAX_SERVOS, MEMORY, Hardware
from servolink.virtual.state_file import load_state, save_state
from servolink.virtual.storage import CLEAR, ON_DUPLICATE, Clear, OnDuplicate


class BoardDriver:
    """Wakes a board whenever it has something to do by itself; several for one board do no harm."""

    def __init__(self, board: Hardware) -> None:
        """Begin at once, on the running loop, until `stop`."""
        self._board = board
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        board.advance(self._loop.time())
        board.watch(self._set)
        self._set()

    def stop(self) -> None:
        """Leave the board to itself."""
        self._board.unwatch(self._set)
        self._clear()

    def _set(self) -> None:
        due = self._board.next_due(self._loop.time())
        if self._timer is not None and self._timer.when() == due:
            return
        self._clear()
        if due is not None:
            self._timer = self._loop.call_at(due, self._beat, due)

    def _beat(self, due: float) -> None:
        self._timer = None
        # Timers may fire a little early; the board must not find that nothing is due yet.
        self._board.advance(max(due, self._loop.time()))
        self._set()

    def _clear(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


def from_address(address: Address) -> VirtualTransport | FaultyVirtualTransport:
    """Make a board of its own for `virtual://?servos=16&seed=1&drop=0.01&state=FILE...`."""
    if address.host or address.port or address.path.strip("/"):
        raise address.refusal("a virtual board has no place, only options: virtual://?servos=16")
    seed = address.integer("seed", 0, 0, 2**63 - 1)
    board = VirtualBoard(
        servos=address.integer("servos", 16, 0, MAX_SERVOS),
        seed=seed,
        codec=Codec("big" if address.choice("byte_order", "little", ("little", "big")) == "big" else "little"),
        memory=address.integer("memory", MEMORY, 0, 2**31 - 1),
        on_duplicate=cast("OnDuplicate", address.choice("on_duplicate", "replace", ON_DUPLICATE)),
        clear=cast("Clear", address.choice("clear", "all", CLEAR)),
        partial_writes=address.flag("partial_writes", default=False),
        bus_powered=address.flag("bus_powered", default=False),
    )
    state = address.text("state", "")
    faults = Faults.from_address(address)
    address.refuse_unknown()
    transport = VirtualTransport(board, address.url, Path(state) if state else None)
    return transport if faults == Faults() else FaultyVirtualTransport(transport, faults, seed=seed)


class VirtualTransport:
    """A connection to a board in this program; any number of them may lead to one board."""

    def __init__(self, board: VirtualBoard, url: str = "virtual://", state: Path | None = None) -> None:
        """Lead to `board`; `url` is what errors call it; `state` is a file to load on opening and save on closing."""
        self.board = board
        self._url = url
        self._state = state
        self._receiver: Receiver | None = None
        self._session: Session | None = None
        self._pacemaker: BoardDriver | None = None
        self._spent = False
        self._unsaved = False
        self._said: list[bytes] = []
        self._waiting = 0  # bytes that the board said and the receiver does not have

    @property
    def url(self) -> str:
        """The address it leads to."""
        return self._url

    async def open(self, receiver: Receiver) -> None:
        """Attach to the board; OpenError if this transport was opened before or its file is no state."""
        if self._spent:
            raise OpenError(f"{escape(self.url)}: a transport is opened once; make another")
        if self._state is not None:
            load_state(self.board, self._state)
        self._spent = True
        self._receiver = receiver
        self._unsaved = True
        self._session = self.board.attach(self._hear, lambda: self._waiting)
        self._pacemaker = BoardDriver(self.board)

    async def send(self, data: bytes) -> None:
        """Give `data` to the board, which answers in a later turn of the loop."""
        if self._session is None:
            raise ConnectionLost(f"{escape(self.url)}: {'closed' if self._spent else 'open it before sending'}")
        self._session.receive(data, asyncio.get_running_loop().time())

    async def close(self) -> None:
        """Detach from the board; ServolinkError if its state cannot be saved."""
        self._spent = True
        self._end(None)
        if self._unsaved and self._state is not None:
            self._unsaved = False
            save_state(self.board, self._state)

    def unplug(self) -> None:
        """Pull the plug: the connection is lost at once, with all that the receiver does not have yet."""
        self._end(ConnectionLost(f"{escape(self.url)}: the connection was lost: it was unplugged"))

    def _hear(self, data: bytes) -> None:
        # Never from within send(): a real board cannot answer before its caller has finished writing.
        if not self._said:
            asyncio.get_running_loop().call_soon(self._deliver)
        self._said.append(data)
        self._waiting += len(data)

    def _deliver(self) -> None:
        chunk = b"".join(self._said)
        self._said.clear()
        if self._receiver is None or not chunk:
            return
        try:
            self._receiver.data(chunk)
        except Exception as error:  # noqa: BLE001 - whatever it is, bytes were lost, and that ends the connection
            lost = ConnectionLost(f"{escape(self.url)}: the receiver failed: {escape(str(error))}")
            lost.__cause__ = error
            self._end(lost)
        self._waiting -= len(chunk)

    def _end(self, error: ConnectionLost | None) -> None:
        if self._session is None or self._pacemaker is None or self._receiver is None:
            return
        self._pacemaker.stop()
        self._session.detach(asyncio.get_running_loop().time())
        receiver, self._receiver, self._session, self._pacemaker = self._receiver, None, None, None
        receiver.lost(error)


class FaultyVirtualTransport(FaultyTransport):
    """A bad line to a board in this program."""

    def __init__(self, inner: VirtualTransport, faults: Faults, *, seed: int) -> None:
        """Wrap `inner`."""
        super().__init__(inner, faults, seed=seed)
        self.board = inner.board
        self._line = inner

    def _break(self, reason: str) -> None:
        super()._break(reason)
        self._line.unplug()  # now: closing takes a turn of the loop, in which an answer would arrive
