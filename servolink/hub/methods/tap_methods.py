"""Methods of the control interface for recording: a tap, and the hub's own recorder."""

from __future__ import annotations

import asyncio

from servolink.control import Done, NoParams, Role, Tapping, Touches
from servolink.hub.method_messages import RecorderMark, RecorderStart, RecordingList, RecordingNow, TapStart
from servolink.hub.methods.methods import METHODS, Caller


@METHODS.add("tap.start", Role.WATCH, touches=Touches.SESSION)
def tap_start(caller: Caller, params: TapStart) -> Tapping:
    """Send the notification `tap` from now on, for everything that passes: bytes, requests, events and problems.

    Nothing is sent to the board for it. A program that does not read loses messages, is told how many, and delays
    nobody.
    """
    hub = caller.control.hub
    caller.tap.start(wire_only=params.wire_only)
    codec = hub.board.codec
    return Tapping(caller.tap.now(), codec.byte_order, codec.caption_encoding, hub.state)


@METHODS.add("tap.stop", Role.WATCH, touches=Touches.SESSION)
def tap_stop(caller: Caller, params: NoParams) -> Done:
    """Send the remaining notifications `tap`, and end the tap."""
    caller.tap.stop()
    return Done()


# --- the hub's own recorder -------------------------------------------------------------------------------------------


@METHODS.add("recorder.start", Role.RUN, touches=Touches.HOST)
async def recorder_start(caller: Caller, params: RecorderStart) -> RecordingNow:
    """Record everything that passes to a new file in a folder of the hub's user.

    It goes on when the program leaves, until anybody stops it, the hub ends, it has 1 GiB, or the disk is nearly full.
    RecordingError if something is being recorded already.
    """
    await caller.recorder.start(caller.control.who, hz=params.hz, wire_only=params.wire_only)
    return caller.recorder.now()


@METHODS.add("recorder.stop", Role.RUN, touches=Touches.HOST)
async def recorder_stop(caller: Caller, params: NoParams) -> RecordingNow:
    """End the recording and return its final state. RecordingError if nothing is being recorded."""
    await caller.recorder.stop(caller.control.who)
    return caller.recorder.now()


@METHODS.add("recorder.mark", Role.RUN, touches=Touches.HOST)
def recorder_mark(caller: Caller, params: RecorderMark) -> Done:
    """Put a mark into the recording, to find the moment again. RecordingError if nothing is being recorded."""
    caller.recorder.mark(params.text, caller.control.who)
    return Done()


@METHODS.add("recorder.status", Role.WATCH, touches=Touches.NOTHING)
def recorder_status(caller: Caller, params: NoParams) -> RecordingNow:
    """Return the state of the present or latest recording."""
    return caller.recorder.now()


@METHODS.add("recorder.list", Role.WATCH, touches=Touches.NOTHING)
async def recorder_list(caller: Caller, params: NoParams) -> RecordingList:
    """Return the recordings in the folder."""
    recorder = caller.recorder
    found = await asyncio.to_thread(recorder.stored)
    return RecordingList(str(recorder.folder()), tuple(found))
