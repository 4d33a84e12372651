"""The event loops that servolink is measured on."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version

NewLoop = Callable[[], asyncio.AbstractEventLoop]


def loops(versions: dict[str, str]) -> Iterator[tuple[str, NewLoop]]:
    """Yield names and makers of the loops that are here."""
    yield "asyncio", asyncio.new_event_loop
    if installed("uvloop", versions):
        yield "uvloop", import_module("uvloop").new_event_loop


def installed(package: str, versions: dict[str, str]) -> bool:
    """Note the version of `package`; False if it is not installed."""
    try:
        versions[package] = version(package)
    except PackageNotFoundError:
        return False
    return True
