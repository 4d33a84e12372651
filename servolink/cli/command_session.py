"""A command and its board: choice of the board, end of the command, and report after Ctrl-C."""

from __future__ import annotations

import argparse
import asyncio
import logging
import sys
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Mapping, Sequence
from contextlib import AsyncExitStack, asynccontextmanager, contextmanager, suppress
from functools import partial
from typing import Any, NoReturn, TypeAlias

from servolink.boards import NO_BOARD_FOUND, boards, only, search
from servolink.cli.command import Run, flag
from servolink.cli.screen.output import Form, Table, console, fail, lost_output, print_error, show_table
from servolink.cli.screen.result import Ending, ended
from servolink.cli.screen.terminal import can_ask, confirm, end_process
from servolink.cli.usage import usage_error
from servolink.client import Board, connect
from servolink.errors import (
    ConnectionLost,
    OpenError,
    OutcomeUnknown,
    Reason,
    RecordingError,
    RequestTimeout,
    ServolinkError,
    quote,
)
from servolink.support import ExitCode, Pauses, Reconnecting, Signals
from servolink.transports import DeviceInfo

Talk: TypeAlias = "Callable[[argparse.Namespace, Board, Interruption], Awaitable[Ending]]"
"""Function that performs a command on a board."""

UNFINISHED_IMPORT = (
    "this board holds an unfinished import: `servolink apply FILE` finishes it, `servolink rollback` undoes it"
)
WOKEN = "the board was in transmission mode 0, and is in mode 1 now; `servolink board mode 0` puts it back"
KEEP_MODE = flag("--keep-mode", "leave the board in transmission mode 0 if it was in mode 0")
"""Option of commands that only read."""
UNTOUCHED = "nothing was changed on the board"
ENDLESS = "Ctrl-C ends it with exit code 0. If an option sets the end, Ctrl-C before that ends it with 130."
"""Help of commands that run until Ctrl-C; such commands set `Interruption.code` accordingly."""
_UNMOVED = "no servo was moved"
_LONGEST_PAUSE = 0.3  # seconds between connections after a loss
_PATIENCE = 0.2  # seconds for the board to be closed in good order after Ctrl-C


class Interruption:
    """What Ctrl-C reports. A command keeps `state`, and the exit code `code`, up to date."""

    def __init__(self, state: str) -> None:
        """Start in `state`, such as "no servo was moved"."""
        self.state = state
        self.code = ExitCode.INTERRUPTED
        self._reported = False

    def report(self) -> None:
        """Print the state, once."""
        if not self._reported:
            self._reported = True
            print_error(f"{'ended' if self.code == ExitCode.OK else 'interrupted'}: {self.state}")

    @contextmanager
    def watched(self) -> Iterator[None]:
        """Report as soon as Ctrl-C arrives in here, and end the process if closing what is open takes too long."""
        try:
            yield
        except asyncio.CancelledError:
            self.report()
            asyncio.get_running_loop().call_later(_PATIENCE, end_process, self.code)
            raise

    def end(self) -> NoReturn:
        """Report and end the process at once."""
        self.report()
        end_process(self.code)


def run_interruptible(
    main: Callable[[Interruption], Awaitable[Ending]], state: str = _UNMOVED, *, usage: argparse.Namespace | None = None
) -> int:
    """Run `main` until it ends, show its value and return the exit code; or until Ctrl-C, SIGTERM or a closed terminal.

    The first signal cancels `main`, a second one ends the process at once. With the arguments of the command in
    `usage`, a ValueError is wrong usage.
    """
    interruption = Interruption(state)

    async def watched() -> int:
        task = asyncio.current_task()
        assert task is not None  # noqa: S101 - narrows the type: this runs in one
        with Signals.ENDING.handled(task.cancel, again=interruption.end), interruption.watched():
            return ended(await main(interruption))

    try:
        return asyncio.run(watched())
    except (KeyboardInterrupt, asyncio.CancelledError):
        interruption.report()
        return interruption.code
    except OSError as error:
        if lost := lost_output(error):
            raise ServolinkError(f"{lost}; {interruption.state}") from error
        raise
    except ValueError as error:
        if usage is None or isinstance(error, RecordingError):
            raise
        usage_error(usage, str(error))


