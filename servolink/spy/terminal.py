"""A pseudo-terminal for the program, which takes it for the board's serial port."""

from __future__ import annotations

import asyncio
import errno
import os
import select
from collections.abc import Callable
from contextlib import suppress

from servolink.spy.relay import Relay

_CHUNK = 4096
_LOOK = 0.05  # seconds between looks at what the system does not tell: opening, and another baud rate
_TCGETS2 = 0x802C542A
_IS_LINUX = hasattr(select, "epoll")


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
        self._ours, theirs = os.openpty()
        os.set_blocking(self._ours, False)
        self.name = os.ttyname(theirs)
        """Where programs open it."""
        os.close(theirs)  # so that the system says when the last program has closed it
        # As long as nobody has the terminal open, the system calls it readable. Only on edges it tells what is new:
        # the first bytes of the next program, at once.
        self._edges = select.epoll() if _IS_LINUX else None
        if self._edges is not None:
            self._edges.register(self._ours, select.EPOLLIN | select.EPOLLET)
            self._loop.add_reader(self._edges.fileno(), self._look)
        self._reset()
        self._timer = self._loop.call_later(_LOOK, self._watch)

    def close(self) -> None:
        """Remove the terminal."""
        self._timer.cancel()
        self._loop.remove_reader(self._ours)
        self._loop.remove_writer(self._ours)
        if self._edges is not None:
            self._loop.remove_reader(self._edges.fileno())
            self._edges.close()
        os.close(self._ours)

    # --- bytes --------------------------------------------------------------------------------------------------

    def write(self, data: bytes) -> bool:
        """Give the program bytes; drop them if there is none."""
        if not self._is_open:
            self._look()
        if not self._is_open:
            return True
        if not self._unread:
            data = data[self._written(data) :]
        self._unread += data
        if self._unread:
            self._loop.add_writer(self._ours, self._flush)
        return not self._unread

    def pause_reading(self) -> None:
        """Stop reading, so that the program waits."""
        self._is_paused = True
        self._loop.remove_reader(self._ours)

    def resume_reading(self) -> None:
        """Read again."""
        if self._is_paused:
            self._is_paused = False
            if self._is_open:
                self._loop.add_reader(self._ours, self._look)

    def _flush(self) -> None:
        self._unread = self._unread[self._written(self._unread) :]
        if not self._unread:
            self._loop.remove_writer(self._ours)
            self._relay.program_has_room()
        elif self._is_hung_up():  # a program that is not read is not noticed otherwise
            self._leave()

    def _written(self, data: bytes) -> int:
        try:
            return os.write(self._ours, data)
        except BlockingIOError:
            return 0
        except OSError:  # closed; the next look finds out
            return len(data)

    def _look(self) -> None:
        """Pass on what a program has written, or notice that it has gone."""
        if self._edges is not None:
            self._edges.poll(0)  # or the loop would be told again and again
        if self._is_paused:
            return
        try:
            data = os.read(self._ours, _CHUNK)
        except BlockingIOError:
            data = b""
        except OSError as error:
            if error.errno != errno.EIO:
                raise
            self._leave()
            return
        if not self._is_open:
            self._is_open = True
            self._loop.add_reader(self._ours, self._look)
            self._on_program(True)  # noqa: FBT003 - it is there
        self._follow_baudrate()  # before the bytes that were written at it
        if data:
            self._relay.heard(data)

    # --- programs that come and go -------------------------------------------------------------------------------

    def _watch(self) -> None:
        """Look for what the system does not tell."""
        self._timer = self._loop.call_later(_LOOK, self._watch)
        if self._is_paused and self._is_open and self._is_hung_up():
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
        self._loop.remove_reader(self._ours)
        self._loop.remove_writer(self._ours)
        if self._unread:
            self._unread = b""
            self._relay.program_has_room()
        self._reset()
        self._on_program(False)  # noqa: FBT003 - it is gone

    def _reset(self) -> None:
        """Drop what the last program has not read, and undo its settings."""
        import termios
        import tty

        with suppress(OSError, termios.error):
            theirs = os.open(self.name, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            try:
                termios.tcflush(theirs, termios.TCIFLUSH)
                tty.setraw(theirs, termios.TCSANOW)
                if code := getattr(termios, f"B{self._first_baudrate}", None):
                    settings = termios.tcgetattr(theirs)
                    settings[4] = settings[5] = code
                    termios.tcsetattr(theirs, termios.TCSANOW, settings)
                self._baudrate = _baudrate_of(theirs)
            finally:
                os.close(theirs)

    def _is_hung_up(self) -> bool:
        poll = select.poll()
        poll.register(self._ours, 0)
        return any(event & select.POLLHUP for _, event in poll.poll(0))

    def _follow_baudrate(self) -> None:
        baudrate = _baudrate_of(self._ours)
        if baudrate not in {0, self._baudrate}:  # 0 hangs up
            self._baudrate = baudrate
            self._on_baudrate(baudrate)


def _baudrate_of(terminal: int) -> int:
    """Return the speed to which a terminal is set; 0 if it cannot be known."""
    import fcntl
    import termios
    from array import array

    try:
        if _IS_LINUX:  # as a number, also one that has no name
            settings = array("I", bytes(256))
            fcntl.ioctl(terminal, _TCGETS2, settings)
            return settings[10]
        return int(termios.tcgetattr(terminal)[5])
    except (OSError, termios.error):
        return 0
