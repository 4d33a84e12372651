"""RawPackets: packets made by programs, kept within the same limits as the methods of a board."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from typing import Any, TypeVar

from servolink.client.board_servos import ServoController
from servolink.client.session import Session
from servolink.client.stored_runs import StoredRuns
from servolink.errors import EncodeError
from servolink.motion import Ticket
from servolink.protocol import (
    Command,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    Request,
    Response,
    SetAngleUnitRequest,
    SetServoParameterRequest,
)

R = TypeVar("R", bound=Response)


class RawPackets:
    """Sends any packet within the limits, and keeps the known state of the servos up to date."""

    def __init__(self, session: Session, servos: ServoController, runs: Callable[[], StoredRuns]) -> None:
        """Send through `session`; under limits, send movements through `servos` and the result of `runs`."""
        self._session = session
        self._servos = servos
        self._runs = runs
        self._limits = servos.planner.limits

    def request(
        self, packet: Request[R], *, timeout: float | None, unchecked: bool, ticket: Ticket | None
    ) -> Coroutine[Any, Any, R]:
        """Return a coroutine to send a request (see `Board.request`)."""
        # Queries without a time limit do not come here: `Board.request` sends them at once.
        if isinstance(packet, SetAngleUnitRequest):
            setting: Any = self._servos.units.request(packet, timeout=timeout, unchecked=unchecked)
            return setting  # type: ignore[no-any-return]
        request: Any = self._session.request
        if isinstance(packet, SetServoParameterRequest):
            request = self._servos.request
        elif self._limits and isinstance(packet, ExecuteMacroRequest):
            request = self._runs().request
        answer: Coroutine[Any, Any, R] = request(packet, timeout=timeout, unchecked=unchecked, ticket=ticket)
        return answer

    async def send(self, packet: Command, *, ticket: Ticket | None) -> None:
        """Send a packet without a response (see `Board.send`)."""
        if isinstance(packet, ExecuteActionRequest):
            _check_each_once(packet)
        if not self._limits or not isinstance(packet, ExecuteActionRequest | ExecuteActionExRequest):
            await self._session.send(packet, ticket=ticket)
            return
        self._session.codec.encode(packet)  # refuses invalid values before comparing them
        if isinstance(packet, ExecuteActionRequest):
            await self._servos.send(packet, ticket=ticket)
        else:
            await self._runs().run_action(packet.action_id, any_angle=True, ticket=ticket)


def _check_each_once(packet: ExecuteActionRequest) -> None:
    servo_ids = [step.servo_id for step in packet.steps]
    if twice := {servo_id for servo_id in servo_ids if servo_ids.count(servo_id) > 1}:
        raise EncodeError(f"ExecuteActionRequest.steps: servo {min(twice)} is there twice")
