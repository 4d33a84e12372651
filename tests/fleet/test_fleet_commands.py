"""`servolink fleet` as a person runs it, with boards that only answer.

Modules: servolink.cli.fleet.boards, servolink.cli.fleet.fleet_apply, servolink.cli.fleet.fleet_join,
servolink.cli.fleet.fleet_run, servolink.cli.fleet.fleet_watch.
"""

from __future__ import annotations

import asyncio
import json
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from servolink.errors import OpenError
from servolink.fleet import checks
from servolink.project import ProjectFile, save_project
from servolink.support import ExitCode
from tests.cli.programs import Said, call, finished, in_terminal, started
from tests.extras import hide
from tests.fleet.mosquitto import Broker, needs_broker
from tests.fleet.patience import LIMIT, have_answered, patience_ends
from tests.fleet.stand_in import Refused, StandIn, stand_ins
from tests.project.projects import HUMANOID

pytestmark = needs_broker

APPLIED = {"changed": True, "resumed": False, "backup": "b.json", "project_id_bits": 32}
PLAN = {
    "changes": [{"what": "action 3", "old": None, "new": {}}, {"what": "macro 4", "old": {}, "new": None}],
    "inconsistencies": [],
    "estimated_seconds": 2.4,
    "memory": {"warning": None},
    "is_unfinished": False,
}
SAME = {**PLAN, "changes": []}


@contextmanager
def boards(broker: Broker, *names: str, **known: Any) -> Iterator[list[StandIn]]:
    """Yield boards that answer on a loop of their own."""
    there: list[StandIn] = []
    ready, over = threading.Event(), asyncio.Event()
    loop = asyncio.new_event_loop()

    async def serve() -> None:
        async with stand_ins(broker, *names, **known) as found:
            there.extend(found)
            for board in found:
                board.answers |= {"board.state": lambda params: {}, "echo": lambda params: {"monotonic": 0.0}}
            ready.set()
            await over.wait()

    thread = threading.Thread(target=loop.run_until_complete, args=(serve(),))
    thread.start()
    try:
        assert ready.wait(120)
        yield there
    finally:
        loop.call_soon_threadsafe(over.set)
        thread.join()
        loop.close()


def refuse(text: str) -> Callable[[object], Any]:
    def answer(params: object) -> None:
        raise Refused("ProjectError", text)

    return answer


