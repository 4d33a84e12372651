"""`servolink project play`: play an action or a macro on a robot, or as a chart of its movements."""

from __future__ import annotations

import argparse
import asyncio
import shutil
import sys
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from contextlib import asynccontextmanager, contextmanager
from typing import TYPE_CHECKING, Any

from servolink.cli.arguments import not_empty
from servolink.cli.command import Command, flag, group, option
from servolink.cli.command_session import Interruption, run_interruptible, run_with_board
from servolink.cli.motion.move import DEFAULT_SPEED, LIMITS, limits_of, make_ready
from servolink.cli.motion.run import stopped_by_interruption
from servolink.cli.motion.servo_output import are, listed
from servolink.cli.projects.source import SOURCE, is_address, with_project
from servolink.cli.screen.live import live_bars, redrawn
from servolink.cli.screen.output import (
    Table,
    console,
    is_terminal,
    plain_lines,
    print_error,
    print_json,
    print_table,
    print_text,
    text_width,
)
from servolink.cli.screen.terminal import cleanup, single_keys
from servolink.cli.usage import named_board, usage_error
from servolink.errors import ProjectError
from servolink.project.model import Project
from servolink.project.record_lookup import by_servo, by_type, find, name_of, servos_used
from servolink.protocol.record_types import ACTION, MACRO, type_of
from servolink.protocol.records import Action, Macro
from servolink.protocol.servos import ServoState
from servolink.script import OK
from servolink.virtual.dry_run import DryMove, DryRun, Timeline

if TYPE_CHECKING:  # and imported late: `--help` needs none of it
    from servolink.client.board import Board
    from servolink.client.playing import Playback
    from servolink.client.servo_state import Servo

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
        ),
        *LIMITS,
    ),
    takes_board=False,
)
def run(args: argparse.Namespace) -> int:
    """Play the record on a board, or else as a dry run, in which all servos start at 0 degrees."""
    if is_address(args.source) and not args.source.startswith("virtual:"):
        usage_error(args, "play reads a file; export the project of the board first, and play the file")
    if board := _board(args):
        args.url = board
        return with_project(args, lambda project: play_on_board(args, project, find(project, args.record, _PLAYED)))
    if args.start or args.limit or args.speed_cap or args.soft_start:
        usage_error(args, "--start, --limit, --speed-cap and --soft-start are for a robot: name it with --board")
    with_bars = is_terminal() and not args.json and not args.fast
    return with_project(args, lambda project: _play(args, project, with_bars=with_bars))


def _board(args: argparse.Namespace) -> str | None:
    """Return the board that the command line names.

    One in the environment does not count: what is meant to be a dry run must not move a robot.
    """
    named: str | None = args.on_board
    return named_board(args) if named is None else named


def _play(args: argparse.Namespace, project: Project, *, with_bars: bool) -> int:
    record = find(project, args.record, _PLAYED)
    try:
        timeline = _dry_run(project).play(record)
    except ProjectError as error:
        raise ProjectError(f"{name_of(record)}: {error}; `servolink project check` explains it") from error
    if with_bars:
        ended = run_interruptible(
            lambda interruption: _show(_dry_run(project), record, timeline), "only a virtual board was moved"
        )
        if ended != OK:
            return ended
    if args.json:
        print_json(_described(record, timeline))
    else:
        _print(project, record, timeline)
    return OK


def _dry_run(project: Project) -> DryRun:
    by_type(project)  # refuses duplicate ids: the board would play either record
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
    return OK


def _servo(state: ServoState) -> Servo:
    from servolink.client.servo_state import Servo

    reported = (state.servo_id, state.angle, state.current, state.temperature, state.servo_type)
    return Servo(*reported, is_start=bool(state.is_start), is_hold=bool(state.is_hold))


def _print(project: Project, record: Action | Macro, timeline: Timeline) -> None:
    captions = {servo_id: one.servo_caption for servo_id, one in by_servo(project).items()}
    whole = "" if timeline.is_whole else "; the chart shows only the beginning"
    print_text(f"{name_of(record)} takes {timeline.seconds:g} s{whole}", "bold")
    if not timeline.moves:
        print_text("no servo moves")
        return
    print_text("")
    for line in chart(timeline, captions, shutil.get_terminal_size((100, 24)).columns):
        print_text(line)
    print_text("")
    moved = sorted({move.servo_id for move in timeline.moves})
    rows = [(servo_id, captions.get(servo_id, ""), round(timeline.angles[servo_id])) for servo_id in moved]
    print_table(Table(("servo", "", "at the end"), rows))


def _described(record: Action | Macro, timeline: Timeline) -> dict[str, Any]:
    kind = type_of(record)
    return {
        "kind": kind.label,
        "id": kind.id_of(record),
        "caption": kind.caption_of(record),
        "duration_seconds": round(timeline.seconds, 3),
        "is_whole": timeline.is_whole,
        "moves": [
            {
                "servo_id": move.servo_id,
                "start_seconds": round(move.start, 3),
                "end_seconds": round(move.end, 3),
                "from_degree": round(move.from_angle),
                "target_degree": move.target,
                "is_cut": move.is_cut,
            }
            for move in timeline.moves
        ],
        "angles": [
            {"servo_id": servo_id, "degree": round(angle)} for servo_id, angle in sorted(timeline.angles.items())
        ],
    }


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
    kind = type_of(record)
    name, chosen = name_of(record), f"{kind.label}:{kind.id_of(record)}"
    servo_ids = sorted(servos_used(project, record))
    args.soft_start = args.soft_start or DEFAULT_SPEED

    async def talk(board: Board, interruption: Interruption) -> int:
        from servolink.client.playing import Playback

        used = [servo for servo in await board.servos() if servo.servo_id in servo_ids]
        await make_ready(board, used, interruption, start=args.start)
        seconds = await board.play(project, chosen, dry_run=True)
        moved = listed(servo_ids) if servo_ids else "no servo"
        print_error(f"servolink: {name} takes {seconds:g} s and moves {moved}; it is not stored on the board")
        playback = Playback()
        interruption.state = f"{name} may have been begun; `servolink stop` stops the servos"
        stopping = stopped_by_interruption(board, interruption, f"{name} was begun", f"{name} was ended")
        async with stopping, _drawn(playback):
            with _keys(playback):
                await board.play(project, chosen, playback=playback)
        interruption.state = f"{name} is over"
        if args.json:
            described = {"kind": kind.label, "id": kind.id_of(record), "caption": kind.caption_of(record)}
            print_json({**described, "duration_seconds": seconds, "servo_ids": servo_ids, "arrived": True})
        else:
            print_text(f"{name} is over" + (f": {are(servo_ids)} at rest" if servo_ids else ""))
        return OK

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
    if sys.stderr is None or not sys.stderr.isatty():
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
