"""Limp servos during the recording of poses, and the keys and buttons that record poses."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from typing import Literal

from servolink.cli.screen.live import Draw, live_bars
from servolink.cli.screen.result import CommandResult, print_for_people, show
from servolink.cli.screen.terminal import single_keys
from servolink.client import Board, Servo
from servolink.errors import ConnectionLost, OutcomeUnknown, RequestTimeout
from servolink.project import PoseRecorder

_SILENCE_PAUSE = 0.2  # seconds before a board that does not answer is asked again


class ReleasedServos:
    """Releases servos and holds the servos again in place."""

    def __init__(self, board: Board, servos: Sequence[Servo]) -> None:
        """Remember the state of the `servos` before their release."""
        self._board = board
        self._servos = servos
        self.ids = [servo.servo_id for servo in servos]

    async def release(self) -> None:
        """Release the servos: all go limp."""
        for servo in self._servos:
            await self._board.release(servo.servo_id)

    async def hold(self) -> None:
        """Hold all servos first, then start the servos that were started before.

        A servo that is started while it is limp may turn to its last target; one that is held first stays.
        """
        for servo in self._servos:
            await self._board.set_servo(servo.servo_id, start=False, hold=True)
        for servo in self._servos:
            if servo.is_start:
                await self._board.set_servo(servo.servo_id, start=True, hold=True)

    async def hold_when_back(self) -> None:
        """Hold the servos as soon as the board responds, without a time limit."""
        while True:
            try:
                await self.hold()
            except ConnectionLost:
                await self._reconnected()
            except (OutcomeUnknown, RequestTimeout):
                await asyncio.sleep(_SILENCE_PAUSE)
            else:
                return

    async def _reconnected(self) -> None:
        async for state in self._board.states():
            if state == "connected":
                return


_PAUSE = 0.04  # seconds between two readings
_KEYS: dict[str, Wish] = {" ": "take", "\n": "take", "\r": "take", "u": "undo", "q": "end", "\x1b": "end"}
Wish = Literal["take", "undo", "end"]


class PoseTaken(CommandResult, frozen=True):
    """JSON of each pose of `teach`: number, degrees by servo id, and seconds to the pose."""

    pose: int
    degrees: dict[int, int]
    seconds: float


class PoseUndone(CommandResult, frozen=True):
    """JSON of each forgotten pose of `teach`, by number."""

    undone: int


class CaptureSession:
    """Records, forgets or ends as keys and buttons of the board ask."""

    def __init__(self, board: Board, lesson: PoseRecorder, servo_ids: frozenset[int], *, button: int | None) -> None:
        """Record poses of `servo_ids` at presses of `button`; None for any button."""
        self._board = board
        self._lesson = lesson
        self._servo_ids = servo_ids
        self._button = button
        self._wishes: deque[Wish] = deque()

    async def until(self, stop: asyncio.Event) -> None:
        """Record poses until somebody ends it or `stop` is set. Raise ConnectionLost if the board is gone."""
        listening = asyncio.create_task(self._listen())
        try:
            with single_keys(self._typed) as keyboard, live_bars(self._servo_ids) as draw:
                self._say_how(keyboard=keyboard)
                await self._follow(stop, draw)
        finally:
            listening.cancel()
            with suppress(asyncio.CancelledError, Exception):  # it fails as reading the servos does
                await listening

    async def _follow(self, stop: asyncio.Event, draw: Draw) -> None:
        loop = asyncio.get_running_loop()
        start = loop.time()
        while not stop.is_set():
            servos = await self._board.servos()
            draw(loop.time() - start, servos)
            while self._wishes:
                if self._is_end(self._wishes.popleft(), servos, loop.time()):
                    return
            await asyncio.sleep(_PAUSE)

    def _is_end(self, wish: Wish, servos: tuple[Servo, ...], now: float) -> bool:
        if wish == "take":
            degrees = {servo.servo_id: int(servo.angle) for servo in servos if servo.servo_id in self._servo_ids}
            pose = self._lesson.take(degrees, now)
            number = len(self._lesson.poses)
            angles = ", ".join(f"servo {servo_id} {angle}°" for servo_id, angle in pose.degrees.items())
            show(PoseTaken(number, pose.degrees, pose.seconds), f"pose {number}, {pose.seconds:g} s: {angles}")
        elif wish == "undo" and self._lesson.poses:
            self._lesson.undo()
            undone = len(self._lesson.poses) + 1
            show(PoseUndone(undone), f"pose {undone} is forgotten")
        return wish == "end"

    def _typed(self, text: str) -> None:
        # The code of an arrow key starts with Esc; Esc itself comes alone.
        keys = [text] if text.startswith("\x1b") else list(text)
        self._wishes.extend(_KEYS[key] for key in keys if key in _KEYS)

    async def _listen(self) -> None:
        async with self._board.button_events() as events:
            async for event in events:
                if self._button in (None, event.button_id):
                    # A long press starts as a press, which recorded a pose: remove the pose.
                    wishes: dict[str, list[Wish]] = {"press": ["take"], "long_press": ["undo", "end"]}
                    self._wishes.extend(wishes.get(event.kind, []))

    def _say_how(self, *, keyboard: bool) -> None:
        keys = "space, or " if keyboard else ""
        ends = "q, or " if keyboard else ""
        undoes = "; u forgets the last pose" if keyboard else ""
        which = "a button of the board" if self._button is None else f"button {self._button} of the board"
        print_for_people(f"{keys}{which} records a pose{undoes}; {ends}a long press ends")
