"""Entry point of PyInstaller: the folder of the hook that packs servolink into frozen programs."""

from __future__ import annotations

from pathlib import Path


def hook_folders() -> list[str]:
    """Return the folder of the hook."""
    return [str(Path(__file__).parent)]
