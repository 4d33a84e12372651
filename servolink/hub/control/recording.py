"""The methods of the control interface for who records: a tap, and the hub's own recorder."""

from __future__ import annotations

from servolink.hub.control.messages import Done, NoParams, Tapping, TapStart
from servolink.hub.control.methods import METHODS, Caller
from servolink.hub.roles import Role


@METHODS.add("tap.start", Role.WATCH)
def tap_start(caller: Caller, params: TapStart) -> Tapping:
    """Send the notification `tap` from now on, for everything that passes: bytes, requests, events and problems.

    Nothing is sent to the board for it. A program that does not read loses messages, is told how many, and delays
    nobody.
    """
    hub = caller.control.hub
    caller.tap.start(wire_only=params.wire_only)
    codec = hub.board.codec
    return Tapping(caller.tap.now(), codec.byte_order, codec.caption_encoding, hub.state)


@METHODS.add("tap.stop", Role.WATCH)
def tap_stop(caller: Caller, params: NoParams) -> Done:
    """Send what is left of the notifications `tap`, and no more."""
    caller.tap.stop()
    return Done()
