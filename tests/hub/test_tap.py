"""The tap of a hub: who asked what, what became of it, and the bytes; it sends nothing and delays nobody.

Modules: servolink.hub.methods.feeds, servolink.hub.methods.tap_methods.
"""

from __future__ import annotations

import asyncio
import json
from typing import Any

from servolink.hub.engine.tap import HubTap
from servolink.hub.methods.feeds import TapFeed
from servolink.recorder import CommandDone, Event, Message, ProblemFound, Wire, decode
from tests.hub.control_program import RpcProgram, shared
from tests.hub.shared_world import MOVE, STOP, world


def heard(program: RpcProgram) -> list[Message]:
    """Return what a program has heard through its tap."""
    return [
        decode(item["channel"], json.dumps(item["message"]).encode())
        for frame in program.of("tap")
        for item in frame["items"]
    ]


def commands(messages: list[Message]) -> list[tuple[str, str, str]]:
    return [(each.who, each.packet, each.outcome) for each in messages if isinstance(each, CommandDone)]


async def test_it_names_who_asked_and_what_became_of_it() -> None:
    async with shared() as here, here.program("studio") as studio, here.program("recorder", "watch") as recorder:
        await recorder.call("tap.start")
        sent = here.hub.board.stats.frames_sent
        await asyncio.sleep(1)
        assert here.hub.board.stats.frames_sent == sent
        await studio.call("move", targets={"1": 60}, duration=0.1, wait=True)
        await studio.call("stop")
        await recorder.call("tap.stop")
        messages = heard(recorder)
        assert ("studio", "ExecuteActionRequest", "sent") in commands(messages)
        assert ("studio", "SetServoParameterRequest", "answered") in commands(messages)
        assert Event("lease", "taken", "studio", "session of studio") in messages
        moved = next(each for each in messages if isinstance(each, CommandDone) and "Action" in each.packet)
        assert moved.session == "session of studio"
        assert moved.fields["steps"] == [{"servo_id": 1, "degree": 60, "interval": 10}]
        wire = [each for each in messages if isinstance(each, Wire)]
        assert {each.direction for each in wire} == {"sent", "received"}
        assert here.hub.board.connection.taps.members == ()
        count = len(recorder.of("tap"))
        await studio.call("servos.list")
        await asyncio.sleep(1)
        assert len(recorder.of("tap")) == count


async def test_bytes_only() -> None:
    async with shared() as here, here.program("recorder", "watch") as recorder, here.program("studio") as studio:
        await recorder.call("tap.start", wire_only=True)
        sent = here.hub.board.stats.bytes_sent
        await studio.call("move", targets={"1": 60}, duration=0.1)
        await recorder.call("tap.stop")
        messages = heard(recorder)
        assert {type(each) for each in messages} == {Wire}
        size = sum(len(each.data) for each in messages if isinstance(each, Wire) and each.direction == "sent")
        assert size == here.hub.board.stats.bytes_sent - sent


async def test_a_refused_packet_has_the_reason() -> None:
    async with world() as here:
        messages: list[Message] = []
        tap = HubTap(here.hub, lambda _, message: messages.append(message))
        one, two = here.join("one"), here.join("two")
        await here.move(one)
        await here.move(two)
        two.send(STOP)
        await asyncio.sleep(0.5)
        tap.close()
        tap.close()
        assert commands(messages)[:2] == [
            ("one", "ExecuteActionRequest", "sent"),
            ("two", "ExecuteActionRequest", "refused"),
        ]
        refused = next(each for each in messages if isinstance(each, CommandDone) and each.outcome == "refused")
        assert refused.lease == "one"
        assert refused.reason
        assert ("two", "SetServoParameterRequest", "answered") in commands(messages)
        one.send(MOVE)
        count = len(messages)
        await asyncio.sleep(0.5)
        assert len(messages) == count


async def test_who_does_not_read_loses_telemetry_first_and_is_told() -> None:
    async with shared() as here:
        paused = True
        frames: list[Any] = []
        feed = TapFeed(here.hub, frames.append, lambda: paused)
        feed.start(wire_only=False)
        (tap,) = here.hub.board.connection.taps.members
        for _ in range(20_000):
            tap.received(bytes(1000))
        assert frames == []
        paused = False
        await asyncio.sleep(0.2)
        tap.received(b"again")
        feed.stop()
        messages = [item.message for frame in frames for item in frame.items]
        sizes = [
            sum(len(item.message.data) for item in frame.items if isinstance(item.message, Wire)) for frame in frames
        ]
        assert 6_000_000 < sum(sizes) < 9_000_000
        assert max(sizes) < 100_000
        (dropped,) = [each for each in messages if isinstance(each, ProblemFound)]
        assert dropped.channel == "/wire"
        assert dropped.count == 20_000 + 1 - sum(isinstance(each, Wire) for each in messages)
        assert "reads too slowly" in dropped.text
