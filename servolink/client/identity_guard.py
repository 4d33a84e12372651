"""IdentityGuard: protection of a board from motions and changes meant for another board."""

from __future__ import annotations

import asyncio
import logging
from contextlib import suppress

from servolink.boards import BoardIdentityRecord, ProfileInUse, identity_of
from servolink.connection import Connection
from servolink.errors import DecodeError, RequestTimeout, WrongBoard, escape
from servolink.motion import Ticket
from servolink.protocol import (
    Effect,
    Packet,
    Query,
    QueryMemorySizeRequest,
    QueryServoListRequest,
    SendDummyDataRequest,
    SetAngleUnitRequest,
    SubscribeButtonEventRequest,
    TransmissionModeSettingRequest,
)
from servolink.transports import PortIdentity

_HARMLESS = (
    Query,
    SendDummyDataRequest,
    SetAngleUnitRequest,  # needed for reading, too
    SubscribeButtonEventRequest,
    TransmissionModeSettingRequest,
)
"""What neither moves nor changes a board."""
_logger = logging.getLogger(__name__)


class IdentityGuard:
    """Gate against motions and changes of another board than the profile's."""

    def __init__(self, connection: Connection, profile: ProfileInUse) -> None:
        """Guard `connection`, whose board must fit `profile`."""
        self._connection = connection
        self._profile = profile
        self._expected = profile.profile.identity or BoardIdentityRecord()
        self._is_right = False
        self._checking = asyncio.Lock()

    async def prepare(self, packet: Packet, ticket: Ticket) -> None:
        """Check the board before `packet` is sent. Raise WrongBoard for another board."""
        if self.refusal(packet, ticket) and (difference := await self._check()):
            raise WrongBoard(f"{difference}: {type(packet).__name__} was not sent. {self._remedy}", packet)

    def refusal(self, packet: Packet, ticket: Ticket) -> WrongBoard | None:
        """Refuse motions and changes of an unchecked or wrong board, but never a release."""
        if self._is_right or packet.effect is Effect.GOES_LIMP or isinstance(packet, _HARMLESS):
            return None
        return WrongBoard(f"whether this is {self._name} is not known: {type(packet).__name__} was not sent", packet)

    async def refuse_another(self) -> None:
        """Raise WrongBoard for another board."""
        if difference := await self._check():
            raise WrongBoard(f"{difference}. {self._remedy}")

    async def warn(self) -> None:
        """Check the board at once, and log a warning for another board, which may be read all the same."""
        with suppress(RequestTimeout, DecodeError):  # asked again before a motion or change
            if difference := await self._check():
                _logger.warning("%s; it can be read, but neither moved nor changed", escape(difference))

    async def _check(self) -> str:
        """Return the difference from the profile, empty for the right board; concurrent callers share one check."""
        async with self._checking:
            difference = "" if self._is_right else await self._difference()
            self._is_right = not difference
        return difference

    async def _difference(self) -> str:
        """Return the difference from the profile, empty for the right board."""
        found = await self._found()
        if self._expected.fits(found):
            return ""
        expected, actual = _described(self._expected), _described(found)
        return f"{self._name} was learnt with {expected}; the board at {self._connection.transport.url} has {actual}"

    async def _found(self) -> BoardIdentityRecord:
        """Return the identity of the connected board, in the facts known of the expected board."""
        expected, unsupported = self._expected, self._connection.unsupported
        servo_ids, memory_total, port = None, None, PortIdentity()
        if expected.servo_ids is not None and "QueryServoList" not in unsupported:
            servo_ids = (await self._connection.request(QueryServoListRequest())).servo_id_list
        if expected.memory_total is not None and "QueryMemorySize" not in unsupported:
            memory_total = (await self._connection.request(QueryMemorySizeRequest())).total_size
        if (expected.vendor_id, expected.product_id, expected.serial_number) != (None, None, None):
            found = await asyncio.to_thread(identity_of, self._connection.transport.url)
            port = PortIdentity() if found is None else found
        return BoardIdentityRecord.of(
            servo_ids=servo_ids,
            memory_total=memory_total,
            vendor_id=port.vendor_id,
            product_id=port.product_id,
            serial_number=port.serial_number or None,
        )

    @property
    def _name(self) -> str:
        return self._profile.name or "the board of the profile"

    @property
    def _remedy(self) -> str:
        if self._profile.name is None:
            return "Connect to the right board, or with another profile"
        return (
            f"If it is the same robot, learn it again: servolink doctor {self._profile.name} --learn; else connect "
            "to the right one, or give this one a name of its own: servolink use"
        )


def _described(identity: BoardIdentityRecord) -> str:
    """Return the facts of an identity, such as `servos 1..16, memory total 65536`."""
    return ", ".join(map(" ".join, identity.facts())) or "unknown"
