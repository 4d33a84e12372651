"""The demo: each step checked from outside, and the whole of it as a person sees it.

Module: servolink.cli.first_steps.demo_stage.
"""

from __future__ import annotations

import asyncio
import re
import shlex
import sys
import time
from collections.abc import Callable
from typing import Any

import pytest

from servolink.cli.first_steps import demo
from servolink.cli.first_steps import demo_stage as stage
from servolink.cli.first_steps.demo import STEPS
from servolink.cli.first_steps.demo_stage import FaultyLine
from servolink.cli.screen.result import print_for_people
from servolink.transports import MemoryTransport
from tests import processes
from tests.cli.programs import Said, call, environment, in_terminal, program

NAMES = list(STEPS)


@pytest.fixture(scope="module")
def told() -> Said:
    """What the fast demo says to programs."""
    return program("demo", "--fast", "--json")


@pytest.fixture(scope="module")
def steps(told: Said) -> dict[str, Any]:
    """Its objects by step."""
    return {described["step"]: described for described in told.objects}


def measured(steps: dict[str, Any], name: str) -> dict[str, Any]:
    """Return what a step measured."""
    found = steps[name]["measured"]
    assert isinstance(found, dict)
    return found


def test_every_step_went_well(told: Said, steps: dict[str, Any]) -> None:
    assert (told.code, told.err) == (0, "")
    assert list(steps) == [*NAMES, "end"]
    assert all(described["ok"] for described in steps.values())
    assert all(steps[name]["checks"] and all(steps[name]["checks"].values()) for name in NAMES)
    assert (steps["end"]["failed"], steps["end"]["seconds"] < processes.LIMIT) == ([], True)


def test_it_goes_through_a_real_serial_port(steps: dict[str, Any]) -> None:
    assert measured(steps, "servos")["servos"] == 16
    scheme = "tcp://" if sys.platform == "win32" else "serial:///dev/"
    assert measured(steps, "servos")["url"].startswith(scheme)
    assert steps["end"]["stats"]["bytes_received"] > 1000


@pytest.mark.parametrize("name", ["pose", "action", "macro"])
def test_movements_take_their_time(name: str, steps: dict[str, Any]) -> None:
    assert 0.03 < measured(steps, name)["seconds"] < processes.LIMIT


def test_the_button_was_pressed_and_released(steps: dict[str, Any]) -> None:
    assert measured(steps, "button")["events"] == ["press", "up"]


def test_one_reply_was_damaged(steps: dict[str, Any]) -> None:
    counted = measured(steps, "damaged")
    assert counted["damaged_responses"] == 1
    assert counted["skipped_bytes"] >= 9 + 1 + 16 * 11, "the whole answer of 16 servos"
    assert min(counted["timeouts"], counted["retries"]) >= 1


def test_one_reply_was_late(steps: dict[str, Any]) -> None:
    counted = measured(steps, "late")
    assert counted["delayed_responses"] == 1
    assert min(counted["timeouts"], counted["fences"], counted["late_responses"]) >= 1
    assert (counted["late_angle"] != 0, counted["angle"]) == (True, 0)


def test_a_pulled_cable_lost_nothing(steps: dict[str, Any]) -> None:
    assert measured(steps, "export") == {"file": measured(steps, "export")["file"], "actions": 3, "macros": 1}
    pulled = measured(steps, "pulled")
    assert 0 < pulled["done"] < pulled["total"]
    assert measured(steps, "resumed")["differences"] == 0


def test_the_commands_to_try_next_work_as_they_are(steps: dict[str, Any]) -> None:
    serve, *others = steps["end"]["next"]
    server = processes.start(shlex.split(serve), env=environment())
    assert server.stdout is not None
    assert server.stdout.readline().startswith("listening tcp://")
    ran = [processes.run(["/bin/sh", "-c", command], env=environment()) for command in others]
    assert [(one.returncode, one.stderr) for one in ran] == [(0, ""), (0, "")]
    assert len(ran[0].stdout.splitlines()) == 17
    assert re.search(r"^ +1 .* 60°$", ran[1].stdout, re.MULTILINE)


def test_plain_text_has_no_escapes() -> None:
    said = program("demo", "--fast")
    assert (said.code, said.err) == (0, "")
    assert all(character == "\n" or character.isprintable() for character in said.out)
    titles = re.findall(r"^\d+\. (.*)$", said.out, re.MULTILINE)
    assert titles == [(step.__doc__ or "").rstrip(".") for step in STEPS.values()]
    assert "FAILED" not in said.out


@pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are those of Unix")
@pytest.mark.parametrize(
    ("arguments", "angles"), [(("--fast",), 2), pytest.param((), 10, marks=pytest.mark.slow)], ids=["fast", "real time"]
)
def test_a_terminal_sees_the_servos_move(arguments: tuple[str, ...], angles: int) -> None:
    said = in_terminal("demo", *arguments)
    assert said.code == 0
    assert said.out.rindex("\x1b[?25h") > said.out.rindex("\x1b[?25l"), "the cursor is there again"
    assert len(set(re.findall(r"servo 4 .*?(-?\d+)°", said.out))) > angles
    assert "All of it worked" in said.out


