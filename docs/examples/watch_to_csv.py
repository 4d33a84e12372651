"""Write what all servos report, ten times a second, to a CSV file that spreadsheets open."""

import csv
import sys
from pathlib import Path

import servolink

BOARD = sys.argv[1] if sys.argv[1:] else "virtual://"
FILE = Path(sys.argv[2] if sys.argv[2:] else "servos.csv")
SECONDS = float(sys.argv[3]) if sys.argv[3:] else 5.0


def main() -> None:
    """Write a row for each servo and reading; current and temperature have no unit."""
    with servolink.sync.connect(BOARD) as board, FILE.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(["seconds", "servo", "angle", "state", "current_raw", "temperature_raw"])
        for reading in board.watch(hz=10).within(SECONDS):
            for servo in reading.servos:
                values = servo.servo_id, servo.angle, servo.state, servo.current, servo.temperature
                table.writerow([f"{reading.seconds:.3f}", *values])
    print(f"{FILE} is written")


servolink.run(main)
