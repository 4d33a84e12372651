"""Commands in this process, in a pipe and in a real terminal: a process for each would take half a second."""

from __future__ import annotations

import fcntl
import io
import os
import re
import select
import struct
import sys
import termios
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from tests.cli.programs import Said, exit_code
from tests.processes import LIMIT

_COLUMNS, _LINES = 2000, 50
"""Wide, so that nothing is wrapped, and texts of different lengths come with the same escapes."""

ESCAPE = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")
"""What this program's own colours, bars and tables are made of."""


def in_pipe(*arguments: str, encoding: str = "utf-8") -> Said:
    """Run a command whose output nobody sees at once."""
    out, err = (io.TextIOWrapper(io.BytesIO(), encoding=encoding, newline="\n") for _ in range(2))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "stdout", out)
        patch.setattr(sys, "stderr", err)
        code = exit_code(arguments)
    texts = []
    for stream in (out, err):
        stream.seek(0)
        texts.append(stream.read())
    assert "internal error" not in texts[1]
    return Said(code, *texts)


def in_terminal(*arguments: str, typed: str = "", encoding: str = "utf-8") -> Said:
    """Run a command in a terminal, to which it says everything; what it got is in `out`.

    `typed` are the lines that it will be asked for. There are no single keys: the terminal is not this process's own.
    """
    with _terminal(typed) as (theirs, heard), pytest.MonkeyPatch.context() as patch:
        for name in ("NO_COLOR", "FORCE_COLOR"):
            patch.delenv(name, raising=False)
        for name, value in (("TERM", "xterm-256color"), ("COLUMNS", str(_COLUMNS)), ("LINES", str(_LINES))):
            patch.setenv(name, value)
        with (
            open(theirs, "w", encoding=encoding, newline="\n", closefd=False) as out,
            open(theirs, "w", encoding=encoding, newline="\n", closefd=False) as err,
            open(theirs, encoding=encoding, closefd=False) as stdin,
        ):
            for name, stream in (("stdout", out), ("stderr", err), ("stdin", stdin)):
                patch.setattr(sys, name, stream)
            code = exit_code(arguments)
    assert b"internal error" not in heard
    return Said(code, bytes(heard).decode(encoding), "")


@contextmanager
def _terminal(typed: str) -> Iterator[tuple[int, bytearray]]:
    """Make a terminal that passes on what is written to it as it is; yield its descriptor and what it gets."""
    ours, theirs = os.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", _LINES, _COLUMNS, 0, 0))
    modes = termios.tcgetattr(theirs)
    modes[1] &= ~termios.OPOST
    modes[3] &= ~termios.ECHO
    termios.tcsetattr(theirs, termios.TCSANOW, modes)
    if typed:
        os.write(ours, typed.encode())
        assert select.select([theirs], [], [], LIMIT)[0]
    heard = bytearray()

    def listen() -> None:
        while chunk := _read(ours):
            heard.extend(chunk)

    listening = threading.Thread(target=listen)
    listening.start()
    try:
        yield theirs, heard
    finally:
        os.close(theirs)
        listening.join()
        os.close(ours)


def _read(terminal: int) -> bytes:
    try:
        return os.read(terminal, 65536)
    except OSError:  # EIO: nobody has the other end any more
        return b""
