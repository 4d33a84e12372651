"""The attack tables of the studio: each handshake, and each method through each kind of link."""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from aiohttp import ClientWebSocketResponse, WSMsgType, WSServerHandshakeError
from msgspec import inspect

from servolink.boards import BoardProfile, ProfileFile, SafetyLimits
from servolink.control import Code, Role, RoleName, Touches
from servolink.hub import METHODS as HUB_METHODS
from servolink.studio import page as page_module
from servolink.studio.links import Links
from servolink.studio.studio_methods import METHODS as OWN_METHODS
from tests.studio.serving import Place, run, welcomed

pytestmark = pytest.mark.usefixtures("user")

ROLES: dict[RoleName, str] = {
    "watch": """
        battery board.facts board.state buttons.subscribe buttons.unsubscribe lease.ask lease.beat lease.give
        limits.tighten project.ease project.export project.images project.lesson project.paste project.thin
        recorder.list recorder.status records.get records.list rename servos.ack servos.list servos.parameters
        servos.unwatch servos.watch status stop stop.heard studio.about studio.blocks.get studio.check
        studio.draft.get studio.figure.get studio.file.read studio.file.write studio.fleet studio.fleet.groups
        studio.fleet.stop studio.rename studio.stop studio.twin.reach studio.twin.stop studio.twin.try
        studio.twin.verdicts tap.start tap.stop
    """,
    "run": """
        lease.take motion.check recorder.mark recorder.start recorder.stop run run.prepare run.start
        studio.recording.read
    """,
    "move": """
        move move.end question.answer question.ask question.show question.withdraw release servo.set stream.begin
        stream.send
    """,
    "edit": """
        board.hold board.mode board.release line.test project.apply project.backups project.plan project.rollback
        records.delete records.put studio.backup studio.blocks.save studio.boards studio.doctor studio.draft.save
        studio.figure.save studio.firmware studio.fleet.run studio.fleet.runnable studio.give_back studio.limits.save
        studio.links studio.links.change studio.share studio.use
    """,
}
"""The least role for each method. A method that is not here fails the test: decide who may call it."""
TOUCHES = {
    "session": """
        board.hold board.release buttons.subscribe buttons.unsubscribe lease.ask lease.beat lease.give lease.take
        limits.tighten motion.check question.answer question.ask question.show question.withdraw rename servos.ack
        servos.unwatch servos.watch stop.heard studio.rename tap.start tap.stop
    """,
    "session, motion": "move.end run.prepare run.start stream.begin stream.send",
    "motion": "move release run servo.set",
    "motion, board": "project.apply project.rollback",
    "board": "board.mode records.delete records.put studio.blocks.save studio.draft.save",
    "host": """
        recorder.mark recorder.start recorder.stop studio.boards studio.figure.save studio.firmware
        studio.fleet.runnable studio.give_back studio.limits.save studio.links studio.links.change studio.share
        studio.use
    """,
    "motion, host": "studio.fleet.run",
}
"""What each method touches. A method that is not here, and touches something, fails the test."""
METHODS: dict[str, Any] = {**HUB_METHODS, **OWN_METHODS}
_DEFECT = -32603


def test_each_method_has_the_role_of_the_table() -> None:
    found = {name: str(Role(method.role)) for name, method in METHODS.items()}
    assert found == {name: role for role, names in ROLES.items() for name in names.split()}


def test_each_method_touches_what_the_table_says() -> None:
    found = {name: method.scope.words for name, method in METHODS.items() if method.scope.touches}
    assert found == {name: words for words, names in TOUCHES.items() for name in names.split()}


def example(kind: inspect.Type) -> Any:
    """Return a small value of a type; of a struct only the fields without a default."""
    found: Any = {}
    match kind:
        case inspect.StructType(_, fields=fields):
            found = {field.encode_name: example(field.type) for field in fields if field.required}
        case inspect.UnionType(types):
            found = example(next(each for each in types if not isinstance(each, inspect.NoneType)))
        case inspect.Metadata(inner):
            found = example(inner)
        case inspect.LiteralType(values):
            found = values[-1]  # of transmission modes the one in which boards respond
        case inspect.BoolType() | inspect.IntType() | inspect.FloatType():
            found = 1
        case inspect.StrType():
            found = "1"
        case inspect.ListType() | inspect.VarTupleType():
            found = []
        case inspect.DictType(_, inspect.FloatType()):
            found = {"1": 20}
    return found


