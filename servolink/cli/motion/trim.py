"""`servolink trim`: nudge servos until they stand right, and store the nudges as their angle corrections."""

from __future__ import annotations

import argparse
import asyncio
import re
from collections.abc import Awaitable, Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from textwrap import wrap

from msgspec.structs import replace

from servolink.cli.arguments import MOST_TRIM, SERVO_NAME, whole_number
from servolink.cli.command import MOVE, Command, flag, option
from servolink.cli.command_session import UNFINISHED_IMPORT, Interruption, run_with_board
from servolink.cli.motion.move import chosen_servos, make_ready
from servolink.cli.motion.run import stopped_by_interruption
from servolink.cli.motion.servo_output import are, reported
from servolink.cli.projects.apply import ContentChanged
from servolink.cli.screen.live import can_draw, follow
from servolink.cli.screen.output import Table, console, plain_lines, print_error, print_text, text_width
from servolink.cli.screen.result import Ending, Returned, print_for_people
from servolink.cli.screen.terminal import can_ask, cleanup, typed_keys
from servolink.cli.stored.change import change_parameters
from servolink.cli.usage import usage_error
from servolink.client import Board, Servo, servo_ids
from servolink.errors import EncodeError, NotFound, ProjectError, RequestRefused, ServolinkError, escape, quote
from servolink.protocol import ServoParameter

_NUDGE = re.compile(r"(.+)=([+-][0-9]{1,9})", re.DOTALL | re.ASCII)
_COARSE = 5  # degrees
_HELP = (
    f"left/right or -/+: 1 degree; with Shift, or by < and >: {_COARSE} degrees",
    "up/down: servo; u: undo; Enter: store; q: leave",
)
_PAUSE = 0.1  # seconds between readings while no key comes
_OTHER_LINES = 5  # of the picture, besides servos and help
_LEFT_OUT = ((), ("nudged",), ("nudged", "caption"))  # until the rest fits
_STEPS = {"right": 1, "+": 1, "=": 1, "left": -1, "-": -1}
_STEPS |= {"shift-right": _COARSE, ">": _COARSE, "shift-left": -_COARSE, "<": -_COARSE}
_SELECT = {"down": 1, "n": 1, "tab": 1, "up": -1, "p": -1}
_UNSTORED = "no correction was stored"


def nudge_argument(text: str) -> tuple[int | str, int]:
    """Return servo (id or caption) and degrees of a text such as `3=+4` or `hip=-2`, for argparse."""
    found = _NUDGE.fullmatch(text)
    if found is None:
        raise argparse.ArgumentTypeError(
            f"{quote(text)} must be SERVO=+N or SERVO=-N, as in 3=+4; `servolink servo trim 3 4` stores 4 without "
            "moving"
        )
    return SERVO_NAME(found[1]), whole_number(-2 * MOST_TRIM, 2 * MOST_TRIM)(found[2])


