"""All servos of a board: addressed together, or one by one where the board ignores the id of all servos (3.2)."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from servolink.client.session import Session
from servolink.connection.options import HUB_MARGIN
from servolink.errors import RequestTimeout, ServolinkError
from servolink.numeric import as_number
from servolink.protocol.servos import ALL_SERVOS, QueryServoListRequest, QueryServoRequest, ServoState

if TYPE_CHECKING:
    from servolink.client.captions import Targets


class AllServos:
    """Reads all servos, and finds out whether the board answers for all of them together.

    A board is separate if its profile has `QueryServo` among the unsupported queries, or if it lists servos and returns
    no state for all of them. A missing response counts only if two are missing in a row, and none came before: a line
    may be interrupted.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        profile = session.profile and session.profile.profile
        self.is_separate = profile is not None and "QueryServo" in (profile.settings.unsupported or ())
        """Whether each servo is addressed by itself."""
        identity = profile and profile.identity
        self._listed = (identity and identity.servo_ids) or ()
        self._has_answered = False
        self._unanswered = 0  # latest requests for all servos, until a response

    @property
    def separate_ids(self) -> tuple[int, ...]:
        """Ids of all servos as far as known on a board that is or may be separate, none on other boards."""
        return self._listed if self.is_separate or self._unanswered else ()

    async def ids(self, **options: Any) -> tuple[int, ...]:
        """Return the ids that address all servos: 255 (`ALL_SERVOS`), or the id of each on a separate board."""
        return await self._list(**options) if self.is_separate else (ALL_SERVOS,)

    async def id_of(self, servo: int | str) -> int:
        """Return the id of a servo, by id or caption, and 255 for `all`. See `captions` for the errors of a caption."""
        if not isinstance(servo, str):
            number: int = as_number(servo)
            return number
        from servolink.client.captions import servo_id  # late, as below: most programs give ids

        return await servo_id(self._session, servo)

    async def targets_by_id(self, targets: Targets) -> Mapping[int, float]:
        """Return `targets` by id, `all` as each servo. Raise EncodeError for a repeated servo."""
        if not isinstance(targets, Mapping) or not any(isinstance(servo, str) for servo in targets):
            return targets  # type: ignore[return-value]  # by id, or refused later
        from servolink.client.captions import servo_targets

        return await servo_targets(self._session, targets)

    async def finds_separate(self) -> bool:
        """Return whether the board answers for single servos only, after a request for all was not answered.

        Within the time that a program behind a hub waits longer than the hub, which may be the caller.
        """
        self._unanswered += 1
        with suppress(ServolinkError):
            await self.states(timeout=HUB_MARGIN / 2)
        return self.is_separate

    async def states(self, **options: Any) -> tuple[ServoState, ...]:
        """Return the states of all servos; `options` are those of `Connection.request`."""
        connection = self._session.connection
        if not self.is_separate:
            states: tuple[ServoState, ...] = ()
            try:
                states = (await connection.request(QueryServoRequest(ALL_SERVOS), **options)).servos
                self._unanswered = 0
            except RequestTimeout:
                if self._has_answered or not await self._list(**options):
                    raise
                self._unanswered += 1
            self._has_answered = self._has_answered or bool(states)
            if states or not await self._list(**options):
                return states
            self.is_separate = self._unanswered != 1  # answered without a state, or twice not at all
        found: list[ServoState] = []
        for servo_id in await self._list(**options):
            found += (await connection.request(QueryServoRequest(servo_id), **options)).servos
        return tuple(found)

    async def _list(self, **options: Any) -> tuple[int, ...]:
        self._listed = (await self._session.connection.request(QueryServoListRequest(), **options)).servo_id_list
        return self._listed
