"""Moves the servos of a virtual board, and prints their angles as JSON."""

from __future__ import annotations

import json

import servolink


async def main() -> None:
    async with servolink.connect("virtual://?servos=2") as board:
        await board.move({1: 30, 2: -20}, duration=0.3, wait=True)
        servos = await board.servos()
        print(json.dumps({servo.servo_id: servo.angle for servo in servos}))
