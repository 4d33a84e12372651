"""Many boards on many machines, through an MQTT broker.

async with servolink.fleet.connect("mqtt://teacher.local") as fleet:
    await fleet.run("Wave", on="front,rex")
    await fleet.stop()
"""

from __future__ import annotations

TYPE_CHECKING = False  # as type checkers know it, without the import

if TYPE_CHECKING:
    from servolink.fleet.access import broker_access as broker_access
    from servolink.fleet.client import Fleet as Fleet
    from servolink.fleet.client import connect as connect

__all__ = ["Fleet", "broker_access", "connect"]

_MODULES = {
    "Fleet": "servolink.fleet.client",
    "broker_access": "servolink.fleet.access",
    "connect": "servolink.fleet.client",
}


def __getattr__(name: str) -> object:
    """Return a public name and import the module on first use: the extra `fleet` may be missing."""
    if name not in _MODULES:
        raise AttributeError(f"module 'servolink.fleet' has no attribute {name!r}")
    from importlib import import_module

    try:
        value: object = getattr(import_module(_MODULES[name]), name)
    except ModuleNotFoundError as error:
        from servolink.errors import ServolinkError, install_extra

        raise ServolinkError(f"servolink fleet needs paho-mqtt; {install_extra('fleet')}") from error
    globals()[name] = value
    return value
