"""`servolink project play`: play an action or a macro on a robot, or as a chart of its movements."""

from __future__ import annotations

import argparse
import asyncio
import shutil
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from contextlib import asynccontextmanager, contextmanager
from typing import Any, Self

from msgspec import UNSET, Struct, UnsetType

from servolink.cli.arguments import not_empty
from servolink.cli.command import Command, flag, group, option
from servolink.cli.command_session import Interruption, run_interruptible, run_with_board
from servolink.cli.motion.move import ANY_ANGLE, DEFAULT_SPEED, LIMITS, limits_of
from servolink.cli.motion.run import stopped_by_interruption
from servolink.cli.motion.servo_output import are, listed
from servolink.cli.projects.source import SOURCE, is_address, with_project
from servolink.cli.screen.live import draws_progress, live_bars, redrawn
from servolink.cli.screen.output import Table, console, is_terminal, plain_lines, print_error, text_width
from servolink.cli.screen.result import CommandResult, Ending, Part, Returned
from servolink.cli.screen.terminal import cleanup, single_keys
from servolink.cli.usage import named_board, usage_error
from servolink.client import Board, Playback, Servo
from servolink.errors import ProjectError
from servolink.project import Project, name_of
from servolink.protocol import ACTION, MACRO, Action, Macro, RecordType, ServoState
from servolink.support import ExitCode
from servolink.virtual import DryMove, DryRun, Timeline

_PLAYED = (ACTION, MACRO)
_PAUSE = 0.04  # seconds between two drawings


@Command(
    "project play",
    help="play an action or a macro: as a chart of its movements, or on a robot without storing it there",
    examples=(
        "project play robot.servolink.json Bow --fast",
        "project play robot.servolink.json Bow --board virtual://?servos=20",
    ),
    options=(
        *SOURCE,
        option("record", "NAME", "an action or a macro: caption, id, or as in macro:3"),
        flag("--fast", "print the chart at once, without the bars that move in real time"),
        group(
            "on a real robot",
            option(
                "-b --board --url",
                "BOARD",
                "play on this board, step by step, and store nothing there; a virtual one is played on without it",
                not_empty,
                dest="on_board",
            ),
            flag("--start", "start and hold servos that are stopped or released"),
            ANY_ANGLE,
        ),
        *LIMITS,
    ),
    takes_board=False,
)
def run(args: argparse.Namespace) -> Ending:
    """Play the record on a board, or else as a dry run, in which all servos start at 0 degrees."""
    if is_address(args.source) and not args.source.startswith("virtual:"):
        usage_error(args, "play reads a file; export the project of the board first, and play the file")
    if board := _board(args):
        args.url = board
        return with_project(args, lambda project: play_on_board(args, project, project.find(args.record, _PLAYED)))
    if args.start or args.any_angle or args.limit or args.speed_cap or args.soft_start:
        options = "--start, --any-angle, --limit, --speed-cap and --soft-start"
        usage_error(args, f"{options} are for a robot: name it with --board")
    with_bars = is_terminal() and not args.fast
    return with_project(args, lambda project: _play(args, project, with_bars=with_bars))


def _board(args: argparse.Namespace) -> str | None:
    """Return the board that the command line names.

    One in the environment does not count: what is meant to be a dry run must not move a robot.
    """
    named: str | None = args.on_board
    return named_board(args) if named is None else named


def _play(args: argparse.Namespace, project: Project, *, with_bars: bool) -> Ending:
    record = project.find(args.record, _PLAYED)
    try:
        timeline = _dry_run(project).play(record)
    except ProjectError as error:
        raise ProjectError(f"{name_of(record)}: {error}; `servolink project check` explains it") from error
    if with_bars:
        code = run_interruptible(
            lambda interruption: _show(_dry_run(project), record, timeline), "only a virtual board was moved"
        )
        if code != ExitCode.OK:
            return code
    return Returned(_chart(record, timeline), _text(project, record, timeline))


def _dry_run(project: Project) -> DryRun:
    project.by_type()  # refuses duplicate ids: the board would play either record
    servo_ids = {step.servo_id for action in project.actions for step in action.steps}
    servo_ids |= {one.servo_id for one in project.servo_parameters}
    return DryRun(project.actions, project.macros, sorted(servo_ids))


