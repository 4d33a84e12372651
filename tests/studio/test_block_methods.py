"""Programs made of blocks are kept for their board, and no page overwrites what another page has changed."""

from __future__ import annotations

import json
from typing import Any

import pytest

from servolink.support import user_folder
from tests.studio.serving import Place, call, run, welcomed

pytestmark = pytest.mark.usefixtures("user")

NOTHING = {"blocks": None, "tag": ""}


def program(delay_ms: int) -> dict[str, Any]:
    wait = {"type": "wait", "id": "w", "delay_ms": delay_ms}
    return {"blocks": 1, "stacks": [{"x": 1.0, "y": 2.0, "blocks": [wait]}], "made": []}


def test_blocks_are_kept_and_a_later_page_gets_the_newer_ones() -> None:
    async def test(place: Place) -> None:
        token = place.gate.new_token("edit")
        async with place.page() as page, place.page() as other:
            await welcomed(page, token)
            await welcomed(other, token)
            assert (await call(page, "studio.blocks.get"))["result"] == NOTHING
            kept = (await call(page, "studio.blocks.save", blocks=program(1), known=""))["result"]
            assert (kept["blocks"], kept["saved"]) == (program(1), True)
            heard: dict[str, Any] = {}
            while heard.get("method") != "studio.blocks":
                heard = json.loads(await other.receive_str())
            assert heard["params"] == {"blocks": program(1), "tag": kept["tag"]}
            same = (await call(other, "studio.blocks.save", blocks=program(1), known=""))["result"]
            assert same == kept
            late = (await call(other, "studio.blocks.save", blocks=program(2), known=""))["result"]
            assert late == {**kept, "saved": False}
            again = (await call(other, "studio.blocks.save", blocks=program(2), known=kept["tag"]))["result"]
            assert (await call(page, "studio.blocks.get"))["result"] == {"blocks": program(2), "tag": again["tag"]}

    run(test)


def test_what_is_no_program_is_refused_and_links_that_watch_keep_nothing() -> None:
    async def test(place: Place) -> None:
        async with place.page() as page:
            await welcomed(page, place.gate.new_token("edit"))
            wrong = program(1) | {"stacks": [{"x": 0, "y": 0, "blocks": []}]}
            error = (await call(page, "studio.blocks.save", blocks=wrong, known=""))["error"]
            assert "has no blocks" in error["message"]
        async with place.page() as page:
            await welcomed(page, place.gate.new_token("watch"))
            assert "error" in await call(page, "studio.blocks.save", blocks=program(1), known="")
            assert (await call(page, "studio.blocks.get"))["result"] == NOTHING

    run(test)


@pytest.mark.parametrize("made", [0, 1000])  # the longer message is read in a thread
def test_a_save_is_carried_out_although_the_page_is_closed_at_once(made: int) -> None:
    records = [{"kind": "actions", "id": number, "caption": "Bow"} for number in range(made)]
    blocks = program(1) | {"made": records}

    async def test(place: Place) -> None:
        token = place.gate.new_token("edit")
        async with place.page() as page:
            await welcomed(page, token)
            save = {"method": "studio.blocks.save", "params": {"blocks": blocks, "known": ""}}
            await page.send_json({"jsonrpc": "2.0", "id": 1, **save})
        async with place.page() as page:
            await welcomed(page, token)
            while (found := (await call(page, "studio.blocks.get"))["result"]) == NOTHING:
                pass
            assert found["blocks"] == blocks

    run(test)


def test_files_carry_blocks() -> None:
    async def test(place: Place) -> None:
        async with place.page() as page:
            await welcomed(page, place.gate.new_token("watch"))
            project = {"schema": 1, "blocks": program(5)}
            text = (await call(page, "studio.file.write", project=project))["result"]["text"]
            read = (await call(page, "studio.file.read", text=text))["result"]["project"]
            assert read["blocks"] == program(5)

    run(test)


def test_damaged_blocks_count_as_none() -> None:
    async def test(place: Place) -> None:
        folder = user_folder("data") / "blocks"
        folder.mkdir(parents=True)
        async with place.page() as page:
            await welcomed(page, place.gate.new_token("edit"))
            await call(page, "studio.blocks.save", blocks=program(1), known="")
            for path in folder.iterdir():
                path.write_bytes(b'{"blocks": 9}')
            assert (await call(page, "studio.blocks.get"))["result"] == NOTHING

    run(test)
