"""Tried: motions that were tried on the twin of a robot, and what a person has let pass. No clock, no board."""

from __future__ import annotations

from collections import deque
from collections.abc import AsyncGenerator, Hashable, Mapping
from types import MappingProxyType
from typing import Literal, NamedTuple, Protocol, TypeAlias

from servolink.project import Project
from servolink.protocol import Action, Macro

Pose: TypeAlias = Mapping[int, float]
"""Degrees by servo id."""
Uncertain: TypeAlias = Literal["refuse", "ask", "pass"]
"""Choice for a motion whose outcome is uncertain: refuse it, refuse it and ask a person, or let it pass."""

NEAR = 3.0
"""Degrees by which each servo may be elsewhere than in the pose from which a motion was tried."""
ENVELOPE = 10.0
"""Degrees by which the set-points of a stream may leave those that were tried."""
PERMITTED = 30.0
"""Seconds for which a motion may pass once, after a person has said so."""

_MOST_POSES = 8  # for which the verdict about a record is kept
_MOST_POINTS = 64  # set-points of a stream that are kept


class TwinVerdict(Protocol):
    """Result of a check on a twin."""

    @property
    def verdict(self) -> str:
        """One of `stands`, `falls` and `uncertain`."""
        ...

    @property
    def text(self) -> str:
        """What happens, when, and at which servo, for people."""
        ...

    @property
    def basis(self) -> Mapping[str, str]:
        """Origin of `weight`, `strength`, `speed` and `lag`: `measured`, `written` or `assumed`."""
        ...


class MotionTwin(Protocol):
    """Twin of a robot, in a process of its own, on which motions are tried."""

    async def check_move(self, pose: Pose, targets: Pose, seconds: float) -> TwinVerdict:
        """Return the result for a movement from a pose. Raise TwinError if the twin cannot say."""
        ...

    def check_record(
        self, project: Project, record: Action | Macro, pose: Pose
    ) -> AsyncGenerator[TwinVerdict | bool, None]:
        """Yield True after each part of the work, and at last the result. Raise TwinError or ProjectError."""
        ...

    async def close(self) -> None:
        """End the process."""
        ...


class HubVerdict(NamedTuple):
    """Verdict that the hub itself has come to."""

    verdict: str
    text: str
    basis: Mapping[str, str] = MappingProxyType({})


class TriedMotions:
    """Verdicts about stored records, the set-points of streams, and permissions of a person."""

    def __init__(self) -> None:
        self._verdicts: dict[Hashable, deque[tuple[Pose, TwinVerdict]]] = {}
        self._streams: dict[str, tuple[object, deque[Pose]]] = {}
        self._permits: dict[str, tuple[Hashable, float]] = {}

    def verdict(self, record: Hashable, pose: Pose) -> TwinVerdict | None:
        """Return the verdict about a record, if it was tried from about this pose."""
        found = self._verdicts.get(record, ())
        return next((checked for tried, checked in found if is_near(tried, pose)), None)

    def add(self, record: Hashable, pose: Pose, checked: TwinVerdict) -> None:
        """Keep the verdict about a record."""
        self._verdicts.setdefault(record, deque(maxlen=_MOST_POSES)).appendleft((pose, checked))

    def forget_records(self) -> None:
        """Forget the verdicts about all records: they may have been changed."""
        self._verdicts.clear()

    def has_streamed(self, session: str, stream: object, point: Pose) -> bool:
        """Return whether the set-point of a stream lies within the envelope of those that were tried."""
        known, points = self._streams.get(session, (None, deque[Pose]()))
        return known is stream and any(is_near(tried, point, ENVELOPE) for tried in points)

    def add_point(self, session: str, stream: object, point: Pose) -> None:
        """Widen the envelope of the stream of a program, which has one at a time."""
        if session not in self._streams or self._streams[session][0] is not stream:
            self._streams[session] = stream, deque(maxlen=_MOST_POINTS)
        self._streams[session][1].append(point)

    def permit(self, session: str, motion: Hashable, now: float) -> None:
        """Let a motion of a program pass once, if it comes soon."""
        self._permits[session] = motion, now + PERMITTED

    def is_permitted(self, session: str, motion: Hashable, now: float, *, is_sent: bool) -> bool:
        """Return whether a person has let this motion pass, which holds until it is sent once."""
        permitted, until = self._permits.get(session, (None, 0.0))
        if permitted != motion or now > until:
            return False
        if is_sent:
            del self._permits[session]
        return True

    def left(self, session: str) -> None:
        """Forget a program that has left."""
        self._streams.pop(session, None)
        self._permits.pop(session, None)

    def void_permits(self) -> None:
        """Take back all permissions, as after a stop."""
        self._permits.clear()


def is_near(one: Pose, other: Pose, degrees: float = NEAR) -> bool:
    """Return whether the same servos are in both poses, and none farther apart than some degrees."""
    return one.keys() == other.keys() and all(abs(one[each] - other[each]) <= degrees for each in one)
