"""AngleUnits: in which unit the angles of each servo are sent and reported (3.2.4)."""

from __future__ import annotations

import asyncio

from servolink.client.all_servos import AllServos
from servolink.client.session import Session
from servolink.connection import PacketConnection, timed_out
from servolink.errors import EncodeError, OutcomeUnknown, Rejected, quote
from servolink.motion import AngleUnit, ServoUnits, is_accepted, unit_request
from servolink.protocol import ALL_SERVOS, SetAngleUnitRequest, SetAngleUnitResponse
from servolink.support import check_seconds


class AngleUnits:
    """Tracks the unit of each servo, and sets the one that the program asked for.

    A board keeps its units when the program ends, and a query does not say in which unit it is answered. So the unit
    of all servos is set before the first command with an angle. An angle that was computed or read before a unit was
    sent (`Connection.units_sent`) must not be used after it.
    """

    def __init__(
        self,
        session: Session,
        all_servos: AllServos,
        angle_unit: AngleUnit | None,
        current: ServoUnits | None = None,
    ) -> None:
        """Set all servos to `angle_unit` before the first command with an angle; None leaves them as they are.

        `current` is what a hub sets for its program; None for a board without a hub.
        """
        self.current = ServoUnits() if current is None else current
        """Units that are set on the board, also after a reconnect."""
        self._session = session
        self._all = all_servos
        self._chosen: AngleUnit | None = angle_unit  # for all servos, whenever their common unit is not known
        self._setting = asyncio.Lock()
        session.restore_with(self._restore)

    @property
    def is_changing(self) -> bool:
        """Whether a unit is being set, so that `of` may be outdated in a moment."""
        return self._setting.locked()

    def of(self, servo_id: int) -> AngleUnit | None:
        """Return the unit of a servo, None if it is unknown."""
        return self.current.of(servo_id) or self._chosen

    @property
    def _is_set(self) -> bool:
        return self._chosen is None or self.current.common is not None

    async def set(self, unit: AngleUnit, servo: int | str = ALL_SERVOS) -> None:
        """Set the unit of a servo (255: all). Raise Rejected if the board refuses."""
        if unit not in ("degree", "adc"):
            raise EncodeError(f"unit must be 'degree' or 'adc', not {quote(unit)}")
        servo_id = await self._all.id_of(servo)
        async with self._setting:
            if servo_id != ALL_SERVOS:
                await self._set_first()  # or a later command would set all servos over this one
            await self._set_checked(unit_request(servo_id, unit))

    async def ensure(self) -> None:
        """Wait until units are known: for a change under way, and for the first one of this session."""
        if self._is_set and not self._setting.locked():
            return
        async with self._setting:
            await self._set_first()

    async def _set_first(self) -> None:
        """Set the unit of all servos unless it is known to be set. The caller holds the lock."""
        if not self._is_set and self._chosen is not None:
            await self._set_checked(unit_request(ALL_SERVOS, self._chosen))

    async def _set_checked(self, request: SetAngleUnitRequest) -> None:
        _check_response(request, await self._set(request))

    async def answer_to(self, request: SetAngleUnitRequest) -> SetAngleUnitResponse:
        """Set a unit as `set` does, and return the response, whatever it says."""
        async with self._setting:
            return await self._set(request)

    async def _set(self, request: SetAngleUnitRequest) -> SetAngleUnitResponse:
        """Set a unit: for each servo if the board ignores the request for all. The caller holds the lock.

        Return the response; the refusal of a single servo if there is one.
        """
        if request.servo_id != ALL_SERVOS or not self._all.is_separate:
            try:
                return await self._sent(request, unchecked=True)
            except OutcomeUnknown:
                if request.servo_id != ALL_SERVOS or not await self._all.finds_separate():
                    raise
        for servo_id in await self._all.ids():
            single = SetAngleUnitRequest(servo_id, request.unit_type)
            response = await self._sent(single, unchecked=True)
            if not is_accepted(single, response):
                return response
        self.current.set(request)
        return SetAngleUnitResponse(ALL_SERVOS, request.unit_type)

    async def request(
        self, packet: SetAngleUnitRequest, *, timeout: float | None = None, unchecked: bool = False
    ) -> SetAngleUnitResponse:
        """Send a packet that sets a unit, and return the response, whatever it says (see `Board.request`)."""
        begun_at = await self._acquire(packet, timeout)
        try:
            return await self._sent(packet, timeout=timeout, unchecked=unchecked, begun_at=begun_at)
        finally:
            self._setting.release()

    async def _acquire(self, packet: SetAngleUnitRequest, timeout: float | None) -> float | None:
        """Take the lock, and return from when `timeout` counts. Raise RequestTimeout if it is not free in this time."""
        if timeout is None:
            await self._setting.acquire()
            return None
        check_seconds("timeout", timeout)
        begun_at = asyncio.get_running_loop().time()
        try:
            async with asyncio.timeout(timeout):
                await self._setting.acquire()
        except TimeoutError:
            raise timed_out(packet, self._session.url, 0, timeout, self._session.stats) from None
        return begun_at

    async def _sent(
        self,
        packet: SetAngleUnitRequest,
        *,
        timeout: float | None = None,
        unchecked: bool = False,
        begun_at: float | None = None,
    ) -> SetAngleUnitResponse:
        connection = self._session.connection
        sent = connection.units_sent
        try:
            response = await connection.request(packet, timeout=timeout, unchecked=unchecked, begun_at=begun_at)
        except BaseException:
            # Sent, and the response is missing: the board may be in either unit. Forget what is known, so that all
            # servos are set again before the next angle.
            if connection.units_sent != sent:
                self.current.forget()
            raise
        if is_accepted(packet, response):
            self.current.set(packet)
            self._chosen = self.current.common or self._chosen
        return response

    async def _restore(self, connection: PacketConnection) -> None:
        """Set the same units on a new connection: the board may have been switched off and on."""
        for request in ServoUnits().needed(self.current):
            is_for_each = request.servo_id == ALL_SERVOS and self._all.is_separate
            for servo_id in self._all.separate_ids if is_for_each else (request.servo_id,):
                single = SetAngleUnitRequest(servo_id, request.unit_type)
                _check_response(single, await connection.request(single))


def _check_response(request: SetAngleUnitRequest, response: SetAngleUnitResponse) -> None:
    """Raise Rejected if the board reports another servo or unit than it was asked for."""
    if not is_accepted(request, response):
        is_adc = response == SetAngleUnitResponse(request.servo_id, 1)
        advice = "; its angles are raw ADC, as with `--adc` or angle_unit='adc'" if is_adc else ""
        raise Rejected(
            f"servo {request.servo_id} was asked for angle unit {request.unit_type}; the board answered "
            f"servo {response.servo_id}, unit {response.unit_type}{advice}",
            request,
        )
