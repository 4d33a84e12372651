"""Tiles of a fleet for the page: each change is sent once, and what a board says is cut and made safe.

Modules: servolink.studio.fleet_view, servolink.studio.fleet_methods.
"""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any

import msgspec

from servolink.fleet import OFFLINE, ONLINE, BoardNow, Roster, Stored
from servolink.studio.fleet_view import FleetView


class Crowd:
    """A fleet without a broker: boards say what a test lets them say."""

    def __init__(self) -> None:
        self.roster = Roster()
        self.on_change: Any = None
        self.broker = SimpleNamespace(is_connected=True, on_state=None, access=SimpleNamespace(address="mqtt://x:1883"))
        self.view = FleetView(SimpleNamespace(controller=self))  # type: ignore[arg-type]

    def hear(self, board: str, kind: str, payload: bytes) -> None:
        if (changed := self.roster.take(board, kind, payload, 0.0)) is not None:
            self.on_change(changed)

    def state(self, board: str, **known: Any) -> None:
        usual: dict[str, Any] = {"host": "here", "version": "1", "connection": "connected", "allow": "run"}
        now = BoardNow(board=board, **usual | known)
        self.hear(board, "state", msgspec.json.encode(now))
        self.hear(board, "available", ONLINE.encode())


async def test_only_the_boards_that_changed_are_sent_and_all_after_one_was_forgotten() -> None:
    crowd = Crowd()
    for board in ("amy", "bob", "cat"):
        crowd.state(board, at=1.0)
    first = await crowd.view.changes(0)
    assert first.is_whole
    assert [tile.name for tile in first.tiles] == ["amy", "bob", "cat"]
    waiting = asyncio.ensure_future(crowd.view.changes(first.revision))
    crowd.state("amy", at=2.0, noise=7)  # nothing that a tile shows
    await asyncio.sleep(1)
    assert not waiting.done()
    crowd.state("bob", at=2.0, battery_percent=12.0)
    crowd.hear("cat", "available", OFFLINE.encode())
    second = await waiting
    assert not second.is_whole
    assert [(tile.name, tile.state, tile.urgency) for tile in second.tiles] == [
        ("bob", "ready", 1),
        ("cat", "offline", 3),
    ]
    crowd.hear("cat", "available", b"")
    third = await crowd.view.changes(second.revision)
    assert third.is_whole
    assert [tile.name for tile in third.tiles] == ["amy", "bob"]
    assert (await crowd.view.changes(99_999)).is_whole  # of an earlier studio


async def test_a_board_that_was_never_shown_can_be_removed() -> None:
    crowd = Crowd()
    for kind, payload in (("pulse", b"word"), ("available", b"")):
        crowd.hear("amy", kind, payload)
    assert (await crowd.view.changes(0)).tiles == ()


async def test_a_lost_broker_is_told_at_once() -> None:
    crowd = Crowd()
    first = await crowd.view.changes(0)
    waiting = asyncio.ensure_future(crowd.view.changes(first.revision))
    await asyncio.sleep(0)
    crowd.broker.is_connected = False
    crowd.broker.on_state(False, "gone")
    assert not (await waiting).is_connected


async def test_texts_of_any_length_are_cut_and_made_safe() -> None:
    crowd = Crowd()
    evil = "\x1b[2J\u202e" + "x" * 100_000
    crowd.state("amy", at=1.0, host=evil, lease=evil, problems=(evil,) * 5)
    (tile,) = (await crowd.view.changes(0)).tiles
    assert len(tile.problems) == 3
    for text in (tile.host, tile.lease, *tile.problems):
        assert text.startswith("\\x1b[2J\\u202ex")
        assert len(text) < 250
    crowd.hear("amy", "state", b"{")
    (tile,) = (await crowd.view.changes(0)).tiles
    assert (tile.state, tile.urgency) == ("unknown", 0)
    assert tile.problems[0].startswith("its state cannot be read")


def test_what_most_boards_can_run_comes_first_and_a_board_that_may_not_run_counts_for_nothing() -> None:
    crowd = Crowd()
    wave, bow = Stored(1, "Wave"), Stored(2, "Bow")
    crowd.state("amy", at=1.0, actions=(bow, wave), macros=(Stored(3, ""),))
    crowd.state("bob", at=1.0, actions=(wave,))
    crowd.state("cat", at=1.0, actions=(wave,), allow="watch")
    found = crowd.view.runnable(["amy", "bob", "cat", "amy", "nobody"])
    assert [(one.type, one.id, one.boards) for one in found] == [
        ("action", "Wave", 2),
        ("action", "Bow", 1),
        ("macro", 3, 1),
    ]
