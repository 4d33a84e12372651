"""The port of a studio stays the same: what a browser keeps for a page belongs to the address of the page.

A page keeps in the browser what it could not save, because the studio was killed. The page of the next studio can read
it only at the same port.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from servolink.files import read_file, user_folder, write_atomically
from servolink.studio.drafts import file_name

_MOST_BYTES = 32
_MOST = 4


def last_ports(board: str) -> list[int]:
    """Return the ports of the last studios of the board of this name, the latest first; empty if they are not known.

    There are several if one studio was started beside another.
    """
    with suppress(OSError, ValueError):
        ports = [int(port) for port in read_file(_path(board), _MOST_BYTES).split()]
        if all(0 < port < 1 << 16 for port in ports):
            return ports
    return []


def keep_port(board: str, port: int) -> None:
    """Note the port for the next studio. No effect if that cannot be written."""
    with suppress(OSError):
        path = _path(board)
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        ports = [port, *(one for one in last_ports(board) if one != port)][:_MOST]
        write_atomically(path, f"{' '.join(map(str, ports))}\n".encode(), private=True)


def _path(board: str) -> Path:
    return user_folder("data") / "studio" / f"{file_name(board)}.port"
