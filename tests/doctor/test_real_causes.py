"""Each cause that can be made real here is made real, and the command names it."""

from __future__ import annotations

import fcntl
import grp
import os
import pwd
import subprocess
import sys
import termios
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from servolink import virtual
from servolink.boards import Alias, Aliases, BoardProfile, BoardSettings, ProfileFile
from servolink.doctor import contact, line_quality
from servolink.protocol import Codec
from servolink.transports import Faults, Receiver, WrappedTransport
from servolink.virtual import VirtualBoard, VirtualTransport
from tests import processes
from tests.cli.programs import Said, call, environment, finished, program, started
from tests.cli.robot import Robot

ROOT = Path(__file__).parents[2]


@contextmanager
def served(*arguments: str) -> Iterator[str]:
    """Serve a virtual board in a process of its own and give its address."""
    process = started("virtual", *arguments)
    try:
        assert process.stdout is not None
        yield process.stdout.readline().split()[-1]
    finally:
        process.terminate()
        finished(process)


@contextmanager
def terminal() -> Iterator[str]:
    """Yield the name of a pseudo-terminal whose other end is silent."""
    ours, theirs = os.openpty()
    try:
        yield os.ttyname(theirs)
    finally:
        os.close(ours)
        os.close(theirs)


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wait long for responses, as the machine may be busy."""
    monkeypatch.setattr(contact, "_FIRST", processes.LIMIT)
    monkeypatch.setattr(line_quality, "_PATIENCE", processes.LIMIT)


Examined = Callable[..., tuple[int, dict[str, Any]]]


@pytest.fixture
def examined(capsys: pytest.CaptureFixture[str]) -> Examined:
    """Return a function that runs the doctor and returns its exit code and its JSON."""

    def run(*arguments: str) -> tuple[int, dict[str, Any]]:
        said = call(capsys, "doctor", "--json", *arguments)
        assert said.err == ""
        return said.code, said.json

    return run


def checks(report: dict[str, Any]) -> list[str]:
    return [finding["check"] for finding in report["findings"]]


@pytest.mark.usefixtures("patient")
@pytest.mark.parametrize("line", ["--pty", "--tcp=127.0.0.1:0"])
def test_a_board_in_good_health(line: str, examined: Examined) -> None:
    with served(line) as url:
        code, report = examined(url)
        assert (code, report["findings"], report["examined"]) == (0, [], [url])
        assert report["response"]["project_id"] == 0
        assert (report["line"]["noise_bytes"], report["line"]["unanswered"]) == (0, 0)
        assert report["line"]["round_trip_seconds"]["p50"] > 0


@pytest.mark.usefixtures("robot")
def test_good_health_is_said_in_words(capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "doctor", "virtual://")
    assert (said.code, said.out.splitlines()[-1]) == (0, "nothing is wrong")
    assert "project id none, little byte order" in said.out, "as `servolink info` calls it"


@pytest.mark.usefixtures("patient")
def test_the_only_board_needs_no_address(tmp_path: Path, examined: Examined, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    with served("--tcp", "127.0.0.1:0") as url:
        code, report = examined()
        if [board["url"] for board in report["boards"]] == [url]:  # not so where a real one is plugged in
            assert (code, report["examined"]) == (0, [url])
        with served("--tcp", "127.0.0.1:0") as other:
            code, report = examined()
            assert (code, report["response"]) == (1, None)
            several = report["findings"][-1]
            assert several["check"] == "several"
            assert {f"servolink doctor {board}" for board in (url, other)} <= set(several["remedy"].splitlines())


def test_the_wrong_byte_order(robot: Robot, examined: Examined) -> None:
    robot.board = VirtualBoard(codec=Codec("big"))
    code, report = examined("virtual://")
    assert (code, report["response"]["byte_order"], checks(report)) == (1, "big", ["byte order"])
    assert "servolink --byte-order big --board virtual:// info" in report["findings"][0]["remedy"]
    assert "in every program: virtual://?byte_order=big" in report["findings"][0]["remedy"]
    for right in (("--byte-order", "big", "virtual://"), ("virtual://?byte_order=big",)):
        assert examined(*right)[0] == 0
    code, report = examined("virtual://?byte_order=little&patience=0.3")
    assert "in every program: virtual://?patience=0.3&byte_order=big" in report["findings"][0]["remedy"]


def test_the_profile_of_a_board_says_in_which_byte_order_it_is_expected(
    robot: Robot, examined: Examined, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    robot.board = VirtualBoard(codec=Codec("big"))
    Aliases.save("rex", Alias("virtual://"))
    ProfileFile("rex").save(BoardProfile(settings=BoardSettings(byte_order="big")))
    for board in ("rex", "virtual://"):
        assert examined(board)[0] == 0
    ProfileFile("rex").path.write_text("[settings]\nbyte_order = 3\n")
    code, report = examined("rex")
    assert (code, checks(report)) == (1, ["profile", "byte order"])
    assert "rex.toml, line 2: byte_order must be" in report["findings"][0]["observation"]
    assert "servolink board forget rex" in report["findings"][0]["remedy"]


def test_noise(robot: Robot, examined: Examined) -> None:
    robot.faults = Faults(insert=0.01)
    code, report = examined("virtual://")
    assert code == 1
    assert checks(report)[0] == "noise"
    assert report["line"]["noise_bytes"] > 0
    assert (
        f"{report['line']['noise_bytes']} of {report['line']['received_bytes']}" in report["findings"][0]["observation"]
    )


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="only Linux shows who has a file open")
def test_a_port_that_another_program_has() -> None:
    with terminal() as name:
        holding = os.open(name, os.O_RDWR | os.O_NOCTTY)
        try:
            fcntl.flock(holding, fcntl.LOCK_EX)  # as every careful program does
            fcntl.ioctl(holding, termios.TIOCEXCL)
            said = program("doctor", "--json", name)
        finally:
            os.close(holding)
    # This process holds the other end too, which is how a pseudo-terminal is served, so it is not the one to name.
    assert (said.code, said.json["response"], checks(said.json)) == (1, None, ["opening"])


HOLD = """
import fcntl, os, sys, termios
port = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
fcntl.flock(port, fcntl.LOCK_EX)
fcntl.ioctl(port, termios.TIOCEXCL)
print("held", flush=True)
sys.stdin.read()
"""


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="only Linux shows who has a file open")
def test_the_program_that_has_the_port_is_named(examined: Examined) -> None:
    with terminal() as name:
        holder = processes.start([sys.executable, "-c", HOLD, name], stdin=subprocess.PIPE)
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        code, report = examined(name)
    assert (code, checks(report)) == (1, ["in use"])
    finding = report["findings"][0]
    assert f"process {holder.pid} (" in finding["observation"]
    assert finding["observation"].endswith(f"has {name} open")
    assert f"kill {holder.pid}" in finding["remedy"]


@pytest.mark.skipif(sys.platform == "win32" or os.geteuid() != 0, reason="only root can become somebody else")
def test_a_port_that_this_user_may_not_open() -> None:
    nobody = pwd.getpwnam("nobody")
    with terminal() as name:
        os.chmod(name, 0o600)  # noqa: PTH101 - it is no path of ours
        said = as_user(nobody, "doctor", "--json", name)
        assert (said.code, said.err) == (1, "")
        assert checks(said.json) == ["permissions"]
        assert f"{name} belongs to root:" in said.json["findings"][0]["observation"]
        assert "nobody is in nogroup" in said.json["findings"][0]["observation"]

        group = next(group for group in grp.getgrall() if group.gr_gid not in (0, nobody.pw_gid))
        os.chown(name, 0, group.gr_gid)
        os.chmod(name, 0o660)  # noqa: PTH101
        finding = as_user(nobody, "doctor", "--json", name).json["findings"][0]
        assert f"sudo usermod -aG {group.gr_name} nobody" in finding["remedy"]


SWITCH = """
import contextlib, io, os, sys
from servolink.__main__ import main
with contextlib.redirect_stdout(io.StringIO()):
    main(["doctor", "serial:///dev/nowhere"])
