"""Virtual time for the tests of servolink itself."""

from __future__ import annotations

from servolink.testing import VirtualTimeLoop, run

__all__ = ["VirtualTimeLoop", "run"]
