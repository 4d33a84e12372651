"""A page fetches recordings of the hub, and no other files."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

import pytest

from servolink.control import Code, RoleName
from tests.studio.serving import Place, call, run, welcomed


def asked(role: RoleName, **params: Any) -> dict[str, Any]:
    """Return what a page gets."""
    found: list[dict[str, Any]] = []

    async def ask(place: Place) -> None:
        async with place.page() as page:
            await welcomed(page, place.gate.new_token(role))
            found.append(await call(page, "studio.recording.read", **params))

    run(ask)
    return found[0]


def test_recording_comes_in_pieces(user: Path) -> None:
    folder = user / "data" / "servolink" / "recordings"
    folder.mkdir(parents=True)
    content = bytes(range(256)) * 1500
    (folder / "rex-1.mcap").write_bytes(content)
    got = b""
    while piece := base64.b64decode(asked("edit", name="rex-1.mcap", offset=len(got))["result"]["data"]):
        assert len(piece) <= 256 * 1024
        got += piece
    assert got == content


@pytest.mark.usefixtures("user")
@pytest.mark.parametrize(
    "name", ["../x.mcap", "/etc/passwd", ".mcap", "x.txt", "a/b.mcap", "\\x.mcap", "x\0.mcap", "none.mcap", ""]
)
def test_other_files_are_refused(name: str) -> None:
    assert asked("edit", name=name)["error"]["code"] == Code.INVALID_PARAMS


@pytest.mark.usefixtures("user")
def test_who_only_watches_gets_none() -> None:
    assert asked("watch", name="x.mcap")["error"]["code"] == Code.FORBIDDEN
