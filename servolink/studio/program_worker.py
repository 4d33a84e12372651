"""Python program in a separate worker of the page: one more program of the hub in the worker of the studio.

The page ends the worker to stop the program. `ProgramWorker` sends the page messages of a kind and a text:

| kind | text |
| --- | --- |
| output | printed text |
| ended | JSON of the `Failure`; empty without an error |
"""

from __future__ import annotations

import ast
import asyncio
import io
import linecache
import sys
import time
import traceback
from collections.abc import Callable
from typing import Any

import msgspec
from msgspec import Struct

from servolink.boards import HubClaim
from servolink.control import ShareTransport
from servolink.studio.program_pipes import PortPipes, Post
from servolink.support import listening_in_memory

FILE = "program.py"
DEAD_MAN = 2.0
"""Seconds without a turn of the event loop after which the hub stops motions of the program."""
_PAUSE = 0.1  # seconds between two messages with output
_HALF = 4096  # characters of output kept at the begin and at the end of a message; the middle is left out

_FUNCTIONS = ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda | ast.ClassDef


class Failure(Struct):
    """Error that ended a program."""

    kind: str
    """Name of the class, such as `NameError`."""
    line: int
    """Line of the program, from 1; 0 if the error is in no line."""
    message: str
    trace: str


class ProgramWorker:
    """Runs one program."""

    def __init__(self, tell: Callable[[str, str], object], post: Post) -> None:
        """Call `tell` with messages for the page, and `post` with messages for the hub."""
        self._tell = tell
        self._pipes = PortPipes(post)
        self._hub: asyncio.Future[str] = asyncio.get_running_loop().create_future()

    def hear(self, kind: str, number: int, text: str) -> None:
        """Handle a message of the other worker."""
        if kind == "hub":
            self._hub.set_result(text)
        else:
            self._pipes.hear(kind, number, text)

    async def run(self, source: str) -> None:
        """Run the text of a program to the end, and tell the page the outcome."""
        name = await self._hub
        ShareTransport.dead_man = DEAD_MAN
        sys.argv = [FILE]
        sys.stdout = sys.stderr = console = _Console(self._tell)
        with listening_in_memory(name, self._pipes.open), await HubClaim.of(name) as claim:
            claim.announce(f"page://{name}")  # for `connect()` without an address
            failure = await perform(source)
        console.pass_on()
        self._tell("ended", "" if failure is None else msgspec.json.encode(failure).decode())


async def perform(source: str) -> Failure | None:
    """Run the text of a program as a module; return the error that ended the program, None without an error."""
    linecache.cache[FILE] = len(source), None, source.splitlines(keepends=True), FILE
    names: dict[str, Any] = {"__name__": "__main__", "__file__": FILE}
    try:
        running = eval(compiled(source), names)  # noqa: S307 - after a person has pressed Run
        if running is not None:
            await running
    except BaseException as error:  # noqa: BLE001 - every error ends program and worker
        is_over = isinstance(error, SystemExit) and not error.code
        return None if is_over else _failure(error)
    return None


def compiled(source: str) -> Any:
    """Return the code of a program, in which `asyncio.run` outside of functions awaits. Raise SyntaxError.

    A browser without stack switching cannot wait for a coroutine in a function that does not await.
    """
    tree = ast.fix_missing_locations(_Awaiting().visit(ast.parse(source, FILE)))
    return compile(tree, FILE, "exec", ast.PyCF_ALLOW_TOP_LEVEL_AWAIT)


class _Awaiting(ast.NodeTransformer):
    """Replaces `asyncio.run(main())` by `await main()`."""

    def visit_Call(self, node: ast.Call) -> ast.AST:
        self.generic_visit(node)
        is_run = ast.unparse(node.func) == "asyncio.run" and bool(node.args)
        return ast.copy_location(ast.Await(node.args[0]), node) if is_run else node

    def visit(self, node: ast.AST) -> Any:
        return node if isinstance(node, _FUNCTIONS) else super().visit(node)


def _failure(error: BaseException) -> Failure:
    """Describe an error, with the latest line of the program in the traceback."""
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    own = error.__traceback__
    while own is not None and own.tb_frame.f_code.co_filename != FILE:
        own = own.tb_next
    lines = [frame.lineno or 0 for frame in traceback.extract_tb(own) if frame.filename == FILE]
    message = str(error)
    if isinstance(error, SyntaxError):
        lines, message = [error.lineno or 0], error.msg
    trace = "".join(traceback.format_exception(type(error), error, own))
    return Failure(type(error).__name__, lines[-1] if lines else 0, message, trace)


class _Console(io.TextIOBase):
    """Output for the page, in few messages even in an endless loop."""

    def __init__(self, tell: Callable[[str, str], object]) -> None:
        self._tell = tell
        self._text = ""
        self._told_at = 0.0
        self._timer: asyncio.TimerHandle | None = None

    def write(self, text: str) -> int:
        """Tell the page, or keep the text for a moment."""
        self._text += text
        if len(self._text) > 4 * _HALF:
            self._text = f"{self._text[:_HALF]}\n...\n{self._text[-_HALF:]}"
        if time.monotonic() - self._told_at >= _PAUSE:
            self.pass_on()
        elif self._timer is None:
            self._timer = asyncio.get_running_loop().call_later(_PAUSE, self.pass_on)
        return len(text)

    def pass_on(self) -> None:
        """Send the page the kept text."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self._text:
            self._tell("output", self._text)
            self._text, self._told_at = "", time.monotonic()