os.setgroups([]); os.setgid(int(sys.argv[1])); os.setuid(int(sys.argv[2]))
sys.exit(main(sys.argv[3:]))
"""
"""Becomes another user once everything is imported, perhaps from a folder that this user cannot enter."""


def as_user(user: pwd.struct_passwd, *arguments: str) -> Said:
    """Run the command as another user, without measuring coverage, which that user cannot save."""
    ran = processes.run(
        [sys.executable, "-c", SWITCH, str(user.pw_gid), str(user.pw_uid), *arguments],
        env={name: value for name, value in environment().items() if not name.startswith("COV")},
        cwd=ROOT,
    )
    return Said(ran.returncode, ran.stdout, ran.stderr)


def test_the_wrong_hid_package(tmp_path: Path) -> None:
    """A module of that name, first on the path, stands for the package hid; hidapi's own is hidden by another."""
    package = tmp_path / "hid"
    package.mkdir()
    (package / "__init__.py").write_text("class Device: ...\n")
    (tmp_path / "hidraw.py").write_text("raise ImportError\n")
    said = program("doctor", "hid://1234:5678", "--json", PYTHONPATH=f"{tmp_path}{os.pathsep}{ROOT}")
    (finding,) = [finding for finding in said.json["findings"] if finding["check"] == "hid package"]
    assert said.code == 1
    assert finding["remedy"].splitlines() == [
        f"{sys.executable} -m pip uninstall hid",
        f"{sys.executable} -m pip install --force-reinstall hidapi",
    ]


