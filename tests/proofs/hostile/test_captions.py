"""Captions that would take over a terminal are shown as text, and lose nothing on their way to programs and files."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from servolink.client import connect
from servolink.errors import ConnectionLost, escape
from servolink.project import load_project
from servolink.protocol import HEADER_SIZE, AddActionRequest, Codec
from servolink.transports import RecordingTransport, create
from tests.cli.programs import in_terminal
from tests.cli.terminals import ESCAPE, in_pipe
from tests.proofs.hostile.corpus import ONE_OF_EACH, PAYLOADS, controls
from tests.proofs.hostile.world import World
from tests.virtual_time import run


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    """A hostile one."""
    world = World.hostile(tmp_path_factory.mktemp("world") / "hostile")
    world.build()
    return world


def on_the_wire(action_id: int, text: str) -> bytes:
    """Return the caption of an action as the board gets it, without its padding."""
    packet = AddActionRequest(action_id, text)
    return Codec().encode(packet, unchecked=True)[HEADER_SIZE + 4 : HEADER_SIZE + 36].partition(b"\0")[0]


def test_programs_get_the_captions_as_they_are(world: World) -> None:
    said = in_pipe("--json", *world.arguments("--url {all} actions"))
    found = json.loads(said.out)["actions"]
    assert [on_the_wire(one["action_id"], one["action_caption"]) for one in found] == [
        payload.caption.partition(b"\0")[0] for payload in PAYLOADS
    ]


def test_a_project_file_keeps_the_captions_as_they_are(world: World, tmp_path: Path) -> None:
    path = tmp_path / "file"
    assert in_pipe("--url", world.url("few"), "export", str(path)).code == 0
    assert not controls(path.read_text(encoding="utf-8"))
    actions = load_project(path, unchecked=True).actions
    assert [on_the_wire(one.action_id, one.action_caption) for one in actions] == [
        payload.caption.partition(b"\0")[0] for payload in ONE_OF_EACH
    ]


def test_markup_is_shown_as_it_is(world: World) -> None:
    quote = in_pipe("--url", world.url("all"), "actions").out
    for text in ("[bold]x[/]", "[link=file:///]x[/link]", "[@click=app.bell()]x", ":bomb:", "<b>x</b>", "\\[bold]"):
        assert text in quote


@pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are those of Unix")
@pytest.mark.parametrize("command", ["servos", "tables 1"])
def test_a_program_in_a_terminal_of_its_own_makes_only_its_own_escapes(command: str, world: World) -> None:
    said = in_terminal("--url", world.url("few"), *command.split())
    assert said.code == 0
    assert r"\x1b[2J" in said.out
    assert not controls(ESCAPE.sub("", said.out)) - {"\r"}
    assert {*ESCAPE.findall(said.out)} <= {"\x1b[1m", "\x1b[0m"}


@pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are those of Unix")
def test_a_lesson_in_a_project_with_a_hostile_name(world: World) -> None:
    arguments = world.arguments("--url {few} teach wave 1 --file {lesson} --yes")
    said = in_terminal(*arguments, later=("records a pose", " q"))
    assert said.code == 0
    assert "'wave' with 1 pose is written: " in said.out
    assert not controls(ESCAPE.sub("", said.out)) - {"\r"}
    assert load_project(world.path("lesson")).actions[0].action_caption == "wave"


def test_a_recording_holds_nothing_but_plain_characters(world: World, tmp_path: Path) -> None:
    async def record() -> None:
        transport = RecordingTransport(create(world.url("few")), tmp_path / "recording")
        async with connect(transport) as board:
            assert len(await board.actions()) == len(ONE_OF_EACH)
            transport._break(world.name)
            with pytest.raises(ConnectionLost) as lost:
                await board.actions()
        assert not controls(str(lost.value))

    run(record())
    text = (tmp_path / "recording").read_text(encoding="ascii")
    assert not controls(text)
    assert json.loads(text.splitlines()[-1])["lost"].endswith(escape(world.name))
