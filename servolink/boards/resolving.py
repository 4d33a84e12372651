"""Address and name of a board, without loading names and searches for an address that has no name."""

from __future__ import annotations

import asyncio

from msgspec import Struct

from servolink.boards.names import resolve, resolve_exclusive
from servolink.boards.store import ProfileFile
from servolink.support import is_name


class Resolved(Struct, frozen=True):
    """Address of a board, with its name if known."""

    url: str
    name: str | None
    """Given name, or name of the profile of the board; None without a name."""


async def resolve_board(board: str | None, *, through_hub: bool = True) -> Resolved:
    """Return address and name of `board`: an address, a name given by `servolink use`, or None for the only board.

    A board shared by a hub has the address of the hub, unless another address is given. With `through_hub` False,
    exclusive use is required, and a board shared by a hub is refused. An address has a name if the name has a profile,
    and stands for the same port or, without a serial number, for the same address.

    Raises:
        OpenError: No board or several boards were found, the named board is absent, or a hub shares the board.
        InvalidAddress: The name is unknown.

    """
    board = board and board.strip()  # as pasted
    if through_hub and board is not None and not is_name(board) and not ProfileFile.names():
        return Resolved(board, None)

    return Resolved(*await asyncio.to_thread(resolve if through_hub else resolve_exclusive, board))


async def resolve_url(board: str | None, *, through_hub: bool = True) -> str:
    """Return the address of `board`, resolved by `resolve_board`."""
    if through_hub and board is not None and not is_name(board.strip()):
        return board
    return (await resolve_board(board, through_hub=through_hub)).url
