"""All servos of a board: addressed together, or one by one where the board ignores the id of all servos (3.2)."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import suppress
from typing import Any, TypeAlias

from servolink.client.captions import Targets, servo_targets
from servolink.client.captions import servo_id as one_servo_id
from servolink.client.session import Session
from servolink.connection import HUB_MARGIN
from servolink.errors import DecodeError, MotionRefused, Reason, RequestTimeout, ServolinkError
from servolink.motion import AngleUnit, Degrees, MotionLimits, idle_servos, missing_servo
from servolink.protocol import (
    ALL_SERVOS,
    QueryServoListRequest,
    QueryServoRequest,
    ServoState,
    SetServoParameterRequest,
)
from servolink.support import as_number

_UnitOf: TypeAlias = Callable[[int], AngleUnit | None]
_logger = logging.getLogger(__name__)


class KnownServos:
    """Ids and states of servos, collected from the responses of the board and from requests. Sends nothing.

    Cleared when the board is lost. The programs of a hub share one record.
    """

    def __init__(self, losses: Callable[[], int], learnt: Collection[int] = ()) -> None:
        """Forget everything when `losses` changes. `learnt` holds the ids in the board's profile."""
        self._losses = losses
        self._learnt = frozenset(learnt)
        self._forget()

    def _forget(self) -> None:
        """Start again without ids and states."""
        self._known_at = self._losses()
        self._listed: frozenset[int] | None = None
        self._unlisted: set[int] = set()  # answer under their own ids, and are in no list
        self._mute: set[int] = set()  # ids without a response of their own
        self._idle: dict[int, bool] = {}
        self._readings: dict[tuple[int, AngleUnit | None], tuple[int, str]] = {}  # latest angles, and doubts

    def _look(self) -> None:
        """Forget all ids and states if the board was lost."""
        if self._known_at != self._losses():
            self._forget()

    # --- ids of the servos ---------------------------------------------------------------------------------

    @property
    def listed(self) -> frozenset[int] | None:
        """Ids in the list of servos, or in the profile for a board without a readable list; None before it is read."""
        self._look()
        return self._listed

    @property
    def ids(self) -> frozenset[int]:
        """Ids of all servos known: listed, learnt or reported."""
        listed = self.listed
        return (self._learnt if listed is None else listed).union(self._unlisted)

    def take_list(self, servo_ids: Iterable[int] | None) -> frozenset[int]:
        """Take the list of servos, None for a board without a readable one. Return the ids to count by."""
        self._listed = self._learnt if servo_ids is None else frozenset(servo_ids) - {ALL_SERVOS}
        self._unlisted -= self._listed
        return self._listed

    def are_all(self, states: Collection[ServoState]) -> bool:
        """Return whether `states` holds one state of each servo."""
        return len(states) == len(ids := {state.servo_id for state in states}) and ids == self.ids

    def unsure(self, states: Collection[ServoState]) -> list[int]:
        """Return the ids that must be asked singly after a response about all servos.

        Those are left out, reported twice with different states, or reported and in no list.
        """
        ids = {state.servo_id for state in states}
        if not self.listed:
            self._unlisted |= ids  # nothing to count by
        asked = (ids ^ self.ids) - self._mute
        if len(states) > len(ids):
            different = [state.servo_id for state in set(states)]
            asked |= {servo_id for servo_id in ids if different.count(servo_id) > 1}
        return sorted(asked)

    def settle(self, servo_id: int, *, has_answered: bool) -> None:
        """Take the outcome of a question to a single servo."""
        if has_answered:
            self._mute.discard(servo_id)
            self._unlisted |= {servo_id} - self.ids
            return
        self._mute.add(servo_id)
        self._unlisted.discard(servo_id)
        if servo_id in self.ids:
            _logger.warning("servo %d is in the list of servos and reports nothing", servo_id)

    def accept(self, servo_ids: Iterable[int]) -> None:
        """Count servos as present on a board that can be asked neither for a list nor for states."""
        self._unlisted |= set(servo_ids)

    def doubt(self) -> None:
        """Ask servos without a response again, at the next reading."""
        self._mute.clear()

    # --- readings that cannot be true ------------------------------------------------------------------------

    def take_readings(self, readings: Mapping[int, tuple[int, str]], unit_of: _UnitOf) -> None:
        """Take angles and doubts by servo id, in the units of `unit_of`."""
        self._look()
        for servo_id, reading in readings.items():
            self._readings[servo_id, unit_of(servo_id)] = reading

    def lacks_reading(self, servo_ids: Iterable[int], unit_of: _UnitOf) -> bool:
        """Return whether a servo was not read in its unit since the board was connected."""
        self._look()
        return any((servo_id, unit_of(servo_id)) not in self._readings for servo_id in servo_ids)

    def doubtful(self, unit_of: _UnitOf) -> frozenset[int]:
        """Return the servos whose latest reading cannot be true, in the units of `unit_of`."""
        self._look()
        readings = self._readings.items()
        return frozenset(servo_id for (servo_id, unit), (_, doubt) in readings if doubt and unit == unit_of(servo_id))

    def check_readings(self, servo_ids: Iterable[int], unit_of: _UnitOf, limits: MotionLimits) -> None:
        """Raise MotionRefused for a servo whose latest reading cannot be true: where it would start is not known.

        A servo without a reading passes, and one of several turns, which has limits that say so.
        """
        self._look()
        for servo_id in servo_ids:
            angle, doubt = self._readings.get((servo_id, unit_of(servo_id)), (0, ""))
            is_beyond = isinstance(angle, Degrees) and angle.is_beyond
            if is_beyond and max(map(abs, limits.of(servo_id) or (0,))) < abs(angle):
                raise MotionRefused(
                    f"servo {servo_id} reports {angle}°, beyond 360: the board has confirmed degrees and may report "
                    "raw ADC readings; use --adc (angle_unit='adc'), or for a servo of several turns --any-angle "
                    "(any_angle=True)",
                    reason=Reason.ANGLE_UNIT,
                )
            if doubt and not is_beyond:
                raise MotionRefused(
                    f"servo {servo_id} reports values that cannot be true ({doubt}), so where it would start is not "
                    "known; nothing was sent. Run `servolink doctor`, or move it all the same with --any-angle "
                    "(any_angle=True)"
                )

    # --- servos that ignore movements -------------------------------------------------------------------------

    def read(self, states: Iterable[ServoState]) -> None:
        """Take a reading of some servos."""
        self._look()
        self._idle |= {state.servo_id: not (state.is_start and state.is_hold) for state in states}

    def has_reported(self, servo_id: int) -> bool:
        """Return whether a state of the servo was read since the board was connected."""
        self._look()
        return servo_id in self._idle

    def set(self, servo_id: int, *, is_idle: bool) -> None:
        """Take that a servo, or all for 255, was stopped or released, or started and held."""
        self._look()
        if servo_id == ALL_SERVOS:
            self._idle.clear()
        self._idle[servo_id] = is_idle

    def idle(self, servo_ids: Iterable[int]) -> list[int]:
        """Return the servos that are stopped or released, as far as known."""
        self._look()
        known = self._idle
        if not any(known.values()):
            return []
        return [servo_id for servo_id in servo_ids if known.get(servo_id, known.get(ALL_SERVOS, False))]


