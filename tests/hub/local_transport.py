"""LocalTransport: a program's session in the process of the hub, without a socket and in virtual time."""

from __future__ import annotations

import asyncio
from functools import partial

from servolink.control import Role
from servolink.errors import OpenError
from servolink.hub import FrameProgram, Hub
from servolink.motion import AngleUnit
from servolink.protocol import Codec
from servolink.transports import BaseTransport


class LocalTransport(BaseTransport):
    """Transport to the board of a hub; bytes have the order, limits and rights of any other program."""

    def __init__(
        self,
        hub: Hub,
        *,
        who: str = "this process",
        door: str = "local",
        role: Role = Role.EDIT,
        codec: Codec | None = None,
        unit: AngleUnit = "degree",
        session_id: str | None = None,
    ) -> None:
        """Join `hub` on opening, unless `join` comes first."""
        super().__init__(f"share://{hub.name}")
        self.program: FrameProgram | None = None
        """Session of the program; None before `join`."""
        self._join = partial(
            hub.join, self._receive, who=who, door=door, role=role, codec=codec, unit=unit, session_id=session_id
        )
        self._hub = hub
        self._pending: list[bytes] = []

    @property
    def board_url(self) -> str:
        """The address of the board behind the hub."""
        return self._hub.url

    def join(self) -> FrameProgram:
        """Begin the session and return the program. Raise OpenError if the id is in use."""
        if self.program is None:
            try:
                self.program = self._join()
            except ValueError as error:
                raise OpenError(f"{self.url}: {error}") from None
            self.program.on_end = lambda: self._lose(ConnectionError("the hub has ended"))
        return self.program

    async def _open(self) -> None:
        self.join()

    def _send(self, data: bytes) -> None:
        if data and self.program is not None:
            self.program.receive(data)

    async def _close(self) -> None:
        self._abort()

    def _abort(self) -> None:
        if self.program is not None:
            self.program.leave()

    def _receive(self, data: bytes) -> None:
        # Delivered later, never from within `send`, as by any transport.
        if not self._pending:
            asyncio.get_running_loop().call_soon(self._deliver_pending)
        self._pending.append(data)

    def _deliver_pending(self) -> None:
        chunk = b"".join(self._pending)
        self._pending.clear()
        self._deliver(chunk)