async def _show(dry_run: DryRun, record: Action | Macro, timeline: Timeline) -> int:
    """Draw the servos as they move, in real time."""
    loop = asyncio.get_running_loop()
    moved = {move.servo_id for move in timeline.moves}
    dry_run.begin(record)
    start, elapsed = loop.time(), 0.0
    with live_bars(moved) as draw:
        while elapsed < timeline.seconds:
            await asyncio.sleep(_PAUSE)
            elapsed = min(loop.time() - start, timeline.seconds)
            dry_run.hardware.advance(elapsed)
            states = [servo.state() for servo in dry_run.hardware.servos.values()]
            draw(elapsed, [_servo(state) for state in states])
    return ExitCode.OK


def _servo(state: ServoState) -> Servo:
    reported = (state.servo_id, state.angle, state.current, state.temperature, state.servo_type)
    return Servo(*reported, is_start=bool(state.is_start), is_hold=bool(state.is_hold))


def _text(project: Project, record: Action | Macro, timeline: Timeline) -> Iterator[Part]:
    captions = {servo_id: one.servo_caption for servo_id, one in project.by_servo().items()}
    whole = "" if timeline.is_whole else "; the chart shows only the beginning"
    yield f"{name_of(record)} takes {timeline.seconds:g} s{whole}", "bold"
    if not timeline.moves:
        yield "no servo moves"
        return
    yield from ("", *chart(timeline, captions, shutil.get_terminal_size((100, 24)).columns), "")
    moved = sorted({move.servo_id for move in timeline.moves})
    rows = [(servo_id, captions.get(servo_id, ""), round(timeline.angles[servo_id])) for servo_id in moved]
    yield Table(("servo", "", "at the end"), rows)


class ChartedMove(Struct, frozen=True):
    """Movement of a servo; `is_cut` if the next one or the end comes before its target."""

    servo_id: int
    start_seconds: float
    end_seconds: float
    from_degree: int
    target_degree: int
    is_cut: bool


class ChartedServo(Struct, frozen=True):
    """Angle of a servo at the end."""

    servo_id: int
    degree: int


class RecordPlayed(CommandResult, frozen=True, kw_only=True):
    """JSON of `project play`: a chart, or with --board the servos that have arrived."""

    kind: str
    id: int
    caption: str
    duration_seconds: float
    is_whole: bool | UnsetType = UNSET
    moves: list[ChartedMove] | UnsetType = UNSET
    angles: list[ChartedServo] | UnsetType = UNSET
    servo_ids: list[int] | UnsetType = UNSET
    arrived: bool | UnsetType = UNSET

    @classmethod
    def of(cls, record: Action | Macro, seconds: float, **more: Any) -> Self:
        """Return the result of playing `record` in `seconds`."""
        kind = RecordType.of(record)
        number, caption = kind.id_of(record), kind.caption_of(record)
        return cls(kind=kind.label, id=number, caption=caption, duration_seconds=seconds, **more)


def _chart(record: Action | Macro, timeline: Timeline) -> RecordPlayed:
    moves = [
        ChartedMove(one.servo_id, round(one.start, 3), round(one.end, 3), round(one.from_angle), one.target, one.is_cut)
        for one in timeline.moves
    ]
    angles = [ChartedServo(servo_id, round(angle)) for servo_id, angle in sorted(timeline.angles.items())]
    return RecordPlayed.of(record, round(timeline.seconds, 3), is_whole=timeline.is_whole, moves=moves, angles=angles)


_NARROWEST, _WIDEST = 20, 1000
_BETWEEN_TICKS = 8
"""The least columns between two labels of the axis."""
_STEPS = (1, 2, 5)


def chart(timeline: Timeline, captions: Mapping[int, str], width: int) -> list[str]:
    """Return the lines of a chart about `width` columns wide.

    `[60===]` is a movement to 60 degrees, `[60==>` one cut short by the next or by the end, `|` one too short to draw.
    """
    moved = sorted({move.servo_id for move in timeline.moves})
    rows = {servo_id: (servo_id, captions.get(servo_id, "")) for servo_id in moved}
    labels = plain_lines(Table(("servo", ""), list(rows.values())))
    columns = min(_WIDEST, max(_NARROWEST, width - max(map(text_width, labels)) - 2))
    scale = (columns - 1) / max(timeline.seconds, 0.01)
    bars = {servo_id: [" "] * columns for servo_id in rows}
    for move in timeline.moves:
        _draw(bars[move.servo_id], move, scale)
    table = [(*row, "".join(bars[servo_id])) for servo_id, row in rows.items()]
    return plain_lines(Table(("servo", "", _axis(timeline.seconds, scale, columns)), table))


