"""Imports every module of the core rooms, and prints as JSON which cannot be imported and why."""

from __future__ import annotations

import importlib
import json
import pkgutil

import servolink

BEYOND = {"cli", "doctor", "fleet", "gateways", "studio"}
"""Rooms that may need an operating system, a driver or an extra."""


def main() -> None:
    failures = {}
    for module in pkgutil.walk_packages(servolink.__path__, "servolink."):
        if module.name.split(".")[1] not in {*BEYOND, "__main__"}:
            try:
                importlib.import_module(module.name)
            except Exception as error:  # noqa: BLE001 - all are printed
                failures[module.name] = repr(error)
    print(json.dumps(failures))
