"""Hub: process that owns a board and shares the board with any number of programs.

async with servolink.hub.serve_board("/dev/ttyACM0", name="rex") as (hub, urls):
    ...  # programs connect to share://rex
"""

from __future__ import annotations

TYPE_CHECKING = False

if TYPE_CHECKING:
    from servolink.hub.doors.in_process import LocalTransport as LocalTransport
    from servolink.hub.hub import Hub as Hub
    from servolink.hub.hub import share as share
    from servolink.hub.methods.control_session import METHODS as METHODS
    from servolink.hub.serving import hub_of_board as hub_of_board
    from servolink.hub.serving import serve_board as serve_board
else:
    # Lazy imports: each of these modules imports other modules of the package.
    _MODULES = {
        "Hub": "servolink.hub.hub",
        "LocalTransport": "servolink.hub.doors.in_process",
        "METHODS": "servolink.hub.methods.control_session",
        "hub_of_board": "servolink.hub.serving",
        "serve_board": "servolink.hub.serving",
        "share": "servolink.hub.hub",
    }
    __all__ = [*_MODULES]  # noqa: PLE0604 - the keys are strings

    def __getattr__(name: str) -> object:
        if name not in _MODULES:
            raise AttributeError(f"module 'servolink.hub' has no attribute {name!r}")
        from importlib import import_module

        value = getattr(import_module(_MODULES[name]), name)
        globals()[name] = value
        return value