class AllServos:
    """Reads all servos, and finds out whether the board answers for all of them together.

    A reading is counted by ids, against the list of servos (3.2.1): what the response for all leaves out, repeats with
    another state or adds is asked singly. The list is read once for a connection, and again before such a question.

    A board is separate if its profile has `QueryServo` among the unsupported queries, or if two responses in a row are
    missing or leave out listed servos that report when asked singly. That counts only where the line loses nothing
    beside them, and a missing response only if none came before: a line may be bad or interrupted. On such a line
    no servo vanishes: a list that cannot be read changes nothing, and a reading without any known servo is an error.
    """

    def __init__(self, session: Session, known: KnownServos | None = None) -> None:
        """Ask through `session`; `known` is shared by the boards of a hub."""
        self._session = session
        profile = session.profile and session.profile.profile
        self.is_separate = profile is not None and "QueryServo" in (profile.settings.unsupported or ())
        """Whether each servo is addressed by itself."""
        identity = profile and profile.identity
        self.known = known or KnownServos(lambda: session.losses, (identity and identity.servo_ids) or ())
        self._has_answered = False
        self._incomplete = 0  # latest requests for all servos on a good line, until a response for all
        self._is_in_doubt = False  # whether the latest request for all servos was not answered for all
        self._unlisted = 0  # requests for the list without a response
        self._stops = 0  # counted when the servos were read for a movement

    @property
    def separate_ids(self) -> tuple[int, ...]:
        """Ids of all servos as far as known on a board that is or may be separate, none on other boards."""
        return tuple(sorted(self.known.ids)) if self.is_separate or self._is_in_doubt else ()

    async def ids(self, **options: Any) -> tuple[int, ...]:
        """Return the ids that address all servos: 255 (`ALL_SERVOS`), or the id of each on a separate board."""
        return tuple(sorted(await self.listed(again=True, **options))) if self.is_separate else (ALL_SERVOS,)

    async def id_of(self, servo: int | str) -> int:
        """Return the id of a servo, by id or caption, and 255 for `all`. See `captions` for the errors of a caption."""
        if not isinstance(servo, str):
            number: int = as_number(servo)
            return number

        return await one_servo_id(self._session, servo)

    async def targets_by_id(self, targets: Targets) -> Mapping[int, float]:
        """Return `targets` by id, `all` as each servo. Raise EncodeError for a repeated servo."""
        if not isinstance(targets, Mapping) or not any(isinstance(servo, str) for servo in targets):
            return targets  # type: ignore[return-value]  # by id, or refused later

        return await servo_targets(self._session, targets)

    async def finds_separate(self) -> bool:
        """Return whether the board answers for single servos only, after a request for all was not answered.

        Within the time that a program behind a hub waits longer than the hub, which may be the caller.
        """
        self._incomplete, self._is_in_doubt = self._incomplete + 1, True
        with suppress(ServolinkError):
            await self.states(timeout=HUB_MARGIN / 2)
        return self.is_separate

    async def listed(self, *, again: bool = False, **options: Any) -> frozenset[int]:
        """Return the ids to count by: those in the list of servos, or in the profile for a board without a list."""
        listed = self.known.listed
        if listed is not None and not again:
            return listed
        found = await self._read_list(**options)
        if self.is_separate and listed and found is not None and not found:
            raise DecodeError(f"the list of servos is empty, and held {sorted(listed)} before")
        return self.known.take_list(found)

    async def require(self, servo_ids: Iterable[int]) -> None:
        """Raise NotFound for a servo that the board neither lists nor reports.

        Asks the board for the first list of a connection, and before a refusal: a servo may have been plugged in.
        """
        wanted = set(servo_ids)
        if wanted <= self.known.ids:
            return
        is_read = self.known.listed is not None
        if wanted <= await self.listed() or (is_read and wanted <= await self.listed(again=True)):
            return
        try:
            await self.states()
        except (RequestTimeout, DecodeError):
            if not self.known.listed:
                self.known.accept(wanted)
        if missing := wanted - self.known.ids:
            raise missing_servo(min(missing))

    async def ready(self, servo_ids: Collection[int], *, start: bool = False) -> list[int]:
        """Return the servos that must be started and held before a movement, none unless `start`.

        Raise NotFound for a servo that is not there, RequestRefused for one that is stopped or released. Asks the board
        as `require` does, and for the states after a stop, which may be that of another program.
        """
        await self.require(servo_ids)
        stops = self._session.connection.stops.count  # those of other programs of a hub, too
        if stops != self._stops or self.known.idle(servo_ids):
            await self.states()  # for servos started or stopped by another program
            self._stops = stops
        idle = self.known.idle(servo_ids)
        if idle and not start:
            raise idle_servos(idle)
        return idle

    async def is_set(self, request: SetServoParameterRequest) -> bool:
        """Return whether a servo, or each servo for 255, reports the state that `request` asks for."""
        states = await self.states(request.servo_id)
        flags = (request.is_start, request.is_hold)
        are_set = {state.servo_id for state in states if (state.is_start, state.is_hold) == flags}
        return bool(are_set) and are_set >= (self.known.ids if request.servo_id == ALL_SERVOS else {request.servo_id})

    async def states(self, servo_id: int = ALL_SERVOS, **options: Any) -> tuple[ServoState, ...]:
        """Return the state of a servo, or of all servos for 255; `options` are those of `Connection.request`."""
        states = await (self._all_states(**options) if servo_id == ALL_SERVOS else self._single(servo_id, **options))
        self.known.read(states)
        return states

    async def _single(self, servo_id: int, **options: Any) -> tuple[ServoState, ...]:
        """Return the state in the response for one servo, none for a missing servo."""
        return (await self._session.connection.request(QueryServoRequest(servo_id), **options)).servos

    async def _all_states(self, **options: Any) -> tuple[ServoState, ...]:
        """Return one state for each servo, counted against the list of servos."""
        is_read, had, damage = self.known.listed is not None, self.known.ids, self._damage
        strays = self._session.stats.unsolicited
        together = () if self.is_separate else await self._together(**options)
        await self.listed(again=self.is_separate, **options)
        if together and self.known.are_all(together):
            self._incomplete, self._is_in_doubt = 0, False
            return together
        states, retries = together or (), self._session.stats.retries
        unsure = self.known.unsure(states)
        if unsure and is_read and not self.is_separate:
            await self.listed(again=True, **options)
            unsure = self.known.unsure(states)
        self._is_in_doubt = together is None or not {state.servo_id for state in states}.issuperset(unsure)
        found = await self._with_singles(states, unsure, **options)
        ids = self.known.ids or (had if together is None else frozenset())
        if ids and not found:
            raise DecodeError(f"no servo reports, where {sorted(ids)} are known")
        if not self.is_separate and self._damage == damage:
            is_whole = self._session.stats.retries == retries
            self._count(states, found, is_whole=is_whole, strays=self._session.stats.unsolicited - strays)
        return found

    @property
    def _damage(self) -> int:
        """Number of damaged bytes and responses. When it grows, responses may be lost too."""
        return self._session.stats.noise + self._session.stats.undecodable

    async def _together(self, **options: Any) -> tuple[ServoState, ...] | None:
        """Return the states in the response for all servos; None if the board ignores the request."""
        strays = self._session.stats.unsolicited
        try:
            states = (await self._session.connection.request(QueryServoRequest(ALL_SERVOS), **options)).servos
        except RequestTimeout:
            # Several frames, one for each servo, may have come in place of the response.
            has_strays = self._session.stats.unsolicited > strays
            if (self._has_answered and not has_strays) or not await self.listed(**options):
                raise
            return None
        self._has_answered = self._has_answered or bool(states)
        return states

    def _count(
        self, together: Collection[ServoState], found: Collection[ServoState], *, is_whole: bool, strays: int
    ) -> None:
        """Find out from a response for all servos and the states found in the end whether the board is separate.

        Unless the reading `is_whole`, without repeats, a servo may be left out by chance. Stray responses, as many as
        the servos left out, are their states: frames of their own, and no copies.
        """
        left_out = {state.servo_id for state in found} - {state.servo_id for state in together}
        left_out &= self.known.listed or frozenset()
        if is_whole:
            self._incomplete = self._incomplete + 1 if left_out else 0
        self.is_separate = self._incomplete > 1 or 0 < len(left_out) <= strays

    async def _with_singles(
        self, states: tuple[ServoState, ...], unsure: Iterable[int], **options: Any
    ) -> tuple[ServoState, ...]:
        """Return a state for each servo that is there, in the order of ids; `unsure` servos are asked singly."""
        found, damage = {state.servo_id: state for state in states}, self._damage
        for servo_id in unsure:
            found.pop(servo_id, None)
            states_of: tuple[ServoState, ...] = ()
            try:
                states_of = await self._single(servo_id, **options)
            except (RequestTimeout, DecodeError):
                if not states:
                    raise
                if "first" in options:  # the stop is not confirmed, and is sent again the sooner
                    break
                if self._damage != damage or self.known.has_reported(servo_id):
                    raise  # it may be lost on the line
            found |= {state.servo_id: state for state in states_of if state.servo_id == servo_id}
            self.known.settle(servo_id, has_answered=servo_id in found)
        return tuple(found[servo_id] for servo_id in sorted(found.keys() & self.known.ids))

    async def _read_list(self, **options: Any) -> tuple[int, ...] | None:
        """Return the list of servos, as known if it cannot be read now; None from a board without a readable one."""
        if QueryServoListRequest().short_name in self._session.unanswered:
            return None
        try:
            return (await self._session.connection.request(QueryServoListRequest(), **options)).servo_id_list
        except DecodeError:
            return tuple(self.known.listed) if self.known.listed else None
        except RequestTimeout as error:
            if self.known.listed:
                return tuple(self.known.listed)
            self._unlisted += 1
            if "timeout" in options and self._unlisted == 1:  # of a stop: shorter than the patience, and repeated
                raise
            await self._session.note_unanswered(QueryServoListRequest(), error)
            return None
