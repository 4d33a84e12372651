"""From a board to an open page: finds the hub of the board, or shares the board here, and serves the studio."""

from __future__ import annotations

import asyncio
import html
import os
import webbrowser
from collections.abc import AsyncIterator, Iterator
from contextlib import AsyncExitStack, asynccontextmanager, contextmanager, suppress
from importlib.resources import files
from pathlib import Path
from typing import Any

from servolink.client.board import Board
from servolink.control.greeting import Greeting
from servolink.control.share_address import greet
from servolink.discovery import hubs
from servolink.discovery.names import resolve_board
from servolink.discovery.search import boards, search
from servolink.files import user_folder
from servolink.hub import serve_board
from servolink.project.project_file import parse_project
from servolink.protocol.record_types import RECORD_TYPES
from servolink.studio.studio_methods import Studio

VIRTUAL = "virtual://?servos=16"
_SHARED = "share://"


@asynccontextmanager
async def studio_for(board: str | None, *, demo: bool = False, **options: Any) -> AsyncIterator[Studio]:
    """Yield the studio of `board`: an address, a name, or None for the only present board, else for a virtual board.

    A hub that shares the board is used. Otherwise the board is shared from here, with the `options` of `connect`, so
    that other programs can use it meanwhile. With `demo`, or if no board is here, it is a new virtual board that holds
    some actions and macros.
    """
    address = VIRTUAL if demo else await _address(board)
    if address.startswith(_SHARED):
        name = address.removeprefix(_SHARED).partition("?")[0]
        await _check_hub(name)
        yield Studio(name)
        return
    async with AsyncExitStack() as stack:
        hub, _ = await stack.enter_async_context(serve_board(address, name=_name_of(address, board), **options))
        if address == VIRTUAL:
            await _store_demo(hub.board)
        yield Studio(hub.name)


async def _check_hub(name: str) -> None:
    """Raise OpenError, with a remedy, without a running hub of this name."""
    greeting = Greeting(wants="rpc", who="studio: looking for the hub", role="watch")
    pipe, _ = await greet(name, greeting, asyncio.Protocol())
    pipe.abort()


async def _address(board: str | None) -> str:
    if board is not None:
        return (await resolve_board(board)).url
    if not boards(await asyncio.to_thread(search)):
        return VIRTUAL
    return (await resolve_board(None)).url


async def _store_demo(board: Board) -> None:
    """Store the demo on a new virtual board."""
    demo = parse_project((files("servolink.studio") / "demo.servolink.json").read_bytes())
    for kind in RECORD_TYPES:
        for record in getattr(demo, kind.field):
            await board.request(kind.add(record))
    await board.add_servo_parameters(demo.servo_parameters)
    await board.set_active_joystick_table(1)


def _name_of(address: str, board: str | None) -> str | None:
    """Return a name for the hub; None for the name stored on the board."""
    if address == VIRTUAL or (board is not None and board.startswith("virtual:")):
        taken = {hub.url for hub in hubs.candidates()}
        return "virtual" if f"{_SHARED}virtual" not in taken else f"virtual-{os.getpid()}"
    return None


@contextmanager
def opened_in_browser(url: str) -> Iterator[None]:
    """Open `url` in the user's browser.

    Not as an argument of the browser, which every user of this machine could read, but through a private file that
    leads there.
    """
    with _private_page(url) as path:
        if path is not None:
            webbrowser.open(path.as_uri())
        yield


@contextmanager
def _private_page(url: str) -> Iterator[Path | None]:
    path: Path | None = None
    try:
        path = user_folder("runtime") / f"studio-{os.getpid()}.html"
        number = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(number, "w") as file:
            file.write(f'<!doctype html><meta http-equiv="refresh" content="0;url={html.escape(url)}">\n')
    except OSError:
        path = None  # the address was printed, and can be opened by hand
    try:
        yield path
    finally:
        if path is not None:
            with suppress(OSError):
                path.unlink()
