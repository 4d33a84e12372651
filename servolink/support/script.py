"""Run a script; a failure ends with one line of text and an exit code instead of a traceback."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable, Coroutine
from enum import IntEnum
from typing import Any, TypeVar, overload

from servolink.errors import InvalidAddress, ProfileError, ServolinkError, SeveralBoards, TransportError, escape, quote

T = TypeVar("T")


class ExitCode(IntEnum):
    """Exit code of a program."""

    OK = 0
    FAILED = 1
    USAGE = 2
    NO_BOARD = 3
    INTERRUPTED = 130

    @classmethod
    def of(cls, error: ServolinkError) -> ExitCode:
        """Return the exit code of a program ended by `error`."""
        if isinstance(error, InvalidAddress | SeveralBoards):
            return cls.USAGE
        is_absent = isinstance(error, TransportError) and not isinstance(error, ProfileError)
        return cls.NO_BOARD if is_absent else cls.FAILED


@overload
def run(main: Callable[[], Coroutine[Any, Any, T]] | Coroutine[Any, Any, T]) -> T: ...
@overload
def run(main: Callable[[], T]) -> T: ...
def run(main: Any) -> Any:
    """Run a script: call `main`, a plain or async function, and return the result.

    For a ServolinkError, print file, line and text on standard error, and end the program with the exit code of the
    command line: 3 if no board was found, 2 for a wrong address or several boards, otherwise 1. For Ctrl-C, end the
    program with 130. Other errors are defects of the script and are raised; `python -X dev` raises all errors.
    """
    try:
        return _call(main)
    except (ServolinkError, KeyboardInterrupt) as error:
        if sys.flags.dev_mode:
            raise
        text, code = _ending(main, error)
    print(text, file=sys.stderr)
    sys.exit(code)


def _ending(main: Any, error: ServolinkError | KeyboardInterrupt) -> tuple[str, ExitCode]:
    """Return the last line of a script and its exit code."""
    if isinstance(error, KeyboardInterrupt):
        return "interrupted", ExitCode.INTERRUPTED
    return f"{_place(main, error)}: {error}", ExitCode.of(error)


def _call(main: Any) -> Any:
    if not (callable(main) or asyncio.iscoroutine(main)):
        raise TypeError(f"main must be a function such as `async def main():`, not {quote(main)}")
    result = main() if callable(main) else main
    if not asyncio.iscoroutine(result):
        return result
    if not _has_loop():
        return asyncio.run(result)
    result.close()
    raise RuntimeError("an event loop runs here already, as in notebooks: write `await main()`, without servolink.run")


def _has_loop() -> bool:
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return False
    return True


def _place(main: Any, error: BaseException) -> str:
    """Return file and line of the script where `error` was raised, or of the call from the script."""
    code = getattr(main, "__code__", None) or getattr(main, "cr_code", None)
    place, traceback = "servolink", error.__traceback__
    while traceback is not None:
        file = traceback.tb_frame.f_code.co_filename
        if code is not None and file == code.co_filename:
            place = f"{file}:{traceback.tb_lineno}"
        traceback = traceback.tb_next
    return escape(place)
