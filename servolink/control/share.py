"""A board that a hub on this machine shares: `share://NAME`.

The hub listens on a Unix socket in the user's runtime folder. A session begins with one line of JSON in each direction,
the Greeting of the program and the Welcome of the hub. After that it carries frames, or JSON-RPC.

Windows has no such sockets in Python. There the hub listens on a port of the loopback interface, and its private file
names the port and a token without which it welcomes nobody.
"""

from __future__ import annotations

import asyncio
import errno
import os
import socket
import stat
import struct
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import islice
from pathlib import Path
from typing import cast

import msgspec
from msgspec import Struct

from servolink.control.greeting import MOST_GREETING, ROLES, VERSION, Greeting, Refusal, RoleName, Welcome
from servolink.errors import OpenError
from servolink.escaping import escape
from servolink.files import is_name, is_ours, read_file, reason, user_folder
from servolink.transports.address import Address
from servolink.transports.stream import StreamTransport

HAS_UNIX_SOCKETS = hasattr(socket, "AF_UNIX")

_MOST_WELCOME = 1024 * 1024
_WELCOME_LIMIT = 5.0  # seconds
_FULL_PAUSE = 0.01  # seconds between attempts while too many programs wait for the hub to accept them
_SEND_BUFFER = 32768  # requests are short; see TCP
_LONGEST_PATH = 103  # bytes in the address of a Unix socket on macOS; Linux takes four more
_MOST_WHO = 80
_ROOT = 0
_FLAGS = {"-v", "-vv", "--verbose", "--json"}


class ShareTransport(StreamTransport):
    """One session with a hub, which repeats lost requests and keeps the answers of programs apart."""

    is_shared = True

    def __init__(self, url: str, name: str, greeting: Greeting) -> None:
        """Lead to the board that is shared as `name`. `greeting` may be changed until the hub is greeted."""
        super().__init__(url)
        self.greeting = greeting
        self.welcome: Welcome | None = None
        """What the hub said; None before `greet` or `open`."""
        self._name = name

    @property
    def board_url(self) -> str:
        """The address of the board behind the hub; that of the hub before `greet`."""
        return self.url if self.welcome is None else self.welcome.url

    async def greet(self) -> Welcome:
        """Connect to the hub, unless that was done, and return its welcome; `open` can follow. Raise OpenError."""
        if self.welcome is None:
            self._pipe, self.welcome = await greet(self._name, self.greeting, self, url=self.url)
        return self.welcome

    async def connect(self) -> asyncio.Transport:
        """Greet the hub; OpenError says what to do."""
        await self.greet()
        assert self._pipe is not None  # noqa: S101 - narrows the type
        return self._pipe

    async def _open(self) -> None:
        await super()._open()
        if self._pipe is not None:
            self._pipe.resume_reading()


async def greet(
    name: str, greeting: Greeting, protocol: asyncio.Protocol, *, url: str = ""
) -> tuple[asyncio.Transport, Welcome]:
    """Connect to the hub `name` and exchange greetings; return the connection and what the hub said.

    From then on it belongs to `protocol`, and brings nothing before `resume_reading`. Raise OpenError, which says what
    to do and calls the hub `url`, and leave nothing open.
    """
    url = url or f"share://{name}"
    listener = _Listener()
    limit = asyncio.timeout(_WELCOME_LIMIT)
    try:
        async with limit:
            connection, greeting.token = await _connect(name)
            try:
                loop = asyncio.get_running_loop()
                pipe, _ = await loop.create_connection(lambda: listener, sock=connection)
            except BaseException:
                connection.close()
                raise
            pipe.write(msgspec.json.encode(greeting) + b"\n")
            welcome = _read_welcome(await listener.line)
    except (OSError, ValueError) as error:
        listener.abort()
        why = f"the hub did not answer within {_WELCOME_LIMIT:g} s" if limit.expired() else _explain(name, error)
        raise OpenError(f"{url}: {why}") from error
    except BaseException:
        listener.abort()
        raise
    pipe.set_protocol(protocol)
    return pipe, welcome


class _Listener(asyncio.Protocol):
    """Waits for one line."""

    def __init__(self) -> None:
        self.line: asyncio.Future[bytes] = asyncio.get_running_loop().create_future()
        self._heard = bytearray()
        self._pipe: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)  # noqa: S101 - narrows the type
        self._pipe = transport

    def data_received(self, data: bytes) -> None:
        self._heard += data
        if (self._heard.endswith(b"\n") or len(self._heard) > _MOST_WELCOME) and self._pipe is not None:
            self._pipe.pause_reading()  # the hub sends nothing more before it is asked
            self.line.set_result(bytes(self._heard))

    def connection_lost(self, exc: Exception | None) -> None:
        if not self.line.done():
            self.line.set_exception(exc or ConnectionResetError("the hub closed the connection; perhaps it is ending"))
            self.line.exception()  # seen, even if nobody waits for it any more

    def abort(self) -> None:
        if self._pipe is not None:
            self._pipe.abort()


def _read_welcome(line: bytes) -> Welcome:
    """Return what the hub said. Raise ValueError if it refuses, or says something else."""
    with suppress(msgspec.DecodeError):
        raise ValueError(f"the hub refuses: {msgspec.json.decode(line, type=Refusal).error}")
    try:
        welcome = msgspec.json.decode(line, type=Welcome)
    except msgspec.MsgspecError as error:
        raise ValueError(f"what listens there is not a hub: {error}") from error
    if welcome.servolink != VERSION:
        raise ValueError(f"the hub has version {welcome.servolink} of its protocol, not {VERSION}: update servolink")
    return welcome


