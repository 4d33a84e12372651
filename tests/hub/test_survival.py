"""A shared board whose programs are killed, whose cable is pulled and whose disk is full: the others go on."""

from __future__ import annotations

import asyncio
import json
import resource
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from pathlib import Path

import msgspec
import pytest

from servolink.client import Servo, connect
from servolink.control import Greeting, HubStatus, open_channel
from servolink.project import build_project, save_project
from servolink.protocol import Action, Codec, FrameParser, QueryServoListRequest, QueryServoListResponse, Step
from tests.cli.programs import COMMAND, environment, finished, started
from tests.cli.terminals import in_pipe
from tests.processes import start

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Unix sockets and kill -9")

_LOOK = 0.05  # seconds between two questions about what another process does
PROJECT = build_project(*(Action(at, f"wave {at}", (Step(1, at % 90, 5),)) for at in range(1, 61)))
WATCHED_OVER = """
import json, os, socket, sys
line = socket.socket(socket.AF_UNIX)
line.connect(os.path.join(os.environ["XDG_RUNTIME_DIR"], "servolink", "rex.sock"))
stream = line.makefile("rw")

def say(message):
    print(json.dumps(message), file=stream, flush=True)

say({"servolink": 1, "wants": "rpc", "who": "a joystick", "role": "move"})
say({"jsonrpc": "2.0", "id": 1, "method": "lease.take", "params": {"dead_man": 60}})
say({"jsonrpc": "2.0", "id": 2, "method": "move", "params": {"targets": {"1": 90}, "duration": 60}})
for text in stream:
    if json.loads(text).get("id") == 2:
        print("moving", flush=True)
"""


