"""Files that are read whole while the event loop waits: only such as end, and at once."""

from __future__ import annotations

import errno
from pathlib import Path


def read_file(path: Path) -> bytes:
    """Return what a file holds; OSError says why not, also for a pipe or a device, which may never come to an end."""
    if path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, "it is no regular file", str(path))
    return path.read_bytes()
