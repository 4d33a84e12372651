"""`servolink completion`: a script that completes commands, options and files in a shell."""

from __future__ import annotations

import argparse

import shtab

from servolink.cli.main import OK
from servolink.cli.parser import Parser, build_parser

_INSTALLING = """
Save what it prints where your shell looks for it, and start a new shell:
  bash  ~/.local/share/bash-completion/completions/servolink
  zsh   _servolink, in a folder of $fpath
  fish  ~/.config/fish/completions/servolink.fish"""
_FILES = {"FILE", "OTHER", "OUT", "BACKUP"}  # metavars


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink completion`."""
    parser.set_defaults(run=run)
    parser.description = f"{parser.description}\n{_INSTALLING}"
    parser.add_argument("shell", choices=("bash", "zsh", "fish"), metavar="bash|zsh|fish", help="for which shell")


def run(args: argparse.Namespace) -> int:
    """Print the script, which knows all commands and asks no Python at the keyboard."""
    parser = build_parser()
    _prepare(parser)
    print(shtab.complete(parser, args.shell), flush=True)
    return OK


def _prepare(parser: Parser) -> None:
    """Load all options below `parser`, and mark those that take a file."""
    parser.load()
    for action in parser._actions:  # noqa: SLF001 - argparse has no other way to walk over them, and shtab takes it too
        if action.metavar in _FILES:
            action.complete = shtab.FILE  # type: ignore[attr-defined]  # how shtab is told
    if parser.commands:
        parser.commands.help = None  # `servolink --help` lists them by topic and hides this
        for command in parser.commands.choices.values():
            _prepare(command)
