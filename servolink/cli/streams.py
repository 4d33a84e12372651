"""Standard streams that are closed, or that take nothing any more."""

from __future__ import annotations

import errno
import os
import sys

_TAKES_NO_MORE = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF}


def open_missing_stderr() -> None:
    """Give errors a place where standard error is closed: to `print`, no file means standard output."""
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 - to the end


def flush_stdout() -> None:
    """Write what is still to be written to standard output."""
    if sys.stdout is not None:
        sys.stdout.flush()


def print_error(text: str) -> None:
    """Print a line on standard error, if that takes it."""
    try:
        print(text, file=sys.stderr, flush=True)
    except OSError:
        silence(2)


def silence(descriptor: int) -> None:
    """Let a stream that cannot be written swallow everything, so that Python does not fail again at its end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), descriptor)


def lost_output(error: OSError) -> str:
    """Say that standard output cannot be written, if that is what `error` is about; it is silenced then.

    A failed `print` names no file and leaves nothing in the stream that would fail again.
    """
    if error.filename is not None or error.errno not in _TAKES_NO_MORE:
        return ""
    silence(1)
    return f"standard output cannot be written: {error.strerror}"