@pytest.mark.parametrize(("owner", "name"), [(demo, "say"), (FaultyLine, "release")])
def test_no_stall_of_the_machine_fails_the_late_response(
    owner: object, name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def stalling(function: Callable[..., None]) -> Callable[..., None]:
        def stall_first(*arguments: object) -> None:
            time.sleep(0.7)  # the stall that is tested: the loop stands still
            function(*arguments)

        return stall_first

    monkeypatch.setattr(owner, name, stalling(getattr(owner, name)))
    monkeypatch.setattr(demo, "STEPS", {name: STEPS[name] for name in ("pose", "late")})
    assert call(capsys, "demo", "--fast", "--json").code == 0


@pytest.mark.parametrize("as_json", [False, True])
def test_a_check_that_fails_is_named(
    as_json: bool, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(FaultyLine, "damage_next", lambda line: None)
    said = call(capsys, "demo", "--fast", *(["--json"] if as_json else []))
    assert said.code == 1
    if as_json:
        assert said.objects[-1]["failed"] == ["damaged"]
        assert [described["step"] for described in said.objects if not described["ok"]] == ["damaged", "end"]
    else:
        assert "FAILED: exactly one response was damaged" in said.out
        assert "FAILED: damaged." in said.out


def test_an_error_ends_the_play(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    async def broken(scene: object) -> dict[str, Any]:
        raise TimeoutError

    monkeypatch.setattr(demo, "STEPS", {"first": broken, "second": broken})
    said = call(capsys, "demo", "--fast", "--json")
    assert said.code == 1
    assert [described["step"] for described in said.objects] == ["first", "end"]
    assert said.objects[0]["measured"] == {"error": "nothing came in time"}


@pytest.mark.parametrize("width", [80, 44])
def test_long_lines_are_broken_between_words(width: int, capsys: pytest.CaptureFixture[str]) -> None:
    text = "pulled while writing, at macro 1: the connection to /dev/pts/1 is gone: the cable was pulled out of it"
    command = "servolink --board tcp://127.0.0.1:40000 move 1=60 2=-30 --speed 45 --with-many-more-options"
    end = demo.DemoEnd(ok=True, failed=[], seconds=9.5, next=[command], stats={})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stage, "is_terminal", lambda: True)
        patch.setenv("COLUMNS", str(width))
        stage.say(text)
        print_for_people(demo.end_text(end))
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines())) <= width
    assert text in " ".join(out.split())
    pasted = out.partition("own:\n")[2].replace("\\\n", "").split()
    assert pasted == command.split(), "it can be pasted into a shell"


@pytest.mark.parametrize("url", ["nonsense://x", "virtual://"])
def test_an_address_is_wrong_usage(url: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "--board", url, "demo", "--fast")
    assert (said.code, said.out) == (2, "")
    assert "the demo has virtual boards of its own; leave out --board" in said.err


def test_the_board_of_other_commands_is_left_alone(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    async def good(scene: object) -> dict[str, Any]:
        return {}

    monkeypatch.setattr(demo, "STEPS", {"first": good})
    monkeypatch.setenv("SERVOLINK_BOARD", "nonsense://x")
    assert call(capsys, "demo", "--fast").code == 0


class ProbeResult:
    """Collects what comes through the line."""

    def __init__(self) -> None:
        self.chunks: list[bytes] = []

    def data(self, chunk: bytes, /) -> None:
        self.chunks.append(chunk)

    def lost(self, error: Exception | None, /) -> None:
        pass


async def test_the_line_does_one_thing_once() -> None:
    ours, theirs = MemoryTransport.pair()
    line, heard = FaultyLine(ours), ProbeResult()
    await line.open(heard)
    await theirs.open(ProbeResult())

    async def comes(chunk: bytes) -> list[bytes]:
        heard.chunks.clear()
        await theirs.send(chunk)
        await asyncio.sleep(0.001)
        return list(heard.chunks)

    assert await comes(b"good") == [b"good"]
    line.damage_next()
    (damaged,) = await comes(b"bad!")
    assert sum(one != other for one, other in zip(damaged, b"bad!", strict=True)) == 1
    assert await comes(b"good") == [b"good"]
    line.hold_next()
    assert await comes(b"late") == []
    assert await comes(b"behind") == []
    line.release()
    assert heard.chunks == [b"late", b"behind"]
    assert await comes(b"good") == [b"good"]
    assert (line.damaged, line.held) == (1, 1)
    line.hold_next()
    assert await comes(b"lost") == []
    await line.close()
    await theirs.close()
    line.release()
    assert heard.chunks == []


@pytest.mark.parametrize(
    ("called", "found", "name"),
    [
        ("/opt/bin/servolink", "/opt/bin/servolink", "servolink"),
        (".venv/bin/servolink", "/usr/bin/servolink", ".venv/bin/servolink"),
        ("my venv/bin/servolink", None, "'my venv/bin/servolink'"),
        ("/lib/servolink/__main__.py", "/usr/bin/servolink", f"{shlex.quote(sys.executable)} -m servolink"),
    ],
)
def test_commands_are_named_as_this_one_was(
    called: str, found: str | None, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", [called])
    monkeypatch.setattr("shutil.which", lambda command: found)
    assert demo.own_name() == name
