"""`servolink share`: what it prints, what it answers, and how it ends.

Module: servolink.cli.together.share_view.
"""

from __future__ import annotations

import json
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from msgspec import Struct, structs

from servolink.cli.screen.output import plain_lines
from servolink.cli.together.share_view import Rate, facts, is_for_the_log, programs, status_line, text_of
from servolink.control import (
    ConnectionNow,
    HoldNotice,
    HoldStatus,
    HubStatus,
    LeaseNotice,
    LeaseStatus,
    ProblemNotice,
    ProgramNotice,
    ProgramStatus,
    RecordingNotice,
    RefusedNotice,
)
from servolink.hub import default_name
from tests.cli.programs import finished, in_terminal, program, started
from tests.cli.terminals import in_pipe

LEASE = LeaseStatus("s1", "servolink move (pid 7)", 65.0, None)
PROGRAM = ProgramStatus("s1", "servolink move (pid 7)", "share", "edit", 3.2, 0, 5, 4, 0, 0, 0, 0)
STATUS = HubStatus("rex", "serial:///dev/ttyACM0", "connected", 7325.0, (PROGRAM,), None, None, 4, 1)


@pytest.fixture(autouse=True)
def _exclusive(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))


def lines_of(process: subprocess.Popen[str], count: int) -> list[str]:
    assert process.stdout is not None
    return [process.stdout.readline().rstrip() for _ in range(count)]


@pytest.fixture
def shared() -> Iterator[subprocess.Popen[str]]:
    hub = started("share", "--board", "virtual://?servos=2", "--name", "rex")
    assert lines_of(hub, 1) == ["listening share://rex"]
    yield hub
    if hub.poll() is None:
        finished(hub, signal.SIGTERM)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_prints_its_doors_and_ends_by_a_signal(number: signal.Signals) -> None:
    hub = started("share", "--board", "virtual://", "--tcp", "127.0.0.1:0", "--watch-tcp", "127.0.0.1:0", "--pty")
    first, *tcp, pty = lines_of(hub, 4)
    assert first == "listening share://virtual"
    assert in_pipe("share", "--status", "--json").json["doors"] == [line.split()[1] for line in (first, *tcp, pty)]
    assert all(line.startswith("listening tcp://127.0.0.1:") for line in tcp)
    assert pty.startswith("listening serial:///dev/")
    watcher = started("watch", "--board", "virtual", "--seconds", "100", "--json")
    lines_of(watcher, 1)
    said = finished(hub, number)
    assert said.code == 0
    assert f"servolink: {tcp[0].split()[1]} is open to every user of this machine\n" in said.err
    assert f"servolink: {tcp[1].split()[1]} is open to every user of this machine, but only for reading\n" in said.err
    assert "the board was left unchanged, and 1 program disconnected\n" in said.err
    assert watcher.stderr is not None
    while "the connection is lost" not in watcher.stderr.readline():  # before it is ended
        assert watcher.poll() is None
    finished(watcher, signal.SIGTERM)


def test_in_json_each_door_is_an_object() -> None:
    hub = started("share", "--board", "virtual://", "--name", "rex", "--tcp", "127.0.0.1:0", "--json")
    listening = [json.loads(line)["listening"] for line in lines_of(hub, 2)]
    assert listening[0] == "share://rex"
    assert in_pipe("servos", "--board", listening[1]).code == 0
    assert finished(hub, signal.SIGTERM).out == ""


def test_programs_behind_doors_have_a_byte_order_of_their_own() -> None:
    board = ("--board", "virtual://?servos=2&byte_order=big")
    hub = started("share", *board, "--name", "rex", "--tcp", "127.0.0.1:0", "--door-byte-order", "little")
    _, tcp = (line.split()[1] for line in lines_of(hub, 2))
    for arguments in (("--board", tcp), ("--board", "rex"), ("--board", "rex", "--byte-order", "big")):
        assert len(in_pipe("servos", "--json", *arguments).json["servos"]) == 2
    finished(hub, signal.SIGTERM)