def calls() -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield each method with params made from its declaration."""
    for name, method in METHODS.items():
        yield name, example(inspect.type_info(method.params))


async def answer(page: ClientWebSocketResponse, name: str, params: dict[str, Any]) -> dict[str, Any]:
    """Return the answer to a call; notifications before it are passed over."""
    await page.send_json({"jsonrpc": "2.0", "id": name, "method": name, "params": params})
    while (message := dict(json.loads(await page.receive_str()))).get("id") != name:
        pass
    return message


async def kept(owner: ClientWebSocketResponse) -> list[Any]:
    """Return all that a link could change, without the temperatures, which rise while servos hold."""
    servos, *others = [await answer(owner, each, {}) for each in ("servos.list", "project.export", "studio.links")]
    return [[servo | {"temperature_raw": None} for servo in servos["result"]["servos"]], *others]


@pytest.mark.parametrize("role", ROLES)
def test_a_link_calls_what_its_role_allows_and_nothing_else(role: RoleName) -> None:
    async def test(place: Place) -> None:
        async with place.page() as page, place.page() as owner:
            await welcomed(owner, place.gate.new_token("edit"))
            await welcomed(page, place.gate.new_token(role))
            before = await kept(owner)
            allowed = set[str]()
            for name, params in calls():
                found = await answer(page, name, params)
                code = found.get("error", {}).get("code")
                assert code != _DEFECT, found
                if code != Code.FORBIDDEN:
                    allowed.add(name)
            own = {"studio.links.change"}  # needs the link that the studio printed
            assert allowed | own == {name for name, m in METHODS.items() if m.role <= Role.parse(role)} | own
            if role == "watch":
                assert (await answer(owner, "status", {}))["result"]["lease"] is None
                await answer(owner, "servo.set", {"servo": "all", "start": True, "hold": True})  # it may stop
                after = await kept(owner)
                assert after == before

    run(test)


def host_files(folder: Path) -> dict[Path, bytes]:
    """Return the files of this computer, without the drafts and the blocks of boards, and copies of their content."""
    own = {"drafts", "blocks", "backups", "imports"}
    found = {path.relative_to(folder): path for path in folder.rglob("*") if path.is_file() and not path.is_socket()}
    return {name: path.read_bytes() for name, path in found.items() if not own & set(name.parts)}


@pytest.mark.parametrize("role", ["edit", "watch"])
def test_a_link_changes_nothing_of_this_computer_whatever_it_calls(
    role: RoleName, user: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(user / "config"))
    ProfileFile("virtual").save(BoardProfile(limits=SafetyLimits(angles={1: (-10, 10)})))

    async def test(place: Place) -> None:
        place.studio.links = links = Links(place.gate, 80, ("robot.local",))
        (token,) = [each.address.partition("token=")[2] for each in links.addresses() if each.role == role]
        async with place.page() as page:
            await welcomed(page, token)
            before = host_files(user)
            assert before
            refused = dict[str, str]()
            for name, params in calls():
                error = (await answer(page, name, params)).get("error", {})
                if error.get("code") == Code.FORBIDDEN:
                    refused[name] = error["message"]
            assert host_files(user) == before
            assert links.addresses()
            assert place.studio.hub == "virtual"
        own = {name for name, method in METHODS.items() if Touches.HOST in method.scope.touches}
        assert set(refused) >= own
        if role == "edit":
            assert set(refused) == own
            assert set(refused.values()) == {"this page was opened through a link"}

    run(test)


def test_a_method_of_a_later_hub_is_not_passed_on_for_a_link(monkeypatch: pytest.MonkeyPatch) -> None:
    declared = {name: method for name, method in HUB_METHODS.items() if name != "battery"}
    monkeypatch.setattr(page_module, "HUB_METHODS", declared)

    async def test(place: Place) -> None:
        place.studio.links = Links(place.gate, 80, ("robot.local",))
        tokens = [place.gate.new_token("edit")]
        tokens += [each.address.partition("token=")[2] for each in place.studio.links.addresses()]
        for token in tokens:
            async with place.page() as page:
                await welcomed(page, token)
                assert ("result" in await answer(page, "battery", {})) == (token == tokens[0])
                assert "result" in await answer(page, "servos.list", {})

    run(test)


HOSTS = {"{place}": True, "localhost:{port}": True, "evil.example": False, "127.0.0.1": False, "127.0.0.1:1": False}
ORIGINS = {
    "http://{place}": True,
    "http://localhost:{port}": True,
    **dict.fromkeys(
        ("https://{place}", "http://localhost", "http://evil.example:{port}", "null", "", "file://", "http://{place}/"),
        False,
    ),
}
TOKENS = {"{token}": True, **dict.fromkeys(("", "{token}x", "{half}", "\u0000", "{token}\u0000", "é"), False)}


@pytest.mark.parametrize(("host", "is_host"), HOSTS.items())
def test_only_the_right_name_origin_and_token_together_get_in(host: str, *, is_host: bool) -> None:
    async def test(place: Place) -> None:
        port, token = place.address.rpartition(":")[2], place.gate.new_token("edit")
        words = {"place": f"127.0.0.1:{port}", "port": port, "token": token, "half": token[: len(token) // 2]}
        for (origin, is_origin), (text, is_token) in product(ORIGINS.items(), TOKENS.items()):
            headers = {"Origin": origin.format(**words), "Host": host.format(**words)}
            opening = place.http.ws_connect(f"{place.address}/ws", headers=headers)
            if not (is_host and is_origin):
                with pytest.raises(WSServerHandshakeError) as refused:
                    await opening
                assert refused.value.status == (403 if is_host else 421)
                continue
            async with opening as page:
                await page.send_json({"token": text.format(**words)})
                message = await page.receive()
                assert (message.type is WSMsgType.TEXT) == is_token, text
                assert is_token or message.data == 4401

    run(test)
