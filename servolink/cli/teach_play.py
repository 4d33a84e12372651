"""Play what was just taught, with servos that may have been limp before.

A servo that is started may turn to the last target that it had: the document leaves it open. So servos are held first
and started one by one, and one that turns by itself ends it.
"""

from __future__ import annotations

import argparse
import asyncio
from datetime import UTC, datetime

from msgspec.structs import replace

from servolink.cli.output import is_terminal, print_json, print_text
from servolink.cli.run import name_of_run, play, read_run, start_run
from servolink.cli.servos import are, reported
from servolink.cli.session import Interruption
from servolink.cli.terminal import can_ask, confirm
from servolink.client.board import Board
from servolink.client.servos import Servo
from servolink.doctor.learn_profile import Measured, merge_profile
from servolink.errors import RequestError
from servolink.profiles.profile import BoardIdentityRecord
from servolink.profiles.store import load_profile, save_profile
from servolink.project.teaching import PoseRecorder

_MOST_TURNED = 3  # degrees
_READINGS = 5
_PAUSE = 0.05  # seconds between readings of a servo that was started


async def play_lesson(board: Board, interruption: Interruption, args: argparse.Namespace, lesson: PoseRecorder) -> None:
    """Play what was taught to the board, if `args` say so or somebody agrees.

    Raise RequestError, with all servos stopped, if a servo turns when it is started.
    """
    interruption.state = f"'{args.name}' is on the board and was not played"
    found = await read_run(board, "macro" if len(lesson.poses) > 1 else "action", f"name:{args.name}")
    if not await _is_wanted(args, name_of_run(found)):
        return
    await start_run(board, found, dry_run=True)  # before servos are started
    limp = [servo for servo in await reported(board, found.servo_ids()) if not (servo.is_start and servo.is_hold)]
    started = [servo for servo in limp if servo.servo_id in found.servo_ids()]
    for servo in started:
        await _start_carefully(board, interruption, servo)
    if started:
        await _keep(board, "stays", f"{are([servo.servo_id for servo in started])} started, and none turned by that")
    await play(board, interruption, found, shown=not args.json and is_terminal())
    if args.json:
        print_json({"played": args.name, "duration_seconds": found.seconds()})
    else:
        print_text(f"{name_of_run(found)} was played")


async def _is_wanted(args: argparse.Namespace, name: str) -> bool:
    if args.play is not None:
        return bool(args.play)
    if args.yes or args.json or not can_ask():
        return False
    return await confirm(f"Play {name} now? Its servos move; Ctrl-C stops them.")


async def _start_carefully(board: Board, interruption: Interruption, servo: Servo) -> None:
    """Hold a servo, then start it. Raise RequestError, with all servos stopped, if it turns by that."""
    await board.set_servo(servo.servo_id, start=False, hold=True)
    before = await board.servo(servo.servo_id)
    interruption.state = f"{are([servo.servo_id])} started and may move; `servolink stop` stops all servos"
    await board.set_servo(servo.servo_id, start=True, hold=True)
    for _ in range(_READINGS):
        await asyncio.sleep(_PAUSE)
        now = await board.servo(servo.servo_id)
        if abs(now.angle - before.angle) > _MOST_TURNED:
            await board.stop()
            turned = (
                f"servo {servo.servo_id} turned by itself when it was started, from {before.angle}° to {now.angle}°"
            )
            await _keep(board, "turns", turned)
            raise RequestError(
                f"{turned}, perhaps to an old target: all servos are stopped and held, and nothing was played. "
                f"`servolink move {servo.servo_id}={now.angle} --start` starts it"
            )


async def _keep(board: Board, behaviour: str, evidence: str) -> None:
    """Keep in the profile of the board, if it has one, what its servos do when they are started.

    That none turned is likely to be so the next time; they may have had no other target.
    """
    if board.profile is None or board.profile.name is None:
        return
    measured = Measured("when_started", behaviour, "certain" if behaviour == "turns" else "likely", evidence)
    await asyncio.to_thread(_update, board.profile.name, measured)


def _update(name: str, measured: Measured) -> None:
    if (profile := load_profile(name)) is not None:  # again: the command took a while
        now = datetime.now(UTC).replace(microsecond=0)
        merged = merge_profile(profile, [measured], profile.identity or BoardIdentityRecord(), now)
        save_profile(name, replace(merged, identity=profile.identity))
