"""Packages of extras: those that the tests do not bring, and those that are missing for a test."""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.util import find_spec

import pytest

NEEDED = {
    "servolink.gateways.metrics.exposition": "prometheus_client",
    "servolink.gateways.models.figure_picture": "PIL",
    "servolink.gateways.foxglove.live_channels": "foxglove",
    "servolink.gateways.foxglove.live_server": "foxglove",
    "servolink.gateways.models.model_results": "pydantic",
    "servolink.gateways.models.model_serving": "mcp",
    "servolink.gateways.ros.ros_node": "rclpy",
    "servolink.gateways.models.model_tools": "mcp",
    "servolink.twin.gym": "gymnasium",
}


def not_importable() -> set[str]:
    """Return the modules whose package is not installed."""
    return {module for module, package in NEEDED.items() if find_spec(package) is None}


def hide(package: str, room: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let `package` be missing for `room`, as if neither had been imported yet."""
    door = import_module(room)
    for name in door.__all__:
        monkeypatch.delitem(vars(door), name, raising=False)
    for module in [name for name in sys.modules if name.startswith((f"{room}.", f"{package}."))]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, package, None)
