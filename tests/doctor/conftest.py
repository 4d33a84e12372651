"""The virtual board that commands are tried on."""

from tests.cli.conftest import robot

__all__ = ["robot"]
