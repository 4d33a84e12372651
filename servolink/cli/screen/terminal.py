"""The terminal: questions, single keys, and its state before and after."""

from __future__ import annotations

import asyncio
import os
import re
import sys
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from typing import NoReturn

from servolink.cli.screen.output import Form, print_error
from servolink.errors import escape
from servolink.support import begin_keys, read_line

_cleanups: list[Callable[[], object]] = []


@contextmanager
def cleanup(act: Callable[[], object]) -> Iterator[None]:
    """Call `act` at the end, also when the process ends at once (see `end_process`)."""
    _cleanups.append(act)
    try:
        yield
    finally:
        _cleanups.remove(act)
        act()


def end_process(code: int) -> NoReturn:
    """End the process without waiting for anything but the calls promised by `cleanup`."""
    for act in reversed(_cleanups):
        with suppress(Exception):  # closed terminal
            act()
    os._exit(code)


def can_ask() -> bool:
    """Return whether somebody can be asked: no JSON is printed, and input and standard error are a terminal."""
    return bool(not Form.json and sys.stdin and sys.stdin.isatty() and sys.stderr and sys.stderr.isatty())


async def confirm(question: str) -> bool:
    """Ask `question` on standard error and return whether the answer is yes; Ctrl-D is a no.

    Call it only if `can_ask()`. The loop and signals keep working meanwhile.
    """
    return await _confirm(question)


async def confirm_motion(question: str) -> bool:
    """As `confirm`, for a motion of another program: what was typed before the question is no answer to it."""
    return await _confirm(question, typed_from_now=True)


async def wait_for_enter(request: str) -> bool:
    """Print `request` on standard error and return whether Enter alone was pressed; Ctrl-D is a no.

    Call it only if `can_ask()`.
    """
    return await _answer_to(request) == "\n"


async def _confirm(question: str, *, typed_from_now: bool = False) -> bool:
    answer = await _answer_to(f"{question} [y/N] ", typed_from_now=typed_from_now)
    return answer.strip().lower() in ("y", "yes")


async def _answer_to(request: str, *, typed_from_now: bool = False) -> str:
    """Print `request` on standard error and return the typed line; the next message starts a line in any case."""
    print(escape(request), end="", file=sys.stderr, flush=True)
    try:
        answer = await read_line(typed_from_now=typed_from_now)
    except asyncio.CancelledError:
        print_error("")
        raise
    if not answer.endswith("\n"):
        print_error("")
    return answer


@contextmanager
def single_keys(typed: Callable[[str], None]) -> Iterator[bool]:
    """Call `typed` with each key, without echo. Yield False, and call nothing, if there is no keyboard to read."""
    end = begin_keys(typed)
    if end is None:
        yield False
    else:
        with cleanup(end):
            yield True


@contextmanager
def typed_keys() -> Iterator[asyncio.Queue[str] | None]:
    """Yield a queue of typed keys, named as by `keys_in`; None without a keyboard."""
    keys: asyncio.Queue[str] = asyncio.Queue()

    def typed(text: str) -> None:
        for key in keys_in(text):
            keys.put_nowait(key)

    with single_keys(typed) as keyboard:
        yield keys if keyboard else None


@asynccontextmanager
async def until_quit(seconds: float | None) -> AsyncIterator[None]:
    """End the context, without an error, after some seconds or when `q` is pressed."""
    limit = asyncio.timeout(seconds)
    try:
        async with limit:
            with single_keys(lambda keys: limit.reschedule(0.0) if "q" in keys.lower() else None):
                yield
    except TimeoutError:
        if not limit.expired():  # timeout of a request in the context
            raise


_KEY = re.compile(r"\x1b[\[O][0-9;]*[A-Za-z~]|.", re.DOTALL)
_ARROWS = {"A": "up", "B": "down", "C": "right", "D": "left", "1;2C": "shift-right", "1;2D": "shift-left"}
_NAMES = {"\x1b": "esc", "\r": "enter", "\n": "enter", "\t": "tab", " ": "space"}


def keys_in(text: str) -> list[str]:
    """Return the keys of a text that `single_keys` passed on: characters, and names such as `up`, `enter` and `esc`.

    Other keys that are typed as several characters are left out. A terminal that is gone counts as `esc`.
    """
    keys = [_NAMES.get(one, one) if len(one) == 1 else _ARROWS.get(one[2:], "") for one in _KEY.findall(text)]
    return [key for key in keys if key] if text else ["esc"]
