"""`servolink` as a person runs it: in this process, as a program, and in a terminal."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pytest

from servolink.__main__ import main
from tests.processes import finish, start
from tests.virtual_time import run

COMMAND = (sys.executable, "-W", "error", "-m", "servolink")
"""Without asyncio's debug mode, which remarks on standard error that the machine is busy."""
_RUN = asyncio.run


@dataclass(frozen=True)
class Said:
    """How a command ended and what it printed."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """What it printed, as the one object that it is."""
        return json.loads(self.out)

    @property
    def objects(self) -> list[Any]:
        """What it printed, an object a line."""
        return [json.loads(line) for line in self.out.splitlines()]

    @property
    def error(self) -> dict[str, Any]:
        """Return the error printed with `--json`, the only line of standard error."""
        assert self.err.count("\n") == 1
        assert self.err.isascii()
        assert self.err.rstrip("\n").isprintable()
        described = json.loads(self.err)
        assert list(described) == ["error"]
        return dict(described["error"])


def call(capsys: pytest.CaptureFixture[str], *arguments: str) -> Said:
    """Run a command in this process, in virtual time if its board is in this process as well."""
    capsys.readouterr()
    code = exit_code(arguments)
    said = capsys.readouterr()
    assert "internal error" not in said.err
    return Said(code, said.out, said.err)


def exit_code(arguments: Sequence[str]) -> int:
    """Run a command as `call` does, on the streams that there are."""
    with pytest.MonkeyPatch.context() as patch:
        if asyncio.run is _RUN and any(word.startswith("virtual://") for word in arguments):
            patch.setattr(asyncio, "run", run)
        try:
            return main(arguments)
        except SystemExit as ended:  # argparse: wrong usage, or --help
            return int(ended.code or 0)


def environment(**changed: str) -> dict[str, str]:
    """Return the environment without what changes how the program looks or what it talks to."""
    left_out = {"SERVOLINK_BOARD", "SERVOLINK_URL", "NO_COLOR", "FORCE_COLOR"}
    kept = {name: value for name, value in os.environ.items() if name not in left_out}
    return {**kept, "COLUMNS": "100", "PYTHONUTF8": "1", **changed}


def started(*arguments: str, **changed: str) -> subprocess.Popen[str]:
    """Start a command as a program of its own, which nobody types to."""
    return start((*COMMAND, *arguments), env=environment(**changed))


_PATIENT = """
import sys
from servolink.cli import command_session
from servolink.__main__ import main
command_session._PATIENCE = 1e9
sys.exit(main(sys.argv[1:]))
"""


def patient(*arguments: str, **changed: str) -> subprocess.Popen[str]:
    """Start a command that takes as long as it needs, after Ctrl-C, to end in good order."""
    return start((sys.executable, "-W", "error", "-c", _PATIENT, *arguments), env=environment(**changed))


def finished(process: subprocess.Popen[str], by: signal.Signals | None = None) -> Said:
    """Wait until a program ends, after sending it a signal."""
    out, err = finish(process, by)
    return Said(process.returncode, out, err)


def program(*arguments: str, **changed: str) -> Said:
    """Run a command as a program of its own."""
    return finished(started(*arguments, **changed))


def in_terminal(
    *arguments: str,
    typed: str = "",
    later: tuple[str, str | signal.Signals] = ("", ""),
    meanwhile: Callable[[], object] = lambda: None,
    env: Mapping[str, str] | None = None,
    command: Sequence[str] = COMMAND,
) -> Said:
    """Run a command in a terminal of 100 columns and 40 lines; what it says on either stream is in `out`.

    `later` is what it says, and what is typed, or the signal that it gets, when it has said that and `meanwhile` was
    done.
    """
    import fcntl
    import struct
    import termios

    ours, theirs = os.openpty()
    try:
        fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 100, 0, 0))
        process = start(
            (*command, *arguments),
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
            # In front on its terminal, as programs are that people start.
            preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
            env=environment(**{"TERM": "xterm-256color", **(env or {})}),
        )
        os.close(theirs)
        os.write(ours, typed.encode())
        out = bytearray()
        said, answer = later
        while chunk := _read(ours):
            out += chunk
            if answer and said in out.decode(errors="replace"):
                meanwhile()
                if isinstance(answer, signal.Signals):
                    process.send_signal(answer)
                else:
                    os.write(ours, answer.encode())
                answer = ""
        finish(process)
        return Said(process.returncode, out.decode(), "")
    finally:
        os.close(ours)


def _read(terminal: int) -> bytes:
    try:
        return os.read(terminal, 65536)
    except OSError:  # EIO: nobody has the other end any more
        return b""
