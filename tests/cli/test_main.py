"""The command line itself: start-up, usage, exit codes, streams that are gone."""

from __future__ import annotations

import inspect
import os
import re
import shlex
import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path

import pytest

import servolink
from servolink.__main__ import interrupt, main
from servolink.cli.command_line import EXIT_CODES
from servolink.cli.index import below
from tests import processes
from tests.cli.programs import COMMAND, call, environment, program
from tests.tables import over


def test_the_public_names_are_loaded_when_they_are_used() -> None:
    assert set(servolink.__all__) <= set(dir(servolink))
    assert all(hasattr(servolink, name) for name in servolink.__all__)
    with pytest.raises(AttributeError, match="no attribute 'bord'"):
        servolink.bord  # type: ignore[attr-defined]  # pyright: ignore[reportAttributeAccessIssue]  # noqa: B018


@over("command", [None, *below("")])
def test_help_names_the_exit_codes(command: str | None, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, *([command] if command else []), "--help")
    assert said.code == 0
    assert EXIT_CODES in " ".join(said.out.split())


@pytest.mark.parametrize("command", ["info", "servos", "stop", "actions", "events", "bench"])
def test_without_a_board_it_says_what_to_write(
    command: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("servolink.boards.search", list)
    said = call(capsys, command)
    assert said.code == 3
    assert all(text in said.err for text in ("SERVOLINK_BOARD", "serial:///dev/ttyACM0", "tcp://", "virtual://"))
    assert said.out == ""


def test_the_address_may_come_from_the_environment(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SERVOLINK_URL", "virtual://?servos=3")
    assert call(capsys, "info", "--json").json["servos"] == 3
    assert call(capsys, "--url", "virtual://?servos=4", "info", "--json").json["servos"] == 4
    assert call(capsys, "info", "--json", "--url", "virtual://?servos=5").json["servos"] == 5


def test_an_empty_address_in_the_environment_is_none(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("servolink.boards.search", list)
    monkeypatch.setenv("SERVOLINK_URL", "")
    said = call(capsys, "info")
    assert (said.code, said.out) == (3, "")
    assert "no board was found" in said.err


@pytest.mark.parametrize(
    "arguments",
    [
        ("nothing",),
        ("--url", "virtual://", "move"),
        ("--url", "virtual://", "move", "1:90"),
        ("--url", "virtual://", "move", "255=1"),
        ("--url", "virtual://", "move", "1=1", "1=2"),
        ("--url", "virtual://", "move", "1=1", "--speed", "1", "--duration", "1"),
        ("--url", "virtual://", "move", "1=1", "--adc"),
        ("--url", "virtual://", "move", "1=1", "--limit", "9", "-9"),
        ("--url", "virtual://", "move", "1=1", "--speed-cap", "0"),
        ("--url", "virtual://", "release"),
        ("--url", "virtual://", "release", "--json"),
        ("--url", "virtual://", "release", "300", "--yes"),
        ("--url", "virtual://", "run", "dance", "1"),
        ("--url", "virtual://", "run", "macro", "0"),
        ("--url", "virtual://", "macros", "-3"),
        ("--url", "virtual://", "events", "--count", "0"),
        ("--url", "virtual://", "events", "--seconds", "soon"),
        ("--url", "virtual://", "bench", "--requests", "none"),
        ("--url", "virtual://", "info", "--caption-encoding", "klingon"),
        ("project", "check", "x.json", "--caption-encoding", "klingon"),
        ("--url", "virtual://", "--caption-encoding", "klingon", "rollback", "--yes", "x.json"),
        *(("move", "1=5", "--duration", duration) for duration in ("nan", "999", "0", "soon")),
        *(("move", "1=5", "--speed", speed) for speed in ("nan", "inf", "0", "1e-300")),
        *(("move", "1=5", "--speed-cap", speed) for speed in ("nan", "0")),
        ("move", "1=5", "--limit", "nan", "5"),
        ("move", "1=99999"),
        *(("project", "scale-time", "x.json", factor, "-o", "y.json") for factor in ("nan", "0", "inf")),
        *(("project", "check", "x.json", "--memory", memory) for memory in ("-1", "٣", "1_0")),
        *(("virtual", option, "٣") for option in ("--seed", "--servos", "--memory")),
        ("virtual", "--seed", "1_0"),
        ("--url", "", "move", "1=5"),
        ("move", "1=5", "--url="),
        *(("move", "1=5", "--timeout", seconds) for seconds in ("0", "nan", "4000", "soon", "")),
        ("--url", "virtual://", "rollback", "--yes", ""),
        ("doctor", ""),
        ("decode", "--file", ""),
    ],
)
def test_wrong_usage_is_2_and_touches_no_board(arguments: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, *arguments)
    assert (said.code, said.out) == (2, "")
    assert said.error["kind"] == "Usage" if "--json" in arguments else "error: " in said.err


@pytest.mark.parametrize(
    "arguments",
    [
        ("actions", "7"),
        ("macros", "7"),
        ("tables", "7"),
        ("run", "action", "7"),
        ("run", "macro", "7"),
        ("move", "99=0"),
        ("move", "1=99", "--limit", "-90", "90"),
        ("move", "1=180", "--duration", "0.1", "--speed-cap", "60"),
        ("release", "99", "--yes"),
    ],
)
def test_what_the_board_or_the_limits_refuse_is_1(
    arguments: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    said = call(capsys, "--url", "virtual://", *arguments)
    assert (said.code, said.out) == (1, "")
    assert re.fullmatch(r"servolink: .+\n", said.err)


@pytest.mark.parametrize("url", ["serial:///nowhere/at/all", "tcp://127.0.0.1:1"])
@pytest.mark.parametrize("command", ["info", "stop"])
def test_a_board_that_cannot_be_had_is_3(url: str, command: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "--url", url, command, "--json")
    assert (said.code, said.out) == (3, "")
    assert said.error["kind"] == "OpenError"


@pytest.mark.parametrize(
    "url", ["gopher://x", "no address", "unknown-name", "virtual://?servos=x", "virtual://?patience=0"]
)
def test_an_address_that_is_written_wrongly_is_2(url: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "--url", url, "info", "--json")
    assert (said.code, said.out) == (2, "")
    assert said.error["kind"] == "InvalidAddress"


@pytest.mark.parametrize("arguments", [("info",), ("move", "1=5"), ("stop",), ("events", "--count", "1")])
@pytest.mark.parametrize("options", [("--timeout", "0.15"), ()])
def test_a_board_that_never_answers_is_3(
    arguments: tuple[str, ...], options: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        url = f"tcp://127.0.0.1:{silent.getsockname()[1]}{'' if options else '?patience=0.15'}"
        said = call(capsys, "--url", url, *arguments, *options)
    assert (said.code, said.out) == (3, "")
    assert ("a stop was sent and could not be confirmed" in said.err) == (arguments == ("stop",))
    assert f"{url} is open, but no board answers" in said.err


def test_a_board_that_goes_away_is_3(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:

        def hang_up() -> None:
            for _ in range(2):  # a board may reset at its first opening
                connection, _ = server.accept()
                connection.recv(1)
                connection.close()

        hanging_up = threading.Thread(target=hang_up)
        hanging_up.start()
        said = call(capsys, "--url", f"tcp://127.0.0.1:{server.getsockname()[1]}", "info")
        hanging_up.join()
    assert (said.code, said.out) == (3, "")
    assert "is gone" in said.err


def test_a_reader_that_goes_away_is_no_news() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    try:
        ran = processes.run([*COMMAND, "--url", "virtual://", "servos"], stdout=writing, env=environment())
    finally:
        os.close(writing)
    assert (ran.returncode, ran.stderr) == (1, "")


def in_shell(command: str) -> subprocess.CompletedProcess[str]:
    """Run `servolink ...` of a shell."""
    line = command.replace("servolink", shlex.join(COMMAND), 1)
    return processes.run(["/bin/sh", "-c", line], env=environment())


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a file that is always full")
@pytest.mark.parametrize(
    ("command", "code", "said"),
    [
        ("--help >/dev/full", 1, "standard output cannot be written: No space left on device"),
        ("info --help >/dev/full", 1, "standard output cannot be written: No space left on device"),
        (
            "--url virtual:// move 1=5 --duration 0.01 >/dev/full",
            1,
            "standard output cannot be written: No space left on device; all servos have arrived",
        ),
        ("encode >/dev/full <&-", 1, "standard input cannot be read: Bad file descriptor"),
        ("decode --file /", 1, "/ cannot be read: Is a directory"),
        ("decode --hex missing", 1, "missing cannot be read: No such file or directory"),
    ],
)
def test_streams_that_fail_are_named(command: str, code: int, said: str) -> None:
    ran = in_shell(f"servolink {command}")
    assert (ran.returncode, ran.stdout, ran.stderr) == (code, "", f"servolink: {said}\n")


def test_a_file_that_was_written_is_not_lost_with_the_output(tmp_path: Path) -> None:
    file = tmp_path / "robot.servolink.json"
    ran = in_shell(f"servolink --url virtual:// export {shlex.quote(str(file))} >/dev/full")
    assert (ran.returncode, ran.stderr.endswith(f"No space left on device; {file} is written\n")) == (1, True)
    assert file.exists()


@pytest.mark.parametrize("to", ["/dev/full", "&-"])
@pytest.mark.parametrize(("command", "code"), [("--json info --url tcp://127.0.0.1:1", 3), ("nothing", 2)])
def test_errors_that_nobody_can_read_keep_their_code(
    command: str, code: int, to: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("PYTHONUNBUFFERED", raising=False)  # with it, nothing is left to be written at the end
    ran = in_shell(f"servolink {command} 2>{to}")
    assert (ran.returncode, ran.stdout, ran.stderr) == (code, "", "")


INTERRUPTED_IMPORT = """
import sys
from servolink.__main__ import main
class Interrupting:
    def find_spec(self, name, path, target=None):
        if name == sys.argv[1]:
            raise KeyboardInterrupt
sys.meta_path.insert(0, Interrupting())
sys.exit(main(sys.argv[2:]))
"""


@pytest.mark.parametrize(
    "module",
    [
        "argparse",
        "servolink.cli",
        "servolink.cli.main",
        "servolink.cli.command_line",
        "servolink.cli.boards.find",
        "asyncio",
    ],
)
def test_ctrl_c_while_it_starts_prints_nothing(module: str) -> None:
    ran = processes.run(
        [sys.executable, "-c", INTERRUPTED_IMPORT, module, "-b", "virtual://", "info"], env=environment()
    )
    assert (ran.returncode, ran.stdout, ran.stderr) == (130, "", "")


SWALLOWED_INTERRUPTION = """
import signal, sys
from servolink.__main__ import main

class Importing:
    def find_spec(self, name, *_):
        if name == sys.argv[1]:
            try:
                signal.raise_signal(signal.SIGINT)
            except KeyboardInterrupt:
                pass  # as modules in C do

sys.meta_path.insert(0, Importing())
sys.exit(main(sys.argv[2:]))
"""


@pytest.mark.parametrize("module", ["servolink.cli.command_line", "msgspec"])
def test_ctrl_c_in_an_import_that_ignores_it_ends_the_command(module: str) -> None:
    command = [sys.executable, "-c", SWALLOWED_INTERRUPTION, module, "-b", "virtual://", "info"]
    ran = processes.run(command, env=environment())
    assert (ran.returncode, ran.stdout, ran.stderr) == (130, "", "")


def test_ctrl_c_outside_of_imports_is_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(os, "_exit")
    with pytest.raises(KeyboardInterrupt):
        interrupt(signal.SIGINT, inspect.currentframe())


def test_the_log_is_printed_on_request(capsys: pytest.CaptureFixture[str]) -> None:
    assert call(capsys, "-b", "virtual://", "info").err == ""
    said = call(capsys, "-b", "virtual://", "info", "-v")
    assert re.findall(r"^[\d:.]+ (.*)$", said.err, re.MULTILINE) == ["virtual://: opened", "virtual://: closed"]
    said = call(capsys, "-b", "virtual://", "info", "-vv")
    assert said.code == 0
    assert re.search(r"^\d\d:\d\d:\d\d\.\d{3} .*QueryProjectIDResponse\(project_id=0\)$", said.err, re.MULTILINE)
    assert call(capsys, "-b", "virtual://", "info").err == "", "only when it is asked for"


def test_a_traceback_is_printed_on_request(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ("-b", "tcp://127.0.0.1:1", "info")
    assert "Traceback" not in call(capsys, *arguments, "-v").err
    said = call(capsys, *arguments, "-vv")
    assert said.code == 3
    assert "Traceback (most recent call last):\n" in said.err
    assert said.err.splitlines()[-1].startswith("servolink: ")


def test_a_bug_is_one_line_that_asks_for_a_report(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("servolink.cli.command_session.connect", lambda *_, **__: 1 / 0)
    assert main(("-b", "virtual://", "info")) == 1
    assert capsys.readouterr().err == (
        "servolink: internal error, please report it with the output of the same command and -vv: "
        "ZeroDivisionError: division by zero\n"
    )


def test_the_name_of_the_board_has_two_variables(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SERVOLINK_URL", "virtual://?servos=3")
    monkeypatch.setenv("SERVOLINK_BOARD", "virtual://?servos=4")
    assert call(capsys, "info", "--json").json["servos"] == 4
    assert call(capsys, "info", "--json", "--board", "virtual://?servos=5").json["servos"] == 5


def test_an_interruption_while_modules_are_loaded_is_one(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def loaded(name: str) -> None:
        raise RuntimeError("Error calling __set_name__") from KeyboardInterrupt()

    monkeypatch.setattr("servolink.cli.index.import_module", loaded)
    assert call(capsys, "info").code == 130


def test_a_terminal_that_knows_ascii_only_is_enough() -> None:
    said = program("--url", "virtual://?servos=1", "servos", PYTHONUTF8="0", PYTHONIOENCODING="ascii")
    assert said.code == 0
    assert "2 deg" in said.out
    header, row = said.out.splitlines()
    assert header.index("state") == row.index("ready")
    said = program("--url", "virtual://?servos=1", "move", "1=400", PYTHONUTF8="0", PYTHONIOENCODING="ascii")
    assert said.code != 0
    assert "\\x" not in said.err


@pytest.mark.parametrize(
    "command",
    ["plan", "apply --yes", "export", "record", "project show", "project merge x.servolink.json", "watch --csv"],
)
def test_an_empty_name_is_no_folder(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "-b", "virtual://", *command.split(), "")
    assert (said.code, said.out) == (2, "")
    assert "must not be empty" in said.err


@pytest.mark.parametrize("command", ["export", "record", "watch --csv", "project new"])
def test_what_is_written_has_a_name(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    said = call(capsys, *command.split(), "-")
    assert (said.code, said.out) == (2, "")
    assert "must name a file" in said.err
    assert not list(tmp_path.iterdir())


def test_watch_writes_no_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "-b", "virtual://", "watch", "--csv", str(tmp_path))
    assert said.code == 2
    assert "is a folder; name a file in it" in said.err
