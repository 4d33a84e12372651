"""The port of a studio stays the same: what a browser keeps for a page belongs to the address of the page.

A page keeps in the browser what it could not save, because the studio was killed. The page of the next studio can read
it only at the same port.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from servolink.files import read_file, user_folder, write_atomically
from servolink.studio.drafts import file_name

_MOST_BYTES = 16


def last_port(board: str) -> int:
    """Return the port of the last studio of the board of this name, 0 if that is not known."""
    with suppress(OSError, ValueError):
        if 0 < (port := int(read_file(_path(board), _MOST_BYTES))) < 1 << 16:
            return port
    return 0


def keep_port(board: str, port: int) -> None:
    """Note the port for the next studio. No effect if that cannot be written."""
    with suppress(OSError):
        path = _path(board)
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        write_atomically(path, f"{port}\n".encode(), private=True)


def _path(board: str) -> Path:
    return user_folder("data") / "studio" / f"{file_name(board)}.port"
