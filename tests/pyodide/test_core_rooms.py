"""Core rooms know no system and no driver: without packages, and in Pyodide, all can be imported, and servos move."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from tests import processes
from tests.sampling import every

HERE = Path(__file__).parent
_LONG = 1200
"""Seconds for all packets of an import on the slowest machine."""
DRIVERS = {
    "servolink.boards.toml_changes": "tomlkit",
    "servolink.transports.listeners.http_connections": "aiohttp",
    "servolink.transports.serial": "serial",
    "servolink.transports.usb": "usb",
    "servolink.transports.usb_devices": "usb",
}
"""Modules that are imported only where they are needed, and the package that may be missing."""


@pytest.fixture(
    params=[
        "tests.pyodide.lacking packages",
        "tests.pyodide.lacking system",
        pytest.param("tests.pyodide", marks=pytest.mark.pyodide),
    ]
)
def python(request: pytest.FixtureRequest) -> list[str]:
    """The command of a Python without drivers and extras."""
    return [sys.executable, "-W", "error", "-m", *request.param.split()]


def printed(python: list[str], file: str, *arguments: str, limit: float = processes.LIMIT) -> Any:
    """Return what a file of this folder prints, as JSON; it must not complain."""
    done = processes.run([*python, str(HERE / file), *arguments], limit=limit, cwd=HERE.parents[1], check=True)
    assert done.stderr == ""
    return json.loads(done.stdout)


def test_all_modules_but_drivers_can_be_imported(python: list[str]) -> None:
    failures = printed(python, "import_rooms.py")
    gym = failures.pop("servolink.twin.gym")
    assert gym.startswith('TwinError("the environment needs Gymnasium; ')
    assert failures.keys() == DRIVERS.keys()
    assert all(driver in failures[module] for module, driver in DRIVERS.items())


def test_servos_of_a_virtual_board_move(python: list[str]) -> None:
    assert printed(python, "move_servo.py") == {"1": 30, "2": -20}


def test_servos_move_through_a_hub_of_the_same_process(python: list[str]) -> None:
    angles = printed(python, "through_hub.py")
    assert (angles["1"], angles["2"]) == (30, -20)


def test_every_query_is_answered_on_a_line_that_loses_bytes(python: list[str]) -> None:
    assert printed(python, "lossy_line.py") == {"1": 50, "2": 50}


@pytest.mark.pyodide
@pytest.mark.timeout(_LONG)
@every(13)
def test_after_a_page_that_ends_before_any_packet_the_next_visit_goes_on(step: int) -> None:
    assert (
        printed([sys.executable, "-m", "tests.pyodide"], "interrupted_visit.py", str(step), limit=_LONG) >= 60 // step
    )
