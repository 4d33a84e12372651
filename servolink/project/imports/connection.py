"""A board for as long as it stays connected: what comes after a loss may be another one."""

from __future__ import annotations

from typing import TypeVar

from servolink.errors import ConnectionLost
from servolink.printable import printable
from servolink.project.imports.read import Asked
from servolink.protocol.codec import Codec
from servolink.protocol.packet import Request, Response

R = TypeVar("R", bound=Response)


class OneConnection:
    """Passes on what a board is asked; ConnectionLost once its connection is another one, even to the same address."""

    def __init__(self, board: Asked) -> None:
        """Speak to `board` through the connection that it has now."""
        self._board = board
        self.connection = board.connection

    @property
    def url(self) -> str:
        """Its address."""
        return self._board.url

    @property
    def codec(self) -> Codec:
        """Byte order and caption encoding of the connection."""
        return self._board.codec

    async def request(self, packet: Request[R], *, exact: bool = False) -> R:
        """Return the answer to `packet`."""
        return await self._still().request(packet, exact=exact)

    async def write_project_id(self, project_id: int) -> None:
        """Write the project id."""
        await self._still().write_project_id(project_id)

    async def clear_all_data(self) -> None:
        """Delete everything."""
        await self._still().clear_all_data()

    def _still(self) -> Asked:
        if self._board.connection is not self.connection:
            raise ConnectionLost(
                f"the connection to {printable(self.url)} was lost and came back in the middle of this, perhaps to "
                "another board; do it again"
            )
        return self._board
