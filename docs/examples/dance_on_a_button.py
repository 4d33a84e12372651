"""Dance when somebody presses button 1 of the remote control, and stop when somebody presses button 2."""

import asyncio
import sys

import servolink

BOARD = sys.argv[1] if sys.argv[1:] else "virtual://"
DANCE, STOP = 1, 2
POSES = ({1: 30, 2: -30}, {1: -30, 2: 30}, {1: 0, 2: 0})


async def dance(board: servolink.Board) -> None:
    """Go through all poses; `start` lets servos obey again that were stopped."""
    for pose in POSES:
        await board.move(pose, duration=0.5, wait=True, start=True)
    print("danced", flush=True)


async def main() -> None:
    """Dance in a task, so that the button that stops is heard meanwhile."""
    dancing: asyncio.Task[None] | None = None
    async with servolink.connect(BOARD) as board, board.button_events() as events:
        print("press a button", flush=True)
        async for event in events:
            if event.kind != "press":
                continue
            if event.button_id == DANCE and (dancing is None or dancing.done()):
                dancing = asyncio.create_task(dance(board))
            elif event.button_id == STOP:
                if dancing is not None:
                    dancing.cancel()
                await board.stop()
                print("stopped", flush=True)


servolink.run(main)
