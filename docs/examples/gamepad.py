"""Turn two servos with the left stick of a gamepad; its first button stops them and ends the program."""

import sys

import pygame  # pyright: ignore[reportMissingImports]

import servolink

BOARD = sys.argv[1] if sys.argv[1:] else "virtual://"
HZ = 50
FASTEST = 90  # degrees per second, with the stick at its end
WIDEST = 80  # degrees to each side
REST = 0.1  # part of its way in which a stick rests


def stick(pad: pygame.joystick.JoystickType, axis: int) -> float:
    """Return where a stick is: from -1 to 1, and 0 at rest."""
    value = pad.get_axis(axis)
    return value if abs(value) > REST else 0.0


async def main() -> None:
    """Send a set-point for each servo 50 times a second; `send` waits until the next is due."""
    pygame.init()
    if pygame.joystick.get_count() == 0:
        sys.exit("no gamepad is plugged in")
    pad = pygame.joystick.Joystick(0)
    async with servolink.connect(BOARD, angle_limits=(-WIDEST, WIDEST), speed_cap=FASTEST) as board:
        servos = (await board.servo_ids())[:2]
        targets = {servo: float((await board.servo(servo)).angle) for servo in servos}
        stream = board.stream(hz=HZ)
        while not pad.get_button(0):
            pygame.event.pump()
            for axis, servo in enumerate(servos):
                target = targets[servo] + stick(pad, axis) * FASTEST / HZ
                targets[servo] = max(-WIDEST, min(WIDEST, target))
            await stream.send(targets)
        await board.stop()
        print("stopped at", [int(servo.angle) for servo in await board.servos() if servo.servo_id in servos])


servolink.run(main)
