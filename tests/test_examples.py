"""Runs every example of README.md and docs/, in the order of its page, as a reader would.

The first word behind the fence says what is to be done, and a page with any other word fails:

`python`            a program of its own, run as such; a `text output` block right behind it is what it prints
`console`           lines with `$ ` are typed into a shell, lines with `> ` go on with them, the others are printed
`console no-run`    the same for a machine with a board, or for what would install something: not run
`sh`                the two commands at the beginning of README.md, which `.ci/run` takes from there and runs
`text`, `json`...   shown, not run

`...` stands for any output, and no output at all for output that nobody promises. A command must succeed unless
`$ echo $?` comes next. `^C` is Ctrl-C. `servolink virtual` and `share` run on until the end of the page; the addresses
that they print on the page stand, in what follows, for those that they printed here.
"""

from __future__ import annotations

import doctest
import os
import re
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from tests import processes

ROOT = Path(__file__).parents[1]
PAGES = [
    ROOT / "README.md",
    *sorted(path for path in (ROOT / "docs").rglob("*.md") if "_" not in str(path.parent.name)),
]
SHOWN = {"text", "text output", "js", "json", "toml", "yaml", "sh", "console no-run", "python no-run"}

_TEMPERATURE = re.compile(r"\b2[56][0-9]\b")  # raw
_FENCE = re.compile(r"^```(?P<info>[^`\n]*)\n(?P<code>.*?)^```$", re.MULTILINE | re.DOTALL)
_SERVING = re.compile(r"servolink (virtual|share (?!--status|--take|--give))")
_LISTENING = re.compile(r"^listening (\S+)$", re.MULTILINE)


class Block(NamedTuple):
    """A fenced block of a page."""

    place: str
    info: str
    code: str


class Typed(NamedTuple):
    """A command and what should come of it."""

    command: str
    output: str


def blocks(page: Path) -> list[Block]:
    """Return the fenced blocks of a page, but for Sphinx's own."""
    text = page.read_text(encoding="utf-8")
    return [
        Block(f"{page.name}:{text.count(chr(10), 0, found.start()) + 1}", found["info"].strip(), found["code"])
        for found in _FENCE.finditer(text)
        if not found["info"].startswith("{")
    ]


def dialogue(code: str) -> Iterator[Typed]:
    """Yield the commands of a console block, each with the output that is shown for it."""
    for part in re.split(r"^\$ ", code, flags=re.MULTILINE)[1:]:
        command, *rest = part.splitlines()
        while rest and rest[0].startswith("> "):
            command += "\n" + rest.pop(0)[2:]
        yield Typed(command, "\n".join(rest))


def is_as_shown(output: str, quote: str) -> bool:
    """Compare what was printed with what the page shows.

    Temperatures from 250 to 269 count as equal: the servos of a virtual board warm up until a busy machine asks them.
    """
    flags = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    shown, printed = (_TEMPERATURE.sub("250", text.strip()) + "\n" for text in (quote, output))
    return not quote.strip() or doctest.OutputChecker().check_output(shown, printed, flags)


