"""Readings of servos as messages, and the resulting alarms."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Sequence
from typing import TypeAlias, cast

from servolink.client import Alarm, AlarmWatch, Board, Servo
from servolink.errors import ServolinkError
from servolink.motion import Angle, AngleUnit
from servolink.recorder.channels import Event, Message, ProblemFound, RecordedServo, ServosRead

Take: TypeAlias = Callable[[float, Message], None]
"""Takes a message with its time: seconds on the clock of the event loop. Neither waits nor raises."""

_PAUSE = 1.0  # seconds until a board without a reading is asked again


class ReadingsFeed:
    """Passes on readings and alarms of the servos."""

    def __init__(self, take: Take, hz: float, alarms: Iterable[Alarm] = ()) -> None:
        """Pass messages on to `take`. Raise TypeError for anything but an alarm in `alarms`."""
        self.hz = hz
        """Readings to request per second; 0 requests none."""
        self._take = take
        self._alarms = AlarmWatch(alarms)
        self._told = ""

    def read(self, seconds: float, servos: Sequence[Servo], missed: int = 0) -> None:
        """Pass on a reading, and the resulting alarms."""
        self._take(seconds, ServosRead(tuple(map(_state, servos)), missed))
        for raised in self._alarms.check(servos, seconds):
            self._take(seconds, Event("alarm", str(raised)))

    def failed(self, error: Exception) -> None:
        """Pass on the reason for missing readings, once for each reason."""
        if str(error) != self._told:
            self._told = str(error)
            text = f"the servos cannot be read: {self._told}"[:500]
            self._take(asyncio.get_running_loop().time(), ProblemFound("servos", text))

    async def follow(self, board: Board) -> None:
        """Pass on the readings of a board; after a missing answer, ask the board again."""
        while True:
            try:
                async with board.watch(self.hz) as watch:
                    async for reading in watch:
                        self.read(reading.seconds, reading.servos, reading.missed)
            except ServolinkError as error:
                if board.connection.ended is not None:
                    return
                self.failed(error)
                await asyncio.sleep(_PAUSE)
            else:
                return


def _state(servo: Servo) -> RecordedServo:
    unit = cast("AngleUnit", servo.angle.unit) if isinstance(servo.angle, Angle) else ""
    return RecordedServo(
        servo.servo_id,
        int(servo.angle),
        unit,
        servo.current,
        servo.temperature,
        servo.servo_type,
        servo.is_start,
        servo.is_hold,
        doubt=servo.doubt,
    )
