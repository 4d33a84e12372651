"""Sockets between programs of one user: what the system is asked, and who is let in.

Module: servolink.support.platforms.user_folders.
"""

from __future__ import annotations

import asyncio
import errno
import json
import os
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from servolink.client import connect
from servolink.errors import OpenError
from servolink.hub import Hub
from servolink.support.platforms import local_sockets
from servolink.support.platforms.user_folders import private_folder, user_folder
from servolink.virtual import VirtualBoard
from tests.hub.door_hub import on_hub, sharing, until

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Unix sockets")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the private folder of a user of their own."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return private_folder()


@contextmanager
def listening(name: str) -> Iterator[local_sockets.LocalSocket]:
    """Listen under a name."""
    door = local_sockets.listen_locally(name)
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


class Listener(asyncio.Protocol):
    """Protocol for the first bytes."""

    def __init__(self, heard: asyncio.Future[bytes]) -> None:
        self._heard = heard

    def data_received(self, data: bytes) -> None:
        self._heard.set_result(data)


async def said_to(door: local_sockets.LocalSocket, name: str) -> tuple[bytes, str]:
    """Return what a program hears that connects by name, and the token that it is to show."""
    loop = asyncio.get_running_loop()
    heard = loop.create_future()
    pipe, token = await local_sockets.connect_locally(name, lambda: Listener(heard))
    accepted, _ = await loop.sock_accept(door.listening)
    with accepted:
        await loop.sock_sendall(accepted, b"hello")
        said = await heard
    pipe.abort()
    return said, token


def test_a_program_is_found_by_its_name(folder: Path) -> None:
    with listening("rex") as door:
        assert (door.path, door.token) == (folder / "rex.sock", "")
        assert asyncio.run(said_to(door, "rex")) == (b"hello", "")


@pytest.mark.parametrize("name", ["rex", "other"])
def test_a_name_that_nobody_has_is_refused(name: str) -> None:
    with listening("rex"):
        pass
    with pytest.raises((FileNotFoundError, ConnectionRefusedError)):
        asyncio.run(local_sockets.connect_locally(name, asyncio.Protocol))


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
        local_sockets.listen_locally("rex")
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("has_unix_sockets", [True, False])
def test_a_folder_of_others_is_refused(has_unix_sockets: bool, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(local_sockets, "has_unix_sockets", lambda: has_unix_sockets)
    assert folder == user_folder("runtime")
    folder.chmod(0o777)
    with pytest.raises(PermissionError, match="is writable for others; correct or remove the folder"):
        asyncio.run(local_sockets.connect_locally("rex", asyncio.Protocol))


def test_without_unix_sockets_a_token_opens_the_door(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As on Windows, as far as another system can try it."""
    monkeypatch.setattr(local_sockets, "has_unix_sockets", lambda: False)

    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with sharing(hub) as url, connect(url) as board:
            assert await board.servo_ids() == (1, 2, 3)
            door = folder / "rex.door"
            assert door.stat().st_mode & 0o777 == 0o600
            place = json.loads(door.read_text())
            reader, writer = await asyncio.open_connection("127.0.0.1", place["port"])
            writer.write(b'{"servolink": 1, "wants": "frames", "who": "x", "token": "guess"}\n')
            assert json.loads(await reader.read())["error"].startswith("wrong token")
            writer.close()
        assert list(folder.iterdir()) == []
        with pytest.raises(OpenError, match="no hub of this name is running"):
            await connect("share://rex")

    on_hub(use)


@pytest.mark.skipif(not hasattr(socket, "SO_PEERCRED"), reason="the system does not say who is there")
def test_who_is_at_the_other_end_is_asked_of_the_system(monkeypatch: pytest.MonkeyPatch) -> None:
    one, other = socket.socketpair()
    with one, other:
        assert local_sockets.is_same_user(one)
        monkeypatch.setattr(local_sockets, "_ROOT", -1)
        monkeypatch.setattr(os, "geteuid", lambda: 4711)
        assert not local_sockets.is_same_user(one)
        monkeypatch.delattr(socket, "SO_PEERCRED")  # as on macOS, where the folder alone keeps others out
        assert local_sockets.is_same_user(one)


def test_a_program_leaves_a_hub_of_another_user() -> None:
    """As if the folder had not kept it out."""

    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with sharing(hub):
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(local_sockets, "is_same_user", lambda _: False)
                with pytest.raises(OpenError, match="the program listening there belongs to another user"):
                    await connect("share://rex")
            await until(lambda: not hub.programs)

    on_hub(use)
