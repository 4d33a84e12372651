"""Pseudo-terminals that one program after the other opens as a serial port, with links that keep their names."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from urllib.parse import quote

from servolink.errors import OpenError
from servolink.files import reason
from servolink.listeners.accept import RareWarning
from servolink.listeners.conversation import HIGH, LOW, MOST_UNREAD, Conversation
from servolink.platforms.pseudo_terminals import PseudoTerminal

LOOK = 0.05
"""Seconds between looks for a program that opens the terminal, closes it unread, or sets another baud rate."""

_TERMINALS = "/dev/"


class ServedTerminal:
    """Pseudo-terminal with a conversation for each program that opens it.

    Settings and unread bytes of one program are gone before the next program.
    """

    def __init__(
        self,
        begin: Callable[[ServedTerminal], Conversation],
        *,
        high: int = HIGH,
        low: int = LOW,
        look: float = LOOK,
        baudrate: int = 0,
        on_baudrate: Callable[[int], object] | None = None,
    ) -> None:
        """Make the terminal, look for a program every `look` seconds, and call `begin` when one opens the terminal.

        A conversation is paused above `high` unread bytes and resumed at `low`. Programs find `baudrate`, unless 0;
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
        self._conversation: Conversation | None = None
        self._is_paused = False  # the conversation
        self._unread = bytearray()
        self._timer: asyncio.TimerHandle | None = None
        self._terminal = PseudoTerminal()
        self.name = self._terminal.name
        """Path by which programs open the terminal."""
        self._hang_up()

    def close(self) -> None:
        """End the conversation, and remove the terminal."""
        self._leave()
        if self._timer is not None:
            self._timer.cancel()
        self._terminal.close()

    def send(self, data: bytes) -> None:
        """Send bytes to the program as an AcceptedConnection does; drop bytes without a program or without room."""
        if self._conversation is None:
            self._look()
        conversation = self._conversation
        if conversation is None:
            return
        if len(self._unread) + len(data) > MOST_UNREAD:
            self._warning.log("%s: responses are dropped, as the program does not read them", self.name)
            return
        is_first = not self._unread
        self._unread += data
        if is_first and conversation.waiting:
            self._loop.call_soon(self._flush)
        elif is_first:
            self._flush()
        if len(self._unread) > self._high and not self._is_paused:
            self._is_paused = True
            conversation.pause()

    # --- coming and going ---------------------------------------------------------------------------------------

    def _look(self) -> None:
        """Begin a conversation if a program has opened the terminal."""
        data = self._terminal.read()
        if data is not None:
            self._conversation = self._begin(self)
            self._conversation.on_room = self._resume
            self._resume()
            self._receive(self._conversation, data)

    def _watch(self) -> None:
        """Look for changes that the system does not report."""
        self._timer = None
        if self._conversation is None:
            self._look()
        elif self._conversation.is_full and self._terminal.is_closed():
            self._hang_up()
        self._follow_baudrate()
        self._watch_later()

    def _watch_later(self) -> None:
        conversation = self._conversation
        if self._timer is None and (conversation is None or conversation.is_full or self._on_baudrate is not None):
            self._timer = self._loop.call_later(self._look_pause if conversation is None else LOOK, self._watch)

    def _hang_up(self) -> None:
        """End the conversation and renew the terminal."""
        self._leave()
        self._terminal.renew(self._first_baudrate)
        self._baudrate = self._terminal.baudrate()
        self._watch_later()

    def _leave(self) -> None:
        self._terminal.on_readable(None)
        self._terminal.on_writable(None)
        self._unread.clear()
        self._is_paused = False
        if self._conversation is not None:
            conversation, self._conversation = self._conversation, None
            conversation.leave()

    def _follow_baudrate(self) -> None:
        if self._on_baudrate is not None and self._conversation is not None:
            baudrate = self._terminal.baudrate()
            if baudrate not in {0, self._baudrate}:  # 0 hangs up
                self._baudrate = baudrate
                self._on_baudrate(baudrate)

    # --- bytes --------------------------------------------------------------------------------------------------

    def _resume(self) -> None:
        if self._conversation is not None:
            self._terminal.on_readable(self._readable)

    def _readable(self) -> None:
        data = self._terminal.read()
        if data is None or self._conversation is None:
            self._hang_up()
        else:
            self._receive(self._conversation, data)

    def _receive(self, conversation: Conversation, data: bytes) -> None:
        self._follow_baudrate()
        if data:
            conversation.receive(data)
        if conversation.is_full and self._conversation is conversation:
            self._terminal.on_readable(None)
            self._watch_later()

    def _flush(self) -> None:
        conversation = self._conversation
        if conversation is None:
            return
        written = self._terminal.write(self._unread)
        if not written and self._terminal.is_closed():  # noticed here only while reading pauses
            self._hang_up()
            return
        del self._unread[:written]
        self._terminal.on_writable(self._flush if self._unread else None)
        if self._is_paused and len(self._unread) <= self._low:
            self._is_paused = False
            conversation.resume()


@contextmanager
def address_of(terminal: ServedTerminal, link: str | Path | None) -> Iterator[str]:
    """Yield the URL of a terminal: by its name, or by `link`, a symbolic link that is removed after this context.

    A link that a killed program left is replaced. Raise OpenError if the link cannot be made.
    """
    if link is None:
        yield f"serial://{terminal.name}"
    else:
        with _linked(Path.cwd() / link, terminal.name) as path:
            yield f"serial://{quote(str(path))}"


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
