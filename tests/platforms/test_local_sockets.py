"""Sockets between programs of one user: what the system is asked, and who is let in.

Module: servolink.platforms.private_files.
"""

from __future__ import annotations

import asyncio
import errno
import os
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from servolink.platforms import local_sockets
from servolink.platforms.private_files import private_folder
from servolink.platforms.user_folders import user_folder

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Unix sockets")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the private folder of a user of their own."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return private_folder()


@contextmanager
def listening(name: str) -> Iterator[local_sockets.LocalSocket]:
    """Listen under a name."""
    door = local_sockets.listen(name)
    with door.listening:
        yield door


def refusing(number: int) -> type[socket.socket]:
    """Return a class of sockets of which the system refuses those of Unix."""

    class Refused(socket.socket):
        def __init__(self, family: int = socket.AF_INET, *args: Any, **options: Any) -> None:
            if family == socket.AF_UNIX and not args:  # the pair of an event loop comes with more
                raise OSError(number, os.strerror(number))
            super().__init__(family, *args, **options)

    return Refused


async def said_to(door: local_sockets.LocalSocket, name: str) -> tuple[bytes, str]:
    """Return what a program hears that connects by name, and the token that it is to show."""
    loop = asyncio.get_running_loop()
    connection, token = await local_sockets.connect(name)
    with connection:
        accepted, _ = await loop.sock_accept(door.listening)
        with accepted:
            await loop.sock_sendall(accepted, b"hello")
        return await loop.sock_recv(connection, 100), token


def test_a_program_is_found_by_its_name(folder: Path) -> None:
    with listening("rex") as door:
        assert (door.path, door.token) == (folder / "rex.sock", "")
        assert asyncio.run(said_to(door, "rex")) == (b"hello", "")


@pytest.mark.parametrize("name", ["rex", "other"])
def test_a_name_that_nobody_has_is_refused(name: str) -> None:
    with listening("rex"):
        pass
    with pytest.raises((FileNotFoundError, ConnectionRefusedError)):
        asyncio.run(local_sockets.connect(name))


def test_a_system_that_refuses_unix_sockets_gets_a_port_and_a_token(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A sandbox does so, though Python has the family."""
    monkeypatch.setattr(socket, "socket", refusing(errno.EAFNOSUPPORT))
    with listening("rex") as door:
        assert door.path == folder / "rex.door"
        assert door.path.stat().st_mode & 0o777 == 0o600
        assert len(door.token) > 40
        assert asyncio.run(said_to(door, "rex")) == (b"hello", door.token)


def test_a_shortage_of_files_opens_no_port(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(socket, "socket", refusing(errno.EMFILE))
    with pytest.raises(OSError, match="Too many open files"):
        local_sockets.listen("rex")
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("has_unix_sockets", [True, False])
def test_a_folder_of_others_is_refused(has_unix_sockets: bool, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(local_sockets, "has_unix_sockets", lambda: has_unix_sockets)
    assert folder == user_folder("runtime")
    folder.chmod(0o777)
    with pytest.raises(PermissionError, match="is writable for others; correct or remove the folder"):
        asyncio.run(local_sockets.connect("rex"))
