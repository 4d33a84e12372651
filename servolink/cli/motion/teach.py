"""`servolink teach`: poses of limbs moved by hand, recorded into a project file or onto the board.

If anything fails, no pose is lost and the servos are held again.
"""

from __future__ import annotations

import argparse
import asyncio
import re
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from itertools import count
from pathlib import Path

from msgspec.structs import replace

from servolink.boards import BoardIdentityRecord, Measured, ProfileFile
from servolink.cli.arguments import SERVO_NAME, file_path, number, or_caption, whole_number
from servolink.cli.command import MOVE, Command, flag, option
from servolink.cli.command_session import Interruption, run_with_board
from servolink.cli.motion.move import check_can_release, chosen_servos, may_release
from servolink.cli.motion.run import name_of_run, play, read_run, start_run
from servolink.cli.motion.servo_output import are, listed, reported
from servolink.cli.motion.teach_session import CaptureSession, ReleasedServos
from servolink.cli.screen.output import counted, print_error
from servolink.cli.screen.result import CommandResult, Ending, Returned, show
from servolink.cli.screen.terminal import can_ask, confirm
from servolink.cli.usage import usage_error
from servolink.client import Board, Servo, button_id
from servolink.errors import ConnectionLost, ProjectError, RequestRefused, ServolinkError
from servolink.project import PoseRecorder, Project, build_project, extend_project, load_project, save_project
from servolink.protocol import Action, Macro
from servolink.support import ExitCode, Signals

_SPEED_CAP = 120.0


class PosesWritten(CommandResult, frozen=True):
    """JSON of `teach` after the recording; `written` is the file, "on the board", or null without a pose."""

    name: str
    poses: int
    written: str | None


class PosesPlayed(CommandResult, frozen=True):
    """JSON of `teach` after the poses were played."""

    played: str
    duration_seconds: float


@Command(
    "teach",
    MOVE,
    help="record poses of limbs that are moved by hand",
    examples=("teach Wave 1 2", "teach Nod --file robot.servolink.json --interval 0.5"),
    options=(
        option("name", "NAME", "caption of the action, or of the macro if there are several poses"),
        option("servos", "SERVO", "the servos to release, by id or caption (all)", SERVO_NAME, nargs="*", default=[]),
        option("--file", "FILE", "write into this project file, not to the board", file_path),
        option(
            "--button",
            "BUTTON",
            "the button that records poses (any): its id, or its caption in the active joystick table",
            or_caption(whole_number(0, 2**32 - 1)),
        ),
        option(
            "--interval",
            "S",
            "time to each pose, in place of the time it took",
            number(PoseRecorder.SHORTEST, PoseRecorder.LONGEST, "seconds"),
        ),
        option(
            "--speed-cap",
            "D",
            f"play no faster than this many degrees per second ({_SPEED_CAP:g})",
            number(1, 10_000, "degrees per second"),
            default=_SPEED_CAP,
        ),
        flag(
            "--play",
            "play from the board what was taught, starting its servos one by one (asks, but not with --yes)",
            action=argparse.BooleanOptionalAction,
        ),
        flag("--yes", "do not ask whether the servos may go limp"),
    ),
)
def run(args: argparse.Namespace) -> int:
    """Release the servos, record poses, hold the servos again and write the poses."""
    check_can_release(args)
    if args.play and args.file is not None:
        usage_error(args, "--play plays from the board; `servolink project play FILE NAME` plays from a file")

    async def talk(board: Board, interruption: Interruption) -> Ending:
        await _check_name(board, args.name, args.file)
        servo_ids = await chosen_servos(board, args.servos)
        button = None if args.button is None else await button_id(board, args.button)
        servos = await reported(board, servo_ids)
        if not await may_release(args, interruption, listed(servo_ids) if servo_ids else "all servos"):
            return ExitCode.FAILED
        if servo_ids:
            servos = tuple(servo for servo in servos if servo.servo_id in servo_ids)
        lesson = PoseRecorder(
            args.name,
            {servo.servo_id: int(servo.angle) for servo in servos},
            asyncio.get_running_loop().time(),
            speed_cap=args.speed_cap,
            seconds=args.interval,
        )
        ids = frozenset(servo.servo_id for servo in servos)
        session = CaptureSession(board, lesson, ids, button=button)
        if not await _record(session, ReleasedServos(board, servos), interruption):
            interruption.state += f"; {counted(len(lesson.poses), 'pose')} not written"
            interruption.report()
            return ExitCode.INTERRUPTED
        if not lesson.poses:
            none = PosesWritten(args.name, 0, None)
            return Returned(none, "no pose was recorded; nothing is written", ExitCode.FAILED)
        where, poses = await _write(board, lesson, args.file), len(lesson.poses)
        written = PosesWritten(args.name, poses, where)
        show(written, f"'{args.name}' with {counted(poses, 'pose')} is written: {where}")
        if args.file is None:
            await play_lesson(board, interruption, args, lesson)
        return ExitCode.OK

    return run_with_board(args, talk, reconnect=True)


