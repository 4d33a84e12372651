"""Move two boards together; if one of them fails, both stop."""

import asyncio
import sys

import servolink

BOARDS = sys.argv[1:3] if sys.argv[2:] else ["virtual://", "virtual://"]


async def main() -> None:
    """Begin each movement on both boards at once, and wait until both are there."""
    async with servolink.connect(BOARDS[0]) as left, servolink.connect(BOARDS[1]) as right:
        try:
            for angle in (40, -40, 0):
                async with asyncio.TaskGroup() as both:
                    for board in (left, right):
                        both.create_task(board.move({1: angle}, duration=0.5, wait=True))
                print("both are at", angle)
        except BaseException:
            await asyncio.gather(left.stop(), right.stop(), return_exceptions=True)
            raise


servolink.run(main)
