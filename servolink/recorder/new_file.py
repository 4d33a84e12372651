"""Files made from recordings: written whole or not at all, replacing another file only on request."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from servolink.errors import RecordingError
from servolink.support import atomic_file, reason


def check_free(path: Path, *, replace: bool) -> None:
    """Raise RecordingError if no file can be written at `path`, or a file exists there and `replace` is not set."""
    with naming(path):
        if path.exists():
            if not path.is_file():
                raise RecordingError(f"{path} is not a regular file, and stays unchanged; choose another name")
            if not replace:
                raise RecordingError(f"{path} exists already; --force replaces it")
        if not path.parent.is_dir():
            raise RecordingError(f"{path} cannot be written: the folder does not exist; create it first")


@contextmanager
def new_file(path: Path, *, replace: bool, private: bool = False) -> Iterator[BinaryIO]:
    """Yield a file that appears at `path` when the context ends; after any failure, `path` stays unchanged.

    With `private`, only the owner can read a new file. Raise RecordingError if a file exists and `replace` is not set,
    and for an error of the system.
    """
    check_free(path, replace=replace)
    with naming(path), atomic_file(path, private=private) as file:
        yield file


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Raise RecordingError, with the name of the file, for an error of writing in this context."""
    try:
        yield
    except RecordingError:
        raise
    except (OSError, ValueError) as error:
        raise RecordingError(f"{path} cannot be written: {reason(error)}") from error
