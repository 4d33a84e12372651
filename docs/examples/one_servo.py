"""Turn the first servo there and back, and print where it is."""

import sys

import servolink

BOARD = sys.argv[1] if sys.argv[1:] else "virtual://"


def main() -> None:
    """Move at 60 degrees per second, and wait each time until the servo is there."""
    with servolink.sync.connect(BOARD) as board:
        first = board.servo_ids()[0]
        for angle in (30, 0):
            board.move({first: angle}, speed=60, wait=True)
            print(f"servo {first} is at {board.servo(first).angle} degrees")


servolink.run(main)