def test_no_libusb(tmp_path: Path) -> None:
    (tmp_path / "libusb_package.py").write_text("raise ImportError('no libusb here')\n")
    said = program("doctor", "usb://1234:5678", "--json", PYTHONPATH=f"{tmp_path}{os.pathsep}{ROOT}")
    assert (said.code, "libusb" in checks(said.json)) == (1, True)


def test_a_silent_device(robot: Robot, examined: Examined) -> None:
    robot.faults = Faults(drop=1.0)
    code, report = examined("virtual://")
    assert (code, report["response"], checks(report)) == (1, None, ["no response"])
    assert "is silent" in report["findings"][0]["observation"]


class Printer(WrappedTransport):
    """Greets whoever opens the line, and answers nothing."""

    async def open(self, receiver: Receiver) -> None:
        await super().open(receiver)
        receiver.data(b"ok T:21.3 /0.0\n")

    async def send(self, data: bytes) -> None:
        pass


@pytest.mark.usefixtures("robot")
def test_a_device_that_speaks_something_else(examined: Examined, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(virtual, "from_address", lambda address: Printer(VirtualTransport(VirtualBoard())))
    code, report = examined("virtual://")
    assert (code, checks(report)) == (1, ["no response"])
    assert "sent text, 'ok T:21.3 /0.0', but no response" in report["findings"][0]["observation"]


@pytest.mark.parametrize("url", ["serial:///dev/nowhere", "tcp://127.0.0.1:1", "hid://1234:5678"])
def test_no_board_is_3(url: str, examined: Examined) -> None:
    code, report = examined(url)
    assert (code, report["response"]) == (3, None)
    assert checks(report)[-1] == "absent"


@pytest.mark.parametrize("url", ["no address", "serial://", "gopher://x"])
def test_no_address_is_wrong_usage(url: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "doctor", url)
    assert said.code == 2


def test_what_a_person_reads_has_numbered_findings(examined: Examined, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "doctor", "serial:///dev/nowhere")
    assert said.code == 3
    lines = said.out.splitlines()
    assert lines[0] == "examined  serial:///dev/nowhere"
    assert any(line.endswith(". absent") for line in lines)
    assert {line.split(" ")[0] for line in lines} >= {"observation", "meaning", "remedy"}
    assert examined("serial:///dev/nowhere")[1]["examined"] == ["serial:///dev/nowhere"]
