"""servolink.run: how a script ends when something fails."""

from __future__ import annotations

import asyncio
import signal
import sys
from pathlib import Path
from typing import Any

import pytest

import servolink
from servolink.errors import InvalidAddress, NotFound, OpenError, RequestTimeout, ServolinkError, SeveralBoards
from servolink.support.script import ExitCode
from tests import processes


def run(tmp_path: Path, program: str, *options: str) -> tuple[int, str, str]:
    """Return the exit code of a script, and what it prints, with the path of the script as "script"."""
    path = tmp_path / "robot.py"
    path.write_text(program, encoding="utf-8")
    done = processes.run([sys.executable, "-W", "error", *options, str(path)])
    return done.returncode, done.stdout, done.stderr.replace(str(path), "script")


ASYNC = """
import servolink

async def main():
    async with servolink.connect({address!r}) as board:
        {body}

servolink.run(main)
"""
SYNC = """
import servolink

def main():
    with servolink.sync.connect({address!r}) as board:
        {body}

servolink.run(main)
"""


@pytest.mark.parametrize("program", [ASYNC, SYNC])
def test_a_missing_port_ends_in_one_line(tmp_path: Path, program: str) -> None:
    code, out, err = run(tmp_path, program.format(address="/dev/nowhere", body="pass"))
    assert (code, out) == (3, "")
    assert err.startswith("script:5: /dev/nowhere: ")
    assert err.count("\n") == 1


@pytest.mark.parametrize("program", [ASYNC, SYNC])
def test_a_wrong_address_and_a_refusal_have_their_own_exit_codes(tmp_path: Path, program: str) -> None:
    code, _, err = run(tmp_path, program.format(address="nonsense://", body="pass"))
    assert (code, err.count("\n")) == (2, 1)
    body = "await board.servo(99)" if program is ASYNC else "board.servo(99)"
    expected = (1, "", "script:6: the board has no servo 99\n")
    assert run(tmp_path, program.format(address="virtual://?servos=2", body=body)) == expected


@pytest.mark.skipif(sys.platform == "win32", reason="sends a POSIX signal")
@pytest.mark.parametrize("program", [ASYNC, SYNC])
def test_ctrl_c_ends_in_one_line(tmp_path: Path, program: str) -> None:
    state = tmp_path / "board.json"
    body = "await asyncio.sleep(300)" if program is ASYNC else "board.move({1: 90}, duration=300, wait=True)"
    ready = "import asyncio; print('ready', flush=True); "
    path = tmp_path / "robot.py"
    path.write_text(program.format(address=f"virtual://?state={state}", body=ready + body), encoding="utf-8")
    process = processes.start([sys.executable, "-W", "error", str(path)])
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    _, err = processes.finish(process, signal.SIGINT)
    assert process.returncode == 130
    assert err == "interrupted\n"
    assert state.exists(), "the board was not closed"


def test_other_errors_are_raised_as_usual(tmp_path: Path) -> None:
    code, _, err = run(tmp_path, ASYNC.format(address="virtual://", body="1 / 0"))
    assert code == 1
    assert "Traceback" in err
    assert err.endswith("ZeroDivisionError: division by zero\n")
    assert "During handling" not in err


def test_development_mode_shows_the_traceback(tmp_path: Path) -> None:
    program = SYNC.format(address="virtual://", body="board.servo(99)")
    code, _, err = run(tmp_path, program, "-X", "dev")
    assert code == 1
    assert "Traceback" in err
    assert "servolink/client/board_servos.py" in err.replace("\\", "/")


def test_a_board_that_sends_terminal_codes_does_not_reach_the_terminal(tmp_path: Path) -> None:
    program = (
        "import servolink\ndef main():\n    raise servolink.ProjectError('a\\n\\x1b[2J\\u202e')\nservolink.run(main)\n"
    )
    assert run(tmp_path, program) == (1, "", "script:3: a\\x0a\\x1b[2J\\u202e\n")


def test_the_result_of_main_is_returned() -> None:
    async def main() -> int:
        return 5

    assert servolink.run(main) == 5
    assert servolink.run(main()) == 5
    assert servolink.run(lambda: "text") == "text"


def test_main_must_be_a_function(capsys: pytest.CaptureFixture[str]) -> None:
    main: Any = servolink.connect("virtual://")
    with pytest.raises(TypeError, match="main must be a function"):
        servolink.run(main)


def test_an_error_that_was_raised_elsewhere_has_no_line(capsys: pytest.CaptureFixture[str]) -> None:
    main: Any = type("Main", (), {"__call__": lambda self: servolink.connect(3)})()  # type: ignore[arg-type]
    with pytest.raises(TypeError):
        servolink.run(main)
    main = type("Main", (), {"__call__": lambda self: servolink.Action.pose("", {}, seconds=-1)})()
    with pytest.raises(SystemExit) as ended:
        servolink.run(main)
    assert ended.value.code == 1
    assert capsys.readouterr().err == "servolink: a time must be 0..327.67 s, not -1\n"


def test_in_a_notebook_it_says_what_to_write() -> None:
    async def main() -> None:
        raise AssertionError

    async def cell() -> None:
        servolink.run(main)

    with pytest.raises(RuntimeError, match="write `await main"):
        asyncio.run(cell())


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (OpenError("x"), 3),
        (InvalidAddress("x"), 2),
        (SeveralBoards("x"), 2),
        (RequestTimeout("x"), 1),
        (NotFound("x"), 1),
        (ServolinkError("x"), 1),
    ],
)
def test_exit_codes(error: ServolinkError, code: int) -> None:
    assert ExitCode.of(error) == code
