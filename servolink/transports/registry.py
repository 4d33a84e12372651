"""Registry of transports by scheme: built-in modules, and entry points of other packages."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any, ClassVar, TypeAlias, cast

from msgspec import Struct

from servolink.errors import TransportError, TransportUnavailable
from servolink.transports.address import Address, shorten
from servolink.transports.base import Transport
from servolink.transports.foreign import ForeignTransport, contained

Factory: TypeAlias = "Callable[[Address], Transport]"


class _TransportKind(Struct, frozen=True):
    module: str
    function: str
    needs: str = ""  # packages to install if the library of the module is missing


_KINDS = {
    "serial": _TransportKind("servolink.transports.serial", "from_address", "pyserial-asyncio"),
    "tcp": _TransportKind("servolink.transports.stream", "from_address"),
    "rfc2217": _TransportKind("servolink.transports.rfc2217", "from_address"),
    "hid": _TransportKind("servolink.transports.hid", "from_address", "hidapi"),
    "usb": _TransportKind("servolink.transports.usb", "from_address", "pyusb libusb-package"),
    "share": _TransportKind("servolink.control", "from_address"),
    "memory": _TransportKind("servolink.transports.memory", "from_address"),
    "webserial": _TransportKind("servolink.transports.page_ports", "from_address"),
    "webusb": _TransportKind("servolink.transports.page_ports", "from_address"),
    "webhid": _TransportKind("servolink.transports.page_ports", "from_address"),
    "replay": _TransportKind("servolink.recorder", "from_address"),
    "virtual": _TransportKind("servolink.virtual", "from_address"),
}


_ELSEWHERE = {
    "telnet": "write rfc2217://host:port, or tcp://host:port if the serial server only passes bytes",
    "mqtt": "boards of a broker are reached by `servolink fleet`",
    "mqtts": "boards of a broker are reached by `servolink fleet`",
}
"""Remedies for kinds of addresses that people bring from other programs."""


def create(url: str | Transport) -> Transport:
    """Return an unopened transport for `url`; a transport itself, with the errors of other packages contained.

    Raises:
        InvalidAddress: The address is written wrongly.
        TransportUnavailable: A library is missing, or a plug-in is broken.

    """
    if not isinstance(url, str):
        return contained(url)
    address = Address.parse(url)
    if kind := _KINDS.get(address.scheme):
        return _load(address, kind)(address)
    others = PlugIn.all_in(PlugIn.TRANSPORTS)
    for plug_in in others:
        if plug_in.name == address.scheme:
            return _create_with(plug_in, address)
    if remedy := _ELSEWHERE.get(address.scheme):
        raise address.refusal(f"is an address of other programs; {remedy}")
    schemes = ", ".join(f"{scheme}://" for scheme in sorted({*_KINDS, *(plug_in.name for plug_in in others)}))
    raise address.refusal(f"unknown kind of address; known are {schemes} and a bare device path")


class PlugIn:
    """Entry point of another package; failures become TransportUnavailable, with the name of the package."""

    TRANSPORTS: ClassVar[str] = "servolink.transports"
    """Entry-point group for schemes of other packages: name = scheme, value = function of an Address."""
    DISCOVERY: ClassVar[str] = "servolink.discovery"
    """Entry-point group for the search by other packages: value = function that returns DeviceInfos."""

    @classmethod
    def all_in(cls, group: str) -> list[PlugIn]:
        """Return the entry points of other packages in `group`."""
        points = entry_points(group=group)
        return [cls(each, f"{each.name}://" if group == cls.TRANSPORTS else "discovery") for each in points]

    def __init__(self, entry_point: EntryPoint, purpose: str) -> None:
        """Store `entry_point`, not loaded yet; errors mention `purpose`."""
        self.name = entry_point.name
        self.package = entry_point.dist.name if entry_point.dist else entry_point.value
        self._entry_point = entry_point
        self._purpose = purpose

    def load(self) -> Any:
        """Import and return the registered function. Raise TransportUnavailable."""
        return self._entry_point.load()

    @contextmanager
    def blamed(self) -> Iterator[None]:
        """Turn any exception except TransportError into TransportUnavailable."""
        try:
            yield
        except TransportError:
            raise
        except Exception as error:
            raise self.broken(f"{type(error).__name__}: {error}") from error

    def broken(self, reason: str) -> TransportUnavailable:
        """Return the error for a broken plug-in."""
        return TransportUnavailable(
            f"the plug-in {self.package} for {self._purpose} is broken: {shorten(reason)}; update or remove the plug-in"
        )


def _create_with(plug_in: PlugIn, address: Address) -> Transport:
    with plug_in.blamed():
        transport = plug_in.load()(address)
    if not isinstance(transport, Transport):
        raise plug_in.broken(f"it returned {type(transport).__name__} instead of a transport")
    return ForeignTransport(transport, f"the plug-in {plug_in.package}")


def _load(address: Address, kind: _TransportKind) -> Factory:
    try:
        return cast("Factory", getattr(import_module(kind.module), kind.function))
    except Exception as error:  # another package of the same name fails in any way, not only with ImportError
        cure = f"; try: pip install --force-reinstall {kind.needs}" if kind.needs else ""
        reason = f"{type(error).__name__}: {error}"
        raise TransportUnavailable(f"{address.scheme}:// cannot be loaded: {reason}{cure}") from error
