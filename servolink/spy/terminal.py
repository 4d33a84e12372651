"""A pseudo-terminal for the program, which takes it for the board's serial port."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from servolink.platforms.pseudo_terminals import PseudoTerminal
from servolink.spy.relay import Relay

_LOOK = 0.05  # seconds between looks at what the system does not tell: another baud rate, and hanging up unread
_LOOK_FOR_PROGRAM = 0.01  # the first bytes of a program wait for it


class TerminalSide:
    """A pseudo-terminal, which programs open and close as they like."""

    def __init__(
        self, relay: Relay, baudrate: int, on_baudrate: Callable[[int], object], on_program: Callable[[bool], object]
    ) -> None:
        """Make the terminal with this baud rate; call `on_baudrate` with each other one that a program sets.

        `on_program` is called with whether a program has it open.
        """
        self._relay = relay
        self._loop = asyncio.get_running_loop()
        self._first_baudrate = self._baudrate = baudrate
        self._on_baudrate, self._on_program = on_baudrate, on_program
        self._is_open = False  # whether a program has it open
        self._is_paused = False
        self._unread = b""
        self._terminal = PseudoTerminal()
        self.name = self._terminal.name
        """Where programs open it."""
        self._renew()
        self._timer = self._loop.call_later(_LOOK_FOR_PROGRAM, self._watch)

    def close(self) -> None:
        """Remove the terminal."""
        self._timer.cancel()
        self._terminal.close()

    # --- bytes --------------------------------------------------------------------------------------------------

    def write(self, data: bytes) -> bool:
        """Give the program bytes; drop them if there is none."""
        if not self._is_open:
            self._look()
        if not self._is_open:
            return True
        if not self._unread:
            data = data[self._terminal.write(data) :]
        self._unread += data
        if self._unread:
            self._terminal.on_writable(self._flush)
        return not self._unread

    def pause_reading(self) -> None:
        """Stop reading, so that the program waits."""
        self._is_paused = True
        self._terminal.on_readable(None)

    def resume_reading(self) -> None:
        """Read again."""
        if self._is_paused:
            self._is_paused = False
            if self._is_open:
                self._terminal.on_readable(self._look)

    def _flush(self) -> None:
        self._unread = self._unread[self._terminal.write(self._unread) :]
        if not self._unread:
            self._terminal.on_writable(None)
            self._relay.program_has_room()
        elif self._terminal.is_closed():  # a program that is not read is not noticed otherwise
            self._leave()

    def _look(self) -> None:
        """Pass on what a program has written, or notice that it has gone."""
        if self._is_paused:
            return
        data = self._terminal.read()
        if data is None:
            self._leave()
            return
        if not self._is_open:
            self._is_open = True
            self._terminal.on_readable(self._look)
            self._on_program(True)  # noqa: FBT003 - it is there
        self._follow_baudrate()  # before the bytes that were written at it
        if data:
            self._relay.heard(data)

    # --- programs that come and go -------------------------------------------------------------------------------

    def _watch(self) -> None:
        """Look for what the system does not tell."""
        self._timer = self._loop.call_later(_LOOK if self._is_open else _LOOK_FOR_PROGRAM, self._watch)
        if self._is_paused and self._is_open and self._terminal.is_closed():
            self._leave()
        elif not self._is_open:
            self._look()
        else:
            self._follow_baudrate()

    def _leave(self) -> None:
        """Make the terminal as new for the next program."""
        if not self._is_open:
            return
        self._is_open = False
        self._terminal.on_readable(None)
        self._terminal.on_writable(None)
        if self._unread:
            self._unread = b""
            self._relay.program_has_room()
        self._renew()
        self._on_program(False)  # noqa: FBT003 - it is gone

    def _renew(self) -> None:
        self._terminal.renew(self._first_baudrate)
        self._baudrate = self._terminal.baudrate()

    def _follow_baudrate(self) -> None:
        baudrate = self._terminal.baudrate()
        if baudrate not in {0, self._baudrate}:  # 0 hangs up
            self._baudrate = baudrate
            self._on_baudrate(baudrate)
