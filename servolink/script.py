"""Run a script so that a failure ends it with one line and an exit code, not with a traceback."""

from __future__ import annotations

import sys
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar, overload

from servolink.errors import InvalidAddress, ProfileError, ServolinkError, SeveralBoards, TransportError
from servolink.escaping import escape, quote

T = TypeVar("T")

OK, FAILED, USAGE, NO_BOARD, INTERRUPTED = 0, 1, 2, 3, 130
"""Exit codes."""


def exit_code(error: ServolinkError) -> int:
    """Return the exit code of a program that ends with `error`."""
    if isinstance(error, InvalidAddress | SeveralBoards):
        return USAGE
    is_absent = isinstance(error, TransportError) and not isinstance(error, ProfileError)
    return NO_BOARD if is_absent else FAILED


@overload
def run(main: Callable[[], Coroutine[Any, Any, T]] | Coroutine[Any, Any, T]) -> T: ...
@overload
def run(main: Callable[[], T]) -> T: ...
def run(main: Any) -> Any:
    """Run a script: call `main`, which may be an async function, and return its result.

    If it raises a ServolinkError, print file, line and text on standard error, and end the program with the exit code
    of the command line: 3 if there is no board, 2 for a wrong address or if several boards are here, otherwise 1.
    Ctrl-C ends it with 130. Other errors are defects of the script and raised; `python -X dev` raises all of them.
    """
    try:
        return _call(main)
    except (ServolinkError, KeyboardInterrupt) as error:
        if sys.flags.dev_mode:
            raise
        text, code = _ending(main, error)
    print(text, file=sys.stderr)
    sys.exit(code)


def _ending(main: Any, error: ServolinkError | KeyboardInterrupt) -> tuple[str, int]:
    """Return the line and the exit code with which a script ends."""
    if isinstance(error, KeyboardInterrupt):
        return "interrupted", INTERRUPTED
    return f"{_place(main, error)}: {error}", exit_code(error)


def _call(main: Any) -> Any:
    import asyncio

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
    import asyncio

    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return False
    return True


def _place(main: Any, error: BaseException) -> str:
    """Return file and line of the script where `error` was raised, or of the call that raised it."""
    code = getattr(main, "__code__", None) or getattr(main, "cr_code", None)
    place, traceback = "servolink", error.__traceback__
    while traceback is not None:
        file = traceback.tb_frame.f_code.co_filename
        if code is not None and file == code.co_filename:
            place = f"{file}:{traceback.tb_lineno}"
        traceback = traceback.tb_next
    return escape(place)