def _draw(row: list[str], move: DryMove, scale: float) -> None:
    start, end = round(move.start * scale), min(round(move.end * scale), len(row))
    size = end - start
    if size < 2:
        row[start] = "|"
        return
    label = str(move.target)
    inside = label.ljust(size - 2, "=") if len(label) <= size - 2 else "=" * (size - 2)
    row[start:end] = f"[{inside}{'>' if move.is_cut or end == len(row) else ']'}"


def _axis(seconds: float, scale: float, columns: int) -> str:
    """Return `0 s     0.5     1`, with labels where they belong."""
    steps = (step * 10.0**power for power in range(-3, 10) for step in _STEPS)
    tick = next(step for step in steps if step * scale >= _BETWEEN_TICKS)
    axis = [" "] * columns
    count = int(seconds / tick + 1e-9)
    for number in range(count + 1):
        label = f"{number * tick:g}" + (" s" if number == 0 else "")
        at = min(round(number * tick * scale), columns - len(label))
        axis[at : at + len(label)] = label
    return "".join(axis)


HELP = "space pauses and continues; q, Esc or Ctrl-C stops the servos"
_END = ("q", "\x1b")


def play_on_board(args: argparse.Namespace, project: Project, record: Action | Macro) -> int:
    """Play `record` on the board of `args`. The first movement is slow, unless `args` sets the speed."""
    kind = RecordType.of(record)
    name, chosen = name_of(record), f"{kind.label}:{kind.id_of(record)}"
    servo_ids = sorted(project.servos_used(record))
    args.soft_start = args.soft_start or DEFAULT_SPEED

    async def talk(board: Board, interruption: Interruption) -> Returned:
        allowed = {"start": args.start, "any_angle": args.any_angle}
        seconds = await board.play(project, chosen, dry_run=True, **allowed)
        moved = listed(servo_ids) if servo_ids else "no servo"
        print_error(f"servolink: {name} takes {seconds:g} s and moves {moved}; it is not stored on the board")
        playback = Playback()
        interruption.state = f"{name} may have been begun; `servolink stop` stops the servos"
        stopping = stopped_by_interruption(board, interruption, f"{name} was begun", f"{name} was ended")
        async with stopping, _drawn(playback):
            with _keys(playback):
                await board.play(project, chosen, playback=playback, **allowed)
        interruption.state = f"{name} is over"
        text = f"{name} is over" + (f": {are(servo_ids)} at rest" if servo_ids else "")
        return Returned(RecordPlayed.of(record, seconds, servo_ids=servo_ids, arrived=True), text)

    return run_with_board(args, talk, **limits_of(args))


@contextmanager
def _keys(playback: Playback) -> Iterator[None]:
    """Pause, continue and end with keys, if standard input is a terminal."""
    task = asyncio.current_task()
    assert task is not None  # noqa: S101 - narrows the type: this runs in one
    typed = key_handler(playback, task.cancel)
    with single_keys(typed) as there:
        if there:
            print_error(HELP)
        yield


def key_handler(playback: Playback, end: Callable[[], object]) -> Callable[[str], None]:
    """Return a function for typed keys that calls `end` for a key that stops the servos."""

    def typed(text: str) -> None:
        # The code of an arrow key starts with Esc; Esc itself comes alone.
        for key in [text] if text.startswith("\x1b") else text:
            if key in _END:
                end()
                return
            if key == " ":
                (playback.resume if playback.is_paused else playback.pause)()

    return typed


@asynccontextmanager
async def _drawn(playback: Playback) -> AsyncIterator[None]:
    """Show the progress on standard error, if standard error is a terminal."""
    if not draws_progress():
        yield
        return
    from rich.progress import BarColumn, Progress, TextColumn

    displayed = console(stderr=True)
    columns = TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed:.1f} of {task.total:.1f} s")
    with cleanup(displayed.show_cursor), Progress(*columns, console=displayed, auto_refresh=False) as bar:
        shown = bar.add_task("", total=0.0)

        def draw() -> None:
            seconds, total = playback.seconds, playback.total_seconds
            bar.update(shown, description=state_of(playback), completed=seconds, total=total, refresh=True)

        try:
            async with redrawn(draw, _PAUSE):
                yield
        finally:
            draw()


def state_of(playback: Playback) -> str:
    """Return what is played now, such as `paused`. A pause has no effect on the last step."""
    if not playback.total_seconds:
        return "to the first pose"
    if playback.seconds >= playback.total_seconds:
        return "played"
    return "paused" if playback.is_paused else "playing"
