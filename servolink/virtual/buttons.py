"""Buttons of the board: presses, long presses and releases, and the macros started by buttons."""

from __future__ import annotations

from collections.abc import Callable

from msgspec import Struct

from servolink.protocol import TABLE, Button, ButtonEventResponse, Codec
from servolink.virtual.player import Player
from servolink.virtual.storage import Storage

LONG_PRESS_AFTER = 0.8
"""Shortest long press, in seconds."""


class _Held(Struct):
    """Button while pressed."""

    long_at: float
    long_macro: int = 0
    is_long: bool = False


class Buttons:
    """Converter of presses and releases into events and macros."""

    def __init__(self, storage: Storage, player: Player, codec: Codec, send: Callable[[bytes], None]) -> None:
        """Run the macros of the active table with `player`, and pass the frame of each event to `send`."""
        self._storage = storage
        self._player = player
        self._codec = codec
        self._send = send
        self._held: dict[int, _Held] = {}
        self.last: int | None = None
        """Id of the last pressed button; None before the first press."""

    @property
    def due(self) -> float | None:
        """Time of the next long press; None without a pressed button."""
        return min((held.long_at for held in self._held.values() if not held.is_long), default=None)

    @property
    def down(self) -> list[int]:
        """Ids of the pressed buttons."""
        return sorted(self._held)

    def press(self, button_id: int, now: float) -> None:
        """Press a button. No effect for an already pressed button."""
        if button_id in self._held:
            return
        self.last = button_id
        self._send_event(button_id, ButtonEventResponse.PRESS)
        self._held[button_id] = _Held(now + LONG_PRESS_AFTER)
        self._run(self._button(button_id).button_press_macro, now)

    def release(self, button_id: int, now: float) -> None:
        """Release a button. No effect for a button not pressed."""
        held = self._held.pop(button_id, None)
        if held is None:
            return
        self._send_event(button_id, ButtonEventResponse.UP)
        button = self._button(button_id)
        long_macro_runs = held.long_macro != 0 and self._player.macro_id == held.long_macro
        if long_macro_runs and button.uninterruptible:
            self._player.run_after(button.button_up_macro)
        else:
            self._run(button.button_up_macro, now)

    def reset(self) -> None:
        """Forget all pressed buttons, so that their release has no effect."""
        self._held.clear()

    def advance(self, now: float) -> None:
        """Report long presses up to the time `now`."""
        for button_id, held in self._held.items():
            if not held.is_long and held.long_at <= now:
                held.is_long = True
                self._send_event(button_id, ButtonEventResponse.LONG_PRESS)
                macro_id = self._button(button_id).button_long_press_macro
                if self._run(macro_id, held.long_at):
                    held.long_macro = macro_id

    def _send_event(self, button_id: int, event: int) -> None:
        self._send(self._codec.encode(ButtonEventResponse(button_id, event)))

    def _run(self, macro_id: int, now: float) -> bool:
        return macro_id != 0 and self._player.run_macro(macro_id, now)

    def _button(self, button_id: int) -> Button:
        """Return a button of the active table; for an unknown id, a button without macros."""
        request = self._storage.decode(TABLE, self._storage.active_table, self._codec)
        table = None if request is None else TABLE.record_in(request)
        buttons = () if table is None else table.buttons
        return next((button for button in buttons if button.button_id == button_id), Button(button_id))
