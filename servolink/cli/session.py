"""One command's conversation with a board, and what Ctrl-C does to it."""

from __future__ import annotations

import argparse
import asyncio
import os
import sys
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from typing import Any

from servolink.cli.choosing import chosen
from servolink.cli.main import INTERRUPTED, NO_BOARD, fail, refuse
from servolink.cli.streams import lost_output
from servolink.client.board import Board
from servolink.client.connect import connect
from servolink.errors import OutcomeUnknown, RequestTimeout, ServolinkError

UNFINISHED_IMPORT = (
    "this board holds an unfinished import: `servolink apply FILE` finishes it, `servolink rollback` undoes it"
)
_UNMOVED = "no servo was moved"
_PATIENCE = 1.0  # seconds for the board to be closed in good order after Ctrl-C


class Interruption:
    """What Ctrl-C says and does; commands keep `state`, and `code` for the exit, true as they go."""

    def __init__(self, state: str) -> None:
        """Begin in `state`, such as "no servo was moved"."""
        self.state = state
        self.code = INTERRUPTED
        self._told = False

    def tell(self) -> None:
        """Say, once, what is now the case."""
        if not self._told:
            self._told = True
            print(f"interrupted: {self.state}", file=sys.stderr, flush=True)

    @contextmanager
    def watched(self) -> Iterator[None]:
        """Speak at once when Ctrl-C comes in here, and end the process if what is then closed does not end."""
        try:
            yield
        except asyncio.CancelledError:
            self.tell()
            asyncio.get_running_loop().call_later(_PATIENCE, os._exit, self.code)
            raise


def run_interruptible(main: Callable[[Interruption], Awaitable[int]], state: str = _UNMOVED) -> int:
    """Run `main` until it returns the exit code or Ctrl-C comes."""
    interruption = Interruption(state)

    async def watched() -> int:
        with interruption.watched():
            return await main(interruption)

    try:
        return asyncio.run(watched())
    except (KeyboardInterrupt, asyncio.CancelledError):  # the latter from a command that handles Ctrl-C itself
        interruption.tell()
        return interruption.code
    except OSError as error:
        if lost := lost_output(error):
            raise ServolinkError(f"{lost}; {interruption.state}") from error
        raise


def converse(
    args: argparse.Namespace,
    talk: Callable[[Board, Interruption], Awaitable[int]],
    *,
    greet: bool = True,
    state: str = _UNMOVED,
    **options: Any,
) -> int:
    """Connect to the board of `args`, let `talk` talk to it and return what that returns.

    `greet` asks for something harmless first, so that a silent board is told from a command that failed, and says
    so if an import was left unfinished on the board. `state` is what Ctrl-C says at first; `options` are those of
    `connect`.
    """
    try:
        connection = connect(
            chosen(args), byte_order=args.byte_order, caption_encoding=args.caption_encoding, **options
        )
    except ValueError as error:
        refuse(args, str(error))

    async def main(interruption: Interruption) -> int:
        async with connection as board:
            try:
                with interruption.watched():
                    if greet and await board.has_unfinished_import():
                        print(UNFINISHED_IMPORT, file=sys.stderr, flush=True)
                    return await talk(board, interruption)
            except (RequestTimeout, OutcomeUnknown) as error:
                if board.stats.frames_received:
                    raise
                return fail(error, NO_BOARD)

    return run_interruptible(main, state)
