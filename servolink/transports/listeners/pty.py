"""Pseudo-terminals that programs open, in turn, as a serial port, with links that keep their names."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from urllib.parse import quote

from servolink.errors import OpenError
from servolink.support import PseudoTerminal, reason
from servolink.transports.listeners.accept import RareWarning
from servolink.transports.listeners.accepted import HIGH, LOW, MOST_UNREAD, ProgramHandler

LOOK = 0.05
"""Seconds between looks for a program that opens the terminal, closes it unread, or sets another baud rate."""

_TERMINALS = "/dev/"


class ServedTerminal:
    """Pseudo-terminal with a new handler for each program.

    Settings and unread bytes of one program are gone before the next program.
    """

    def __init__(
        self,
        begin: Callable[[ServedTerminal], ProgramHandler],
        *,
        high: int = HIGH,
        low: int = LOW,
        look: float = LOOK,
        baudrate: int = 0,
        on_baudrate: Callable[[int], object] | None = None,
    ) -> None:
        """Make the terminal, look for a program every `look` seconds, and call `begin` when one opens the terminal.

        A handler is paused above `high` unread bytes and resumed at `low`. Programs find `baudrate`, unless 0;
        `on_baudrate` is called with each other rate that a program sets, before the bytes sent at that rate. Raise
        TransportUnavailable on Windows.
        """
        self._begin = begin
        self._high, self._low = high, low
        self._look_pause = look
        self._first_baudrate = self._baudrate = baudrate
        self._on_baudrate = on_baudrate
        self._loop = asyncio.get_running_loop()
        self._warning = RareWarning()
        self._handler: ProgramHandler | None = None
        self._is_paused = False  # the handler
        self._unread = bytearray()
        self._timer: asyncio.TimerHandle | None = None
        self._terminal = PseudoTerminal()
        self.name = self._terminal.name
        """Path of the terminal, for programs."""
        self._hang_up()

    @contextmanager
    def address(self, link: str | Path | None) -> Iterator[str]:
        """Yield the URL of the terminal: its name, or `link`, a symbolic link that is removed after the context.

        A link that a killed program left is replaced. Raise OpenError if the link cannot be made.
        """
        if link is None:
            yield f"serial://{self.name}"
        else:
            with _linked(Path.cwd() / link, self.name) as path:
                yield f"serial://{quote(str(path))}"

    def close(self) -> None:
        """Tell the handler that the program is gone, and remove the terminal."""
        self._leave()
        if self._timer is not None:
            self._timer.cancel()
        self._terminal.close()

    def send(self, data: bytes) -> None:
        """Send bytes to the program as an AcceptedConnection does; drop bytes without a program or without room."""
        if self._handler is None:
            self._look()
        handler = self._handler
        if handler is None:
            return
        if len(self._unread) + len(data) > MOST_UNREAD:
            self._warning.log("%s: responses are dropped, as the program does not read", self.name)
            return
        is_first = not self._unread
        self._unread += data
        if is_first and handler.waiting:
            self._loop.call_soon(self._flush)
        elif is_first:
            self._flush()
        if len(self._unread) > self._high and not self._is_paused:
            self._is_paused = True
            handler.pause()

    # --- coming and going ---------------------------------------------------------------------------------------

    def _look(self) -> None:
        """Get a handler if a program has opened the terminal."""
        data = self._terminal.read()
        if data is not None:
            self._handler = self._begin(self)
            self._handler.on_room = self._resume
            self._resume()
            self._receive(self._handler, data)

    def _watch(self) -> None:
        """Look for changes that the system does not report."""
        self._timer = None
        if self._handler is None:
            self._look()
        elif self._handler.is_full and self._terminal.is_closed():
            self._hang_up()
        self._follow_baudrate()
        self._watch_later()

    def _watch_later(self) -> None:
        handler = self._handler
        if self._timer is None and (handler is None or handler.is_full or self._on_baudrate is not None):
            self._timer = self._loop.call_later(self._look_pause if handler is None else LOOK, self._watch)

    def _hang_up(self) -> None:
        """Tell the handler that the program is gone, and renew the terminal."""
        self._leave()
        self._terminal.renew(self._first_baudrate)
        self._baudrate = self._terminal.baudrate()
        self._watch_later()

    def _leave(self) -> None:
        self._terminal.on_readable(None)
        self._terminal.on_writable(None)
        self._unread.clear()
        self._is_paused = False
        if self._handler is not None:
            handler, self._handler = self._handler, None
            handler.leave()

    def _follow_baudrate(self) -> None:
        if self._on_baudrate is not None and self._handler is not None:
            baudrate = self._terminal.baudrate()
            if baudrate not in {0, self._baudrate}:  # 0 hangs up
                self._baudrate = baudrate
                self._on_baudrate(baudrate)

    # --- bytes --------------------------------------------------------------------------------------------------

    def _resume(self) -> None:
        if self._handler is not None:
            self._terminal.on_readable(self._readable)

    def _readable(self) -> None:
        data = self._terminal.read()
        if data is None or self._handler is None:
            self._hang_up()
        else:
            self._receive(self._handler, data)

    def _receive(self, handler: ProgramHandler, data: bytes) -> None:
        self._follow_baudrate()
        if data:
            handler.receive(data)
        if handler.is_full and self._handler is handler:
            self._terminal.on_readable(None)
            self._watch_later()

    def _flush(self) -> None:
        handler = self._handler
        if handler is None:
            return
        written = self._terminal.write(self._unread)
        if not written and self._terminal.is_closed():  # noticed here only while reading pauses
            self._hang_up()
            return
        del self._unread[:written]
        self._terminal.on_writable(self._flush if self._unread else None)
        if self._is_paused and len(self._unread) <= self._low:
            self._is_paused = False
            handler.resume()


@contextmanager
def _linked(link: Path, terminal: str) -> Iterator[Path]:
    if link.is_symlink() and not _target(link).startswith(_TERMINALS):
        raise OpenError(f"{link} is a link to something else than a terminal; choose another name")
    if link.exists() and not link.is_symlink():
        raise OpenError(f"{link} is there already; choose another name")
    temporary = link.with_name(f".servolink-{os.urandom(8).hex()}")
    try:
        temporary.symlink_to(terminal)
        try:
            temporary.replace(link)
        except OSError:
            temporary.unlink()
            raise
    except OSError as error:
        raise OpenError(f"{link}: no link can be made there: {reason(error)}") from error
    try:
        yield link
    finally:
        with suppress(OSError):
            if _target(link) == terminal:  # unless another hub has replaced the link
                link.unlink()


def _target(link: Path) -> str:
    return os.readlink(link)  # noqa: PTH115 - as it is written
