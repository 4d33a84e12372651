"""The studio lets in pages that were loaded from it and know the token, and carries what they ask to the hub.

Modules: servolink.studio.draft_methods, servolink.studio.start, servolink.studio.studio_methods,
servolink.studio.web_socket.
"""

from __future__ import annotations

import asyncio
import json
from contextlib import AsyncExitStack

import pytest
from aiohttp import ClientSession, WSMsgType, WSServerHandshakeError

from servolink.errors import OpenError
from servolink.hub import serve_board
from servolink.studio import draft_methods
from servolink.studio.robots import VIRTUAL
from servolink.studio.server import HEADERS, keep_port, last_ports, serve_studio
from servolink.studio.start import studio_for
from servolink.studio.studio_methods import Studio
from servolink.support import user_folder
from servolink.virtual import VirtualBoard, serve
from tests.studio.serving import LIMIT, Place, call, run, welcomed

pytestmark = pytest.mark.usefixtures("user")


def test_the_page_and_its_files_come_with_strict_headers() -> None:
    async def test(place: Place) -> None:
        for path in ("/", "/app.js", "/figure/stage.js", "/css/tokens.css", "/nothing"):
            async with place.http.get(place.address + path) as response:
                assert response.status == (404 if path == "/nothing" else 200)
                assert {name: response.headers[name] for name in HEADERS} == HEADERS
                tag = response.headers.get("ETag", "")
            async with place.http.get(place.address + path, headers={"If-None-Match": tag}) as response:
                assert response.status == (404 if path == "/nothing" else 304)

    run(test)


@pytest.mark.parametrize("path", ["/%2e%2e/server.py", "/../gate.py", "/vendor/vendor.json", "/tsconfig.json", "/css"])
def test_other_files_cannot_be_asked_for(path: str) -> None:
    async def test(place: Place) -> None:
        async with place.http.get(place.address + path) as response:
            assert response.status == 404

    run(test)


def test_another_name_is_misdirected() -> None:
    async def test(place: Place) -> None:
        for path in ("/", "/ws"):
            async with place.http.get(place.address + path, headers={"Host": "evil.example"}) as response:
                assert response.status == 421
                text = await response.text()
                assert place.address.removeprefix("http://") in text
                assert "not as 'evil.example'; --allow-host adds a name" in text

    run(test)


@pytest.mark.parametrize("origin", ["", "null", "http://127.0.0.1:1", "https://evil.example"])
def test_other_pages_get_no_socket(origin: str) -> None:
    async def test(place: Place) -> None:
        with pytest.raises(WSServerHandshakeError) as refused:
            async with place.page(Origin=origin):
                pass
        assert refused.value.status == 403

    run(test)


@pytest.mark.parametrize("first", ["{}", '{"token": "wrong"}', '{"token": 1}', "[", "\ufeff", "[" * 100_000])
def test_without_the_token_the_socket_is_closed(first: str) -> None:
    async def test(place: Place) -> None:
        place.gate.new_token("edit")
        async with place.page() as page:
            await page.send_str(first)
            message = await page.receive()
            assert message.type is WSMsgType.CLOSE
            assert message.data == 4401

    run(test)


def test_a_page_speaks_with_the_hub() -> None:
    async def test(place: Place) -> None:
        async with place.page() as page:
            welcome = await welcomed(page, place.gate.new_token("edit"))
            assert (welcome["role"], welcome["name"], welcome["is_virtual"]) == ("edit", "virtual", True)
            status = (await call(page, "status"))["result"]
            assert [each["who"] for each in status["programs"] if each["session"] == welcome["session"]] == [
                "studio: Tablet 2"
            ]
            moved = await call(page, "move", targets={"1": 20}, duration=0.1, wait=True)
            assert moved["result"] == {"seconds": 0.1}
            servos = (await call(page, "servos.list"))["result"]["servos"]
            assert abs(servos[0]["angle"] - 20) <= 2

    run(test)