@Command(
    "trim",
    MOVE,
    help="nudge servos until they stand right, and store their corrections",
    details=f"Keys: {'; '.join(_HELP)}.\n\nEach nudge moves the servo. What is stored as its "
    "correction is the old one and all nudges. The protocol does not say how the board applies a correction: check "
    "the servos afterwards. `servolink rollback` brings the old corrections back.",
    examples=("trim --set 3=+4", "trim --set 1=-2 --set 2=+1 --json"),
    options=(
        option("servos", "SERVO", "which servos, by id or caption (all)", SERVO_NAME, nargs="*", default=[]),
        option(
            "--set",
            "SERVO=+N",
            "nudge a servo by N degrees and store, without keys; may be given again",
            nudge_argument,
            action="append",
            default=[],
            dest="nudges",
        ),
        flag("--start", "start and hold servos that are stopped or released"),
    ),
    defaults={"yes": True},
)
def run(args: argparse.Namespace) -> int:
    """Nudge by keys or as `--set` says, then store, unless somebody leaves without it."""
    if args.nudges and args.servos:
        usage_error(args, "--set names the servos itself: leave SERVO out")
    if not args.nudges and (not can_ask() or not can_draw()):
        why = "servos are nudged by keys, which needs an interactive terminal"
        usage_error(args, f"{why}; without one, use --set SERVO=+N")

    async def talk(board: Board, interruption: Interruption) -> Ending:
        if await board.has_unfinished_import():
            raise ProjectError(f"{UNFINISHED_IMPORT}; no servo was moved, and {_UNSTORED}")
        nudges = await _nudges(args, board)
        ids = [*nudges] if args.nudges else await chosen_servos(board, args.servos)
        servos = [servo for servo in await reported(board, ids) if not ids or servo.servo_id in ids]
        stored = {one.servo_id: one for one in await board.servo_parameters()}
        session = TrimSession(board, servos, stored)
        await _check(board, session, nudges, servos, start=args.start)
        await make_ready(board, servos, interruption, start=args.start)
        work = _as_given(args, board, session, nudges, servos) if nudges else _by_keys(board, session)
        wanted = await _moving(work, board, interruption, session)
        interruption.state = f"{session.described()}; {_UNSTORED}"
        if wanted and session.corrections():
            return await change_parameters(args, board, interruption, session.changes())
        return Returned(ContentChanged(changed=False), interruption.state)

    return run_with_board(args, talk, greet=False, state=f"no servo was moved, and {_UNSTORED}")


async def _nudges(args: argparse.Namespace, board: Board) -> dict[int, int]:
    """Return the degrees of `--set`, by servo id."""
    ids = await servo_ids(board, [servo for servo, _ in args.nudges])
    nudges = dict(zip(ids, (degrees for _, degrees in args.nudges), strict=True))
    if len(nudges) < len(ids):
        raise EncodeError(f"a servo is given twice; {_UNSTORED}")
    if 255 in nudges:
        raise NotFound("`--set` takes single servos, not `all`")
    return nudges


async def _check(
    board: Board, session: TrimSession, nudges: dict[int, int], servos: list[Servo], *, start: bool
) -> None:
    """Raise EncodeError, or MotionRefused, for a nudge of `--set` that is not possible, before anything moves."""
    targets = {servo.servo_id: session.check(servo.servo_id, nudges.get(servo.servo_id, 0)) for servo in servos}
    if nudges:
        await board.move(targets, speed=SPEED, dry_run=True, start=start)


async def _moving(work: Awaitable[bool], board: Board, interruption: Interruption, session: TrimSession) -> bool:
    """Return the result of `work`, which moves servos. After an interruption or failure, print the moved servos."""
    try:
        stopped = f"the servos were stopped, and {_UNSTORED}"
        async with stopped_by_interruption(board, interruption, _UNSTORED, stopped):
            return await work
    except asyncio.CancelledError:
        interruption.state = f"{session.described()}; {interruption.state}"
        raise
    except ServolinkError:
        print_error(f"servolink: {session.described()}; {_UNSTORED}")
        raise


async def _as_given(
    args: argparse.Namespace, board: Board, session: TrimSession, nudges: dict[int, int], servos: list[Servo]
) -> bool:
    """Nudge as `--set` says, and wait until the servos have arrived."""
    targets = {servo.servo_id: session.check(servo.servo_id, nudges[servo.servo_id]) for servo in servos}
    print_for_people([f"servo {one.servo_id} moves from {one.angle}° to {targets[one.servo_id]}°" for one in servos])
    for servo_id, degrees in nudges.items():
        await session.nudge(servo_id, degrees)
    longest = max(map(abs, nudges.values()), default=0) / SPEED
    await follow(board, targets, longest, lambda elapsed, servos: None)
    return True


