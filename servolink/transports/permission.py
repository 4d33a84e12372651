"""Whether this user may open a device, asked without opening it."""

from __future__ import annotations

import os

UDEV_CURE = "`servolink doctor --print-udev` prints the udev rule that gives it, and where to put it"
"""What to do about a USB device that may not be opened, on Linux."""


def may_use(path: str) -> bool:
    """Tell whether this process may read and write `path`; yes if there is no such file, as on other systems."""
    try:
        os.stat(path)  # noqa: PTH116 - a port's or device's name need not be that of a file
    except PermissionError:
        return False
    except OSError:
        return True
    return os.access(path, os.R_OK | os.W_OK, effective_ids=os.access in os.supports_effective_ids)
