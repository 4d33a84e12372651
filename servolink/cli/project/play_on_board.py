"""`servolink project play --board`: play an action or a macro of a file on a board, without storing it there."""

from __future__ import annotations

import argparse
import asyncio
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from servolink.cli.main import OK
from servolink.cli.motion import DEFAULT_SPEED, limits_of, make_ready
from servolink.cli.output import console, print_error, print_json, print_text
from servolink.cli.run import stopped_by_interruption
from servolink.cli.servos import are, listed
from servolink.cli.session import Interruption, run_with_board
from servolink.cli.terminal import cleanup, single_keys
from servolink.project.model import Project
from servolink.project.records import name_of, servos_used
from servolink.protocol.record_types import type_of
from servolink.protocol.records import Action, Macro

if TYPE_CHECKING:
    from servolink.client.board import Board
    from servolink.client.playing import Playback

HELP = "space pauses and continues; q, Esc or Ctrl-C stops the servos"
_END = ("q", "\x1b")
_PAUSE = 0.05  # seconds between two drawings


def play_on_board(args: argparse.Namespace, project: Project, record: Action | Macro) -> int:
    """Play `record` on the board of `args`. The first movement is a slow one, unless `args` says how fast it is."""
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
        async with stopped_by_interruption(board, interruption, f"{name} was begun", f"{name} was ended"):
            with _keys(playback), _drawn(playback):
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
    """Return a function that takes what is typed, and calls `end` if the servos are to be stopped."""

    def typed(text: str) -> None:
        # The code of an arrow key starts with Esc; Esc itself comes alone.
        for key in [text] if text.startswith("\x1b") else text:
            if key in _END:
                end()
                return
            if key == " ":
                (playback.resume if playback.is_paused else playback.pause)()

    return typed


@contextmanager
def _drawn(playback: Playback) -> Iterator[None]:
    """Show on standard error how far it is, if that is a terminal."""
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

        drawing = asyncio.create_task(_repeated(draw))
        try:
            yield
        finally:
            drawing.cancel()
            draw()


def state_of(playback: Playback) -> str:
    """Return what is played now, such as `paused`. A pause has no effect on the last step."""
    if not playback.total_seconds:
        return "to the first pose"
    if playback.seconds >= playback.total_seconds:
        return "played"
    return "paused" if playback.is_paused else "playing"


async def _repeated(draw: Callable[[], None]) -> None:
    while True:
        draw()
        await asyncio.sleep(_PAUSE)
