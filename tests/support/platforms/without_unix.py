"""Runs servolink on Linux with what Windows lacks taken away: `python without_unix.py COMMAND...`, or `-m MODULE`.

Modules such as fcntl and termios are taken away, functions and flags of `os`, signals, Unix sockets, and the methods
that the event loop of Windows does not have. What Windows forbids is refused: removing or replacing a file that this
program has open, opening a folder as a file, making a link, and names with characters such as a colon. `msvcrt` is one
of ours, with keys from standard input. `sys.platform` is "win32". Python programs that servolink starts run like this
too.

This proves nothing about what Windows has in a form of its own: paths and drives, COM ports, drivers for HID and USB,
consoles and their colours, real locks, signals from other programs, clocks, the event loop itself, and the branches of
other libraries for Windows, which are imported before `sys.platform` changes.
"""

from __future__ import annotations

import asyncio
import builtins
import codecs
import contextlib
import errno
import fcntl
import importlib
import io
import os
import platform
import select
import shutil
import signal
import socket
import sys
import tty
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path[0] = str(Path(__file__).parents[2])
from tests.support.platforms.other_system import run_as  # noqa: E402

MODULES = "curses fcntl grp pty pwd readline resource termios tty"
FUNCTIONS = """
    chown fchmod fchown fork forkpty getegid geteuid getgid getgroups getpgid getpgrp getuid killpg mkfifo nice openpty
    pread pwrite sched_getaffinity set_blocking setsid statvfs tcgetpgrp ttyname uname
    O_CLOEXEC O_DIRECTORY O_NOCTTY O_NOFOLLOW O_NONBLOCK
"""
SIGNALS = "SIGALRM SIGCONT SIGHUP SIGKILL SIGPIPE SIGQUIT SIGTSTP SIGUSR1 SIGUSR2 SIGWINCH"
LOOP_METHODS = """
    add_reader add_writer remove_reader remove_writer add_signal_handler remove_signal_handler
    connect_read_pipe connect_write_pipe create_unix_connection create_unix_server
"""
LIBRARIES = """
    asyncio.subprocess concurrent.futures.process concurrent.futures.thread ctypes.util getpass http.client locale
    logging.handlers multiprocessing ssl tempfile urllib.request uuid webbrowser
    hid keyring libusb_package mcap.reader mcap.writer msgspec paho.mqtt.client platformdirs.unix
    rich.console rich.live rich.progress segno serial.tools.list_ports serial_asyncio usb.backend.libusb1 usb.core
"""
"""Imported while this is still Linux: their branches for Windows need Windows."""
SLOW = {
    "aiohttp.web": {"studio", "--import"},
    **{name: {"--import"} for name in ("gymnasium", "mcp.server.mcpserver", "uvicorn")},
}
"""Libraries that take longer to import than all others, and the words of command lines that need them."""
FORBIDDEN = set('<>:"|?*\\')


class Console:
    """The part of `msvcrt` that servolink uses. Keys come from standard input, which is a terminal of Linux."""

    LK_LOCK, LK_NBLCK = 1, 2

    def __init__(self) -> None:
        """Make the terminal pass on each key at once, as a console does for those who read keys."""
        self._decoder = codecs.getincrementaldecoder("utf-8")()
        self._keys = ""
        self._select, self._read, self._lock = select.select, os.read, fcntl.flock
        self._modes = {self.LK_LOCK: fcntl.LOCK_EX, self.LK_NBLCK: fcntl.LOCK_EX | fcntl.LOCK_NB}
        if os.isatty(0):
            tty.setcbreak(0)

    def kbhit(self) -> bool:
        """Return whether a key waits."""
        while not self._keys and self._select([0], [], [], 0)[0]:
            if not (data := self._read(0, 1)):
                raise OSError(errno.EBADF, "The handle is invalid")
            self._keys = self._decoder.decode(data)
        return bool(self._keys)

    def getwch(self) -> str:
        """Return a key, or half of one."""
        assert self.kbhit(), "this would wait"
        key, self._keys = self._keys[0], self._keys[1:]
        return key

    def locking(self, descriptor: int, mode: int, size: int) -> None:
        """Lock a file."""
        self._lock(descriptor, self._modes[mode])


