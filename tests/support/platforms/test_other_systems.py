"""Commands on Windows and macOS, as far as `without_unix.py` and `without_linux.py` can simulate them."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import tempfile
import urllib.request
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple, cast

import pytest

import servolink
from tests.cli.programs import Said, environment, finished, in_terminal
from tests.fleet import mosquitto
from tests.processes import LIMIT, finish, start

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="takes from Linux what others lack")

ROBOT = Path(servolink.__file__).parent / "studio/demo.servolink.json"


class System(NamedTuple):
    """A simulated system."""

    script: str
    encoding: str
    """Of files and pipes."""
    left: str
    """Arrow key as its console gives it."""
    right: str
    door: str
    """End of the name of the file with which a hub is found."""

    @property
    def command(self) -> tuple[str, ...]:
        """Beginning of a command line."""
        return sys.executable, "-W", "error", str(Path(__file__).with_name(self.script))

    def started(self, *arguments: str) -> subprocess.Popen[str]:
        """Start a command."""
        changed = {"PYTHONUTF8": "0", "PYTHONIOENCODING": self.encoding, "PYTHONUNBUFFERED": "1"}
        return start((*self.command, *arguments), env=environment(**changed))

    def run_all(self, *commands: str, fails: Mapping[int, int] = MappingProxyType({})) -> list[Said]:
        """Run commands one after the other in one program; each must end well, or with its code in `fails`."""
        words = [command.split() for command in commands]
        said = output_of(self.started("--all", json.dumps(words)))
        assert (said.code, said.err) == (0, "")
        done = [Said(*each) for each in said.json]
        for number, (command, each) in enumerate(zip(words, done, strict=True)):
            assert each.code == fails.get(number, 0), (command, each)
        return done

    @contextmanager
    def serving(self, *arguments: str, pattern: str = r"(?:tcp|share|http)://\S+") -> Iterator[str]:
        """Run a command that serves until it is told to end; yield the first address that it prints."""
        process = self.started(*arguments)
        assert process.stdout is not None
        line = process.stdout.readline()
        found = re.search(pattern, line)
        if found is None:
            pytest.fail(f"{line}{finish(process, signal.SIGTERM)}")
        yield found[0]
        said = finished(process, signal.SIGTERM)
        assert "Traceback" not in said.err
        assert said.code in {0, 143}, said


WINDOWS = System("without_unix.py", "cp1252", "\xe0K", "\xe0M", ".door")
MACOS = System("without_linux.py", "utf-8", "\x1b[D", "\x1b[C", ".sock")


@pytest.fixture(params=[pytest.param(WINDOWS, id="windows"), pytest.param(MACOS, id="macos", marks=pytest.mark.slow)])
def system(request: pytest.FixtureRequest) -> System:
    """One of the systems."""
    return cast("System", request.param)


@pytest.fixture
def world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A user of their own, whose programs write as the system does."""
    for name in ("CONFIG", "DATA", "STATE", "CACHE"):
        (tmp_path / name.lower()).mkdir(mode=0o700)
        monkeypatch.setenv(f"XDG_{name}_HOME", str(tmp_path / name.lower()))
    with tempfile.TemporaryDirectory() as short:  # macOS allows 103 bytes in the path of a socket
        (tmp_path / "runtime").symlink_to(short)
        monkeypatch.setenv("XDG_RUNTIME_DIR", short)
        monkeypatch.chdir(tmp_path)
        yield tmp_path


def output_of(process: subprocess.Popen[str]) -> Said:
    """Return how a program ended, which nobody ends."""
    out, err = finish(process)
    return Said(process.returncode, out, err)


@pytest.fixture
def board(system: System, world: Path) -> Iterator[str]:
    """A virtual board that another program serves."""
    with system.serving("virtual", "--tcp", "127.0.0.1:0", "--state", "board.json") as url:
        yield url
    assert (world / "board.json").exists()
    assert list(world.glob(".*lock")) == list((world / "runtime/servolink").iterdir()) == []


def test_every_module_can_be_imported(system: System) -> None:
    said = output_of(system.started("--import"))
    assert (said.code, said.json) == (0, {}), said.err


def test_a_board_is_found_moved_read_and_written(system: System, board: str, world: Path) -> None:
    on = f"--board {board}"
    said = system.run_all(
        "list --json",
        f"{on} move 1=20 --json",
        f"{on} stop",
        f"{on} servo start all",
        f"{on} servos --json",
        f"{on} export before.servolink.json",
        f"{on} plan {ROBOT} --json",
        f"{on} apply {ROBOT} --yes",
        f"{on} plan {ROBOT} --json",
        f"{on} rollback --yes",
        f"{on} plan before.servolink.json --json",
        f"{on} record recorded.mcap --seconds 0.2",
        "convert recorded.mcap --csv -o recorded.csv",
        f"{on} report -o report.zip --yes --seconds 0.1",
        f"use rex {board}",
        "--board rex info --json",
        "--board rex doctor --json",
        "firmware info --json",
        fails={6: 1},
    )
    assert [one["url"] for one in said[0].json["boards"]] == [board]
    assert said[1].json["servos"][0]["angle"] == 20
    assert all(one["is_start"] for one in said[4].json["servos"])
    assert [bool(said[number].json["changes"]) for number in (6, 8, 10)] == [True, False, False]
    assert said[16].json["response"]["byte_order"] == "little"
    assert {"recorded.mcap", "report.zip"} <= {path.name for path in world.iterdir()}
    assert list(world.glob("recorded*.csv"))


