"""From a board to an open page: the studio of a board, and the browser that shows the page."""

from __future__ import annotations

import html
import os
import webbrowser
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from pathlib import Path
from typing import Any

from servolink.boards import resolve_board
from servolink.errors import OpenError
from servolink.studio.robots import VIRTUAL, Robots
from servolink.studio.studio_methods import Studio
from servolink.support import user_folder


@asynccontextmanager
async def studio_for(board: str | None, *, demo: bool = False, **options: Any) -> AsyncIterator[Studio]:
    """Yield the studio of `board`: an address, a name, or None for the only present board.

    A hub that shares the board is used. Otherwise the board is shared from here, with the `options` of `connect`, so
    that other programs can use it meanwhile. With `demo` it is a new virtual board that holds some actions and macros.
    Without a name, and without a board that can be opened, the studio has no board: people choose one on the page.
    """
    robots = Robots(**options)
    studio = Studio(robots=robots)
    try:
        try:
            studio.begin(await robots.open(VIRTUAL if demo else (await resolve_board(board)).url))
        except OpenError:
            if demo or board is not None:
                raise
        yield studio
    finally:
        await studio.twin.close()
        await robots.close()


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
        with os.fdopen(number, "w", encoding="utf-8") as file:
            file.write('<!doctype html><meta charset="utf-8">')
            file.write(f'<meta http-equiv="refresh" content="0;url={html.escape(url)}">\n')
    except OSError:
        path = None  # the address was printed, and can be opened by hand
    try:
        yield path
    finally:
        if path is not None:
            with suppress(OSError):
                path.unlink()