def connection_options(args: argparse.Namespace) -> dict[str, Any]:
    """Return the options of a connection that the command line sets."""
    options = {"byte_order": args.byte_order, "caption_encoding": args.caption_encoding, "patience": args.timeout}
    # In mode 0 a board is silent.
    return options | ({"transmission_mode": "auto"} if getattr(args, "keep_mode", False) else {})


def run_with_board(
    args: argparse.Namespace,
    talk: Callable[[Board, Interruption], Awaitable[Ending]],
    *,
    greet: bool = True,
    repeats: bool = False,
    state: str = _UNMOVED,
    **options: Any,
) -> int:
    """Connect to the board of `args`, show the value of `talk` and return the exit code.

    `greet` reports an import left unfinished on the board. `repeats`: after a loss, connect and `talk` again, within
    the patience of the connection; only for what may be repeated, such as a stop. `state` is what Ctrl-C reports at
    first; `options` go to `connect`.
    """
    keeps_mode: bool = getattr(args, "keep_mode", False)
    try:
        connection = connect(choose_board(args), **connection_options(args), **options)
    except ValueError as error:
        usage_error(args, str(error))

    board: Board | None = None

    async def once(interruption: Interruption) -> int:
        nonlocal board
        async with AsyncExitStack() as stack:
            if greet:
                stack.enter_context(_unlogged("servolink.client.projects"))  # the greeting says the same
            board = await stack.enter_async_context(connection)
            with interruption.watched():
                async with mode_restored(board, keeps_mode=keeps_mode):
                    if greet and await _has_unfinished_import(board):
                        print_error(UNFINISHED_IMPORT)
                    return ended(await talk(board, interruption))

    async def main(interruption: Interruption) -> int:
        loop = asyncio.get_running_loop()
        started_at = loop.time()
        try:
            if not repeats:
                return await once(interruption)
            return await _until_kept(
                partial(once, interruption),
                lambda: board is not None and loop.time() < started_at + board.connection.patience,
            )
        except (RequestTimeout, OutcomeUnknown, ConnectionLost) as error:
            if board is None or board.stats.frames_received:
                raise
            return fail(error, ExitCode.NO_BOARD)

    return run_interruptible(main, state)


async def _until_kept(attempt: Callable[[], Awaitable[int]], may_repeat: Callable[[], bool]) -> int:
    """Repeat `attempt` after a loss while `may_repeat` returns True, as some boards restart when they are opened.

    Raise the first loss if no later connection stays either.
    """
    losses: list[ConnectionLost] = []

    def retry(error: Exception) -> bool:
        if isinstance(error, ConnectionLost):
            losses.append(error)
        return bool(losses) and isinstance(error, ConnectionLost | OpenError) and may_repeat()

    try:
        return await anext(Reconnecting(attempt, Pauses(longest=_LONGEST_PAUSE), retry))
    except (ConnectionLost, OpenError) as error:
        if losses and error is not losses[0]:
            raise losses[0] from error
        raise


@asynccontextmanager
async def mode_restored(board: Board, *, keeps_mode: bool, woke: bool = False) -> AsyncIterator[None]:
    """Put a board that was in transmission mode 0 back at the end with `keeps_mode`, else say that it is not.

    `woke`: an earlier connection of this command has set mode 1.
    """
    woke = woke or _has_woken(board)
    if woke and not keeps_mode:
        print_error(WOKEN)
    try:
        yield
    finally:
        has_woken = woke or _has_woken(board)  # perhaps by a second connection, after a loss
        is_back = False
        if keeps_mode and has_woken:
            with suppress(ServolinkError):
                await board.set_transmission_mode(0)
                is_back = True
        if has_woken and not is_back and (keeps_mode or not woke):
            print_error(WOKEN)