def test_a_board_is_shared_with_a_second_program(system: System, board: str, world: Path) -> None:
    folder = world / "runtime/servolink"
    with system.serving("--board", board, "share", "--name", "rex") as url:
        assert url == "share://rex"
        assert {path.suffix for path in folder.iterdir()} == {".board", ".hub", system.door}
        found, moved, _, shared = system.run_all(
            "list --json",
            f"--board {url} move 1=20 --json",
            f"--board {url} stop",
            "share --status --name rex --json",
        )
        assert {one["url"] for one in found.json["boards"]} == {board, "share://rex"}
        assert moved.json["servos"][0]["angle"] == 20
        assert shared.json["name"] == "rex"
    assert [path.suffix for path in folder.iterdir()] == [".board"]


@pytest.mark.slow
def test_a_program_is_served_by_spy_over_tcp(system: System, board: str, world: Path) -> None:
    with system.serving("spy", board, "--tcp", "127.0.0.1:0", "--record", "spied.mcap") as url:
        (said,) = system.run_all(f"--board {url} servos --json")
        assert len(said.json["servos"]) == 16
    assert (world / "spied.mcap").stat().st_size > 0


@pytest.mark.slow
def test_the_studio_answers(system: System, board: str) -> None:
    with system.serving("--board", board, "studio", "--no-browser") as page:
        assert page.startswith("http://127.0.0.1:")
        with urllib.request.urlopen(page, timeout=LIMIT) as answer:  # noqa: S310 - as was just seen
            assert (answer.status, b"<html" in answer.read()) == (200, True)


@pytest.mark.slow
def test_the_demo_works(system: System, world: Path) -> None:
    (said,) = system.run_all("demo --fast")
    assert "All of it worked" in said.out


@pytest.mark.slow
@pytest.mark.broker
@pytest.mark.skipif(mosquitto.FOUND is None, reason="mosquitto is not installed")
def test_a_fleet_is_seen_and_stopped(system: System, board: str, world: Path) -> None:
    broker = mosquitto.Broker(world)
    broker.start()
    with system.serving("fleet", "join", broker.url, board, "--name", "rex", pattern=r"share://\w+") as url:
        listed, _, stopped, examined = system.run_all(
            f"fleet list --broker {broker.url} --json",
            f"--board {url} move 1=20",
            f"fleet stop --broker {broker.url} --json",
            f"fleet doctor --broker {broker.url}",
        )
    assert [one["board"] for one in listed.json["boards"]] == ["rex"]
    assert stopped.json["stopped"].keys() == {"rex"}
    assert "nothing is wrong" in examined.out
    broker.end()


@pytest.mark.parametrize(("answer", "code"), [("y\n", 0), (signal.SIGINT, 130)])
def test_a_question_can_be_answered_and_left(
    system: System, world: Path, answer: str | signal.Signals, code: int
) -> None:
    said = in_terminal("--board", "virtual://", "apply", str(ROBOT), later=("[y/N]", answer), command=system.command)
    assert said.code == code, said.out


@pytest.mark.slow
def test_keys_of_a_console_trim_a_servo(system: System, board: str) -> None:
    keys = system.right * 3 + system.left + "\r"
    said = in_terminal("--board", board, "trim", "1", later=("Enter: store", keys), command=system.command)
    assert said.code == 0, said.out
    system.run_all(f"--board {board} export trimmed.servolink.json")
    stored = json.loads(Path("trimmed.servolink.json").read_text(encoding="utf-8"))["servo_parameters"]
    assert [(one["servo_id"], one["adjusted_degree"]) for one in stored] == [(1, 2)]


@pytest.mark.slow
def test_keys_of_a_console_press_buttons(system: System, board: str) -> None:
    system.run_all(f"--board {board} apply {ROBOT} --yes")
    said = in_terminal("--board", board, "remote", later=("q or Esc: end", "a q"), command=system.command)
    assert said.code == 0, said.out
    assert "all servos are stopped and held" in said.out


@pytest.mark.slow
def test_keys_of_a_console_record_poses(system: System, board: str) -> None:
    said = in_terminal(
        "--board", board, "teach", "Wave", "--yes", "--no-play", later=("space", "  q"), command=system.command
    )
    assert said.code == 0, said.out
    (said,) = system.run_all(f"--board {board} macros --json")
    assert [one["macro_caption"] for one in said.json["macros"]] == ["Wave"]
