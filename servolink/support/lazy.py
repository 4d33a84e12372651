"""Doors whose names need a package that may be missing: each name is imported on first use."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module

from servolink.errors import ServolinkError, TransportUnavailable, install_extra

_PACKAGES = {"paho": "paho-mqtt", "serial": "pyserial", "serial_asyncio": "pyserial-asyncio", "usb": "pyusb"}
"""Packages with another name on the index than in Python."""


def lazy_names(room: str, modules: Mapping[str, Sequence[str]], *, extra: str = "") -> Callable[[str], object]:
    """Return a `__getattr__` for `room`, which imports the module of a name on first use.

    `modules` has the names of each module of the room. If a package is missing, the name raises ServolinkError with the
    way to install `extra`, or TransportUnavailable with the way to install the package itself.
    """
    module_of = {name: f"{room}.{module}" for module, names in modules.items() for name in names}

    def find(name: str) -> object:
        if name not in module_of:
            raise AttributeError(f"module {room!r} has no attribute {name!r}")
        try:
            value: object = getattr(import_module(module_of[name]), name)
        except ModuleNotFoundError as error:
            package, _, _ = (error.name or "").partition(".")
            if package == "servolink":
                raise
            package = _PACKAGES.get(package, package)
            if extra:
                raise ServolinkError(f"{room} needs {package}; {install_extra(extra)}") from error
            raise TransportUnavailable(f"{room}.{name} needs {package}; pip install {package}") from error
        setattr(sys.modules[room], name, value)
        return value

    return find
