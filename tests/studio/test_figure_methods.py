"""The figure of a robot is kept for its board, and all pages of a studio have the same one.

Module: servolink.studio.kept.
"""

from __future__ import annotations

import json
from typing import Any

import pytest

from servolink.project import Figure
from servolink.studio.figure_methods import read_figure, write_figure
from servolink.support import user_folder
from tests.studio.serving import Place, call, run, welcomed

pytestmark = pytest.mark.usefixtures("user")

FIGURE = {"figure": 1, "name": "Arm", "view": {}, "joints": [{"id": "arm", "servo": 1, "offset": 12}]}


def test_a_figure_is_kept_and_other_pages_hear_of_it() -> None:
    async def test(place: Place) -> None:
        token = place.gate.new_token("edit")
        async with place.page() as page, place.page() as other:
            await welcomed(page, token)
            await welcomed(other, token)
            assert (await call(page, "studio.figure.get"))["result"] == {"figure": None}
            assert (await call(other, "studio.figure.get"))["result"] == {"figure": None}
            assert (await call(page, "studio.figure.save", figure=FIGURE))["result"] == {"figure": FIGURE}
            heard: dict[str, Any] = {}
            while heard.get("method") != "studio.figure":
                heard = json.loads(await other.receive_str())
            assert heard["params"] == {"figure": FIGURE}
            assert (await call(other, "studio.figure.get"))["result"] == {"figure": FIGURE}
            assert (await call(other, "studio.figure.save", figure=None))["result"] == {"figure": None}
            assert (await call(page, "studio.figure.get"))["result"] == {"figure": None}

    run(test)


@pytest.mark.parametrize(
    ("change", "place_of"),
    [({"joints": []}, "joints"), ({"joints": [{"id": "a", "parent": "b"}]}, "parent"), ({"figure": 3}, "figure")],
)
def test_what_is_no_figure_is_refused(change: dict[str, Any], place_of: str) -> None:
    async def test(place: Place) -> None:
        async with place.page() as page:
            await welcomed(page, place.gate.new_token("edit"))
            error = (await call(page, "studio.figure.save", figure=FIGURE | change))["error"]
            assert place_of in error["message"]
        async with place.page() as page:
            await welcomed(page, place.gate.new_token("watch"))
            assert "error" in await call(page, "studio.figure.save", figure=FIGURE)
            assert (await call(page, "studio.figure.get"))["result"] == {"figure": None}

    run(test)


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b'{"figure": 9}', b"\xff"])
def test_a_damaged_figure_counts_as_none(content: bytes, caplog: pytest.LogCaptureFixture) -> None:
    write_figure("robbie", Figure.from_json(FIGURE))
    assert read_figure("robbie") is not None
    (path,) = (user_folder("data") / "figures").iterdir()
    path.write_bytes(content)
    assert read_figure("robbie") is None
    assert "cannot be read" in caplog.text
