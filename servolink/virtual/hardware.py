"""Hardware: what a virtual board consists of, without the hosts that talk to it.

It has no clock: every method that depends on time is passed seconds of any monotonic clock.
"""

from __future__ import annotations

from collections.abc import Callable
from random import Random

from servolink.protocol.codec import Codec
from servolink.virtual.buttons import Buttons
from servolink.virtual.kind import DEFAULT_KIND, BoardKind
from servolink.virtual.player import Player
from servolink.virtual.simulated_servo import SimulatedServo
from servolink.virtual.storage import Storage

MAX_SERVOS = 254
"""Ids are one byte; 0 means "no such servo" and 255 means all."""
NEW_PROTOCOL = 1
"""The transmission mode in which a board takes all requests (3.1.1)."""

_FULL = 1000.0  # battery, per mille
_STANDBY = _FULL / (10 * 3600)  # an idle board lasts ten hours
_PER_CHARGE = _FULL / (2000.0 * 3600)  # a current of 2000 raw ADC lasts an hour


class Hardware:
    """Servos, storage, buttons and battery, and the player that runs what is stored."""

    def __init__(
        self,
        servos: int,
        kind: BoardKind = DEFAULT_KIND,
        *,
        seed: int = 0,
        codec: Codec | None = None,
        send_event: Callable[[bytes], None] = lambda frame: None,
    ) -> None:
        """Switch on; frames of button events go to `send_event`. Raise ValueError for a value out of range."""
        if not 0 <= servos <= MAX_SERVOS:
            raise ValueError(f"servos must be 0..{MAX_SERVOS}, not {servos}")
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
        """The transmission mode."""
        self.battery = _FULL
        """Remaining charge, per mille."""
        self.powered = True
        """Whether the power is on."""
        self._buttons = Buttons(self.storage, self.player, self.codec, send_event)
        self._watchers: list[Callable[[], None]] = []
        self._now: float | None = None

    @property
    def buttons_down(self) -> list[int]:
        """The ids of the buttons that are down."""
        return self._buttons.down

    @property
    def button_pressed_last(self) -> int | None:
        """The id of the button that was pressed last; None if none was."""
        return self._buttons.last

    def press_button(self, button_id: int, now: float) -> None:
        """Press a button. No effect while the power is off."""
        self.advance(now)
        if self.powered:
            self._buttons.press(button_id, now)
        self.notify_watchers()

    def release_button(self, button_id: int, now: float) -> None:
        """Release a button; it was a long press if the button was down for 0.8 s."""
        self.advance(now)
        self._buttons.release(button_id, now)
        self.notify_watchers()

    def push_servo(self, servo_id: int, degree: float, now: float) -> None:
        """Turn a servo by hand to an angle in degrees. No effect if it is held or does not exist."""
        self.advance(now)
        if servo_id in self.servos:
            self.servos[servo_id].push(degree)
        self.notify_watchers()

    def advance(self, now: float) -> None:
        """Bring motions, macros, buttons and battery up to `now`; an earlier time than the last changes nothing."""
        while (due := self._due()) is not None and due <= now:
            self._advance_to(due, now)
        last = self._now
        if last is None or now > last:
            for servo in self.servos.values():
                servo.advance(now)
            self._drain(0.0 if last is None else now - last)
            self._now = now

    def next_due(self, now: float) -> float | None:
        """Return when `advance` must be called next, never before `now`; None if nothing is under way."""
        due = self._due()
        return None if due is None else max(due, now)

    def watch(self, changed: Callable[[], None]) -> None:
        """Call `changed` whenever a host or a person did something; `next_due` may then be another."""
        self._watchers.append(changed)

    def unwatch(self, changed: Callable[[], None]) -> None:
        """Undo `watch`."""
        self._watchers.remove(changed)

    def notify_watchers(self) -> None:
        """Call the watchers: something was done from outside."""
        for changed in list(self._watchers):
            changed()

    def switch(self, *, on: bool) -> None:
        """Switch the power on or off; without power everything that is not stored is lost."""
        self.powered = on
        if not on:
            self.player.stop()
            self._buttons.reset()
            self.mode = self.kind.mode
        for servo in self.servos.values():
            servo.switch(on=on)

    def _advance_to(self, due: float, now: float) -> None:
        """Carry out events of the time `due`, at most `now`."""
        self._buttons.advance(due)
        self.player.advance(due, now)

    def _due(self) -> float | None:
        return min((due for due in (self._buttons.due, self.player.due) if due is not None), default=None)

    def _drain(self, elapsed: float) -> None:
        drawn = sum(servo.take_charge() for servo in self.servos.values())
        self.battery = max(0.0, self.battery - elapsed * _STANDBY - drawn * _PER_CHARGE)
