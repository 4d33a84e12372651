"""Addresses of boards: `scheme://host:port/path?option=value`, or a bare device path."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping, Sequence
from urllib.parse import quote as percent_encoded
from urllib.parse import unquote

from servolink.errors import InvalidAddress, quote

# Compiled on first use: compiling takes time, and no address needs all patterns.
_BARE_DEVICE = r"(?ai)/|\\\\\.\\|com\d+(\?|$)"
_COM_PORT = r"(?ai)(?:\\\\\.\\)?(com\d+)"
_SCHEME = r"(?a)[a-z][a-z0-9+.-]*"
_AUTHORITY = r"(?:\[(?P<v6>[^\[\]]*)\]|(?P<host>[^\[\]:]*))(?::(?P<port>[^:\[\]]*))?"
_BAD_ESCAPE = r"(?i)%(?![0-9a-f]{2})"
_CONTROL = r"[\x00-\x1f\x7f]"
_HOST_AND_PORT = r"(?a)(\[[0-9a-fA-F:.%]+\]|[\w.-]+):[0-9]+"
_INTEGER = r"[+-]?[0-9]{1,18}"
_HEXADECIMAL = r"(?ai)0x[0-9a-f]{1,15}"
_NUMBER = r"(?ai)[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)(e[+-]?[0-9]{1,3})?"
_FORMS = "write it as serial:///dev/ttyACM0, serial://COM3, tcp://host:port or virtual://"
_OTHER_NAMES = {"socket": "tcp"}  # of schemes, in programs with pyserial
_LONGEST = 200  # characters of an address in an error text
_MOST = 65_536  # characters of an address: resolving links in a path takes time with its square
CONNECTION_OPTIONS = (
    "byte_order",
    "caption_encoding",
    "transmission_mode",
    "patience",
    "depth",
    "write_depth",
    "answers_twice",
    "late_copies",
    "ignore_extra",
)
"""Options of every address, for the connection and not for the transport (see `servolink.connection.options`)."""


class Address:
    """Parsed address. Options are read by name and type; `refuse_unknown` refuses unread options.

    `options` belong to the transport; `connection_options` are allowed in every address.
    """

    def __init__(
        self,
        url: str,
        scheme: str,
        host: str = "",
        port: str = "",
        path: str = "",
        options: Mapping[str, str] | None = None,
    ) -> None:
        """Store the parts as text; `port` is the text after the colon of the host, used as an id by some schemes."""
        self.url = url
        self.scheme = scheme
        self.host = host
        self.port = port
        self.path = path
        self.options = dict(options or {})
        self.connection_options = {name: self.options.pop(name) for name in CONNECTION_OPTIONS if name in self.options}
        self._declared: dict[str, None] = {}

    @classmethod
    def parse(cls, url: str) -> Address:
        """Return the address in `url`, without blanks around it. Raise InvalidAddress, with the form, for others."""
        url = url.strip()
        if len(url) > _MOST:
            raise refusal(url, f"is longer than {_MOST:,} characters")
        if re.search(_CONTROL, url):
            raise refusal(url, f"holds a control character; {_FORMS}")
        if re.match(_BARE_DEVICE, url):  # taken literally: file names need no escapes
            path, _, query = url.partition("?")
            return cls(url, "serial", path=path, options=_options(url, query))
        scheme, separator, rest = url.partition("://")
        if not separator or not re.fullmatch(_SCHEME, scheme.lower()):
            is_tcp = re.fullmatch(_HOST_AND_PORT, url)
            raise refusal(url, f"is not an address; {f'write tcp://{url}' if is_tcp else _FORMS}")
        place, _, query = rest.partition("?")
        authority, slash, path = place.partition("/")
        parts = re.fullmatch(_AUTHORITY, authority)
        if parts is None:
            raise refusal(url, "is not an address: an IPv6 host must be in brackets, as in tcp://[::1]:9000")
        host, port = parts["v6"] or parts["host"] or "", parts["port"] or ""
        return cls(
            url,
            _OTHER_NAMES.get(scheme.lower(), scheme.lower()),
            _unescaped(url, host),
            _unescaped(url, port),
            _unescaped(url, slash + path),
            _options(url, query),
        )

    @property
    def serial_device(self) -> str:
        """Device file or COM port in the address of a serial port, with links resolved; otherwise empty."""
        if self.scheme != "serial":
            return ""
        device = self.host + self.path
        if "/" in device:  # perhaps a link in /dev/serial/by-id
            return os.path.realpath(device)
        port = re.fullmatch(_COM_PORT, device)
        return port[1].upper() if port else device

    def port_number(self) -> int:
        """Return the port number, 1..65535. Raise InvalidAddress."""
        if not re.fullmatch(_INTEGER, self.port) or not 1 <= int(self.port) <= 65535:
            raise self.refusal(f"needs a port from 1 to 65535: {self.scheme}://host:port")
        return int(self.port)

    def integer(self, name: str, default: int, low: int, high: int) -> int:
        """Return an integer option, `low`..`high`, in decimal or hexadecimal notation (0x81).

        Like all readers of options, return `default` for a missing option, and raise InvalidAddress for a wrong value.
        """
        text = self._option(name)
        if text is None:
            return default
        value = (
            int(text, 16) if re.fullmatch(_HEXADECIMAL, text) else int(text) if re.fullmatch(_INTEGER, text) else None
        )
        if value is None or not low <= value <= high:
            raise self._bad(name, text, f"an integer from {low} to {high}")
        return value

    def number(self, name: str, default: float, low: float, high: float) -> float:
        """Return a numeric option, `low`..`high`; read as by `integer`."""
        text = self._option(name)
        if text is None:
            return default
        value = float(text) if re.fullmatch(_NUMBER, text) else math.nan
        if not low <= value <= high:
            raise self._bad(name, text, f"a number from {low:g} to {high:g}")
        return value

    def choice(self, name: str, default: str, choices: Sequence[str]) -> str:
        """Return an option with a value among `choices`; read as by `integer`."""
        text = self._option(name)
        if text is not None and text not in choices:
            raise self._bad(name, text, "one of " + ", ".join(choices))
        return default if text is None else text

    def flag(self, name: str, *, default: bool) -> bool:
        """Return whether an option is 1 and not 0; read as by `integer`."""
        return self.choice(name, "1" if default else "0", ("0", "1")) == "1"

    def text(self, name: str, default: str) -> str:
        """Return a text option, or `default` for a missing option."""
        text = self._option(name)
        return default if text is None else text

    def refuse_unknown(self) -> None:
        """Raise InvalidAddress for unread options. Call after reading all known options."""
        unknown = [name for name in self.options if name not in self._declared]
        if unknown:
            own = ", ".join(self._declared) or "none of its own"
            every = ", ".join(CONNECTION_OPTIONS)
            raise self.refusal(
                f"unknown option {shorten(unknown[0])}; {self.scheme}:// has: {own}; every address has: {every}"
            )

    def refusal(self, reason: str) -> InvalidAddress:
        """Return an error with this address and `reason`."""
        return refusal(self.url, reason)

    def with_options(self, options: Mapping[str, str]) -> str:
        """Return this address with `options` added; options of the same name are replaced."""
        if not options:
            return self.url
        place, _, query = self.url.partition("?")
        kept = [option for option in query.split("&") if option and option.partition("=")[0] not in options]
        added = (f"{name}={percent_encoded(value, safe='')}" for name, value in options.items())
        return f"{place}?{'&'.join([*kept, *added])}"

    def _option(self, name: str) -> str | None:
        if name in CONNECTION_OPTIONS:
            return self.connection_options.get(name)
        self._declared[name] = None
        return self.options.get(name)

    def _bad(self, name: str, text: str, expected: str) -> InvalidAddress:
        return self.refusal(f"option {name} must be {expected}, not {quote(shorten(text))}")


def refusal(url: str, reason: str) -> InvalidAddress:
    """Return an error with the address `url` and the reason why the address is unusable."""
    return InvalidAddress(f"{shorten(url)}: {reason}" if url else f"'' {reason}")


def shorten(text: str) -> str:
    """Return `text`, cut to 200 characters for an error text."""
    return text if len(text) <= _LONGEST else text[:_LONGEST] + "..."


def _options(url: str, query: str) -> dict[str, str]:
    options: dict[str, str] = {}
    for item in filter(None, query.split("&")):
        name, separator, value = item.partition("=")
        name = _unescaped(url, name)
        if not separator or not name:
            raise refusal(url, f"option {quote(shorten(item))} must be written name=value")
        if name in options:
            raise refusal(url, f"option {shorten(name)} is given twice; keep one value")
        options[name] = _unescaped(url, value)
    return options


def _unescaped(url: str, text: str) -> str:
    if bad := re.search(_BAD_ESCAPE, text):
        raise refusal(url, f"bad escape {quote(text[bad.start() :][:3])}; write a percent sign as %25")
    plain = text
    if "%" in text:
        plain = unquote(text, errors="surrogateescape")
    if re.search(_CONTROL, plain):
        raise refusal(url, f"holds a control character; {_FORMS}")
    return plain
