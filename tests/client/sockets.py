"""A place where boards are plugged in, and out."""

from __future__ import annotations

from servolink.errors import OpenError
from servolink.transports import Receiver, WrappedTransport
from servolink.virtual import VirtualBoard, VirtualTransport


class Socket:
    """Where boards are plugged in: one at a time, or none."""

    def __init__(self, board: VirtualBoard) -> None:
        self.board: VirtualBoard | None = board
        self.opened = 0
        self.live: list[Cable] = []

    def transport(self, url: str) -> Cable:
        return Cable(self, url)

    def pull(self) -> None:
        """Pull the cable out of every program."""
        self.board = None
        for cable in list(self.live):
            cable.pull()

    def plug(self, board: VirtualBoard) -> None:
        self.board = board


class Cable(WrappedTransport):
    """A connection that ends when it is pulled."""

    def __init__(self, socket: Socket, url: str) -> None:
        super().__init__(VirtualTransport(socket.board or VirtualBoard(), url))
        self._socket = socket

    async def open(self, receiver: Receiver) -> None:
        self._socket.opened += 1
        if self._socket.board is None:
            raise OpenError("no board is plugged in")
        await super().open(receiver)
        self._socket.live.append(self)

    async def close(self) -> None:
        if self in self._socket.live:
            self._socket.live.remove(self)
        await super().close()

    def pull(self) -> None:
        self._break("it was unplugged")