def test_commands_find_it_and_it_tells_who_is_there(shared: subprocess.Popen[str]) -> None:
    assert "shared by a hub" in in_pipe("list").out
    assert in_pipe("servos", "--json", "--board", "rex").json["servos"][1]["servo_id"] == 2
    assert in_pipe("move", "1=10", "--duration", "0.1").code == 0  # the only board here
    status = in_pipe("share", "--status").out
    assert status.startswith("hub               share://rex\nboard             virtual://?servos=2 (connected)\n")
    assert status.endswith("no program is connected\n")
    described = in_pipe("share", "--status", "--json", "--board", "rex").json
    assert (described["name"], described["programs"], described["lease"]) == ("rex", [], None)


def test_the_lease_is_taken_from_a_program_and_given_back(shared: subprocess.Popen[str]) -> None:
    assert in_pipe("share", "--take", "rex").out == "nobody has the lease: any program may move the servos\n"
    moving = started("move", "1=90", "--duration", "60", "--board", "rex")
    while (lease := in_pipe("share", "--status", "--json").json["lease"]) is None:
        assert moving.poll() is None
    assert lease["who"] == f"servolink move (pid {moving.pid})"
    refused = in_pipe("move", "2=10", "--board", "rex")
    assert refused.code == 1
    assert f"servolink move (pid {moving.pid})" in refused.err
    assert "servolink share --take rex" in refused.err
    taken = in_pipe("share", "--take", "rex")
    assert taken.out.startswith(f"servolink move (pid {moving.pid}) may not move the servos any more;")
    assert in_pipe("move", "2=10", "--duration", "0.1", "--board", "rex").code == 0
    assert in_pipe("share", "--give", "rex", "--json").json == {"moved_by": None}
    assert in_pipe("stop", "--board", "rex").code == 0
    finished(moving, signal.SIGTERM)


def test_it_answers_for_the_board_at_an_address(monkeypatch: pytest.MonkeyPatch) -> None:
    board = started("virtual", "--tcp", "127.0.0.1:0")
    url = lines_of(board, 1)[0].split()[1]
    hub = started("share", "--board", url, "--name", "rex")
    lines_of(hub, 1)
    assert in_pipe("share", "--status", "--json", "--board", url).json["name"] == "rex"
    monkeypatch.setenv("SERVOLINK_BOARD", "tcp://127.0.0.1:1")
    assert in_pipe("share", "--status", "--json", "--name", "rex").json["url"] == url
    finished(hub, signal.SIGTERM)
    finished(board, signal.SIGTERM)


def test_a_second_hub_is_told_of_the_first(shared: subprocess.Popen[str]) -> None:
    said = program("share", "--board", "virtual://", "--name", "rex")
    assert said.code == 3
    assert "shared by a hub" in said.err
    said = program("share", "--board", "share://rex", "--name", "max")
    assert said.code == 3
    assert "is shared by a hub" in said.err


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (("share", "--status"), "no board is shared here; `servolink share` shares one"),
        (("share", "--status", "--board", "virtual://"), "virtual:// is not shared"),
        (("share", "--take", "rex"), "no hub of this name is running"),
    ],
)
def test_without_a_hub_it_says_so(arguments: tuple[str, ...], why: str) -> None:
    said = in_pipe(*arguments)
    assert said.code == 3
    assert why in said.err


def test_with_several_hubs_one_must_be_chosen(shared: subprocess.Popen[str]) -> None:
    other = started("share", "--board", "virtual://", "--name", "max")
    lines_of(other, 1)
    said = in_pipe("share", "--status")
    assert said.code == 2
    assert "choose one with --name: max, rex" in said.err
    assert in_pipe("share", "--status", "--name", "max", "--json").json["name"] == "max"
    finished(other, signal.SIGTERM)


def test_on_a_terminal_a_line_stays() -> None:
    said = in_terminal(
        "share",
        "--board",
        "virtual://",
        "--name",
        "rex",
        later=("rex  0 programs", signal.SIGINT),
        env={"TERM": "xterm"},
    )
    assert said.code == 0
    assert "0 responses/s" in said.out
    assert "\x1b[?25h" in said.out  # the cursor is back


# --- what it shows ---


