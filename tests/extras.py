"""Modules that need packages of the extras which the tests do not bring."""

from __future__ import annotations

from importlib.util import find_spec

NEEDED = {
    "servolink.fleet.metrics": "prometheus_client",
    "servolink.gateways.figure_picture": "PIL",
    "servolink.gateways.live_channels": "foxglove",
    "servolink.gateways.live_server": "foxglove",
    "servolink.gateways.model_serving": "mcp",
    "servolink.gateways.model_tools": "mcp",
    "servolink.twin.gym": "gymnasium",
}


def not_importable() -> set[str]:
    """Return the modules whose package is not installed."""
    return {module for module, package in NEEDED.items() if find_spec(package) is None}
