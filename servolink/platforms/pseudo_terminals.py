"""Pseudo-terminals: serial ports without hardware. One end belongs to this program, the other has a name.

Programs open and close the end with the name as they like. Systems differ in how they say so: while no program has it
open, reading fails on Linux and returns nothing on macOS, and both call it readable. Windows has no pseudo-terminals.
"""

from __future__ import annotations

import asyncio
import errno
import os
import sys
from array import array
from collections.abc import Callable
from contextlib import suppress

from servolink.errors import TransportUnavailable

if sys.platform != "win32":
    import fcntl
    import select
    import termios
    import tty

AVAILABLE = sys.platform != "win32"
"""Whether this system has pseudo-terminals."""

_CHUNK = 4096
_TCGETS2 = 0x802C542A


def open_pair() -> tuple[int, int, str]:
    """Return descriptors of both ends of a new pseudo-terminal that changes no byte, and the name of the second.

    Our end, which is the first, does not block. Raise TransportUnavailable on Windows.
    """
    if sys.platform == "win32":
        raise TransportUnavailable("pseudo-terminals do not exist on Windows; use TCP")
    else:
        ours, theirs = os.openpty()
        os.set_blocking(ours, False)
        tty.setraw(theirs)
        return ours, theirs, os.ttyname(theirs)


class PseudoTerminal:
    """Our end of a pseudo-terminal that one program after the other opens and closes."""

    def __init__(self) -> None:
        """Make the pseudo-terminal. Raise TransportUnavailable on Windows."""
        self._loop = asyncio.get_running_loop()
        self._ours, theirs, self.name = open_pair()
        os.close(theirs)  # so that the system says when the last program has closed it

    def close(self) -> None:
        """Remove the terminal."""
        self.on_readable(None)
        self.on_writable(None)
        os.close(self._ours)

    def on_readable(self, act: Callable[[], object] | None) -> None:
        """Call `act` while there is something to read, or no program has the terminal open; None calls nothing."""
        if act is None:
            self._loop.remove_reader(self._ours)
        else:
            self._loop.add_reader(self._ours, act)

    def on_writable(self, act: Callable[[], object] | None) -> None:
        """Call `act` while there is room for something to write; None calls nothing."""
        if act is None:
            self._loop.remove_writer(self._ours)
        else:
            self._loop.add_writer(self._ours, act)

    def read(self) -> bytes | None:
        """Return what a program has written, which may be nothing; None if no program has the terminal open."""
        try:
            return os.read(self._ours, _CHUNK) or None
        except BlockingIOError:
            return b""
        except OSError as error:
            if error.errno != errno.EIO:
                raise
            return None

    def write(self, data: bytes | bytearray) -> int:
        """Write what there is room for; return how many bytes. All count as written if no program has it open."""
        try:
            return os.write(self._ours, data)
        except BlockingIOError:
            return 0
        except OSError:  # closed; the next reading finds out
            return len(data)

    def is_closed(self) -> bool:
        """Return whether no program has the terminal open, without reading what the last one has written."""
        if sys.platform == "win32":
            return True
        elif sys.platform == "darwin":  # whose poll does not know devices
            queue = select.kqueue()
            try:
                found = queue.control([select.kevent(self._ours, select.KQ_FILTER_READ, select.KQ_EV_ADD)], 1, 0)
            finally:
                queue.close()
            return any(event.flags & select.KQ_EV_EOF for event in found)
        else:
            poll = select.poll()
            poll.register(self._ours, 0)
            return any(event & select.POLLHUP for _, event in poll.poll(0))

    def renew(self, baudrate: int = 0) -> None:
        """Drop what the last program has not read, and undo its settings; set a baud rate unless that is 0."""
        if sys.platform != "win32":
            with suppress(OSError, termios.error):
                theirs = os.open(self.name, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
                try:
                    termios.tcflush(theirs, termios.TCIFLUSH)
                    tty.setraw(theirs, termios.TCSANOW)
                    if code := getattr(termios, f"B{baudrate}", 0):
                        settings = termios.tcgetattr(theirs)
                        settings[4] = settings[5] = code
                        termios.tcsetattr(theirs, termios.TCSANOW, settings)
                finally:
                    os.close(theirs)

    def baudrate(self) -> int:
        """Return the baud rate to which the terminal is set; 0 if it cannot be known."""
        if sys.platform == "win32":
            return 0
        else:
            try:
                if sys.platform == "linux":
                    settings = array("I", bytes(256))
                    fcntl.ioctl(self._ours, _TCGETS2, settings)  # as a number, also one that has no name
                    return settings[10]
                else:
                    return int(termios.tcgetattr(self._ours)[5])
            except (OSError, termios.error):
                return 0
