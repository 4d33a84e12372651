"""The studio says what keeps it from the board, and whom it lets in from other machines.

Module: servolink.studio.links.
"""

from __future__ import annotations

import re
from typing import Any

import pytest
import segno
from aiohttp import WSMsgType

from servolink.doctor import Finding
from servolink.studio import board_methods
from servolink.studio.gate import Gate
from servolink.studio.links import Links, qr_code
from tests.studio.serving import Place, call, run, welcomed

pytestmark = pytest.mark.usefixtures("user")

IN_USE = Finding("in use", "a program has it open", "only one can", "close it")
DENIED = Finding("permissions", "root only", "you may not", "ask root")


async def called(place: Place, method: str, **params: Any) -> Any:
    async with place.page() as page:
        await welcomed(page, place.gate.new_token("edit"))
        return await call(page, method, **params)


def test_the_doctor_leaves_out_the_hub_as_long_as_it_has_the_board(monkeypatch: pytest.MonkeyPatch) -> None:
    urls: list[str] = []

    def found(_facts: object, given: list[str]) -> list[Finding]:
        urls.extend(given)
        return [IN_USE, DENIED]

    monkeypatch.setattr(board_methods, "checks_before_opening", found)

    async def test(place: Place) -> None:
        for is_connected, checks in ((True, ["permissions"]), (False, ["in use", "permissions"])):
            report = (await called(place, "studio.doctor", is_connected=is_connected))["result"]
            assert [finding["check"] for finding in report["findings"]] == checks

    run(test)
    assert {url.partition(":")[0] for url in urls} == {"virtual"}


def test_the_doctor_has_nothing_to_say_of_a_virtual_board() -> None:
    async def test(place: Place) -> None:
        assert (await called(place, "studio.doctor", is_connected=True))["result"] == {"findings": []}

    run(test)


def test_our_own_board_is_marked_in_the_list() -> None:
    async def test(place: Place) -> None:
        boards = (await called(place, "studio.boards"))["result"]["boards"]
        assert [board["url"] for board in boards if board["is_ours"]] == ["share://virtual"]

    run(test)


def test_a_studio_for_this_machine_only_has_no_links() -> None:
    async def test(place: Place) -> None:
        assert (await called(place, "studio.links"))["result"] == {"links": [], "is_open_to_others": False}
        refused = await called(place, "studio.links.change", role="watch", action="renew")
        assert "--allow-host" in refused["error"]["data"]["remedy"]

    run(test)


def test_a_link_is_revoked_with_the_pages_that_it_opened() -> None:
    async def test(place: Place) -> None:
        place.studio.links = Links(place.gate, 80, ("robot.local",))
        async with place.page() as local, place.page() as watching:
            await welcomed(local, place.gate.new_token("edit"))
            links = {link["role"]: link["address"] for link in (await call(local, "studio.links"))["result"]["links"]}
            await welcomed(watching, links["watch"].partition("token=")[2])
            left = await call(local, "studio.links.change", role="watch", action="revoke")
            assert [link["role"] for link in left["result"]["links"]] == ["edit"]
            while (message := await watching.receive()).type is WSMsgType.TEXT:
                pass
            assert message.type in {WSMsgType.CLOSE, WSMsgType.CLOSED}
            renewed = await call(local, "studio.links.change", role="watch", action="renew")
            (address,) = [link["address"] for link in renewed["result"]["links"] if link["role"] == "watch"]
            assert address != links["watch"]
        async with place.page() as late:
            await late.send_json({"token": links["watch"].partition("token=")[2]})
            assert (await late.receive()).data == 4401

    run(test)


def test_a_page_that_a_link_opened_learns_of_no_other_links() -> None:
    async def test(place: Place) -> None:
        place.studio.links = Links(place.gate, 80, ("robot.local",))
        (drive,) = [link for link in place.studio.links.addresses() if link.role == "edit"]
        async with place.page() as page:
            await welcomed(page, drive.address.partition("token=")[2])
            assert "through a link" in (await call(page, "studio.links"))["error"]["message"]

    run(test)


def test_a_link_that_is_revoked_gives_its_page_no_more_than_before(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(place: Place) -> None:
        place.studio.links = links = Links(place.gate, 80, ("robot.local",))

        def drive() -> str:
            return next(each.address.partition("token=")[2] for each in links.addresses() if each.role == "edit")

        async with place.page() as page:
            await welcomed(page, drive())
            links.revoke("edit")  # this page is about to be closed
            for method, params in (("studio.links.change", {"role": "edit", "action": "renew"}), ("studio.boards", {})):
                assert "through a link" in (await call(page, method, **params))["error"]["message"]
            assert {each.role for each in links.addresses()} == {"watch"}
        links.renew("edit")
        welcome = place.studio.welcome

        async def revoked_meanwhile(*args: Any, **options: Any) -> Any:
            links.revoke("edit")
            return await welcome(*args, **options)

        monkeypatch.setattr(place.studio, "welcome", revoked_meanwhile)
        async with place.page() as late:
            assert (await welcomed(late, drive()))["is_link"]
            assert (await late.receive()).type in {WSMsgType.CLOSE, WSMsgType.CLOSED}

    run(test)


def test_links_have_the_names_under_which_the_studio_is_reached() -> None:
    gate = Gate(8200)
    links = Links(gate, 8200, ("robot.local", "10.0.0.7"))
    assert [(link.role, link.address.partition("#")[0]) for link in links.addresses()] == [
        ("edit", "http://robot.local:8200/"),
        ("watch", "http://robot.local:8200/"),
        ("edit", "http://10.0.0.7:8200/"),
        ("watch", "http://10.0.0.7:8200/"),
    ]
    for link in links.addresses():
        assert link.qr == qr_code(link.address)
    assert links.revoke("edit") is not None
    assert links.revoke("edit") is None
    assert {link.role for link in links.addresses()} == {"watch"}


def test_a_qr_code_is_drawn_as_it_is() -> None:
    text = "http://robot.local:8200/#token=abc"
    code = qr_code(text)
    drawn = [[0] * code.size for _ in range(code.size)]
    for x, y, width in (map(int, each) for each in re.findall(r"M(\d+) (\d+)h(\d+)v1h-\d+z", code.path)):
        drawn[y][x : x + width] = [1] * width
    wanted = segno.make_qr(text, error="m")
    assert drawn == [list(row) for row in wanted.matrix_iter(border=4)]
