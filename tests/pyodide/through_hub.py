"""Moves servos through a hub of the same process, by packets and by JSON-RPC, and prints their angles as JSON."""

from __future__ import annotations

import json

import servolink
from tests.hub.control_program import shared
from tests.hub.local_transport import LocalTransport


async def main() -> None:
    async with shared() as here:
        async with servolink.connect(LocalTransport(here.hub)) as board:
            await board.move({1: 30}, duration=0.3, wait=True)
        async with here.program() as pad:
            await pad.call("move", targets={"2": -20}, duration=0.3, wait=True)
        print(json.dumps({servo.servo_id: servo.angle for servo in await here.states()}))
