"""`servolink project schema`: the form of project files, for editors that complete and check them."""

from __future__ import annotations

import argparse

from servolink.cli.main import OK
from servolink.project.files.schema import schema_text


def configure(command: str, parser: argparse.ArgumentParser) -> None:
    """Add no options."""


def run(args: argparse.Namespace) -> int:
    """Print the schema, which is JSON with `--json` and without."""
    print(schema_text(), end="")
    return OK
