"""Named sockets between programs of the same user on the same machine.

A name stands for a Unix socket in the runtime folder of the user. Python on Windows has no Unix sockets: a name stands
for a private file there, with a port of the loopback interface and a token that clients must send.
"""

from __future__ import annotations

import asyncio
import errno
import os
import secrets
import socket
import stat
import struct
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import msgspec
from msgspec import Struct

from servolink.support.files import read_file, write_atomically
from servolink.support.platforms.memory_pipes import connect_in_memory
from servolink.support.platforms.user_folders import refuse_foreign, user_folder

_BACKLOG = 1024
_FULL_PAUSE = 0.01  # seconds between attempts while too many programs wait to be accepted
_SEND_BUFFER = 32768  # bytes; requests are short, as on TCP
_LONGEST_PATH = 103  # bytes in the address of a Unix socket on macOS; Linux takes four more
_LONGEST_DOOR = 4096
_PRIVATE = 0o600
_TOKEN_BYTES = 32
_ROOT = 0


@dataclass(frozen=True, slots=True)
class LocalSocket:
    """Listening socket."""

    listening: socket.socket
    path: Path
    """File under which programs find the socket, to be removed at the end."""
    token: str
    """Secret required from clients; empty for a Unix socket, protected by the system."""


class _Door(Struct):
    """Content of the private file."""

    port: int
    token: str


def has_unix_sockets() -> bool:
    """Return whether Unix sockets are available, and their files have owners."""
    if sys.platform == "win32" or sys.platform == "emscripten":
        return False
    else:
        try:
            socket.socket(socket.AF_UNIX).close()
        except OSError as error:
            return error.errno != errno.EAFNOSUPPORT
        return True


def listen_locally(name: str) -> LocalSocket:
    """Listen under `name` in the runtime folder, which must exist. Raise OSError.

    Replace the file of a killed program; the caller must have made sure that no program uses the name.
    """
    folder = user_folder("runtime")
    if sys.platform == "win32" or not has_unix_sockets():
        listening, token = socket.create_server(("127.0.0.1", 0), backlog=_BACKLOG), secrets.token_urlsafe(_TOKEN_BYTES)
        path = folder / f"{name}.door"
        door = _Door(listening.getsockname()[1], token)
        write_atomically(path, msgspec.json.encode(door), private=True)
    else:
        with socket_folder() as short:
            place = socket_path(short, name)
            _remove_stale(place)
            listening, token = socket.socket(socket.AF_UNIX), ""
            listening.bind(place)
            Path(place).chmod(_PRIVATE)
            listening.listen(_BACKLOG)
        path = folder / f"{name}.sock"
    listening.settimeout(0)
    return LocalSocket(listening, path, token)


async def connect_locally(name: str, make_protocol: Callable[[], asyncio.Protocol]) -> tuple[asyncio.Transport, str]:
    """Connect to the program listening under `name`; return the connection, and the token to send.

    Raise OSError or ValueError; FileNotFoundError and ConnectionRefusedError if none is running.
    """
    if sys.platform == "emscripten":
        return connect_in_memory(name, make_protocol), ""
    else:
        connection, token = await _connected_to(name)
        try:
            pipe, _ = await asyncio.get_running_loop().create_connection(make_protocol, sock=connection)
        except BaseException:
            connection.close()
            raise
        return pipe, token


async def _connected_to(name: str) -> tuple[socket.socket, str]:
    folder = user_folder("runtime")
    if sys.platform == "win32" or not has_unix_sockets():
        refuse_foreign(folder, folder.lstat())
        door = msgspec.json.decode(read_file(folder / f"{name}.door", _LONGEST_DOOR), type=_Door)
        return await _connected(socket.AF_INET, ("127.0.0.1", door.port)), door.token
    else:
        with socket_folder() as short:
            path = socket_path(short, name)
            status = os.lstat(path)
            if not stat.S_ISSOCK(status.st_mode) or status.st_uid != os.geteuid():
                raise PermissionError(errno.EPERM, f"{name}.sock in {folder} must be a socket of this user")
            connection = await _connected(socket.AF_UNIX, path)
        if not is_same_user(connection):
            connection.close()
            raise PermissionError(errno.EPERM, "the program listening there belongs to another user")
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        return connection, ""


def is_same_user(connection: socket.socket) -> bool:
    """Return whether the peer of a Unix socket is the same user or root; True if the system cannot tell."""
    if (
        sys.platform == "win32"
        or sys.platform == "emscripten"
        or connection.family != socket.AF_UNIX
        or not hasattr(socket, "SO_PEERCRED")
    ):
        return True
    else:
        _, user, _ = struct.unpack(
            "3i", connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i"))
        )
        return user in {os.geteuid(), _ROOT}


@contextmanager
def socket_folder() -> Iterator[Path]:
    """Yield a path to the runtime folder, valid inside the context. Raise OSError if others can write to the folder.

    On Linux the path leads to the checked folder even after the folder was renamed, and is short: the address of a
    socket has room for about 100 bytes.
    """
    folder = user_folder("runtime")
    if sys.platform == "win32":
        yield folder
    else:
        number = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
        try:
            refuse_foreign(folder, os.fstat(number))
            short = Path(f"/proc/self/fd/{number}")
            yield short if sys.platform == "linux" and short.exists() else folder
        finally:
            os.close(number)


def socket_path(folder: Path, name: str) -> str:
    """Return the path of the socket `name`. Raise OSError if the path is too long for the system."""
    path = str(folder / f"{name}.sock")
    if len(os.fsencode(path)) > _LONGEST_PATH:
        why = f"{path} is too long for a socket: use a shorter name, or set XDG_RUNTIME_DIR"
        raise OSError(errno.ENAMETOOLONG, why)
    return path


def _remove_stale(place: str) -> None:
    """Remove the socket file of a killed program."""
    with suppress(FileNotFoundError):
        if not stat.S_ISSOCK(os.lstat(place).st_mode):
            raise FileExistsError(f"{Path(place).name} exists and must be a socket; remove the file")
        Path(place).unlink()


async def _connected(family: int, place: str | tuple[str, int]) -> socket.socket:
    # With the protocol number of TCP: only then asyncio sets TCP_NODELAY, so that short requests are sent immediately.
    connection = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP if family == socket.AF_INET else 0)
    try:
        connection.settimeout(0)
        while True:
            try:
                await asyncio.get_running_loop().sock_connect(connection, place)
                connection.getpeername()  # raises for a full queue, taken for success by asyncio on a Unix socket
            except OSError as error:
                if error.errno not in {errno.ENOTCONN, errno.EAGAIN}:
                    raise
                await asyncio.sleep(_FULL_PAUSE)
            else:
                return connection
    except BaseException:
        connection.close()
        raise
