"""`servolink complete`, which the scripts of `servolink completion` run at each press of Tab.

It imports no other command and opens no board: commands and options come from the index, names from files of this user.
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from importlib import import_module
from typing import Any

from servolink.boards import Aliases
from servolink.cli.command import Command, option
from servolink.cli.index import below, index
from servolink.cli.usage import VARIABLES
from servolink.errors import ServolinkError
from servolink.project import BackupStore, load_project
from servolink.protocol import ACTION, MACRO, SERVO_PARAMETER, TABLE, StoredType
from servolink.support import ExitCode
from servolink.transports import DeviceInfo

_FILES = {"FILE", "OTHER", "OUT", "FOLDER", "LINK", "BACKUP"}  # metavars
_KINDS = (("transports", "serial_devices"), ("boards", "announced_boards"), ("boards", "running_hubs"))
"""Modules that find boards without opening ports; modules for HID and USB take too long to import."""
_PLAIN = re.compile(r"[^\w@%+=:,./-]")


@Command(
    "complete",
    help="print how the last word of a command line may go on",
    examples=("complete bash -- 'servolink mo'", "complete zsh -- move --du"),
    options=(
        option("shell", "bash|zsh|fish", "which one asks"),
        option("words", "WORD", "after servolink; for bash the whole line", nargs="*", default=[]),
    ),
    takes_board=False,
)
def run(args: argparse.Namespace) -> int:
    """Print a line for each possibility; fail if the name of a file is wanted."""
    words = args.words
    if args.shell == "bash":
        try:
            words = _words(" ".join(words))
        except ValueError:  # a quotation is open
            return ExitCode.OK
    found = _TypedLine(words or [""]).possible()
    if found is None:
        return ExitCode.FAILED
    last = words[-1] if words else ""
    for word in dict.fromkeys(found):
        if word.startswith(last) and word.isprintable():
            print(_in_bash(word, last) if args.shell == "bash" else word)
    return ExitCode.OK


def _words(line: str) -> list[str]:
    """Return the words after the name of the program; the last one is empty behind a space. ValueError in quotes."""
    words = shlex.split(line)
    words = words[1 + next((at for at, word in enumerate(words) if "=" not in word), 0) :]  # behind FOO=1 servolink
    return words if line == line.rstrip() or line.endswith("\\ ") else [*words, ""]


def _in_bash(word: str, last: str) -> str:
    """Return a word in place of `last`, quoted, without the part before the last word break of bash."""
    start = max(last.rfind("="), last.rfind(":")) + 1
    return _PLAIN.sub(r"\\\g<0>", word[start:])


class _TypedLine:
    """A command line up to the cursor."""

    def __init__(self, words: Sequence[str]) -> None:
        """Store the words; the last word, possibly empty, is to be completed."""
        *before, self._last = words
        self._name = ""
        self._given: list[str] = []
        self._waiting: list[str] = []  # metavars of values that come next
        self._board = next(filter(None, map(os.environ.get, VARIABLES)), "")
        for word in before:
            self._take(word)

    def _take(self, word: str) -> None:
        if self._waiting:
            if self._waiting.pop(0) == "BOARD":
                self._board = word
        elif word.startswith("-"):
            flag, equals, value = word.partition("=")
            metavars = (index()[self._name].options.get(flag) or "").split()
            if metavars == ["BOARD"] and equals:
                self._board = value
            self._waiting = [] if equals else metavars
        elif word in below(self._name):
            self._name = f"{self._name} {word}".lstrip()
        else:
            self._given.append(word)

    def possible(self) -> Iterable[str] | None:
        """Return candidates for the last word; None for file names."""
        entry = index()[self._name]
        if self._waiting:
            return self._values(self._waiting[0])
        if self._last.startswith("-"):
            flag, equals, _ = self._last.partition("=")
            values = self._values(entry.options.get(flag) or "") if equals else ()
            return values and [f"{flag}={value}" for value in values] if equals else entry.options
        if (subcommands := below(self._name)) and not self._given:
            return (name for name, each in subcommands.items() if self._name or each.topic)
        arguments = [*entry.arguments, *entry.arguments[-1:]] if entry.arguments else [""]
        at = min(len(self._given), len(entry.arguments))
        is_over = at == len(entry.arguments) and not arguments[-1].endswith("...")
        return () if is_over else self._values(arguments[at].removesuffix("..."))

    def _values(self, metavar: str) -> Iterable[str] | None:
        """Return known values of an option or an argument; None if they are names of files."""
        about = self._name.partition(" ")[0].removesuffix("s")
        if "|" in metavar:
            return metavar.split("|")
        if metavar in _FILES:
            return None
        if metavar == "COMMAND":
            return below(" ".join(self._given))
        if metavar in {"BOARD", "PORT"} or (metavar == "NAME" and about in {"board", "use"}):
            return _boards()
        if metavar.startswith("SERVO"):
            equals = "=" if metavar.startswith("SERVO=") else ""
            return [f"{caption}{equals}" for caption in self._captions("servo")]
        if metavar == "NAME":
            return self._captions(self._given[0] if about == "run" and self._given else about)
        return ()

    def _captions(self, noun: str) -> Iterator[str]:
        """Yield the captions in the latest backup of the board."""
        kinds: dict[str, StoredType[Any]] = {"action": ACTION, "macro": MACRO, "table": TABLE, "servo": SERVO_PARAMETER}
        if noun not in kinds:
            return
        with suppress(ServolinkError):
            if (path := BackupStore().latest(*_addresses(self._board))) is not None:
                kind, project = kinds[noun], load_project(path, unchecked=True)
                yield from filter(None, map(kind.caption_of, kind.by_id(project).values()))


def _boards() -> Iterator[str]:
    """Yield names and addresses of boards."""
    with suppress(ServolinkError):
        yield from Aliases.load()
    yield from (device.url for device in _devices())


def _devices() -> Iterator[DeviceInfo]:
    for room, search in _KINDS:
        with suppress(Exception):  # missing or broken library, with any exception
            yield from getattr(import_module(f"servolink.{room}"), search)()


def _addresses(board: str) -> Iterator[str]:
    """Yield the address of the named or only board, and the address shared by the hub of the board."""
    devices = [*_devices()]
    if not board and len(devices) == 1:
        board = devices[0].url
    aliases = Aliases.load()
    address = aliases[board].url if board in aliases else board
    yield from filter(None, (address, *(device.shares for device in devices if device.url == address)))
