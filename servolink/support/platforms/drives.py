"""Mounted drives."""

from __future__ import annotations

import re
import string
import sys
from pathlib import Path

_ESCAPED = re.compile(r"\\([0-7]{3})")
"""Character of a mount point as Linux lists it: a backslash and three octal digits."""

if sys.platform == "win32":

    def mounted_drives() -> list[Path]:
        """Return all drive letters, whether or not there is a drive."""
        return [Path(f"{letter}:\\") for letter in string.ascii_uppercase]

elif sys.platform == "darwin":

    def mounted_drives() -> list[Path]:
        """Return the folders of all mounted volumes."""
        return sorted(Path("/Volumes").iterdir())

else:

    def mounted_drives() -> list[Path]:
        """Return the mount points of all file systems."""
        mounts = Path("/proc/self/mounts").read_text("utf-8", "surrogateescape")
        places = (line.split(" ")[1] for line in mounts.splitlines())
        return [Path(_ESCAPED.sub(lambda code: chr(int(code[1], 8)), place)) for place in places]