def _has_woken(board: Board) -> bool:
    """Return whether the present connection has set mode 1 on a board in mode 0."""
    return board.connection.opener.woke


@contextmanager
def _unlogged(name: str) -> Iterator[None]:
    """Drop what a module logs."""
    logger = logging.getLogger(name)
    logger.disabled = True
    try:
        yield
    finally:
        logger.disabled = False


async def _has_unfinished_import(board: Board) -> bool:
    """Return whether an import was interrupted; False for a board that answers, but not this question."""
    try:
        return await board.has_unfinished_import()
    except RequestTimeout:
        if board.stats.frames_received:
            return False
        raise


def interruptible(
    state: str = _UNMOVED, *, in_usage: bool = False
) -> Callable[[Callable[[argparse.Namespace, Interruption], Awaitable[Ending]]], Run]:
    """Return a decorator for the function of a command without a board: see `run_interruptible`.

    A ValueError is wrong usage if `in_usage`.
    """
    return lambda main: lambda args: run_interruptible(partial(main, args), state, usage=args if in_usage else None)


def on_board(
    before: Callable[[argparse.Namespace], Mapping[str, Any] | None] = lambda args: None,
    *,
    state: str = _UNMOVED,
    **options: Any,
) -> Callable[[Talk], Run]:
    """Return a decorator for the function of a command with a board: see `run_with_board`.

    `before` is called before the board is chosen: it may end as wrong usage, or return further options.
    """

    def decorated(talk: Talk) -> Run:
        return lambda args: run_with_board(args, partial(talk, args), state=state, **options, **(before(args) or {}))

    return decorated


def is_answered(board: Board, query: str) -> bool:
    """Return whether the board may answer a query, such as `QueryProjectID`, by its profile and the handshake."""
    return query not in board.unanswered


def refuse_without_answer(args: argparse.Namespace) -> None:
    """End as wrong usage without `--yes` and without a terminal for the question."""
    if args.yes:
        return
    if Form.json:
        usage_error(args, "--json needs --yes, because it asks nothing")
    if not can_ask():
        usage_error(args, "no terminal for the question; --yes continues without asking")


def refuse_unasked(args: argparse.Namespace, text: str) -> None:
    """End as wrong usage, with `text`, without `--yes` and without a terminal for the question."""
    if not args.yes and not can_ask():
        usage_error(args, text)


async def agreed(args: argparse.Namespace, interruption: Interruption, question: str) -> bool:
    """Return whether to go on, after asking unless `--yes` was given; a no prints the state."""
    if args.yes or await confirm(question):
        return True
    print_error(f"servolink: {interruption.state}")
    return False


def choose_board(args: argparse.Namespace) -> str:
    """Return the board given in `args`, the only connected board, or the board chosen at the terminal.

    Raise OpenError if there is none. Without a terminal, several boards are a usage error.
    """
    if args.url:
        return str(args.url)

    candidates = search()
    found = boards(candidates)
    usable = [board for board in found if not board.problem]
    if not found:
        raise OpenError(NO_BOARD_FOUND, reason=Reason.NOT_FOUND)
    if len(found) == 1 or len(usable) == 1:
        return only(candidates)
    if not can_ask():
        addresses = "\n".join(f"  --board {board.url}" for board in found)
        usage_error(args, f"{len(found)} boards are here; choose one:\n{addresses}")
    return _pick(args, found)


def _pick(args: argparse.Namespace, found: Sequence[DeviceInfo]) -> str:
    """Ask for the number of a board, and return the address of the board."""
    rows = [(str(number), board.url, board.product, board.problem) for number, board in enumerate(found, 1)]
    terminal = console(stderr=True)
    show_table(Table(("", "address", "product", "problem"), rows), terminal)
    terminal.print(f"Which one? 1 to {len(found)}:", end=" ")
    answer = sys.stdin.readline().strip()
    if not (answer.isascii() and answer.isdecimal() and 1 <= int(answer) <= len(found)):
        usage_error(args, f"{quote(answer)} must be a number from 1 to {len(found)}; or give --board")
    return found[int(answer) - 1].url
