"""Options of `servolink virtual`: each is that of the kind of the board."""

from __future__ import annotations

import argparse

import pytest

from servolink.cli.developers import virtual as command
from servolink.virtual import BoardKind
from tests.virtual.test_kind import RIGHT, WRONG


def parsed(*args: str) -> BoardKind:
    parser = argparse.ArgumentParser(exit_on_error=False)
    for option in command.run.options:
        option.add_to(parser)
    values = vars(parser.parse_args(args))
    return BoardKind(**{kind.name: values[kind.name] for kind in BoardKind.options()})


@pytest.mark.parametrize("name", RIGHT)
def test_an_option_means_the_same_as_in_an_address(name: str) -> None:
    text, value = RIGHT[name]
    kind, flag = BoardKind(**{name: value}), "--" + name.replace("_", "-")
    assert parsed(flag, *([] if value is True else [text])) == kind


@pytest.mark.parametrize(("name", "text"), [(name, text) for name, texts in WRONG.items() for text in texts])
def test_a_wrong_value_is_refused(name: str, text: str) -> None:
    with pytest.raises((argparse.ArgumentError, SystemExit)):
        parsed("--" + name.replace("_", "-"), text)
