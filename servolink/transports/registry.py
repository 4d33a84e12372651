"""From an address to the transport that serves its scheme."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple, TypeAlias, cast

from servolink.errors import TransportError, TransportUnavailable
from servolink.escaping import escape
from servolink.transports.address import Address
from servolink.transports.base import Transport

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

PLUG_INS = "servolink.transports"
"""The entry-point group in which other packages name their schemes."""

Factory: TypeAlias = Callable[[Address], Transport]


class _Kind(NamedTuple):
    module: str
    function: str
    needs: str = ""  # what to install when the module's library is missing


_KINDS = {
    "serial": _Kind("servolink.transports.serial", "from_address", "pyserial-asyncio"),
    "tcp": _Kind("servolink.transports.stream", "from_address"),
    "hid": _Kind("servolink.transports.hid", "from_address", "hidapi"),
    "usb": _Kind("servolink.transports.usb", "from_address", "pyusb libusb-package"),
    "memory": _Kind("servolink.transports.memory", "from_address"),
    "replay": _Kind("servolink.transports.recording", "from_address"),
    "virtual": _Kind("servolink.virtual.transport", "from_address"),
}


def create(url: str) -> Transport:
    """Make the transport for `url` without opening it; TransportUnavailable says what is wrong or missing."""
    address = Address.parse(url)
    if kind := _KINDS.get(address.scheme):
        return _load(address, kind)(address)

    from importlib.metadata import entry_points  # brings half of the email package

    plug_ins = entry_points(group=PLUG_INS)
    if address.scheme in plug_ins.names:
        return _from_plug_in(address, plug_ins[address.scheme])
    known = ", ".join(f"{scheme}://" for scheme in sorted({*_KINDS, *plug_ins.names}))
    raise address.refusal(f"unknown kind of address; known are {known} and a bare device path")


def _load(address: Address, kind: _Kind) -> Factory:
    try:
        return cast("Factory", getattr(import_module(kind.module), kind.function))
    except Exception as error:  # another package of the library's name fails in any way, not by ImportError alone
        cure = f"; try: pip install --force-reinstall {kind.needs}" if kind.needs else ""
        raise address.refusal(f"{address.scheme}:// cannot be loaded: {_named(error)}{cure}") from error


def _from_plug_in(address: Address, plug_in: EntryPoint) -> Transport:
    try:
        transport = plug_in.load()(address)
    except TransportError:
        raise
    except Exception as error:
        raise _broken(address, plug_in, _named(error)) from error
    if not isinstance(transport, Transport):
        raise _broken(address, plug_in, f"it made no transport but {type(transport).__name__}")
    return transport


def _broken(address: Address, plug_in: EntryPoint, reason: str) -> TransportUnavailable:
    package = plug_in.dist.name if plug_in.dist else plug_in.value
    return address.refusal(
        f"the plug-in {escape(package)} for {address.scheme}:// is broken: {reason}; update or remove it"
    )


def _named(error: Exception) -> str:
    return escape(f"{type(error).__name__}: {error}")