async def _by_keys(board: Board, session: TrimSession) -> bool:
    """Obey keys until somebody ends it. Return whether the corrections are to be stored."""
    print_text(f"keys move the servo that is marked, at {SPEED:g}°/s; Ctrl-C stops all servos")
    message = ""
    with typed_keys() as keys, _picture() as draw:
        if keys is None:
            raise RequestRefused("no keys can be read here; use --set SERVO=+N")
        while True:
            draw(session, await board.servos(), message)
            try:
                async with asyncio.timeout(_PAUSE):
                    key = await keys.get()
            except TimeoutError:
                continue
            if key in ("enter", "q", "esc"):
                return key == "enter"
            message = await _obey(session, key)


async def _obey(session: TrimSession, key: str) -> str:
    """Carry out a key, and return a remark for the person, or an empty text."""
    try:
        if key in _SELECT:
            session.select(_SELECT[key])
        elif key in _STEPS:
            await session.nudge(session.selected, _STEPS[key])
        elif key == "u":
            undone = await session.undo()
            return "there is nothing to undo" if undone is None else f"the last nudge of servo {undone} was taken back"
    except EncodeError as error:  # also MotionRefused: a limit of the profile
        return str(error)
    return ""


@contextmanager
def _picture() -> Iterator[Callable[[TrimSession, tuple[Servo, ...], str], None]]:
    """Yield a function that draws the servos; the last picture stays visible."""
    from rich.live import Live
    from rich.text import Text

    displayed = console()
    with cleanup(displayed.show_cursor), Live(console=displayed, auto_refresh=False) as live:

        def draw(session: TrimSession, servos: tuple[Servo, ...], message: str) -> None:
            idle = [one.servo_id for one in servos if one.servo_id == session.selected and not one.is_start]
            said = f"{are(idle)} stopped: nudges have no effect" if idle else message
            lines = picture(session, servos, said, (displayed.width, displayed.height))
            live.update(Text("\n".join(lines), no_wrap=True, overflow="ellipsis"), refresh=True)

        yield draw


def picture(session: TrimSession, servos: tuple[Servo, ...], said: str, size: tuple[int, int]) -> list[str]:
    """Return the servos, the help for keys and the latest message, for a width and a height (`size`)."""
    width, height = size
    foot = [line for text in _HELP for line in wrap(text, width)]
    rows = max(1, height - len(foot) - _OTHER_LINES)
    lines: list[str] = []
    for without in _LEFT_OUT:
        lines = plain_lines(session.table(servos, rows, without=without))
        if max(map(text_width, lines)) <= width:
            break
    return [*lines, "", *foot, *(wrap(escape(said), width) or [""])]


SPEED = 30.0
"""Degrees per second of a nudge."""