def take_away() -> None:
    """Make this process as much like one on Windows as it can be."""
    for library in [*LIBRARIES.split(), *(library for library, words in SLOW.items() if words & {*sys.argv})]:
        with contextlib.suppress(ImportError):
            importlib.import_module(library)
    platform.platform()  # which remembers what it has found
    _keep_system_of("platformdirs")
    console: Any = Console()
    _restrict_files()
    _restrict_sockets()
    for name in LOOP_METHODS.split():
        setattr(asyncio.SelectorEventLoop, name, _only_for_asyncio(name, getattr(asyncio.SelectorEventLoop, name)))
    for name in MODULES.split():
        sys.modules[name] = None  # type: ignore[assignment]  # so that its import fails
    answer = types.SimpleNamespace(NeedCurrentDirectoryForExePath=lambda command: True)
    for owner, name, value in ((shutil, "_winapi", answer), (os, "process_cpu_count", os.cpu_count)):
        setattr(owner, name, value)  # which Python reads from 3.12 and 3.13 on
    for owner, names in ((os, FUNCTIONS), (signal, SIGNALS), (select, "epoll poll")):
        for name in names.split():
            if hasattr(owner, name):
                delattr(owner, name)
    setattr(signal, "SIGBREAK", signal.SIGTTOU)  # noqa: B010 - which no type checker on Linux knows
    sys.modules["msvcrt"] = console
    sys.platform = "win32"


def _keep_system_of(library: str) -> None:
    """Leave a library that has chosen its branches for Linux the functions of `os` that they call."""
    system = types.ModuleType("os")
    vars(system).update(vars(os))
    for name, module in [*sys.modules.items()]:
        if name.startswith(f"{library}.") and hasattr(module, "os"):
            setattr(module, "os", system)  # noqa: B010 - not of the same type


def _only_for_asyncio(name: str, real: Callable[..., Any]) -> Callable[..., Any]:
    def call(*args: Any, **options: Any) -> Any:
        if sys._getframe(1).f_globals["__name__"].startswith("asyncio."):
            return real(*args, **options)
        raise NotImplementedError(f"the event loop of Windows has no {name}")

    return call


def _restrict_files() -> None:
    """Refuse what Windows refuses."""
    for name, paths, checks in (
        ("unlink", 1, (_refuse_open,)),
        ("remove", 1, (_refuse_open,)),
        ("rename", 2, (_refuse_open, _refuse_name)),
        ("replace", 2, (_refuse_open, _refuse_name)),
        ("mkdir", 1, (_refuse_name,)),
        ("open", 1, (_refuse_name, _refuse_folder)),
        ("symlink", 1, (_refuse_link,)),
    ):
        setattr(os, name, _checked(getattr(os, name), paths, *checks))
    builtins.open = io.open = _checked(io.open, 1, _refuse_name)
    setattr(shutil, "_use_fd_functions", False)  # noqa: B010 - which no type checker knows


def _checked(real: Callable[..., Any], paths: int, *checks: Callable[[Any], None]) -> Any:
    """Return a function that looks at its first arguments, which are paths, before it does anything."""

    def call(*args: Any, **options: Any) -> Any:
        for path in args[:paths]:
            for check in checks:
                if not isinstance(path, int):
                    check(path)
        return real(*args, **options)

    return call


def _refuse_open(path: Any) -> None:
    try:
        wanted = os.lstat(path)
    except FileNotFoundError:
        return
    for file in Path("/proc/self/fd").iterdir():
        try:
            is_open = os.path.samestat(os.fstat(int(file.name)), wanted)
        except OSError:  # that of the list itself
            continue
        if is_open:
            raise PermissionError(errno.EACCES, "The process cannot access the file: it is being used", str(path))


def _refuse_name(path: Any) -> None:
    if FORBIDDEN & set(Path(os.fsdecode(path)).name):
        raise OSError(errno.EINVAL, "The filename, directory name, or volume label syntax is incorrect", str(path))


def _refuse_folder(path: Any) -> None:
    if Path(os.fsdecode(path)).is_dir():
        raise PermissionError(errno.EACCES, "Permission denied", str(path))


def _refuse_link(path: Any) -> None:
    raise OSError(errno.EPERM, "A required privilege is not held by the client", str(path))


def _restrict_sockets() -> None:
    real, family = socket.socketpair, socket.AF_UNIX
    setattr(socket, "socketpair", lambda *_, **__: real(family))  # noqa: B010 - not of the same type
    for name in ("AF_UNIX", "SO_PEERCRED"):
        delattr(socket, name)


if __name__ == "__main__":
    sys.exit(run_as(take_away, __file__, "cp1252"))
