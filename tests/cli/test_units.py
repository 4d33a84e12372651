"""Units for systemd: each starts a command that there is."""

from __future__ import annotations

import configparser
import shlex
from pathlib import Path

import pytest

from servolink.cli.command_line import parser_of
from tests.test_release import UNITS


def start_of(unit: Path) -> list[str]:
    read = configparser.ConfigParser(interpolation=None)
    read.optionxform = str  # type: ignore[assignment,method-assign]  # as the documentation of `configparser` shows
    read.read(unit, encoding="utf-8")
    return shlex.split(read["Service"]["ExecStart"].replace("%i", "rex"))


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.stem)
def test_a_unit_starts_a_command_that_there_is(unit: Path) -> None:
    program, *arguments = start_of(unit)
    assert program == "%h/.local/bin/servolink"
    args = parser_of().parse_args(arguments)
    assert callable(args.run)
