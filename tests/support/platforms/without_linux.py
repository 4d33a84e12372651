"""Runs servolink on Linux with what macOS lacks taken away: `python without_linux.py COMMAND...`, or `-m MODULE`.

Taken away are epoll, so that the event loop waits with `select`; /proc, /sys and devices such as /dev/ttyACM0; clocks,
signals, flags and functions of Linux alone; and long paths of Unix sockets. `sys.platform` is "darwin". Python programs
that servolink starts run like this too.

This proves nothing about what macOS has in a form of its own: kqueue, /dev/cu.* and its drivers, mounted drives, the
keychain, permissions that a person has to allow, and the branches of other libraries for macOS, which are imported
before `sys.platform` changes.
"""

from __future__ import annotations

import builtins
import contextlib
import errno
import importlib
import io
import os
import platform
import select
import selectors
import signal
import socket
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path[0] = str(Path(__file__).parents[2])
from tests.support.platforms.other_system import run_as  # noqa: E402

FUNCTIONS = """
    eventfd memfd_create pidfd_open sched_getaffinity sched_setaffinity timerfd_create
    O_PATH O_TMPFILE
"""
CLOCKS = "CLOCK_BOOTTIME CLOCK_TAI"
SIGNALS = "SIGPWR SIGSTKFLT SIGRTMIN SIGRTMAX"
SOCKETS = "AF_NETLINK AF_PACKET AF_ALG SO_PEERCRED SOCK_CLOEXEC SOCK_NONBLOCK"
LIBRARIES = """
    asyncio.subprocess ctypes.util getpass hid keyring libusb_package locale mcap.reader mcap.writer multiprocessing
    paho.mqtt.client platformdirs.unix rich.console rich.live rich.progress segno serial.tools.list_ports serial_asyncio
    tempfile urllib.request usb.backend.libusb1 usb.core uuid webbrowser
"""
"""Imported while this is still Linux: their branches for macOS need macOS."""
SERVER, NEED_SERVER = "aiohttp.web", {"studio", "--import"}
"""A library that takes longer to import than all others, and the words of command lines that need it."""
ABSENT = ("/proc", "/sys", "/dev/ttyACM", "/dev/ttyUSB", "/dev/serial", "/dev/hidraw", "/dev/bus")
LONGEST_SOCKET = 103
"""Bytes in the path of a Unix socket, 107 on Linux."""


def take_away() -> None:
    """Make this process as much like one on macOS as it can be."""
    for library in [*LIBRARIES.split(), *([SERVER] if NEED_SERVER & {*sys.argv} else [])]:
        with contextlib.suppress(ImportError):
            importlib.import_module(library)
    platform.platform()  # which remembers what it has found
    selectors.DefaultSelector = selectors.SelectSelector  # type: ignore[assignment, misc]  # a class for each system
    for owner, names in (
        (os, FUNCTIONS),
        (time, CLOCKS),
        (signal, SIGNALS),
        (socket, SOCKETS),
        (select, "epoll"),
    ):
        for name in names.split():
            if hasattr(owner, name):
                delattr(owner, name)
    setattr(time, "CLOCK_UPTIME_RAW", time.CLOCK_MONOTONIC)  # noqa: B010 - which no type checker on Linux knows
    setattr(os, "process_cpu_count", os.cpu_count)  # noqa: B010 - which Python reads from 3.13 on
    _hide_files()
    _shorten_sockets()
    sys.platform = "darwin"


def _hide_files() -> None:
    """Let files of Linux alone be missing."""
    for name in ("open", "listdir", "scandir", "stat", "lstat", "readlink", "access"):
        setattr(os, name, _where_present(getattr(os, name), missing=False if name == "access" else None))
    builtins.open = io.open = _where_present(io.open)


def _where_present(real: Callable[..., Any], *, missing: bool | None = None) -> Any:
    def call(*args: Any, **options: Any) -> Any:
        path = args[0] if args else "."
        if not isinstance(path, int) and os.fsdecode(path).startswith(ABSENT):
            if missing is not None:
                return missing
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), path)
        return real(*args, **options)

    return call


def _shorten_sockets() -> None:
    real = socket.socket.bind

    def bind(self: socket.socket, address: Any) -> None:
        if self.family == socket.AF_UNIX and len(os.fsencode(address)) > LONGEST_SOCKET:
            raise OSError("AF_UNIX path too long")
        real(self, address)

    setattr(socket.socket, "bind", bind)  # noqa: B010 - a method of another kind


if __name__ == "__main__":
    sys.exit(run_as(take_away, __file__, "utf-8"))
