"""Where Wireshark looks for the plugins of a user, and how the dissector gets there."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path

from servolink.errors import ServolinkError
from servolink.files import MIB, read_file, reason, write_atomically
from servolink.wireshark.dissector import FIRST_LINE

FILE_NAME = "servolink.lua"


def plugin_folder(platform: str = sys.platform, environment: Mapping[str, str] = os.environ) -> Path:
    """Return the folder of personal Lua plugins that the User's Guide of Wireshark names, whether it exists or not.

    Raise ServolinkError for a user without a home.
    """
    variable, folders = (
        ("APPDATA", "Wireshark/plugins") if platform == "win32" else ("HOME", ".local/lib/wireshark/plugins")
    )
    if not (home := environment.get(variable)):
        raise ServolinkError(f"{variable} is not set, so Wireshark has no personal plugins; set it, or print the text")
    return Path(home, folders)


def install(text: str) -> Path:
    """Write the dissector into the folder of personal plugins and return its path. Replace only an older one."""
    path = plugin_folder() / FILE_NAME
    try:
        if path.exists() and not read_file(path, MIB).startswith(FIRST_LINE.encode()):
            raise ServolinkError(f"{path} was not written by servolink; remove it, or print the text and keep both")
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, text.encode())
    except (OSError, ValueError) as error:
        raise ServolinkError(f"{path} cannot be written: {reason(error)}") from error
    return path