async def _record(session: CaptureSession, released: ReleasedServos, interruption: Interruption) -> bool:
    """Record poses with limp servos and hold the servos again. Return False after an interruption."""
    interruption.state = f"{listed(released.ids)} may be limp; `servolink stop` holds all servos"
    lost = False
    with _stop_on_signal() as stop:
        try:
            await released.release()
            await session.until(stop)
        except ConnectionLost as error:
            lost = True
            _note(f"{error}; {listed(released.ids)} will be held as soon as the board is back, Ctrl-C twice gives up")
        finally:
            await released.hold_when_back()
        interruption.state = f"{are(released.ids)} held again"
        if lost:
            _note(f"the board is back, and {are(released.ids)} held")
        return not stop.is_set()


@contextmanager
def _stop_on_signal() -> Iterator[asyncio.Event]:
    """Yield an event set by the first Ctrl-C, in time to hold limp servos; a second Ctrl-C cancels the task."""
    stop, task = asyncio.Event(), asyncio.current_task()

    def interrupt() -> None:
        if stop.is_set() and task is not None:
            task.cancel()
        stop.set()

    with Signals.ENDING.handled(interrupt):
        yield stop


def _note(text: str) -> None:
    print_error(f"servolink: {text}")


async def _check_name(board: Board, name: str, file: Path | None) -> None:
    """Raise ProjectError if the poses could not be stored under `name`: before anything goes limp."""
    project = _in(file) if file is not None else await _outline(board)
    PoseRecorder.refuse_duplicate(project, name)
    build_project(Action.pose(f"{name} 99", {}), Macro.of(name))


async def _write(board: Board, lesson: PoseRecorder, file: Path | None) -> str:
    """Add the poses to the file, or to the board by an import, and return where they are.

    If that fails, write them to a file of their own and raise an error that names it.
    """
    try:
        if file is not None:
            save_project(file, _taught_to(_in(file), lesson))
            return str(file)
        await board.apply_project(_taught_to(await board.export_project(), lesson))
    except ServolinkError as error:
        kept = _free_file(lesson.caption)
        save_project(kept, build_project(lesson.record()))
        raise ProjectError(f"{error}. The poses are in {kept}; `servolink project merge` adds them") from error
    return "on the board"


def _taught_to(project: Project, lesson: PoseRecorder) -> Project:
    """Return `project` with the taught records. Raise ProjectError for a caption in use."""
    PoseRecorder.refuse_duplicate(project, lesson.caption)
    return extend_project(project, lesson.record())


def _in(file: Path) -> Project:
    return load_project(file) if file.exists() else Project()


async def _outline(board: Board) -> Project:
    """Return a project with the captions used on the board."""
    actions = [Action(entry.action_id, entry.action_caption) for entry in await board.actions()]
    macros = [Macro(entry.macro_id, entry.macro_caption) for entry in await board.macros()]
    return Project(actions=tuple(actions), macros=tuple(macros))


def _free_file(caption: str) -> Path:
    """Return the path of a new file in this folder."""
    name = re.sub(r"[^\w-]+", "_", caption).strip("_") or "lesson"
    names = (Path(f"{name}{f'-{number}' if number > 1 else ''}.servolink.json") for number in count(1))
    return next(path for path in names if not path.exists())


_MOST_TURNED = 3  # degrees
_READINGS = 5
_PAUSE = 0.05  # seconds between readings of a servo that was started


async def play_lesson(board: Board, interruption: Interruption, args: argparse.Namespace, lesson: PoseRecorder) -> None:
    """Play what was taught to the board, if `args` say so or somebody agrees.

    Raise RequestRefused, with all servos stopped, if a servo turns when it is started.
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
    await play(board, interruption, found)
    show(PosesPlayed(args.name, found.seconds()), f"{name_of_run(found)} was played")


async def _is_wanted(args: argparse.Namespace, name: str) -> bool:
    """Return whether to play the taught poses now, after asking on a terminal."""
    if args.play is not None:
        return bool(args.play)
    if args.yes or not can_ask():
        return False
    return await confirm(f"Play {name} now? Its servos move; Ctrl-C stops them.")


async def _start_carefully(board: Board, interruption: Interruption, servo: Servo) -> None:
    """Hold and then start a servo. Raise RequestRefused, with all servos stopped, if the servo turns on starting."""
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
            raise RequestRefused(
                f"{turned}, perhaps to an old target: all servos are stopped and held, and nothing was played. "
                f"`servolink move {servo.servo_id}={now.angle} --start` starts it"
            )


async def _keep(board: Board, behaviour: str, evidence: str) -> None:
    """Record the behaviour of started servos in the profile of the board, if present.

    That none turned is likely to be so the next time; they may have had no other target.
    """
    if board.profile is None or board.profile.name is None:
        return
    measured = Measured("when_started", behaviour, "certain" if behaviour == "turns" else "likely", evidence)
    await asyncio.to_thread(_update, board.profile.name, measured)


def _update(name: str, measured: Measured) -> None:
    if (profile := ProfileFile(name).load()) is not None:  # again: the command took a while
        now = datetime.now(UTC).replace(microsecond=0)
        merged = profile.merged([measured], profile.identity or BoardIdentityRecord(), now)
        ProfileFile(name).save(replace(merged, identity=profile.identity))
