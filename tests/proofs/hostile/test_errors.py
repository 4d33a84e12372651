"""Hostile texts in what a program says to the library: each error can be shown, logged and raised again as it is."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from servolink.client import connect
from servolink.errors import ServolinkError
from servolink.project import Project, ProjectFile, load_project, save_project
from servolink.protocol import RECORD_TYPES, Action, AddActionRequest, Codec, QueryActionResponse, packet_from_json
from servolink.transports import Address, Faults, NetworkPlace, create
from servolink.virtual import BoardKind, VirtualBoard, VirtualTransport, load_state, parse_script
from tests.proofs.hostile.calls import PROJECT
from tests.proofs.hostile.corpus import PAYLOADS, controls
from tests.sampling import sampled
from tests.virtual_time import run


def _stored_on_a_full_board(text: str) -> None:
    async def store() -> None:
        async with connect(VirtualTransport(VirtualBoard(1, kind=BoardKind(memory=0)), f"virtual://{text}")) as board:
            await board.request(AddActionRequest(1, text), unchecked=True)
            await board.add_action(Action(1, text))

    run(store())


def _opened(text: str) -> None:
    async def ask() -> None:
        async with connect(f"serial:///dev/x{text}") as board:
            await board.project_id()

    run(ask())


SAYINGS: dict[str, Callable[[str], object]] = {
    "caption": lambda text: Codec().encode(AddActionRequest(1, text)),
    "caption on a full board": _stored_on_a_full_board,
    "caption in another encoding": lambda text: Codec(caption_encoding="big5").encode(QueryActionResponse(1, text)),
    "caption encoding": lambda text: Codec(caption_encoding=text),
    "packet": lambda text: packet_from_json({"packet": text}),
    "packet that is a list": lambda text: packet_from_json({"packet": [text]}),
    "field": lambda text: packet_from_json({"id": 20020, "fields": {text: 1}}),
    "field of a record": lambda text: packet_from_json({"id": 20050, "fields": {"steps": [{text: 1}]}}),
    "value": lambda text: packet_from_json({"id": 20020, "fields": {"servo_id": text}}),
    "data": lambda text: packet_from_json({"id": 10050, "fields": {"data": text}}),
    "address": Address.parse,
    "address of a device": _opened,
    "scheme": lambda text: create(f"{text}://x"),
    "option": lambda text: create(f"virtual://?{text}=1"),
    "value of an option": lambda text: create(f"virtual://?servos={text}"),
    "faults": Faults.parse,
    "place": NetworkPlace.parse,
    "script": parse_script,
    "saved board": lambda text: load_state(VirtualBoard(1), _nowhere(text)),
    "project": ProjectFile.parse,
    "key of a project": lambda text: ProjectFile.parse(json.dumps({"schema": 1, text: 1})).project,
    "number in a project": lambda text: ProjectFile.parse(json.dumps({"schema": 1, "project_id": text})).project,
    "version": lambda text: ProjectFile.parse(json.dumps({"schema": text})).project,
    "type of a command": lambda text: (
        ProjectFile.parse(json.dumps({"schema": 1, "macros": [{"macro_id": 1, "commands": [{"type": text}]}]})).project
    ),
    "caption in a project": lambda text: (
        ProjectFile.parse(
            json.dumps({"schema": 1, "actions": [{"action_id": 1, "action_caption": text, "steps": []}]})
        ).project
    ),
    "file of a project": lambda text: load_project(_nowhere(text)),
    "file for a project": lambda text: save_project(_nowhere(text), PROJECT),
    "name of a record": lambda text: PROJECT.find(text, RECORD_TYPES),
    "name among hostile names": lambda text: (
        Project(actions=(Action(1, text), Action(2, text), Action(3, f"{text}!")))
    ).find(text, RECORD_TYPES),
}


@pytest.mark.parametrize("name", sampled(SAYINGS, 12))
def test_an_error_is_text(name: str) -> None:
    errors = [error for payload in PAYLOADS if (error := _error(SAYINGS[name], payload.text)) is not None]
    assert errors
    for error in errors:
        for quote in (str(error), repr(error)):
            assert not controls(quote), ascii(quote)


def _nowhere(text: str) -> Path:
    """Return a path with `text` in its last name; never one that could be written, not even as root."""
    return Path("/dev/null/nowhere") / f"x{text.replace('/', chr(0x2215))}"


def _error(say: Callable[[str], Any], text: str) -> Exception | None:
    try:
        say(text)
    except (ServolinkError, ValueError) as error:
        return error
    return None
