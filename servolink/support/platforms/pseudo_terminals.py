"""Pseudo-terminals: serial ports without hardware, with our end in the program and a named end for other programs.

Other programs open and close the named end at any time. Systems report a closed terminal in different ways: reading
our end fails on Linux and returns nothing on macOS, and both systems call our end readable. Windows and Pyodide
have no pseudo-terminals.
"""

from __future__ import annotations

import asyncio
import errno
import os
import sys
from array import array
from collections.abc import Callable
from contextlib import suppress
from typing import ClassVar

from servolink.errors import TransportUnavailable

if sys.platform != "win32" and sys.platform != "emscripten":
    import fcntl
    import select
    import termios
    import tty

_CHUNK = 4096
_TCGETS2 = 0x802C542A


class PseudoTerminal:
    """Our end of a pseudo-terminal. Programs open and close the other end, one after another."""

    AVAILABLE: ClassVar[bool] = sys.platform != "win32" and sys.platform != "emscripten"
    """Whether the system has pseudo-terminals."""

    def __init__(self) -> None:
        """Make the pseudo-terminal. Raise TransportUnavailable without pseudo-terminals."""
        self._loop = asyncio.get_running_loop()
        self._controller, terminal, self.name = self.open_pair()
        os.close(terminal)  # the system reports a closed terminal only if no descriptor is left

    @staticmethod
    def open_pair() -> tuple[int, int, str]:
        """Return the descriptors of a new raw pseudo-terminal, our end first, and the name of the other end.

        Our end does not block. Raise TransportUnavailable without pseudo-terminals.
        """
        if sys.platform == "win32" or sys.platform == "emscripten":
            raise TransportUnavailable("this system has no pseudo-terminals; use TCP")
        else:
            controller, terminal = os.openpty()
            os.set_blocking(controller, False)
            tty.setraw(terminal)
            return controller, terminal, os.ttyname(terminal)

    def close(self) -> None:
        """Remove the terminal."""
        self.on_readable(None)
        self.on_writable(None)
        os.close(self._controller)

    def on_readable(self, act: Callable[[], object] | None) -> None:
        """Call `act` whenever bytes are readable or the terminal is closed; None ends the calls."""
        if act is None:
            self._loop.remove_reader(self._controller)
        else:
            self._loop.add_reader(self._controller, act)

    def on_writable(self, act: Callable[[], object] | None) -> None:
        """Call `act` whenever bytes are writable; None ends the calls."""
        if act is None:
            self._loop.remove_writer(self._controller)
        else:
            self._loop.add_writer(self._controller, act)

    def read(self) -> bytes | None:
        """Read available bytes, possibly zero; return None if the terminal is closed."""
        try:
            return os.read(self._controller, _CHUNK) or None
        except BlockingIOError:
            return b""
        except OSError as error:
            if error.errno != errno.EIO:
                raise
            return None

    def write(self, data: bytes | bytearray) -> int:
        """Write as many bytes as possible and return their number; drop all bytes if the terminal is closed."""
        try:
            return os.write(self._controller, data)
        except BlockingIOError:
            return 0
        except OSError:  # the terminal is closed, and read returns None next
            return len(data)

    def is_closed(self) -> bool:
        """Return whether no program has the terminal open, without reading."""
        if sys.platform == "win32" or sys.platform == "emscripten":
            return True
        elif sys.platform == "darwin":  # poll on macOS supports no devices
            queue = select.kqueue()
            try:
                found = queue.control([select.kevent(self._controller, select.KQ_FILTER_READ, select.KQ_EV_ADD)], 1, 0)
            finally:
                queue.close()
            return any(event.flags & select.KQ_EV_EOF for event in found)
        else:
            poll = select.poll()
            poll.register(self._controller, 0)
            return any(event & select.POLLHUP for _, event in poll.poll(0))

    def renew(self, baudrate: int = 0) -> None:
        """Drop unread bytes and reset the settings of the terminal; set `baudrate` unless 0."""
        if sys.platform != "win32" and sys.platform != "emscripten":
            with suppress(OSError, termios.error):
                terminal = os.open(self.name, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
                try:
                    termios.tcflush(terminal, termios.TCIFLUSH)
                    tty.setraw(terminal, termios.TCSANOW)
                    if code := getattr(termios, f"B{baudrate}", 0):
                        settings = termios.tcgetattr(terminal)
                        settings[4] = settings[5] = code
                        termios.tcsetattr(terminal, termios.TCSANOW, settings)
                finally:
                    os.close(terminal)

    def baudrate(self) -> int:
        """Return the baud rate of the terminal; 0 if the system does not report the rate."""
        if sys.platform == "win32" or sys.platform == "emscripten":
            return 0
        else:
            try:
                if sys.platform == "linux":
                    settings = array("I", bytes(256))
                    fcntl.ioctl(self._controller, _TCGETS2, settings)  # as a number: termios names only standard rates
                    return settings[10]
                else:
                    return int(termios.tcgetattr(self._controller)[5])
            except (OSError, termios.error):
                return 0
