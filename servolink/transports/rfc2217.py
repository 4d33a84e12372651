"""Serial port of a Telnet server (RFC 2217): a TCP connection whose server also takes the settings of the port."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable

from servolink.errors import OpenError
from servolink.transports.address import Address
from servolink.transports.stream import TcpTransport

_IAC = b"\xff"  # begins each Telnet command; doubled, a byte of data
_WILL, _WONT, _DO, _DONT = b"\xfb", b"\xfc", b"\xfd", b"\xfe"
_YES, _NO = {_WILL: _DO, _DO: _WILL}, {_WILL: _DONT, _DO: _WONT}  # answers to offers and requests
_BINARY, _NO_GO_AHEAD, _COM_PORT = b"\x00", b"\x03", b"\x2c"
_OPTIONS = (_BINARY, _NO_GO_AHEAD, _COM_PORT)
_COMMAND = re.compile(rb"\xff(?:([\xfb-\xfe])(.)|\xfa((?:[^\xff]++|\xff\xff)*+)\xff\xf0|([^\xfa-\xfe]))", re.DOTALL)
_MOST = 1024  # bytes of a command; a longer one has no end
_BAUD_RATE, _DATA_BITS, _PARITY, _STOP_BITS, _CONTROL, _PURGE = 1, 2, 3, 4, 5, 12
_NAMES = {_BAUD_RATE: "the baud rate", _DATA_BITS: "data bits", _PARITY: "parity", _STOP_BITS: "stop bits"}
_FROM_SERVER = 100  # added to the code of a setting in its confirmation
_NO_FLOW_CONTROL, _DTR_ON, _RTS_ON, _RECEIVED = 1, 8, 11, 1


class Rfc2217Transport(TcpTransport):
    """Serial port of a server, with 8 data bits, no parity, 1 stop bit and no flow control."""

    def __init__(
        self, url: str, host: str, port: int, *, timeout: float, baudrate: int, dtr: bool = False, rts: bool = False
    ) -> None:
        """Use `port` of `host`; opening takes at most `timeout` seconds, with the settings of the serial port."""
        super().__init__(url, host, port, timeout=timeout)
        self.bytes_per_second = baudrate / 10
        """Least capacity of the line."""
        self._baudrate, self._lines = baudrate, (_DTR_ON + (not dtr), _RTS_ON + (not rts))
        self._rest = b""  # beginning of a command whose end has not arrived
        self._said: set[bytes] = set()  # each is said once: no server makes the answers pile up or go in circles
        self._confirmed: dict[int, int] = {}  # values of settings, as the server has set them
        self._agreed = self._is_ready = False
        self._refused = ""  # what the server refuses, in words
        self._news = asyncio.Event()

    async def connect(self) -> asyncio.Transport:
        """Connect, agree on RFC 2217 and set the port. Raise OpenError with what the server refuses or leaves out."""
        limit = asyncio.get_running_loop().time() + self._timeout
        pipe = await super().connect()
        try:
            for option in _OPTIONS:
                self._say(_WILL, option)
                self._say(_DO, option)
            await self._until(lambda: [] if self._agreed else ["the offer of RFC 2217"], limit)
            await self._set_port(pipe, limit)
        except BaseException:
            pipe.abort()
            raise
        self._is_ready = True
        return pipe

    async def _set_port(self, pipe: asyncio.Transport, limit: float) -> None:
        """Drop old bytes and set the port; not all servers confirm flow control and control lines."""
        wanted = {_BAUD_RATE: self._baudrate, _DATA_BITS: 8, _PARITY: 1, _STOP_BITS: 1}
        settings = [(_PURGE, _RECEIVED), *((_CONTROL, each) for each in (_NO_FLOW_CONTROL, *self._lines))]
        pipe.write(b"".join(_setting(code, value) for code, value in (*settings, *wanted.items())))
        await self._until(lambda: [name for code, name in _NAMES.items() if code not in self._confirmed], limit)
        for code, value in wanted.items():
            if (found := self._confirmed.get(code, value)) != value:
                raise OpenError(f"{self.url}: the server set {_NAMES[code]} to {found}, not {value}; use another port")

    async def _until(self, missing: Callable[[], list[str]], limit: float) -> None:
        """Wait until nothing is missing or the connection has ended. Raise OpenError for a refusal or silence."""
        problem = ""
        try:
            async with asyncio.timeout_at(limit):
                while missing() and not self._refused and not self._disconnected.is_set():
                    self._news.clear()
                    await self._news.wait()
        except TimeoutError:
            problem = f"did not answer {' and '.join(missing())} within {self._timeout:g} s"
        if problem := f"refuses {self._refused}" if self._refused else problem:
            remedy = f"if it only passes bytes, write tcp://{self._host}:{self._port}"
            raise OpenError(f"{self.url}: the server {problem}; {remedy}")

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Have somewhere to write answers during the opening (called by asyncio)."""
        assert isinstance(transport, asyncio.Transport)  # noqa: S101 - narrows the type
        self._pipe = transport

    def connection_lost(self, exc: Exception | None) -> None:
        """End the connection, and an opening under way (called by asyncio)."""
        super().connection_lost(exc)
        self._news.set()

    def data_received(self, data: bytes) -> None:
        """Obey the Telnet commands in `data`, and pass on the bytes between (called by asyncio)."""
        if self._rest or _IAC in data:
            data = self._plain(self._rest + data)
        if data and self._is_ready:  # what came before the settings is noise
            self._deliver(data)
        self._news.set()

    def _plain(self, data: bytes) -> bytes:
        """Return `data` without its commands, and keep the beginning of one that is cut."""
        plain, at, self._rest = bytearray(), 0, b""
        while (begin := data.find(_IAC, at)) >= 0:
            plain += data[at:begin]
            found = _COMMAND.match(data, begin)
            if found is None:
                self._rest, at = data[begin:], len(data)
                if len(self._rest) > _MOST:
                    self._lose(ConnectionError("the server sent a Telnet command without an end"))
                break
            at = found.end()
            verb, option, suboption, other = found.groups()
            if other == _IAC:
                plain += _IAC
            elif verb is not None:
                self._negotiate(verb, option)
            elif suboption is not None and suboption[:1] == _COM_PORT and len(suboption) > 1:
                value = suboption[2:].replace(_IAC * 2, _IAC)
                self._confirmed[suboption[1] - _FROM_SERVER] = int.from_bytes(value[:4])
        return bytes(plain + data[at:])

    def _negotiate(self, verb: bytes, option: bytes) -> None:
        """Answer an offer, a request or a refusal of a Telnet option."""
        if verb in _YES:
            self._say((_YES if option in _OPTIONS else _NO)[verb], option)
            self._agreed = self._agreed or option == _COM_PORT
        elif option == _BINARY or verb + option == _DONT + _COM_PORT:
            self._refused = "bytes of 8 bits" if option == _BINARY else "RFC 2217"

    def _say(self, verb: bytes, option: bytes) -> None:
        if verb + option not in self._said and self._pipe is not None:
            self._said.add(verb + option)
            self._pipe.write(_IAC + verb + option)

    def _write(self, pipe: asyncio.Transport, data: bytes) -> None:
        """Pass `data` to the system, with each byte that would begin a command doubled."""
        pipe.write(data.replace(_IAC, _IAC * 2))


def _setting(code: int, value: int) -> bytes:
    """Return the request to set the port; only a baud rate has four bytes."""
    content = value.to_bytes(4 if code == _BAUD_RATE else 1).replace(_IAC, _IAC * 2)
    return _IAC + b"\xfa" + _COM_PORT + bytes([code]) + content + _IAC + b"\xf0"


def from_address(address: Address) -> Rfc2217Transport:
    """Make the transport for `rfc2217://host:port?baudrate=115200&dtr=0&rts=0&timeout=5`."""
    if not address.host or address.path.strip("/"):
        raise address.refusal("must be written rfc2217://host:port")
    timeout = address.number("timeout", 5.0, 0.1, 600)
    baudrate = address.integer("baudrate", 115200, 50, 12_000_000)
    lines = {name: address.flag(name, default=False) for name in ("dtr", "rts")}
    address.refuse_unknown()
    return Rfc2217Transport(
        address.url, address.host, address.port_number(), timeout=timeout, baudrate=baudrate, **lines
    )
