"""Watch of a socket used by another package, on any event loop.

The event loop of Windows has no `add_reader`: there a thread waits for the socket, and the event loop does the rest.
"""

from __future__ import annotations

import asyncio
import socket
import threading
from collections.abc import Callable
from contextlib import suppress
from selectors import EVENT_READ, EVENT_WRITE, DefaultSelector


class SocketWatch:
    """Watch by the event loop."""

    def __init__(self, sock: socket.socket, on_readable: Callable[[], None], on_writable: Callable[[], None]) -> None:
        """Call `on_readable` while `sock` can be read. Raise NotImplementedError if the event loop cannot."""
        self._loop = asyncio.get_running_loop()
        self._number = sock.fileno()
        self._on_writable = on_writable
        self._is_writing = False
        self._loop.add_reader(self._number, on_readable)

    def watch_writing(self, is_needed: bool) -> None:  # noqa: FBT001 - the only argument
        """Call `on_writable` while the socket can be written, if `is_needed`."""
        if is_needed == self._is_writing:
            return
        self._is_writing = is_needed
        if is_needed:
            self._loop.add_writer(self._number, self._on_writable)
        else:
            self._loop.remove_writer(self._number)

    def close(self) -> None:
        """End the watch. To be called before the socket is closed."""
        self._loop.remove_reader(self._number)
        self.watch_writing(False)  # noqa: FBT003 - the only argument


class ThreadedSocketWatch:
    """Watch by a thread; each callback runs in the event loop while the thread waits for the return."""

    def __init__(self, sock: socket.socket, on_readable: Callable[[], None], on_writable: Callable[[], None]) -> None:
        """Call `on_readable` while `sock` can be read."""
        self._loop = asyncio.get_running_loop()
        self._sock = sock
        self._on_readable = on_readable
        self._on_writable = on_writable
        self._is_writing = False
        self._is_closed = False
        self._has_returned = threading.Event()
        self._alarm, self._alarm_end = socket.socketpair()
        for each in (self._alarm, self._alarm_end):
            each.settimeout(0)
        threading.Thread(target=self._run, name="servolink socket watch", daemon=True).start()

    def watch_writing(self, is_needed: bool) -> None:  # noqa: FBT001 - the only argument
        """Call `on_writable` while the socket can be written, if `is_needed`."""
        if is_needed != self._is_writing:
            self._is_writing = is_needed
            self._ring()

    def close(self) -> None:
        """End the watch. To be called before the socket is closed."""
        self._is_closed = True
        self._ring()

    def _ring(self) -> None:
        with suppress(OSError):  # rung often already, or the thread has ended
            self._alarm.send(b"\0")

    def _run(self) -> None:
        with (
            self._alarm,
            self._alarm_end,
            DefaultSelector() as selector,
            suppress(OSError, ValueError, KeyError, RuntimeError),  # the socket or the event loop was closed
        ):
            selector.register(self._alarm_end, EVENT_READ)
            selector.register(self._sock, EVENT_READ)
            while not self._is_closed:
                selector.modify(self._sock, EVENT_READ | EVENT_WRITE if self._is_writing else EVENT_READ)
                ready = {key.fileobj: events for key, events in selector.select()}
                if self._alarm_end in ready:
                    self._alarm_end.recv(4096)
                if self._sock in ready and not self._is_closed:
                    self._has_returned.clear()
                    self._loop.call_soon_threadsafe(self._call, ready[self._sock])
                    self._has_returned.wait()

    def _call(self, events: int) -> None:
        try:
            if events & EVENT_READ and not self._is_closed:
                self._on_readable()
            if events & EVENT_WRITE and not self._is_closed:
                self._on_writable()
        finally:
            self._has_returned.set()


def watch_socket(
    sock: socket.socket, on_readable: Callable[[], None], on_writable: Callable[[], None]
) -> SocketWatch | ThreadedSocketWatch:
    """Return a watch of `sock`, which calls `on_readable`, and after `watch_writing(True)` also `on_writable`."""
    try:
        return SocketWatch(sock, on_readable, on_writable)
    except NotImplementedError:
        return ThreadedSocketWatch(sock, on_readable, on_writable)
