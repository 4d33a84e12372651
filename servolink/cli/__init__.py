"""The `servolink` command: one file per group of commands."""

from __future__ import annotations

from servolink.cli.main import run

__all__ = ["run"]
