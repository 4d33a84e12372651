"""TrimSession: servos that are nudged, what has been nudged so far, and the corrections that it amounts to."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence

from msgspec.structs import replace

from servolink.cli.arguments import MOST_TRIM
from servolink.cli.output import Table
from servolink.client.board import Board
from servolink.client.servos import Servo
from servolink.errors import EncodeError, ProjectError
from servolink.protocol.records import ServoParameter

SPEED = 30.0
"""Degrees per second of a nudge."""


class TrimSession:
    """Nudges servos on a board, one after the other, and adds the nudges up.

    The document does not say how a stored correction acts on the angle of a servo. So this moves the servo by each
    nudge, from the angle that it reported at first, and the correction to store is the old one and all nudges.
    """

    def __init__(self, board: Board, servos: Sequence[Servo], stored: Mapping[int, ServoParameter]) -> None:
        """Start with the first of `servos` selected and nothing nudged; `stored` are the corrections so far."""
        self._board = board
        self._start = {servo.servo_id: int(servo.angle) for servo in servos}
        self._old = {servo_id: stored.get(servo_id, ServoParameter(servo_id)) for servo_id in self._start}
        self._ids = [*self._start]
        self._at = 0
        self._nudges: list[tuple[int, int]] = []  # servo id and degrees, the last one last

    @property
    def selected(self) -> int:
        """The id of the servo that keys nudge."""
        return self._ids[self._at]

    def select(self, step: int) -> None:
        """Select the servo that is `step` further down, from the last on to the first."""
        self._at = (self._at + step) % len(self._ids)

    def nudged(self) -> dict[int, int]:
        """Return the degrees by which servos were nudged, by servo id, without those that are where they were."""
        sums = dict.fromkeys(self._ids, 0)
        for servo_id, degrees in self._nudges:
            sums[servo_id] += degrees
        return {servo_id: degrees for servo_id, degrees in sums.items() if degrees}

    def corrections(self) -> dict[int, int]:
        """Return the corrections to store, by servo id: of the servos that were nudged."""
        return {servo_id: self._old[servo_id].adjusted_degree + degrees for servo_id, degrees in self.nudged().items()}

    def changes(self) -> dict[int, Callable[[ServoParameter], ServoParameter]]:
        """Return, by servo id, what is to be made of the parameters on the board, for `change_parameters`.

        They raise ProjectError if the board holds another correction than at the start.
        """

        def changed(one: ServoParameter) -> ServoParameter:
            old = self._old[one.servo_id].adjusted_degree
            if one.adjusted_degree != old:
                raise ProjectError(
                    f"servo {one.servo_id} had a correction of {old}° at first, and now has {one.adjusted_degree}°; "
                    "no correction was stored; try again"
                )
            return replace(one, adjusted_degree=corrections[one.servo_id])

        corrections = self.corrections()
        return dict.fromkeys(corrections, changed)

    def check(self, servo_id: int, degrees: int) -> int:
        """Return the target of a nudge. Raise EncodeError if the correction would be too large to store."""
        nudged = self.nudged().get(servo_id, 0) + degrees
        correction = self._old[servo_id].adjusted_degree + nudged
        if not -MOST_TRIM <= correction <= MOST_TRIM:
            raise EncodeError(
                f"servo {servo_id}: its correction would be {correction} degrees; it must be from -{MOST_TRIM} to "
                f"{MOST_TRIM}"
            )
        return self._start[servo_id] + nudged

    async def nudge(self, servo_id: int, degrees: int) -> None:
        """Move a servo by `degrees`, and count it. Raise EncodeError, or MotionRefused, if it must not move there."""
        target = self.check(servo_id, degrees)
        self._nudges.append((servo_id, degrees))  # before the movement: if it is interrupted, it may have been sent
        try:
            await self._board.move({servo_id: target}, speed=SPEED)
        except EncodeError:
            self._nudges.pop()
            raise

    async def undo(self) -> int | None:
        """Take the last nudge back, select its servo and return its id. Return None if there is no nudge."""
        if not self._nudges:
            return None
        servo_id, degrees = self._nudges[-1]
        target = self._start[servo_id] + self.nudged().get(servo_id, 0) - degrees
        await self._board.move({servo_id: target}, speed=SPEED)
        self._nudges.pop()
        self._at = self._ids.index(servo_id)
        return servo_id

    def described(self) -> str:
        """Return which servos were moved, such as `servo 3 was moved by +4°`; they may still be on their way."""
        moved = [f"servo {servo_id} was moved by {degrees:+}°" for servo_id, degrees in self.nudged().items()]
        return ", ".join(moved) or "no servo was moved"

    def table(self, servos: Sequence[Servo], rows: int, *, without: Collection[str] = ()) -> Table:
        """Return what `servos` report now, nudges and corrections: at most `rows` lines around the selected servo.

        The columns `without` are left out.
        """
        angles = {servo.servo_id: servo.angle for servo in servos}
        first = max(0, min(self._at - rows // 2, len(self._ids) - rows))
        corrections, nudged = self.corrections(), self.nudged()
        lines = [
            (
                ">" if servo_id == self.selected else "",
                servo_id,
                self._old[servo_id].servo_caption,
                angles.get(servo_id),
                f"{nudged[servo_id]:+}°" if servo_id in nudged else "",
                _change(self._old[servo_id].adjusted_degree, corrections.get(servo_id)),
            )
            for servo_id in self._ids[first : first + rows]
        ]
        columns = ("", "servo", "caption", "angle", "nudged", "correction")
        shown = [at for at, column in enumerate(columns) if column not in without]
        return Table([columns[at] for at in shown], [[line[at] for at in shown] for line in lines])


def _change(old: int, new: int | None) -> str:
    return f"{old}°" if new is None or new == old else f"{old}° -> {new}°"
