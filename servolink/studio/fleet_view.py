"""Fleet of a studio as tiles: state of each board at a broker, and the changes since an earlier answer to a page."""

from __future__ import annotations

import asyncio
import socket
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Literal, TypeAlias

from msgspec import Struct

from servolink.errors import escape
from servolink.fleet import BoardSeen, Fleet, Stored
from servolink.studio.studio_methods import FarBoard

MOST_RUNNABLE = 500
"""Most actions and macros offered for several boards."""
_TOGETHER = 0.2  # seconds for which changes are collected
_LONGEST = 200  # characters of a text of a board
_MOST_PROBLEMS = 3
_MOST_ADDRESS = 500
_MOST_HOST = 100

Kind: TypeAlias = Literal["action", "macro"]
TileState: TypeAlias = Literal["ready", "lost", "closed", "unknown", "offline"]


class Tile(Struct, frozen=True):
    """Board of a fleet, for a page."""

    name: str
    state: TileState
    """`lost`: without its cable or power. `unknown`: joined, without a readable state. `offline`: left the broker."""
    urgency: int
    """0 for a lost or unreadable board, 1 for a problem, 2 for none, 3 for an absent board."""
    host: str
    """Machine of the board; empty if unknown."""
    battery_percent: float | None
    lease: str
    """Program that moves the board; empty for none."""
    hold: str
    """Program with exclusive use of the board; empty for none."""
    may_run: bool
    """Whether the policy of the board allows runs."""
    problems: tuple[str, ...]


class FleetTiles(Struct, frozen=True):
    """Tiles that have changed, or all."""

    revision: int
    """Number of the latest change, for the next question."""
    is_whole: bool
    """Whether `tiles` are all boards."""
    is_connected: bool
    """Whether the broker answers."""
    broker: str
    """Address of the broker, without the user."""
    tiles: tuple[Tile, ...]


class RunnableName(Struct, frozen=True, order=True):
    """Action or macro of several boards."""

    type: Kind
    id: int | str
    """Caption, or the id of a record without a caption."""
    boards: int
    """Number of boards that have it."""


class FleetView:
    """Tiles of the boards of a fleet."""

    def __init__(self, fleet: Fleet) -> None:
        """Follow `fleet`, which is connected."""
        self.fleet = fleet
        self._broker = fleet.controller.broker
        self._tiles: dict[str, tuple[int, Tile]] = {}  # with the revision of the latest change
        self._revision = 1
        self._whole_since = 1  # boards were removed: pages with an earlier revision get all tiles
        self._news = asyncio.Event()
        for seen in fleet.controller.roster:
            self._take(seen)
        fleet.controller.on_change = self._take
        self._broker.on_state = lambda is_connected, text: self._count_change()

    async def changes(self, since: int) -> FleetTiles:
        """Return the tiles that have changed since a revision, as soon as one has; all for revision 0."""
        while since == self._revision:
            await self._news.wait()
        if since:
            await asyncio.sleep(_TOGETHER)
        is_whole = not self._whole_since <= since <= self._revision
        tiles = tuple(tile for revision, tile in self._tiles.values() if is_whole or revision > since)
        broker = self._broker
        return FleetTiles(self._revision, is_whole, broker.is_connected, str(broker.access.address), tiles)

    def runnable(self, boards: Iterable[str]) -> tuple[RunnableName, ...]:
        """Return the actions and macros of the boards that can run one, those of most boards first."""
        roster, found = self.fleet.controller.roster, Counter[tuple[Kind, int | str]]()
        for name in dict.fromkeys(boards):
            seen = roster.get(name)
            if seen is None or seen.now is None or not _may_run(seen):
                continue
            records: dict[Kind, Sequence[Stored]] = {"action": seen.now.actions, "macro": seen.now.macros}
            for kind, stored in records.items():
                for record in dict.fromkeys(one.caption or one.id for one in stored):
                    found[kind, record] += 1
        most = found.most_common(MOST_RUNNABLE)
        return tuple(RunnableName(kind, name, count) for (kind, name), count in most)

    def far_boards(self) -> tuple[FarBoard, ...]:
        """Return the boards that are there, without those of this machine: the search finds their hubs."""
        here = socket.gethostname()
        found = [seen for seen in self.fleet.controller.roster if seen.is_online and seen.now and seen.now.host != here]
        return tuple(
            FarBoard(seen.name, escape(seen.now.host[:_MOST_HOST]), _tcp(seen.now.tcp)) for seen in found if seen.now
        )

    def _take(self, seen: BoardSeen) -> None:
        if self.fleet.controller.roster.get(seen.name) is not seen:
            self._tiles.pop(seen.name, None)
            self._count_change()
            self._whole_since = self._revision
            return
        tile = _tile_of(seen)
        if self._tiles.get(seen.name, (0, None))[1] != tile:
            self._count_change()
            self._tiles[seen.name] = self._revision, tile

    def _count_change(self) -> None:
        self._revision += 1
        self._news.set()
        self._news = asyncio.Event()


def _tile_of(seen: BoardSeen) -> Tile:
    now = seen.now
    problems = (seen.problem, *(now.problems if now is not None and seen.is_online else ()))
    return Tile(
        seen.name,
        _state_of(seen),
        seen.urgency,
        _short(now.host if now else ""),
        now.battery_percent if now else None,
        _short((now and now.lease) or ""),
        _short((now and now.hold) or ""),
        _may_run(seen),
        _shortest(problems),
    )


def _state_of(seen: BoardSeen) -> TileState:
    if not seen.is_online:
        return "offline"
    if seen.now is None or seen.problem:
        return "unknown"
    return "ready" if seen.now.connection == "connected" else seen.now.connection


def _may_run(seen: BoardSeen) -> bool:
    return seen.is_online and seen.now is not None and seen.now.allow != "watch"


def _shortest(texts: Sequence[str]) -> tuple[str, ...]:
    return tuple(_short(text) for text in texts if text)[:_MOST_PROBLEMS]


def _short(text: str) -> str:
    """Return the beginning of a text of a board, which may be of any length, without control characters."""
    return escape(text[:_LONGEST])


def _tcp(claimed: str | None) -> str:
    """Return a TCP address as a board gives it, which may be any text; empty for anything else."""
    if claimed is None or not claimed.startswith("tcp://") or len(claimed) > _MOST_ADDRESS or not claimed.isprintable():
        return ""
    return claimed
