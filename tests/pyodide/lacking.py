"""Runs `main` of a Python file on a Python that lacks packages, or also what Pyodide lacks, without Pyodide.

`python -m tests.pyodide.lacking packages|system FILE`. The packages are drivers, those of extras, and those for
tables and TOML. `system` also takes away modules and functions that Python does not have on Emscripten, and
refuses threads, and timers for times that have passed; `sys.platform` is "emscripten".
"""

from __future__ import annotations

import asyncio
import inspect
import os
import runpy
import socket
import sys
import threading
from collections.abc import Callable
from typing import Any

PACKAGES = """
    hid hidraw libusb_package serial serial_asyncio usb
    aiohttp foxglove gymnasium keyring markdown_it mcap mcp mujoco numpy paho pandas PIL prometheus_client rclpy segno
    uvicorn rich tomlkit
"""
MODULES = "curses fcntl grp pty pwd readline resource select termios tty"
FUNCTIONS = "getegid geteuid getgroups openpty sched_getaffinity"


def take_modules(names: str) -> None:
    """Let the import of each module fail."""
    for name in names.split():
        sys.modules[name] = None  # type: ignore[assignment]  # so that its import fails


def take_system() -> None:
    """Make this process as much like one of Pyodide as it can be."""
    take_modules(MODULES)
    for name in FUNCTIONS.split():
        if hasattr(os, name):
            delattr(os, name)
    pair, family = socket.socketpair, socket.AF_UNIX
    setattr(socket, "socketpair", lambda *_: pair(family))  # noqa: B010 - of which event loops here are made
    delattr(socket, "AF_UNIX")
    setattr(threading.Thread, "start", _start_no_thread)  # noqa: B010 - not of the same type
    loop: Any = asyncio.SelectorEventLoop
    loop.call_at = _refuse_past(loop.call_at)
    loop.run_in_executor = _run_in_executor
    sys.platform = "emscripten"


def _start_no_thread(thread: threading.Thread) -> None:
    raise RuntimeError("can't start new thread")


def _refuse_past(real: Callable[..., Any]) -> Callable[..., Any]:
    def call_at(self: asyncio.AbstractEventLoop, when: float, *args: Any, **options: Any) -> Any:
        if when < self.time() and not sys._getframe(1).f_globals["__name__"].startswith("asyncio."):
            raise ValueError("Can't schedule in the past")
        return real(self, when, *args, **options)

    return call_at


def _run_in_executor(
    loop: asyncio.AbstractEventLoop, executor: object, work: Callable[..., Any], *args: Any
) -> asyncio.Future[Any]:
    done = loop.create_future()
    try:
        done.set_result(work(*args))
    except Exception as error:  # noqa: BLE001 - as an executor does
        done.set_exception(error)
    return done


def run(lacking: str, file: str) -> None:
    """Take away what is lacking, and run the file."""
    take_modules(PACKAGES)
    if lacking == "system":
        take_system()
    result = runpy.run_path(file)["main"]()
    if inspect.iscoroutine(result):
        asyncio.run(result)


if __name__ == "__main__":
    run(*sys.argv[1:])