@pytest.fixture(autouse=True)
def _exclusive(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("XDG_RUNTIME_DIR", "XDG_CONFIG_HOME", "XDG_DATA_HOME"):
        monkeypatch.setenv(name, str(tmp_path))
    for name in ("SERVOLINK_BOARD", "SERVOLINK_URL"):
        monkeypatch.delenv(name, raising=False)


def first_line(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    line = process.stdout.readline().rstrip()
    assert line, process.communicate()
    return line


class Robot:
    """A virtual board at a TCP port, which may be pulled, and a hub that shares it as `rex`."""

    def __init__(self, folder: Path, stack: ExitStack, *options: str) -> None:
        self._state, self._stack, self._options = folder / "state", stack, options
        self.place = "127.0.0.1:0"
        self.plug_in()
        self.hub = self._serve("share", "--board", f"tcp://{self.place}", "--name", "rex", "--tcp", "127.0.0.1:0")
        self.urls = [first_line(self.hub).split()[1] for _ in range(2)]

    def plug_in(self) -> None:
        self.board = self._serve(
            *("virtual", "--tcp", self.place, "--servos", "3", "--state", str(self._state), *self._options)
        )
        self.place = first_line(self.board).removeprefix("listening tcp://")

    def unplug(self) -> None:
        finished(self.board, signal.SIGTERM)

    def _serve(self, *arguments: str) -> subprocess.Popen[str]:
        process = started(*arguments)
        self._stack.callback(lambda: process.poll() is None and finished(process, signal.SIGKILL))
        return process

    async def ask_hub(self, is_so: Callable[[HubStatus], bool] = lambda _: True) -> HubStatus:
        """Ask the hub for its status until something is so."""
        channel, _ = await open_channel("rex", Greeting(wants="rpc", who="a test", role="watch"))
        try:
            while not is_so(status := msgspec.json.decode(await channel.call("status"), type=HubStatus)):
                await asyncio.sleep(_LOOK)
        finally:
            await channel.close()
        return status

    def until(self, is_so: Callable[[HubStatus], bool]) -> HubStatus:
        return asyncio.run(self.ask_hub(is_so))

    def until_servo_1(self, is_so: Callable[[Servo], bool]) -> None:
        """Ask the board until something is so of its servo 1."""

        async def ask() -> None:
            async with connect("share://rex", patience=50) as board:  # the machine may be busy
                while not is_so(await board.servo(1)):
                    await asyncio.sleep(_LOOK)

        asyncio.run(ask())

    def status(self) -> HubStatus:
        return asyncio.run(self.ask_hub())


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Robot]:
    with ExitStack() as stack:
        yield Robot(tmp_path, stack)


def test_a_program_killed_while_it_moves_leaves_the_lease_and_its_motion_ends_by_itself(robot: Robot) -> None:
    moving = started("move", "1=30", "--duration", "3", "--board", "rex")
    lease = robot.until(lambda status: status.lease is not None).lease
    assert lease is not None
    assert lease.who == f"servolink move (pid {moving.pid})"
    robot.until_servo_1(lambda servo: servo.angle > 9)  # from 2: it has the lease before the board has the motion
    finished(moving, signal.SIGKILL)
    status = robot.until(lambda status: status.lease is None)
    assert not any("servolink move" in each.who for each in status.programs)
    assert in_pipe("move", "2=10", "--duration", "0.1", "--board", "rex").code == 0
    robot.until_servo_1(lambda servo: servo.angle == 30)
    assert "ready" in in_pipe("servos", "--board", "rex").out


def test_a_program_that_promised_beats_and_is_killed_stops_the_board(robot: Robot) -> None:
    moving = start((sys.executable, "-c", WATCHED_OVER), env=environment())
    assert first_line(moving) == "moving"
    finished(moving, signal.SIGKILL)
    robot.until_servo_1(lambda servo: not servo.is_start)
    assert "stopped" in in_pipe("servos", "--board", "rex").out
    assert robot.status().lease is None


@pytest.mark.slow
def test_a_program_killed_while_it_waits_leaves_nothing_behind(tmp_path: Path) -> None:
    with ExitStack() as stack:
        robot = Robot(tmp_path, stack, "--turnaround", "0.05")
        waiting = [started("watch", "--hz", "50", "--json", "--board", "rex") for _ in range(3)]
        for each in waiting:
            first_line(each)
        finished(waiting[0], signal.SIGKILL)
        for each in waiting[1:]:
            for _ in range(20):
                first_line(each)
        left = robot.until(lambda status: len(status.programs) < 4)
        assert len([each for each in left.programs if "watch" in each.who]) == 2
        assert [finished(each, signal.SIGTERM).code for each in waiting[1:]] == [0, 0]


@pytest.mark.slow
def test_an_import_that_is_killed_frees_the_board_and_can_be_finished(tmp_path: Path) -> None:
    save_project(tmp_path / "project", PROJECT)
    with ExitStack() as stack:
        robot = Robot(tmp_path, stack, "--turnaround", "0.01")
        applying = started("apply", str(tmp_path / "project"), "--yes", "--board", "rex")
        robot.until(lambda status: status.hold is not None)
        waiting = started("actions", "--json", "--board", "rex")  # until nobody has exclusive use of the board
        finished(applying, signal.SIGKILL)
        assert finished(waiting).code == 0
        assert robot.status().hold is None
        said = in_pipe("apply", str(tmp_path / "project"), "--yes", "--board", "rex")
        assert said.code == 0, said.err
        assert "done, and verified" in said.out
        assert len(in_pipe("actions", "--json", "--board", "rex").json["actions"]) == 60


def test_three_programs_go_on_after_the_board_was_unplugged(robot: Robot) -> None:
    watching = started("watch", "1", "--json", "--board", "rex")
    first_line(watching)
    listening = started("events", "--board", "rex")
    assert listening.stderr is not None
    assert listening.stderr.readline().startswith("listening for button events")
    host, port = robot.urls[1].removeprefix("tcp://").split(":")

    async def use() -> None:
        reader, writer = await asyncio.open_connection(host, int(port))
        with closing(writer):
            await unplug_and_replug(reader, writer)

    async def unplug_and_replug(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        assert await ask(reader, writer) == (1, 2, 3)
        robot.unplug()
        await robot.ask_hub(lambda status: status.state == "lost")
        robot.plug_in()
        await robot.ask_hub(lambda status: status.state == "connected")
        assert await ask(reader, writer) == (1, 2, 3)

    asyncio.run(use())
    before = json.loads(first_line(watching))["seconds"]
    while json.loads(first_line(watching))["seconds"] < before + 1:  # those that were printed before are read first
        pass
    assert listening.poll() is None
    named = [each.who for each in robot.status().programs]
    assert all(
        f"servolink {name} (pid {each.pid})" in named for name, each in (("watch", watching), ("events", listening))
    )
    finished(watching, signal.SIGTERM)
    finished(listening, signal.SIGTERM)
    said = finished(robot.hub, signal.SIGTERM).err
    assert "the connection to the board is lost" in said
    assert "the board is back" in said


async def ask(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> tuple[int, ...]:
    """Ask for the servos as a program in any language does."""
    writer.write(Codec().encode(QueryServoListRequest()))
    parser = FrameParser()
    while not (frames := parser.feed(await reader.read(4096))):
        pass
    response = Codec().decode(*frames[0])
    assert isinstance(response, QueryServoListResponse)
    return response.servo_id_list


def test_where_nothing_can_be_written_it_says_so_and_leaves_nothing(robot: Robot, tmp_path: Path) -> None:
    command = (*COMMAND, "share", "--board", "virtual://", "--name", "max")
    process = start(command, env=environment(), preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0)))
    said = finished(process)
    assert said.code == 3
    assert "share://max: the hub cannot be announced to programs:" in said.err
    assert "max.hub: File too large" in said.err
    assert "max" not in in_pipe("list").out
    assert in_pipe("servos", "--board", "rex").code == 0  # the other hub is not disturbed


def test_a_full_disk_behind_its_log_does_not_end_it(tmp_path: Path) -> None:
    command = (*COMMAND, "share", "--board", "virtual://", "--name", "max", "--tcp", "127.0.0.1:0", "-v")
    with Path("/dev/full").open("w") as full:
        hub = start(command, env=environment(), stderr=full)
    assert first_line(hub) == "listening share://max"
    assert in_pipe("servos", "--board", "max").code == 0
    assert finished(hub, signal.SIGTERM).code == 0


def test_a_full_disk_behind_its_output_is_told(tmp_path: Path) -> None:
    command = (*COMMAND, "share", "--board", "virtual://", "--name", "max")
    with Path("/dev/full").open("w") as full:
        said = finished(start(command, env=environment(), stdout=full))
    assert said.code == 1
    assert "standard output cannot be written" in said.err
