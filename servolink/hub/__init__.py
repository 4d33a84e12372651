"""Hub: process that owns a board and shares the board with any number of programs.

async with servolink.hub.serve_board("/dev/ttyACM0", name="rex") as (hub, urls):
    ...  # programs connect to share://rex
"""

from __future__ import annotations

from servolink.hub.doors.direct import DirectProgram
from servolink.hub.engine.program import FrameProgram
from servolink.hub.hub import Hub, share
from servolink.hub.methods.control_session import METHODS, ControlInterface
from servolink.hub.rules.exchanges import Exchange, RoundRobin
from servolink.hub.serving import default_name, hub_of_board, serve_board

__all__ = [
    # hub
    "ControlInterface",
    "DirectProgram",
    "Exchange",
    "FrameProgram",
    "Hub",
    "METHODS",
    "RoundRobin",
    "default_name",
    "hub_of_board",
    "serve_board",
    "share",
]
