"""Queries a virtual board on a line that loses bytes, and prints as JSON how often each servo has answered."""

from __future__ import annotations

import json
from collections import Counter

import servolink


async def main() -> None:
    answers = Counter[int]()
    async with servolink.connect("virtual://?servos=2&drop=0.01&seed=1") as board:
        for _ in range(50):
            answers.update(servo.servo_id for servo in await board.servos())
    print(json.dumps(answers))