class Reader:
    """Someone who types what a page says."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        commands = folder / "bin"
        commands.mkdir()
        for name, options in (("servolink", "-W error -m servolink"), ("python", "-W error")):
            command = commands / name
            command.write_text(f'#!/bin/sh\nexec "{sys.executable}" {options} "$@"\n', encoding="utf-8")
            command.chmod(0o755)
        self.environment = {
            name: value for name, value in os.environ.items() if name not in {"SERVOLINK_BOARD", "SERVOLINK_URL"}
        } | {
            "XDG_CONFIG_HOME": str(folder / "config"),  # the names that another page has given are not known here
            "XDG_DATA_HOME": str(folder / "data"),
            "PATH": f"{commands}{os.pathsep}{os.environ['PATH']}",
            "PYTHONPATH": str(ROOT),
            "PYTHONUNBUFFERED": "1",
        }
        self.addresses: dict[str, str] = {}
        self.status = 0
        self.started: list[subprocess.Popen[str]] = []

    def follow(self, page: list[Block]) -> None:
        """Do what the page says; AssertionError names the example that is not true."""
        for at, block in enumerate(page):
            if block.info == "python":
                quote = page[at + 1].code if page[at + 1 :] and page[at + 1].info == "text output" else ""
                self.run(block.place, [sys.executable, "-W", "error", "-c", self.here(block.code)], quote)
                assert self.status == 0, f"{block.place} fails"
            elif block.info == "console":
                self.type(block)
            else:
                assert block.info in SHOWN, f"{block.place}: nobody knows whether {block.info!r} is to be run"

    def type(self, block: Block) -> None:
        commands = list(dialogue(block.code))
        assert commands, f"{block.place}: no line begins with '$ '"
        for typed, after in zip(commands, [*commands[1:], None], strict=True):
            if typed.command == "echo $?":
                assert typed.output.strip() == str(self.status), f"{block.place}: exit code {self.status}"
                continue
            if typed.command.startswith("export "):
                name, _, value = typed.command.removeprefix("export ").partition("=")
                self.environment[name] = self.here(value)
                continue
            self.run(block.place, ["bash", "-c", self.here(typed.command)], typed.output)
            told = after is not None and after.command == "echo $?"
            assert told or self.status == 0, f"{block.place}: {typed.command} ends with {self.status}"

    def run(self, place: str, command: list[str], quote: str) -> None:
        """Run a program, until the end, until Ctrl-C, or until it serves."""
        process = processes.start(command, cwd=self.folder, env=self.environment, stderr=subprocess.STDOUT)
        self.started.append(process)
        before, interrupted, _ = quote.partition("^C")
        serves = bool(_SERVING.match(command[-1]))
        output = read(process, until=_LISTENING.sub("listening ...", before) if interrupted or serves else None)
        self.addresses |= dict(zip(_LISTENING.findall(before), _LISTENING.findall(output), strict=False))
        if interrupted:
            os.killpg(process.pid, signal.SIGINT)
            output += "^C" + read(process)
        if interrupted or not serves:
            self.status = process.wait(processes.LIMIT)
        told = f"{place}: {command[-1]}\nprints\n{output}\nand the page shows\n{quote}"
        assert is_as_shown(output, self.here(quote)), told

    def here(self, text: str) -> str:
        """Return `text` with the addresses of this run, and with ports that are free."""
        for there, here in self.addresses.items():
            text = text.replace(there, here)
        return re.sub(r"(--tcp 127\.0\.0\.1):\d+", r"\1:0", text)

    def leave(self) -> None:
        """End what still serves."""
        for process in self.started:
            if process.stdout is not None:
                process.stdout.close()
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGINT)
                assert process.wait(processes.LIMIT) in {0, 130}


def read(process: subprocess.Popen[str], until: str | None = None) -> str:
    """Return what a program prints: all of it, or as much as it takes to be `until`."""
    pipe = process.stdout
    assert pipe is not None
    output, deadline = b"", time.monotonic() + processes.LIMIT
    while until is None or not output or not is_as_shown(output.decode(), until):
        ready, _, _ = select.select([pipe], [], [], max(0.0, deadline - time.monotonic()))
        chunk = os.read(pipe.fileno(), 4096) if ready else b""
        if not chunk:
            assert until is None, f"this is all that was printed:\n{output.decode()}"
            pipe.close()
            break
        output += chunk
    return output.decode()


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, id=str(page.relative_to(ROOT)), marks=[] if page.parent == ROOT else pytest.mark.slow)
        for page in PAGES
    ],
)
def test_examples_do_what_their_page_says(page: Path, tmp_path: Path) -> None:
    if page.name == "gymnasium.md":
        pytest.importorskip("gymnasium", reason="in the extra gym")
    reader = Reader(tmp_path)
    try:
        reader.follow(blocks(page))
    finally:
        reader.leave()


def test_readme_opens_with_the_two_commands_that_are_run_on_every_build() -> None:
    commands = [block.code.splitlines() for block in blocks(ROOT / "README.md") if block.info == "sh"]
    assert commands == [
        [
            "python3 -m venv .venv && .venv/bin/pip install . && .venv/bin/servolink demo",
            'python3 -m venv .venv && .venv/bin/pip install -e ".[test]" && .venv/bin/pytest',
        ]
    ]


@pytest.mark.parametrize(
    ("page", "fault"),
    [
        ("```console\n$ echo one\ntwo\n```\n", "the page shows"),
        ("```console\n$ false\n```\n", "ends with 1"),
        ("```console\n$ false\n$ echo $?\n2\n```\n", "exit code 1"),
        ("```console\necho one\n```\n", "no line begins"),
        ("```python\nraise SystemExit(1)\n```\n", "fails"),
        ("```python\nprint(1)\n```\n```text output\n2\n```\n", "the page shows"),
        ("```bash\ntrue\n```\n", "nobody knows"),
    ],
)
def test_an_example_that_is_not_true_is_noticed(page: str, fault: str, tmp_path: Path) -> None:
    path = tmp_path / "page.md"
    path.write_text(page, encoding="utf-8")
    with pytest.raises(AssertionError, match=fault):
        Reader(tmp_path).follow(blocks(path))