@pytest.fixture
def said(broker: Broker, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Callable[..., Said]:
    """Return what runs a command of the fleet."""
    monkeypatch.setenv("SERVOLINK_BROKER", broker.url)
    return lambda *words: call(capsys, "fleet", *words)


def test_boards_are_listed(broker: Broker, said: Callable[..., Said]) -> None:
    with boards(broker, "rex", "fido", battery_percent=50.5, servos=16, problems=("it is \x1b[31mhot",)):
        found = said("list")
        assert found.code == ExitCode.OK
        assert found.out.splitlines()[0].split() == ["board", "state", "battery", "may", "servos", "version", "machine"]
        assert found.out.splitlines()[1].split() == ["fido", "ready", "50.5", "%", "edit", "16", "0.1.0", "here"]
        assert "rex: it is \\x1b[31mhot" in found.out
        (fido, _) = said("list", "--json").json["boards"]
        assert fido["board"] == "fido"
        assert fido["is_online"]
        assert fido["battery_percent"] == 50.5


def test_nobody_is_listed_with_what_to_do(said: Callable[..., Said]) -> None:
    found = said("list")
    assert found.code == ExitCode.NO_BOARD
    assert "run `servolink fleet join`" in found.err


def test_boards_that_left_are_listed_as_offline(broker: Broker, said: Callable[..., Said]) -> None:
    with boards(broker, "rex") as (rex,):
        _leave(rex)
        found = said("list")
    assert found.code == ExitCode.NO_BOARD
    assert found.out.splitlines()[1].split()[:2] == ["rex", "offline"]


def test_a_board_that_left_for_good_is_forgotten(broker: Broker, said: Callable[..., Said]) -> None:
    with boards(broker, "rex", "fido") as (rex, _):
        _leave(rex)
        for words, told in (
            (("rex", "fido"), "fido is connected, and cannot be forgotten"),
            (("rax",), "'rax' is unknown to the broker"),
        ):
            found = said("forget", *words, "--yes")
            assert found.code == ExitCode.FAILED
            assert told in found.err
        assert [each["board"] for each in said("list", "--json").json["boards"]] == ["fido", "rex"]
        assert said("forget", "rex").code == ExitCode.USAGE
        assert said("forget", "rex", "--yes").out == "forgotten: rex\n"
        assert said("forget", "rex", "--yes").code == ExitCode.FAILED
        assert [each["board"] for each in said("list", "--json").json["boards"]] == ["fido"]


def test_a_board_that_left_is_named_as_the_reason_why_nobody_starts(broker: Broker, said: Callable[..., Said]) -> None:
    with boards(broker, "rex", "fido") as (rex, fido):
        _leave(rex)
        fido.answers["prepare"] = lambda params: {"seconds": 2.0}
        ran = said("run", "Wave", "--on", "rex,fido")
    assert ran.code == ExitCode.FAILED
    assert "rex is not connected: start `servolink fleet join` on its machine" in ran.err
    assert "no board was started" in ran.err


def _leave(board: StandIn) -> None:
    leaving = board.publish(f"servolink/{board.name}/available", "offline")
    asyncio.run_coroutine_threadsafe(leaving, board.loop).result(120)


def test_a_stop_names_who_is_silent(
    broker: Broker, said: Callable[..., Said], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with boards(broker, "rex", "fido") as (rex, fido):
        found = said("stop", "--within", f"{LIMIT}")
        assert found.code == ExitCode.OK
        assert "stopped 2 boards within" in found.out
        before = rex.stops
        (tmp_path / "fleet.toml").write_text('[groups]\nback = ["fido"]\n', encoding="utf-8")
        found = said("stop", "--on", "back", "--groups", str(tmp_path / "fleet.toml"), "--json")
        assert (list(found.json["stopped"]), rex.stops) == (["fido"], before)
        fido.is_silent = True
        patience_ends(monkeypatch, have_answered("rex"))
        found = said("stop", "--within", f"{LIMIT}", "--json")
        assert found.code == ExitCode.FAILED
        assert list(found.json["stopped"]) == ["rex"]
        assert found.json["silent"] == ["fido"]
        assert rex.stops >= 2


def test_what_starts_together_is_said(broker: Broker, said: Callable[..., Said]) -> None:
    with boards(broker, "rex", "fido") as both:
        for board in both:
            board.answers |= {
                "prepare": lambda params: {"seconds": 2.0},
                "start": lambda params: {"host": "here", "after": 0.0, "monotonic": 1.0},
            }
        found = said("run", "Wave")
        assert found.code == ExitCode.OK
        assert found.out.splitlines() == [
            "Wave was started on 2 boards: fido, rex",
            "between the first and the last start: 0.0 ms, by the clock of their machine",
            "it takes 2 s",
        ]
        assert "stopped or released" not in found.err
        both[0].answers["prepare"] = lambda params: {"seconds": 2.0, "idle_servos": [1, 4]}
        found = said("run", "Wave")
        assert (found.code, "servos are stopped or released, and do not move: rex;" in found.err) == (ExitCode.OK, True)
        assert said("run", "Wave", "--json").json["idle_servos"] == {"rex": [1, 4]}
        both[0].answers["start"] = lambda params: {}
        found = said("run", "Wave", "--on", "rex")
        assert found.code == ExitCode.FAILED
        assert "perhaps started, without an answer: rex" in found.err
        assert "no board was started" not in found.err
        found = said("run", "Dance", "--on", "rex")
        assert found.code == ExitCode.FAILED
        assert "rex has no action or macro 'Dance'" in found.err
        assert "no board was started" in found.err


def test_a_project_is_applied_to_all_and_each_failure_is_named(
    broker: Broker, said: Callable[..., Said], tmp_path: Path
) -> None:
    file = tmp_path / "robot.servolink.json"
    save_project(file, HUMANOID)
    with boards(broker, "rex", "fido", "bob") as (rex, fido, bob):
        for board in (rex, fido):
            board.answers |= {"project.plan": lambda params: PLAN, "project.apply": lambda params: APPLIED}
        bob.answers["project.plan"] = lambda params: SAME
        fido.answers["project.apply"] = refuse("the board is full: action 3 does not fit")
        found = said("apply", str(file), "--yes")
        assert found.code == ExitCode.FAILED
        assert "done, and verified, on 1 board: rex" in found.out
        assert "held it already: bob" in found.out
        assert "fido: the board is full: action 3 does not fit" in found.err
        assert "deletes 1 record" in found.out
        found = said("apply", str(file), "--yes", "--json")
        assert found.json == {
            "done": {"rex": {"resumed": False, "backup": "b.json"}},
            "unchanged": ["bob"],
            "failed": {"fido": "fido: the board is full: action 3 does not fit"},
            "not_begun": [],
        }


def test_a_project_is_not_applied_unasked(said: Callable[..., Said], tmp_path: Path) -> None:
    file = tmp_path / "robot.servolink.json"
    save_project(file, HUMANOID)
    found = said("apply", str(file))
    assert found.code == ExitCode.USAGE
    assert "--yes" in found.err


def test_contents_are_exported(broker: Broker, said: Callable[..., Said], tmp_path: Path) -> None:
    with boards(broker, "rex", "fido") as (rex, fido):
        rex.answers["project.export"] = lambda params: {"project": ProjectFile(HUMANOID).form()}
        fido.answers["project.export"] = refuse("it does not answer")
        found = said("export", str(tmp_path / "all"))
        assert found.code == ExitCode.FAILED
        assert found.out == f"{tmp_path}/all/rex.servolink.json\n"
        assert found.err == "servolink: fido: it does not answer\n"
        found = said("export", str(tmp_path / "all"), "--on", "rex")
        assert found.code == ExitCode.USAGE
        assert "holds rex.servolink.json already; --yes replaces them" in found.err


def test_the_doctor_says_that_nothing_is_wrong(
    broker: Broker, said: Callable[..., Said], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(checks, "_SLOW", LIMIT)  # a busy machine is slow, too
    with boards(broker, "rex"):
        found = said("doctor")
        assert found.out == "the broker answers; 1 of 1 board connected\nnothing is wrong\n"
        assert found.code == ExitCode.OK
        assert said("doctor", "--json").json == {"boards": 1, "online": 1, "findings": []}


def test_boards_are_watched_as_lines(broker: Broker, said: Callable[..., Said]) -> None:
    with boards(broker, "rex", "fido", battery_percent=50.5):
        found = said("watch", "--seconds", "0.05")
        assert found.out.splitlines() == ["fido  ready  battery 50.5 %", "rex  ready  battery 50.5 %"]
        found = said("watch", "--seconds", "0.05", "--json")
        assert [json.loads(line)["board"] for line in found.out.splitlines()] == ["fido", "rex"]


def test_boards_are_watched_in_a_table(broker: Broker) -> None:
    with boards(broker, "rex", "fido"):
        shown = in_terminal("fleet", "watch", "--broker", broker.url, later=("hottest", "q"))
    assert shown.code == ExitCode.OK
    assert "2 boards, 2 connected" in shown.out


def test_without_the_extra_it_says_what_to_install(said: Callable[..., Said], monkeypatch: pytest.MonkeyPatch) -> None:
    hide("paho", "servolink.fleet", monkeypatch)
    found = said("list")
    assert found.code == ExitCode.FAILED
    assert found.err == (
        "servolink: servolink.fleet needs paho-mqtt; in a copy of servolink's repository: pip install '.[fleet]'\n"
    )


@pytest.mark.parametrize(
    "command",
    [
        ("fleet", "list", "--broker", "mqtt://rex@127.0.0.1", "--password-file", "nofile"),
        ("fleet", "join", "mqtt://127.0.0.1", "--policy", "nofile"),
    ],
)
def test_a_file_that_is_missing_is_a_failure_and_not_a_missing_board(
    command: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    found = call(capsys, *command)
    assert (found.code, found.out) == (ExitCode.FAILED, "")
    assert "nofile" in found.err


def test_join_takes_the_board_that_the_common_option_names(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[list[str]] = []

    def local_boards(names: list[str], *_: object, **__: object) -> None:
        asked.append(names)
        raise OpenError("seen enough")

    monkeypatch.setattr("servolink.fleet.local_boards", local_boards)
    monkeypatch.setenv("SERVOLINK_BOARD", "max")
    join = ["fleet", "join", "mqtt://127.0.0.1:1"]
    for words in (["--url", "rex", *join], ["--board", "rex", *join, "fido"], join):
        assert call(capsys, *words).code == ExitCode.NO_BOARD
    assert asked == [["rex"], ["fido", "rex"], []], "a variable names the board of other commands"


@pytest.mark.usefixtures("user")
@pytest.mark.parametrize("names", [(), ("rex",)])
def test_join_says_that_boards_connected_later_do_not_join(broker: Broker, names: tuple[str, ...]) -> None:
    hub = started("share", "--board", "virtual://", "--name", "rex")
    assert hub.stdout is not None
    assert hub.stdout.readline()
    bridge = started("fleet", "join", broker.url, *(f"share://{name}" for name in names))
    assert bridge.stdout is not None
    assert bridge.stdout.readline().startswith("joined rex ")
    said = finished(bridge, signal.SIGINT)
    assert ("connected later do not join" in said.err) is not bool(names)
    finished(hub, signal.SIGINT)
