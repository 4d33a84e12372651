"""Hardware of a virtual board, without hosts.

Without a clock: methods take the present time as an argument, in seconds of any monotonic clock.
"""

from __future__ import annotations

from collections.abc import Callable
from random import Random
from typing import ClassVar

from servolink.protocol import Codec
from servolink.virtual.buttons import Buttons
from servolink.virtual.kind import BoardKind
from servolink.virtual.player import Player
from servolink.virtual.simulated_servo import SimulatedServo
from servolink.virtual.storage import Storage

NEW_PROTOCOL = 1
"""Transmission mode in which a board accepts all requests (3.1.1)."""

_FULL = 1000.0  # battery, per mille
_STANDBY = _FULL / (10 * 3600)  # an idle board lasts ten hours
_PER_CHARGE = _FULL / (2000.0 * 3600)  # a current of 2000 raw ADC lasts an hour


class Hardware:
    """Servos, storage, buttons, battery, and player of stored records."""

    MAX_SERVOS: ClassVar[int] = 254
    """Most servos of a board: ids are one byte, 0 means "no such servo", and 255 means all servos."""

    def __init__(
        self,
        servos: int,
        kind: BoardKind = BoardKind.DEFAULT,
        *,
        seed: int = 0,
        codec: Codec | None = None,
        send_event: Callable[[bytes], None] = lambda frame: None,
    ) -> None:
        """Switch on, and pass frames of button events to `send_event`. Raise ValueError for a value out of range."""
        if not 0 <= servos <= self.MAX_SERVOS:
            raise ValueError(f"servos must be 0..{self.MAX_SERVOS}, not {servos}")
        self._random = random = Random(seed)  # noqa: S311 - servos that differ a little, no secrets
        self.codec = codec or Codec()
        self.servos = {
            servo_id: SimulatedServo(servo_id, angle=float(random.randint(-10, 10)), friction=random.uniform(0.9, 1.1))
            for servo_id in range(1, servos + 1)
        }
        self.kind = kind
        self.storage = Storage(kind)
        self.player = Player(self.servos, self.storage, self.codec, kind.interval_unit)
        self.mode: int = kind.mode
        """Current transmission mode of the board, 0 or 1."""
        self.battery = _FULL
        """Remaining charge of the battery, per mille."""
        self.powered = True
        """Whether the power is switched on."""
        self._buttons = Buttons(self.storage, self.player, self.codec, send_event)
        self._watchers: list[Callable[[], None]] = []
        self._now: float | None = None

    @property
    def buttons_down(self) -> list[int]:
        """Ids of the pressed buttons."""
        return self._buttons.down

    @property
    def button_pressed_last(self) -> int | None:
        """Id of the last pressed button; None before the first press."""
        return self._buttons.last

    def press_button(self, button_id: int, now: float) -> None:
        """Press a button. No effect while the power is off."""
        self.advance(now)
        if self.powered:
            self._buttons.press(button_id, now)
        self.notify_watchers()

    def release_button(self, button_id: int, now: float) -> None:
        """Release a button; after 0.8 s the press counts as a long press."""
        self.advance(now)
        self._buttons.release(button_id, now)
        self.notify_watchers()

    def push_servo(self, servo_id: int, degree: float, now: float) -> None:
        """Turn a servo by hand to an angle in degrees. No effect for a held or missing servo."""
        self.advance(now)
        if servo_id in self.servos:
            self.servos[servo_id].push(degree)
        self.notify_watchers()

    def advance(self, now: float) -> None:
        """Advance motions, macros, buttons and battery to the time `now`. No effect for a time in the past."""
        while (due := self._due()) is not None and due <= now:
            self._advance_to(due, now)
        last = self._now
        if last is None or now > last:
            for servo in self.servos.values():
                servo.advance(now)
            self._drain(0.0 if last is None else now - last)
            self._now = now

    def next_due(self, now: float) -> float | None:
        """Return the time for the next call of `advance`, at least `now`; None if nothing will happen."""
        due = self._due()
        return None if due is None else max(due, now)

    def watch(self, changed: Callable[[], None]) -> None:
        """Call `changed` after each action of a host or a person: `next_due` may have changed."""
        self._watchers.append(changed)

    def unwatch(self, changed: Callable[[], None]) -> None:
        """Undo `watch`."""
        self._watchers.remove(changed)

    def notify_watchers(self) -> None:
        """Call all watchers after an action of a host or a person."""
        for changed in list(self._watchers):
            changed()

    def switch(self, *, on: bool) -> None:
        """Switch the power on or off; without power all state outside the storage is lost."""
        self.powered = on
        if not on:
            self.player.stop()
            self._buttons.reset()
            self.mode = self.kind.mode
        for servo in self.servos.values():
            servo.switch(on=on)

    def _advance_to(self, due: float, now: float) -> None:
        """Execute all events up to the time `due`, at most `now`."""
        self._buttons.advance(due)
        self.player.advance(due, now)

    def _due(self) -> float | None:
        return min((due for due in (self._buttons.due, self.player.due) if due is not None), default=None)

    def _drain(self, elapsed: float) -> None:
        drawn = sum(servo.take_charge() for servo in self.servos.values())
        self.battery = max(0.0, self.battery - elapsed * _STANDBY - drawn * _PER_CHARGE)
