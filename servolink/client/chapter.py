"""What the commands of each chapter share."""

from __future__ import annotations

from typing import TypeVar

from servolink.client.arguments import check_count, check_timeout
from servolink.client.explain import described
from servolink.client.identity import Identity
from servolink.client.link import Link
from servolink.errors import EncodeError, Rejected
from servolink.printable import printable
from servolink.protocol.codec import Codec
from servolink.protocol.packet import Command, Request, Response, Result
from servolink.protocol.servos import ExecuteActionRequest

R = TypeVar("R", bound=Response)


class Chapter:
    """Commands to one board."""

    def __init__(self, link: Link) -> None:
        """Speak through `link`."""
        self._link = link
        self._identity = Identity()

    @property
    def url(self) -> str:
        """The address of the board."""
        return self._link.transport.url

    @property
    def codec(self) -> Codec:
        """Byte order and caption encoding of this connection."""
        return self._link.codec

    @property
    def connection(self) -> object:
        """What stands for the connection: another object once it was lost and has come back."""
        return self._link

    async def request(
        self, packet: Request[R], *, timeout: float | None = None, retries: int | None = None, exact: bool = False
    ) -> R:
        """Send any packet that is answered and return its answer, whatever that says.

        `exact` gives back to a board what was read from one: captions may then hold control characters, numbers all
        that the wire carries.

        Raises EncodeError before anything is sent; RequestTimeout after the retries of a query; OutcomeUnknown
        when a command that changes something was sent and not answered; ConnectionLost.
        """
        if not isinstance(packet, Request):
            raise TypeError(f"{type(packet).__name__} is never answered; use send")
        if timeout is not None:
            check_timeout(timeout)
        if retries is not None:
            check_count("retries", retries, 0)
        return await self._link.request(packet, timeout=timeout, retries=retries, exact=exact)

    async def send(self, packet: Command) -> None:
        """Send any packet that is never answered; EncodeError also for the same servo twice in one movement."""
        if not isinstance(packet, Command):
            raise TypeError(f"{type(packet).__name__} is answered; use request")
        if isinstance(packet, ExecuteActionRequest):
            servo_ids = [step.servo_id for step in packet.steps]
            if twice := {servo_id for servo_id in servo_ids if servo_ids.count(servo_id) > 1}:
                raise EncodeError(f"ExecuteActionRequest.steps: servo {min(twice)} is in it twice")
        await self._link.send(packet)

    async def _do(self, packet: Request[Result], reasons: str) -> None:
        """Send a command and raise Rejected, with the likely `reasons`, if the board says it failed."""
        if not (await self._link.request(packet)).result:
            raise Rejected(f"{printable(self.url)} refused {described(packet)}: {reasons}", packet)
