"""The index of commands: what `servolink --help` and completion know is what the commands declare."""

from __future__ import annotations

import sys
from pathlib import Path

from docs.command_index import entries, text
from servolink.cli.index import TABLE, below, index, load
from tests import processes
from tests.tables import over


def test_the_index_is_made_from_the_declarations() -> None:
    assert Path(str(TABLE)).read_text(encoding="ascii") == text(), "run: python -m docs.command_index"
    assert index() == entries()


@over("name", [name for name in index() if name])
def test_a_command_is_declared_where_the_index_says(name: str) -> None:
    command, entry = load(name), index()[name]
    assert (command.name, command.topic, command.help) == (name, entry.topic, entry.help)
    assert (command.run is None) <= bool(below(name)), "it runs nothing and has no subcommands"


def test_a_command_imports_no_other() -> None:
    code = (
        "import sys\n"
        "from servolink.cli.command_line import parser_of\n"
        "parser_of().parse_args(['stop'])\n"
        "print(*(name for name in sys.modules if name.startswith('servolink.cli.')))"
    )
    loaded = processes.run([sys.executable, "-c", code]).stdout.split()
    folders = {name.split(".")[2] for name in loaded if name.count(".") > 2}
    assert "servolink.cli.motion.move" in loaded
    assert folders <= {"motion", "screen"}