@pytest.mark.parametrize(
    ("notice", "text"),
    [
        (ProgramNotice("joined", "s", "ann", "tcp", "edit"), "ann joined (tcp)"),
        (ProgramNotice("left", "s", "ann"), "ann left"),
        (ConnectionNow("lost"), "the connection to the board is lost; trying to get it back"),
        (
            ConnectionNow("lost", "another one"),
            "another one; plug the right one in again, or end this program and start it again to use the other one",
        ),
        (LeaseNotice("taken", "servolink move (pid 7)", LEASE), "servolink move (pid 7) has the lease now (taken)"),
        (LeaseNotice("over", None, None), "nobody has the lease now (over)"),
        (LeaseNotice("asked for", "bob", LEASE), "a program asks for the lease"),
        (HoldNotice(HoldStatus("s", "ann", "servolink apply")), "ann has exclusive use of the board: servolink apply"),
        (HoldNotice(None), "all may use the board again"),
        (RefusedNotice("ExecuteActionRequest", "no lease"), "ann: ExecuteActionRequest was not sent: no lease"),
        (ProblemNotice("the disk is full"), "the disk is full"),
        (RecordingNotice("started", "ann", "rex.mcap"), ""),
    ],
)
def test_what_happens_is_told_in_a_line(notice: Struct, text: str) -> None:
    assert text_of(notice, "ann") == text


def test_where_nobody_watches_only_what_matters_is_told() -> None:
    assert is_for_the_log(ConnectionNow("lost"))
    assert is_for_the_log(ProblemNotice("x"))
    assert not is_for_the_log(ProgramNotice("left", "s", "ann"))


def test_the_line_that_stays_fits() -> None:
    busy = HubStatus("rex", "x", "lost", 1.0, (PROGRAM, PROGRAM), LEASE, HoldStatus("s", "ann\x1b", "apply"), 9, 2)
    line = status_line(busy, 12.4, 200)
    assert line == (
        "rex (lost)  exclusively used by ann\\x1b  2 programs  12 responses/s  noise 2 B  lease: servolink move (pid 7)"
    )
    assert status_line(busy, 12.4, 20) == line[:20]


def test_the_rate_is_that_since_the_look_before() -> None:
    rate = Rate()
    assert rate.of(STATUS, 10.0) == 0.0
    assert rate.of(HubStatus("rex", "x", "connected", 1.0, (), None, None, 24, 0), 10.5) == 40.0
    assert rate.of(STATUS, 10.5) == 0.0


def test_columns_without_anything_are_left_out() -> None:
    assert plain_lines(programs(STATUS)) == [
        "program                 door   for  requests  responses",
        "servolink move (pid 7)  share  3 s         5          4",
    ]
    watching = ProgramStatus("s2", "127.0.0.1:5", "watch-tcp", "watch", 61.0, 0, 5, 4, 1, 2, 0, 3)
    status = HubStatus("rex", "x", "connected", 1.0, (PROGRAM, watching), None, None, 9, 2)
    assert list(programs(status).columns) == [
        *("program", "door", "role", "for", "requests", "responses", "unanswered", "refused", "garbage")
    ]


def told_of(status: HubStatus) -> dict[object, object]:
    return {name: value for name, value in facts(status).rows}  # noqa: C416 - rows are no pairs to a type checker


def test_the_facts_name_lease_and_hold() -> None:
    told = told_of(HubStatus("rex", "x", "connected", 7325.0, (), LEASE, None, 9, 2))
    assert told["shared for"] == "2 h 2 min"
    assert told["lease"] == "servolink move (pid 7) for 1 min 5 s"
    watched = LeaseStatus("s", "studio", 2.0, 0.35)
    held = HubStatus("rex", "x", "connected", 1.0, (), watched, HoldStatus("s", "ann", "apply"), 9, 2)
    told = told_of(structs.replace(held, doors=("share://rex", "tcp://127.0.0.1:9")))
    assert told["door"] == "tcp://127.0.0.1:9"
    assert told["lease"] == "studio for 2 s, and must report every 0.35 s"
    assert told["exclusive use by"] == "ann: apply"


@pytest.mark.parametrize(
    ("url", "name"),
    [
        ("serial:///dev/ttyACM0?baudrate=9600", "ttyACM0"),
        ("tcp://192.168.1.20:9000", "192-168-1-20-9000"),
        ("hid://1209:0001/left arm", "left-arm"),
        ("virtual://?servos=3", "virtual"),
        ("serial:///dev/", "dev"),
    ],
)
def test_a_board_without_a_name_is_called_by_the_end_of_its_address(url: str, name: str) -> None:
    assert default_name(url) == name