def _explain(name: str, error: Exception) -> str:
    if isinstance(error, FileNotFoundError | ConnectionRefusedError):
        return f"no hub of this name is running; `servolink share --name {name}` starts it, `servolink list` shows all"
    return reason(error)


# ── where the hub listens ──


@contextmanager
def hub_folder() -> Iterator[Path]:
    """Yield the folder of the hubs of this user, as a path for the time of this context. Raise OSError for no safe one.

    Where the system allows it the path leads to the folder that was looked at, whatever happens to its name meanwhile,
    and is short: the address of a socket has room for about 100 bytes.
    """
    folder = user_folder("runtime")
    if not HAS_UNIX_SOCKETS:
        yield folder
        return
    number = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        if not is_ours(os.fstat(number)):
            raise PermissionError(
                errno.EPERM, f"{folder} belongs to another user, or others can write to it; correct or remove it"
            )
        short = Path(f"/proc/self/fd/{number}")
        yield short if sys.platform == "linux" and short.exists() else folder
    finally:
        os.close(number)


def socket_name(name: str) -> str:
    """Return the name of the socket of the hub `name`."""
    return f"{name}.sock"


def socket_path(folder: Path, name: str) -> str:
    """Return where the hub `name` listens in `hub_folder`. Raise OSError if the system cannot take such a long path."""
    path = str(folder / socket_name(name))
    if len(os.fsencode(path)) > _LONGEST_PATH:
        raise OSError(
            errno.ENAMETOOLONG, f"{path} is too long for a socket: use a shorter name, or set XDG_RUNTIME_DIR"
        )
    return path


class LoopbackDoor(Struct):
    """Where a hub listens that has no Unix socket, as its private file says."""

    port: int
    token: str


def loopback_path(folder: Path, name: str) -> Path:
    """Return the private file of the hub `name`."""
    return folder / f"{name}.door"


def is_allowed(connection: socket.socket) -> bool:
    """Return whether the other end of a Unix socket is this user or root; True where the system does not say."""
    if not hasattr(socket, "SO_PEERCRED"):
        return True
    _, user, _ = struct.unpack(
        "3i", connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i"))
    )
    return user in {os.geteuid(), _ROOT}


async def _connect(name: str) -> tuple[socket.socket, str]:
    """Return a connection to the hub `name`, and the token for its greeting. Raise OSError or ValueError."""
    with hub_folder() as folder:
        if not HAS_UNIX_SOCKETS:
            door = msgspec.json.decode(read_file(loopback_path(folder, name), MOST_GREETING), type=LoopbackDoor)
            return await _connected(socket.AF_INET, ("127.0.0.1", door.port)), door.token
        path = socket_path(folder, name)
        status = os.lstat(path)
        if not stat.S_ISSOCK(status.st_mode) or status.st_uid != os.geteuid():
            raise PermissionError(
                errno.EPERM, f"{socket_name(name)} in {user_folder('runtime')} is not a socket of this user"
            )
        connection = await _connected(socket.AF_UNIX, path)
    if not is_allowed(connection):
        connection.close()
        raise PermissionError(errno.EPERM, "what listens there belongs to another user")
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
    return connection, ""


async def _connected(family: int, place: str | tuple[str, int]) -> socket.socket:
    connection = socket.socket(family, socket.SOCK_STREAM)
    try:
        connection.settimeout(0)
        while True:
            try:
                await asyncio.get_running_loop().sock_connect(connection, place)
                connection.getpeername()  # asyncio takes a full queue of a Unix socket for success
            except OSError as error:
                if error.errno not in {errno.ENOTCONN, errno.EAGAIN}:
                    raise
                await asyncio.sleep(_FULL_PAUSE)
            else:
                return connection
    except BaseException:
        connection.close()
        raise


def this_program() -> str:
    """Return this program as a person reads it, such as `servolink watch (pid 1234)`."""
    path = Path(sys.argv[0] if sys.argv else "")
    name = path.parent.name if path.name == "__main__.py" else path.name or "python"
    if name == "servolink":
        name = " ".join(["servolink", *_command(sys.argv[1:])])
    return f"{escape(name)[:_MOST_WHO]} (pid {os.getpid()})"


def _command(words: Sequence[str]) -> list[str]:
    """Return the command among the words of a command line: the first that is not an option, nor the value of one."""
    pairs = zip(["", *words], words, strict=False)
    found = (word for before, word in pairs if word.isalpha() and (not before.startswith("-") or before in _FLAGS))
    return list(islice(found, 1))


def from_address(address: Address) -> ShareTransport:
    """Make the transport for `share://NAME?role=watch`."""
    if not is_name(address.host) or address.port or address.path.strip("/"):
        raise address.refusal("must name a shared board: share://NAME, with letters, digits, - and _")
    role = cast("RoleName", address.choice("role", "edit", ROLES))
    address.refuse_unknown()
    greeting = Greeting(wants="frames", who=this_program(), role=role)
    if address.choice("byte_order", "little", ("little", "big")) == "big":
        greeting.byte_order = "big"
    return ShareTransport(address.url, address.host, greeting)
