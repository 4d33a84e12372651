"""A studio changes its robot: the servos are stopped first, every page is told, and nothing of one board meets another.

Modules: servolink.studio.robots, servolink.studio.robot_methods.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Any

import pytest
from aiohttp import ClientSession, ClientWebSocketResponse, WSMsgType

from servolink.boards import Alias, Aliases
from servolink.client import connect
from servolink.studio.links import Links
from servolink.studio.robots import VIRTUAL
from servolink.studio.server import serve_studio
from servolink.studio.start import studio_for
from servolink.virtual import VirtualBoard, serve
from tests.studio.serving import LIMIT, Place, call, run, welcomed

pytestmark = pytest.mark.usefixtures("user")

_MOVING = 4410


@asynccontextmanager
async def arm() -> AsyncIterator[str]:
    """Serve a board with 6 servos, which another program on this machine could be; yield its address."""
    async with serve(VirtualBoard(6), tcp="127.0.0.1:0") as (url,):
        yield url


def run_without_a_board(test: Callable[[Place], Awaitable[None]]) -> None:
    async def main() -> None:
        async with (
            asyncio.timeout(LIMIT),
            studio_for(None) as served,
            serve_studio(served, "127.0.0.1", 0) as (gate, port),
            ClientSession() as http,
        ):
            await test(Place(served, gate, f"http://127.0.0.1:{port}", http))

    asyncio.run(main())


async def farewell(page: ClientWebSocketResponse) -> tuple[list[dict[str, Any]], int | None]:
    """Return what the page is told until the studio closes it, and the code of the close."""
    told = []
    while (message := await page.receive()).type is WSMsgType.TEXT:
        told.append(dict(json.loads(message.data)))
    return [one["params"] for one in told if one.get("method") == "studio.moving"], page.close_code


def test_a_studio_without_a_board_offers_the_boards_that_are_here() -> None:
    async def test(place: Place) -> None:
        async with place.page() as page:
            welcome = await welcomed(page, place.gate.new_token("edit"))
            assert (welcome["name"], welcome["url"], welcome["is_virtual"]) == ("", "", False)
            assert (await call(page, "studio.boards"))["result"] == {"boards": [], "fleet": []}
            assert (await call(page, "studio.doctor", is_connected=False))["result"]["findings"] is not None
            for method in ("status", "stop", "servos.list"):
                assert "there is no method" in (await call(page, method))["error"]["message"]
            assert "any more" in (await call(page, "studio.draft.get"))["error"]["message"]
            await page.send_json({"jsonrpc": "2.0", "id": 1, "method": "studio.use", "params": {"url": VIRTUAL}})
            assert await farewell(page) == ([{"by": "Tablet 2", "left": "", "is_stopped": True}], _MOVING)
        async with place.page() as page:
            assert (await welcomed(page, place.gate.new_token("edit")))["name"] == "virtual"
            assert len((await call(page, "servos.list"))["result"]["servos"]) == 16

    run_without_a_board(test)


def test_all_pages_go_on_to_another_board_after_the_servos_were_stopped() -> None:
    async def test(place: Place) -> None:
        async with arm() as url, place.page() as chooses, place.page() as moves:
            await welcomed(chooses, place.gate.new_token("edit"))
            await welcomed(moves, place.gate.new_token("edit"))
            await call(moves, "lease.take")
            assert "result" in await call(moves, "move", targets={"1": 90}, duration=30)
            await chooses.send_json({"jsonrpc": "2.0", "id": 1, "method": "studio.use", "params": {"url": url}})
            for page in (chooses, moves):
                assert await farewell(page) == ([{"by": "Tablet 2", "left": "virtual", "is_stopped": True}], _MOVING)
            async with connect("share://virtual") as left, place.page() as page:
                servos = await left.servos()
                assert [one.servo_id for one in servos if one.is_start] == []
                assert abs(servos[0].angle) < 45
                assert (await welcomed(page, place.gate.new_token("watch")))["url"] == url
                assert len((await call(page, "servos.list"))["result"]["servos"]) == 6
                assert (await call(page, "status"))["result"]["lease"] is None

    run(test)


def test_every_page_may_stop_the_boards_that_are_shared_and_not_shown() -> None:
    async def test(place: Place) -> None:
        async with arm() as url, place.page() as page:
            await welcomed(page, place.gate.new_token("watch"))
            assert "result" in await call(page, "studio.stop")
            name = await place.studio.robots.open(url)
            async with connect(f"share://{name}") as board:
                await board.set_servo("all", start=True, hold=True)
                assert any(one.is_start for one in await board.servos())
                assert "result" in await call(page, "studio.stop")
                assert not any(one.is_start for one in await board.servos())

    run_without_a_board(test)


@pytest.mark.parametrize("url", ["tcp://127.0.0.1:1", "nonsense://", "", "share://nobody", "\u202e", "a" * 501])
def test_a_board_that_cannot_be_opened_changes_nothing(url: str) -> None:
    async def test(place: Place) -> None:
        async with place.page() as page:
            await welcomed(page, place.gate.new_token("edit"))
            answer = await call(page, "studio.share", url=url)
            assert answer["error"]["message"]
            if url:
                assert (await call(page, "studio.use", url=url))["error"]["message"]
            servos = (await call(page, "servos.list"))["result"]["servos"]
            assert all(servo["is_start"] for servo in servos)
        assert place.studio.hub == "virtual"

    run(test)


def test_a_board_that_is_being_written_is_not_left() -> None:
    async def test(place: Place) -> None:
        async with place.page() as page, place.page() as writes:
            await welcomed(page, place.gate.new_token("edit"))
            await welcomed(writes, place.gate.new_token("edit"))
            assert "result" in await call(writes, "board.hold", reason="writing the project")
            refused = (await call(page, "studio.use", url=""))["error"]
            assert "writing the project" in refused["message"]
            assert refused["data"]["reason"] == "in use"
            await call(writes, "board.release")
            assert place.studio.hub == "virtual"

    run(test)


def test_a_board_is_shared_beside_the_present_one_and_given_back() -> None:
    async def test(place: Place) -> None:
        async with arm() as url, place.page() as page:
            await welcomed(page, place.gate.new_token("edit"))
            name = (await call(page, "studio.share", url=url))["result"]["name"]
            found = {one["name"]: one for one in (await call(page, "studio.boards"))["result"]["boards"]}
            assert {(one, found[one]["is_ours"], found[one]["is_kept"]) for one in ("virtual", name)} == {
                ("virtual", True, True),
                (name, False, True),
            }
            assert "shared by a hub" in (await call(page, "studio.share", url=url))["error"]["message"]
            async with connect(f"share://{name}") as board:
                assert len(await board.servo_ids()) == 6
            assert (await call(page, "studio.give_back", name=name))["result"] == {}
            async with connect(url) as board:  # which one program at a time may open
                assert len(await board.servo_ids()) == 6
            await page.send_json(
                {"jsonrpc": "2.0", "id": 1, "method": "studio.give_back", "params": {"name": "virtual"}}
            )
            told, code = await farewell(page)
            assert ([one["left"] for one in told], code) == (["virtual"], _MOVING)
        async with place.page() as page:
            assert (await welcomed(page, place.gate.new_token("edit")))["name"] == ""
            assert (await call(page, "studio.boards"))["result"] == {"boards": [], "fleet": []}

    run(test)


def test_another_virtual_board_of_the_same_address_is_a_board_of_its_own() -> None:
    async def test(place: Place) -> None:
        async with place.page() as page:
            await welcomed(page, place.gate.new_token("edit"))
            assert (await call(page, "studio.share", url=VIRTUAL))["result"] == {"name": "virtual-2"}
            found = (await call(page, "studio.boards"))["result"]["boards"]
            assert {(one["name"], one["is_ours"]) for one in found} == {("virtual", True), ("virtual-2", False)}

    run(test)


def test_pages_of_links_see_no_boards_and_choose_none() -> None:
    async def test(place: Place) -> None:
        place.studio.links = Links(place.gate, 80, ("robot.local",))
        for link in place.studio.links.addresses():
            async with place.page() as page:
                await welcomed(page, link.address.partition("token=")[2])
                for method, params in (
                    ("studio.boards", {}),
                    ("studio.use", {"url": VIRTUAL}),
                    ("studio.share", {"url": VIRTUAL}),
                    ("studio.give_back", {"name": "virtual"}),
                ):
                    text = (await call(page, method, **params))["error"]["message"]
                    assert ("through a link" if link.role == "edit" else "needs the role") in text
        assert place.studio.hub == "virtual"

    run(test)


def test_a_page_leaves_a_board_whose_hub_has_ended_unless_a_link_opened_it() -> None:
    async def test(place: Place) -> None:
        await place.studio.robots.give_back("virtual")
        place.studio.links = Links(place.gate, 80, ("robot.local",))
        tokens = [link.address.partition("token=")[2] for link in place.studio.links.addresses()]
        for token in tokens:
            async with place.page() as page:
                await page.send_json({"token": token, "leaves": True})
                assert (await page.receive()).data == 4404
        async with place.page() as page:
            await page.send_json({"token": place.gate.new_token("edit"), "leaves": True})
            assert (await page.receive_json())["name"] == ""

    run(test)


def test_boards_that_have_a_name_are_listed_by_it(user: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(user))
    Aliases.save("rex", Alias("tcp://127.0.0.1:1"))
    Aliases.save("far", Alias("/dev/ttyACM9", serial_number="7"))

    async def test(place: Place) -> None:
        async with place.page() as page:
            await welcomed(page, place.gate.new_token("edit"))
            found = (await call(page, "studio.boards"))["result"]["boards"]
            assert [(one["name"], one["url"]) for one in found if not one["is_ours"]] == [("rex", "tcp://127.0.0.1:1")]

    run(test)


def test_an_edit_of_a_page_that_has_not_left_yet_is_kept_for_no_other_board() -> None:
    async def test(place: Place) -> None:
        drafts = place.studio.drafts_of("virtual")
        place.studio.begin("rex")
        with pytest.raises(ConnectionError, match="any more"):
            place.studio.drafts_of("virtual")
        assert place.studio.drafts_of("rex") is not drafts

    run(test)
