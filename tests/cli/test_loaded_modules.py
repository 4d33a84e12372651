"""Modules that a command and `connect` load, and those that they do not."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

import servolink
from tests import processes
from tests.cli.programs import environment

PACKAGE = Path(servolink.__file__).parent

HEAVY = {
    "asyncio",
    "rich",
    "serial",
    "serial_asyncio",
    "hid",
    "hidraw",
    "usb",
    "ssl",
    "servolink.client",
}

NOT_FOR_CONNECTING = {
    "copy",
    "pathlib",
    "unicodedata",
    "servolink.client.captions",
    "servolink.client.reconnect",
    "servolink.connection.evidence",
    "servolink.pauses",
    "servolink.project",
    "servolink.protocol.lenient",
    "servolink.transports.base",
    "servolink.transports.foreign",
}
"""Modules for captions, losses, errors, rare boards and text outside ASCII, of the system and of servolink."""

MOST_FOR_CONNECTING = 65
"""Modules of servolink, with packages."""

NOT_FOR_SERVOS = {
    "copy",
    "termios",
    "servolink.discovery.names",
    "servolink.discovery.search",
    "servolink.profiles.store",
    "servolink.virtual.state_file",
} | ({"pathlib", "platformdirs"} if sys.platform == "linux" else set())
"""Modules that find boards and profiles, for an address where nothing has a profile, and that read keys."""

LIST_MODULES = """
import sys
from servolink.__main__ import main
try:
    main(sys.argv[1:])
finally:
    print(*sys.modules, file=sys.stderr)
"""


NOT_COUNTED = {"COVERAGE_PROCESS_START": "", "COVERAGE_PROCESS_CONFIG": ""}
"""Environment of a program that loads no modules to count the lines that run."""


def loaded_by(folder: Path, program: str, *arguments: str) -> set[str]:
    """Return the modules that `program` prints for a user whose `folder` has neither names nor profiles."""
    homes = dict.fromkeys(("XDG_RUNTIME_DIR", "XDG_CONFIG_HOME", "XDG_DATA_HOME"), str(folder))
    ran = processes.run([sys.executable, "-c", program, *arguments], env=environment(**homes, **NOT_COUNTED))
    return set(ran.stderr.split())


@pytest.mark.parametrize(
    ("arguments", "unwanted"),
    [
        (("--help",), HEAVY | {"msgspec"}),
        *(
            ((command, "--help"), HEAVY - {"asyncio", "ssl"} | {"msgspec"})
            for command in ("move", "stop", "servos", "events")
        ),
        *(
            ((*command.split(), "--help"), HEAVY - {"asyncio", "ssl"} | {"msgspec"})
            for command in ("action add", "table set", "macro delete", "servo trim", "board clear")
        ),
        (("request", "--help"), HEAVY - {"asyncio", "ssl"}),
        (("decode", "134c051d1a2700000000c5"), HEAVY),
        (("--url", "virtual://", "info"), {"rich", "serial", "hid", "hidraw", "usb"}),
        (("--url", "virtual://", "servos"), NOT_FOR_SERVOS),
        (("--url", "virtual://", "stop", "--json"), {"rich", "serial", "hid", "hidraw", "usb"}),
    ],
)
def test_only_what_is_needed_is_loaded(arguments: tuple[str, ...], unwanted: set[str], tmp_path: Path) -> None:
    loaded = loaded_by(tmp_path, LIST_MODULES, *arguments)
    assert "servolink.cli.main" in loaded
    assert loaded & unwanted == set()


def test_connecting_loads_neither_searches_nor_other_kinds_of_address(tmp_path: Path) -> None:
    program = "import sys, servolink; servolink.connect('virtual://'); print(*sys.modules, file=sys.stderr)"
    loaded = loaded_by(tmp_path, program)
    assert "servolink.client.board" in loaded
    assert loaded & (HEAVY - {"asyncio", "ssl", "servolink.client"}) == set()
    assert (
        loaded & {"servolink.cli", "servolink.discovery", "servolink.transports.serial_ports", "servolink.virtual"}
        == set()
    )
    assert loaded & NOT_FOR_CONNECTING == set()
    own = [name for name in loaded if name.partition(".")[0] == "servolink"]
    assert len(own) <= MOST_FOR_CONNECTING, "each module takes 0.1 ms: import it where it is used"


FIRST_IMPORTS = """
import sys
before = set(sys.modules)
import servolink.__main__
print(*sorted(set(sys.modules) - before))
"""


def test_nothing_that_takes_time_is_imported_where_ctrl_c_is_not_caught_yet() -> None:
    ran = processes.run([sys.executable, "-S", "-c", FIRST_IMPORTS], env=environment(PYTHONPATH=str(PACKAGE.parent)))
    assert ran.stdout.split() == ["__future__", "servolink", "servolink.__main__"]