class TrimSession:
    """Nudges servos on a board, one after the other, and adds the nudges up.

    The document does not say how a stored correction acts on the angle of a servo. So this moves the servo by each
    nudge, from the angle that it reported at first, and the correction to store is the old one and all nudges.
    """

    def __init__(self, board: Board, servos: Sequence[Servo], stored: Mapping[int, ServoParameter]) -> None:
        """Start with the first of `servos` selected and nothing nudged; `stored` are the corrections so far."""
        self._board = board
        self._start = {servo.servo_id: int(servo.angle) for servo in servos}
        self._old = {servo_id: stored.get(servo_id, ServoParameter(servo_id)) for servo_id in self._start}
        self._ids = [*self._start]
        self._at = 0
        self._nudges: list[tuple[int, int]] = []  # servo id and degrees, the last one last

    @property
    def selected(self) -> int:
        """The id of the servo that keys nudge."""
        return self._ids[self._at]

    def select(self, step: int) -> None:
        """Select the servo that is `step` further down, from the last on to the first."""
        self._at = (self._at + step) % len(self._ids)

    def nudged(self) -> dict[int, int]:
        """Return the total nudges in degrees by servo id, without servos back at the start."""
        sums = dict.fromkeys(self._ids, 0)
        for servo_id, degrees in self._nudges:
            sums[servo_id] += degrees
        return {servo_id: degrees for servo_id, degrees in sums.items() if degrees}

    def corrections(self) -> dict[int, int]:
        """Return the corrections to store, by servo id: of the servos that were nudged."""
        return {servo_id: self._old[servo_id].adjusted_degree + degrees for servo_id, degrees in self.nudged().items()}

    def changes(self) -> dict[int, Callable[[ServoParameter], ServoParameter]]:
        """Return, by servo id, what is to be made of the parameters on the board, for `change_parameters`.

        They raise ProjectError if the board holds another correction than at the start.
        """

        def changed(one: ServoParameter) -> ServoParameter:
            old = self._old[one.servo_id].adjusted_degree
            if one.adjusted_degree != old:
                raise ProjectError(
                    f"servo {one.servo_id} had a correction of {old}° at first, and now has {one.adjusted_degree}°; "
                    "no correction was stored; try again"
                )
            return replace(one, adjusted_degree=corrections[one.servo_id])

        corrections = self.corrections()
        return dict.fromkeys(corrections, changed)

    def check(self, servo_id: int, degrees: int) -> int:
        """Return the target of a nudge. Raise EncodeError if the correction would be too large to store."""
        nudged = self.nudged().get(servo_id, 0) + degrees
        correction = self._old[servo_id].adjusted_degree + nudged
        if not -MOST_TRIM <= correction <= MOST_TRIM:
            raise EncodeError(
                f"servo {servo_id}: its correction would be {correction} degrees; it must be from -{MOST_TRIM} to "
                f"{MOST_TRIM}"
            )
        return self._start[servo_id] + nudged

    async def nudge(self, servo_id: int, degrees: int) -> None:
        """Move a servo by `degrees`, and count the nudge. Raise EncodeError or MotionRefused for a forbidden angle."""
        target = self.check(servo_id, degrees)
        self._nudges.append((servo_id, degrees))  # before the movement: an interrupted movement may have been sent
        try:
            await self._board.move({servo_id: target}, speed=SPEED)
        except EncodeError:
            self._nudges.pop()
            raise

    async def undo(self) -> int | None:
        """Take the last nudge back, select the servo and return the servo id. Return None without a nudge."""
        if not self._nudges:
            return None
        servo_id, degrees = self._nudges[-1]
        target = self._start[servo_id] + self.nudged().get(servo_id, 0) - degrees
        await self._board.move({servo_id: target}, speed=SPEED)
        self._nudges.pop()
        self._at = self._ids.index(servo_id)
        return servo_id

    def described(self) -> str:
        """Return the moved servos as text, such as `servo 3 was moved by +4°`; movements may still continue."""
        moved = [f"servo {servo_id} was moved by {degrees:+}°" for servo_id, degrees in self.nudged().items()]
        return ", ".join(moved) or "no servo was moved"

    def table(self, servos: Sequence[Servo], rows: int, *, without: Collection[str] = ()) -> Table:
        """Return what `servos` report now, nudges and corrections: at most `rows` lines around the selected servo.

        The columns `without` are left out.
        """
        angles = {servo.servo_id: servo.angle for servo in servos}
        first = max(0, min(self._at - rows // 2, len(self._ids) - rows))
        corrections, nudged = self.corrections(), self.nudged()
        lines = [
            (
                ">" if servo_id == self.selected else "",
                servo_id,
                self._old[servo_id].servo_caption,
                angles.get(servo_id),
                f"{nudged[servo_id]:+}°" if servo_id in nudged else "",
                _change(self._old[servo_id].adjusted_degree, corrections.get(servo_id)),
            )
            for servo_id in self._ids[first : first + rows]
        ]
        columns = ("", "servo", "caption", "angle", "nudged", "correction")
        shown = [at for at, column in enumerate(columns) if column not in without]
        return Table([columns[at] for at in shown], [[line[at] for at in shown] for line in lines])


def _change(old: int, new: int | None) -> str:
    return f"{old}°" if new is None or new == old else f"{old}° -> {new}°"
