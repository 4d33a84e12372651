"""What may be typed as the value of an option; argparse makes wrong usage of the rest."""

from __future__ import annotations

import argparse


def not_empty(text: str) -> str:
    """Read a name that must not be empty, as from a variable of a shell that was never set."""
    if not text:
        raise argparse.ArgumentTypeError("it is empty; leave it out, or say which")
    return text
