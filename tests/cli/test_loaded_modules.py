"""Modules that a command and `connect` load, and those that they do not."""

from __future__ import annotations

import sys
from pathlib import Path

import servolink
from tests import processes
from tests.cli.programs import environment

PACKAGE = Path(servolink.__file__).parent

DRIVERS = {"serial", "serial_asyncio", "hid", "hidraw", "usb", "libusb_package"}
"""Packages for one kind of address each."""

EXTRAS = {"aiohttp", "foxglove", "gymnasium", "mcap", "mcp", "mujoco", "paho", "prometheus_client", "rclpy", "rich"}
"""Packages for one command or door each."""

LATE = DRIVERS | EXTRAS
"""Packages that are loaded by what needs them only: commands, drivers and extras come late, all else at once."""

LIST_MODULES = """
import shlex, sys
from servolink.__main__ import main
for line in sys.argv[1:]:
    try:
        main(shlex.split(line))
    except SystemExit:
        pass
print(*sys.modules, file=sys.stderr)
"""
"""Runs command lines one after the other."""


NOT_COUNTED = {"COVERAGE_PROCESS_START": "", "COVERAGE_PROCESS_CONFIG": ""}
"""Environment of a program that loads no modules to count the lines that run."""


def loaded_by(folder: Path, program: str, *arguments: str) -> set[str]:
    """Return the modules that `program` prints for a user whose `folder` has neither names nor profiles."""
    homes = dict.fromkeys(("XDG_RUNTIME_DIR", "XDG_CONFIG_HOME", "XDG_DATA_HOME"), str(folder))
    ran = processes.run([sys.executable, "-c", program, *arguments], env=environment(**homes, **NOT_COUNTED))
    return set(ran.stderr.split())


def test_the_help_of_all_commands_loads_no_command(tmp_path: Path) -> None:
    loaded = loaded_by(tmp_path, LIST_MODULES, "--help")
    assert "servolink.cli.main" in loaded
    assert loaded & (LATE | {"servolink.client", "servolink.cli.motion.move"}) == set()


def test_only_what_is_needed_is_loaded(tmp_path: Path) -> None:
    commands = ("move", "stop", "servos", "events", "request")
    changes = ("action add", "table set", "macro delete", "servo trim", "board clear")
    asked = ("info", "servos", "stop --json")
    lines = [
        *(f"{command} --help" for command in (*commands, *changes)),
        "decode 134c051d1a2700000000c5",
        *(f"--url virtual:// {command}" for command in asked),
    ]
    loaded = loaded_by(tmp_path, LIST_MODULES, *lines)
    assert "servolink.cli.motion.move" in loaded
    assert loaded & LATE == set()


def test_connecting_loads_neither_drivers_nor_boards_of_software(tmp_path: Path) -> None:
    program = "import sys, servolink; servolink.connect('virtual://'); print(*sys.modules, file=sys.stderr)"
    loaded = loaded_by(tmp_path, program)
    assert "servolink.client.board" in loaded
    assert loaded & (LATE | {"servolink.cli", "servolink.hub", "servolink.virtual"}) == set()


FIRST_IMPORTS = """
import sys
before = set(sys.modules)
import servolink.__main__
print(*sorted(set(sys.modules) - before))
"""


def test_nothing_that_takes_time_is_imported_where_ctrl_c_is_not_caught_yet() -> None:
    ran = processes.run([sys.executable, "-S", "-c", FIRST_IMPORTS], env=environment(PYTHONPATH=str(PACKAGE.parent)))
    assert ran.stdout.split() == ["__future__", "servolink", "servolink.__main__"]
