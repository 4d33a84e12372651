"""Every error has a short text that is safe to print."""

from __future__ import annotations

from servolink.errors import DecodeError, escape

_LONGEST = 2000


def check(error: Exception) -> None:
    """Fail unless `error` is safe to print, also by a debugger or a log."""
    for text in (str(error), repr(error)):
        assert escape(text) == text, ascii(text)
    assert 0 < len(str(error)) <= _LONGEST


def check_kept(error: DecodeError, data: bytes) -> None:
    """Fail also unless `error` keeps the bytes it is about."""
    check(error)
    assert error.data == data