def test_a_page_is_told_anew_whether_the_board_is_virtual() -> None:
    async def main() -> None:
        async with (
            asyncio.timeout(LIMIT),
            serve(VirtualBoard(3), tcp="127.0.0.1:0") as (real,),  # which is not announced as virtual
            AsyncExitStack() as first,
            ClientSession() as http,
        ):
            await first.enter_async_context(serve_board("virtual://", name="rex"))
            async with studio_for("share://rex") as served, serve_studio(served, "127.0.0.1", 0) as (gate, port):
                place = Place(served, gate, f"http://127.0.0.1:{port}", http)
                token = gate.new_token("edit")
                async with place.page() as page:
                    assert (await welcomed(page, token))["is_virtual"]
                await first.aclose()
                async with serve_board(real, name="rex"), place.page() as page:
                    welcome = await welcomed(page, token)
                    assert (welcome["url"], welcome["is_virtual"]) == (real, False)

    asyncio.run(main())


def test_a_page_that_may_only_watch_moves_nothing_and_stops_everything() -> None:
    async def test(place: Place) -> None:
        async with place.page() as page:
            await welcomed(page, place.gate.new_token("watch"))
            assert "needs the role" in (await call(page, "move", targets={"1": 20}, duration=0.1))["error"]["message"]
            assert (await call(page, "stop"))["result"] == {}
            servos = (await call(page, "servos.list"))["result"]["servos"]
            assert not any(servo["is_start"] for servo in servos)

    run(test)


def test_the_studio_has_methods_of_its_own() -> None:
    async def test(place: Place) -> None:
        async with place.page() as page:
            await welcomed(page, place.gate.new_token("edit"))
            assert (await call(page, "studio.about"))["result"]["version"]
            assert (await call(page, "studio.nothing"))["error"]["code"] == -32601

    run(test)


def test_a_page_that_goes_while_it_moves_the_robot_stops_it() -> None:
    async def test(place: Place) -> None:
        token = place.gate.new_token("edit")
        async with place.page() as other:
            await welcomed(other, token)
            async with place.page() as page:
                await welcomed(page, token)
                await call(page, "lease.take", dead_man=5.0)
                await call(page, "move", targets={"1": 90}, duration=10)
            while any(servo["is_start"] for servo in (await call(other, "servos.list"))["result"]["servos"]):
                pass
            assert (await call(other, "board.state"))["result"]["lease"] is None

    run(test)


def test_what_is_not_json_is_answered_by_the_hub() -> None:
    async def test(place: Place) -> None:
        async with place.page() as page:
            await welcomed(page, place.gate.new_token("edit"))
            for text in ("{", '{"jsonrpc":\n"2.0"}', "\x00", "[" * 100_000, '"\\ud800"'):
                await page.send_str(text)
                assert json.loads(await page.receive_str())["error"]["code"] in {-32700, -32600}

    run(test)


def test_pages_share_a_draft_and_tell_each_other_of_their_edits() -> None:
    async def test(place: Place) -> None:
        token = place.gate.new_token("edit")
        edit = {"kind": "active_joystick_table", "id": 0, "known": 0, "base": 1, "record": 2}
        async with place.page() as one, place.page() as other:
            await welcomed(one, token)
            await welcomed(other, token)
            assert (await call(other, "studio.draft.get"))["result"] == {"records": []}
            (saved,) = (await call(one, "studio.draft.save", edits=[edit]))["result"]["saved"]
            assert (saved["who"], saved["record"]) == ("Tablet 2", 2)
            told = json.loads(await other.receive_str())
            assert (told["method"], told["params"]) == ("studio.draft", {"records": [saved]})
            answer = (await call(other, "studio.draft.save", edits=[edit | {"record": 3}]))["result"]
            assert answer == {"saved": [], "conflicts": [saved]}

    run(test)


