"""Names of the boards with a profile, listed without loading profiles: each connection looks for its own."""

from __future__ import annotations

import os
from contextlib import suppress

from servolink.files import is_name
from servolink.platforms.user_folders import user_folder_name

ENDING = ".toml"
"""Ending of the files of profiles."""


def profiles_folder() -> str:
    """Return the folder of profiles. Raise OSError for a user without a home."""
    return os.path.join(user_folder_name("config"), "profiles")  # noqa: PTH118 - loading `pathlib` takes 3 ms


def profile_names() -> list[str]:
    """Return the names of all boards with a profile; empty for a user without a home."""
    with suppress(OSError):
        files = os.listdir(profiles_folder())  # noqa: PTH208 - loading `pathlib` takes 3 ms
        return sorted(name for file in files if file.endswith(ENDING) and is_name(name := file.removesuffix(ENDING)))
    return []