def test_pages_are_told_of_edits_at_another_studio_of_the_board(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(draft_methods, "_LOOK", 0.01)

    async def test(place: Place) -> None:
        edit = {"kind": "active_joystick_table", "id": 0, "known": 0, "base": 1, "record": 2}
        second = Studio(place.studio.hub)
        async with serve_studio(second, "127.0.0.1", 0) as (gate, port), place.page() as here:
            there = place._replace(gate=gate, address=f"http://127.0.0.1:{port}")
            await welcomed(here, place.gate.new_token("edit"))
            async with there.page() as page:
                await welcomed(page, gate.new_token("edit"))
                (saved,) = (await call(page, "studio.draft.save", edits=[edit]))["result"]["saved"]
            told = json.loads(await here.receive_str())
            assert (told["method"], told["params"]) == ("studio.draft", {"records": [saved]})

    run(test)


def test_a_caption_may_have_bytes_that_are_not_text() -> None:
    async def test(place: Place) -> None:
        record = {"action_id": 1, "action_caption": "\udcff\udc9b", "steps": []}
        edit = {"kind": "actions", "id": 1, "known": 0, "record": record}
        async with place.page() as page:
            await welcomed(page, place.gate.new_token("edit"))
            (saved,) = (await call(page, "studio.draft.save", edits=[edit]))["result"]["saved"]
            assert saved["record"] == record

    run(test)


def test_a_page_that_may_only_watch_edits_no_draft() -> None:
    async def test(place: Place) -> None:
        async with place.page() as page:
            await welcomed(page, place.gate.new_token("watch"))
            assert (await call(page, "studio.draft.get"))["result"] == {"records": []}
            assert "needs the role" in (await call(page, "studio.draft.save", edits=[]))["error"]["message"]

    run(test)


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "*", "::", "::1", "127.0.0.2"])
def test_this_machine_reaches_the_studio_wherever_it_listens(host: str) -> None:
    async def test(place: Place) -> None:
        try:
            async with serve_studio(place.studio, host, 0) as (gate, _):
                there = place._replace(gate=gate, address=gate.address)
                async with place.http.get(f"{gate.address}/") as response:
                    assert response.status == 200
                async with there.page() as page:
                    assert (await welcomed(page, gate.new_token("edit")))["role"] == "edit"
        except OpenError as error:
            pytest.skip(str(error))  # no IPv6, or one address of this machine only

    run(test)


def test_the_next_studio_of_a_board_has_the_same_port_if_that_is_free() -> None:
    async def main() -> None:
        async with studio_for(VIRTUAL) as served:
            async with (
                serve_studio(served, "127.0.0.1", 0) as (_, first),
                serve_studio(served, "127.0.0.1", 0) as (_, other),
            ):
                assert first != other
            async with (
                serve_studio(served, "127.0.0.1", 0) as (_, latest),
                serve_studio(served, "127.0.0.1", 0) as (_, beside),
            ):
                assert (latest, beside) == (other, first)
            async with serve_studio(served, "127.0.0.1", 0) as (_, again):
                assert again == other

    asyncio.run(main())


@pytest.mark.parametrize("content", [b"", b"0", b"-1", b"65536", b"x", b"9" * 100, b"\xff"])
def test_a_damaged_note_of_the_port_is_left_alone(content: bytes) -> None:
    for port in (1, 65535, 8123, 65534, 65533, 8123):
        keep_port("robbie", port)
    assert last_ports("robbie") == [8123, 65533, 65534, 65535]
    (path,) = (user_folder("data") / "studio").iterdir()
    path.write_bytes(content)
    assert last_ports("robbie") == []


def test_a_page_has_another_name_at_once() -> None:
    async def test(place: Place) -> None:
        async with place.page() as page:
            await welcomed(page, place.gate.new_token("edit"))
            assert (await call(page, "studio.rename", who="Blue"))["result"] == {"who": "Blue"}
            assert "studio: Blue" in [one["who"] for one in (await call(page, "status"))["result"]["programs"]]
            assert (await call(page, "rename", who="Teacher"))["result"] == {"who": "Teacher"}
            names = [one["who"] for one in (await call(page, "status"))["result"]["programs"]]
            assert "studio: Teacher" in names
            assert "Teacher" not in names
            assert (await call(page, "studio.rename", who="Blue"))["result"] == {"who": "Blue"}
            edit = {"kind": "project_id", "id": 0, "known": 0, "record": 5}
            assert (await call(page, "studio.draft.save", edits=[edit]))["result"]["saved"][0]["who"] == "Blue"
            assert "error" in await call(page, "studio.rename", who="x" * 61)

    run(test)
