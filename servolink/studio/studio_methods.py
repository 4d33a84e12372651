"""Methods that the studio adds to the control interface of the hub, and the shared state of the methods."""

from __future__ import annotations

import asyncio
from collections import defaultdict
from importlib.metadata import version
from typing import Annotated, NamedTuple, Protocol

import msgspec
from msgspec import Meta, Struct

from servolink.boards import ProfileInUse, announced_boards
from servolink.control import Methods, NoParams, Peer, Role, RoleName, Touches, Welcome
from servolink.errors import OpenError, Reason
from servolink.studio.drafts import Drafts
from servolink.studio.gate import Token
from servolink.studio.links import Links
from servolink.studio.robots import Robots, stop_before_leaving
from servolink.studio.studio_twin import Twin
from servolink.twin import is_installed

MOST_NAME = 60
"""Characters of the name of a page."""


class OpenPage(Protocol):
    """Page that is open in a browser."""

    token: Token
    """Token with which the page was opened."""
    is_link: bool
    """Whether it was opened through a link: for good, as a link that is revoked is none any more."""
    who: str
    """Name of the page for people."""
    hub: str
    """Hub of the board that the page shows; empty without a board."""

    def rename(self, who: str) -> None:
        """Give the page the name `who`."""

    def notify(self, name: str, params: Struct) -> None:
        """Send a notification."""

    def close(self) -> None:
        """Close the page from the studio."""

    def leave(self) -> None:
        """Disconnect the page from its board; the page connects again, to the present board of the studio."""


class FarBoard(Struct, frozen=True):
    """Board of the fleet on another machine."""

    name: str
    host: str
    url: str
    """Address under which its hub is reached from here; empty unless it is shared with `--tcp`."""


class FleetOfStudio(Protocol):
    """Boards at a broker, where the studio has a fleet: a page without a server has none."""

    def far_boards(self) -> tuple[FarBoard, ...]:
        """Return the boards on other machines."""
        ...


class Moving(Struct, frozen=True):
    """Notification `studio.moving`: all pages go on to another board."""

    by: str
    """Name of the page that changes the board."""
    left: str
    """Name of the board before; empty for none."""
    is_stopped: bool
    """Whether that board confirms that all servos are stopped."""


class Studio:
    """State shared by all pages of a studio."""

    def __init__(self, hub: str = "", *, robots: Robots | None = None) -> None:
        """Begin with the board of the hub `hub`; with none if empty."""
        self.robots = robots or Robots()
        self.pages: set[OpenPage] = set()
        self.links: Links | None = None
        """Links of the studio; None if only this machine reaches the studio."""
        self.fleet: FleetOfStudio | None = None
        """Boards at a broker; None without a broker."""
        self.twin = Twin()
        self.turns = defaultdict[Token, asyncio.Lock](asyncio.Lock)
        """Turns of the messages that are paced, by the token of their pages."""
        self.readings = defaultdict[Token, asyncio.Semaphore](lambda: asyncio.Semaphore(Peer.MOST_READING))
        """Requests without changes that are carried out at the same time, likewise."""
        self._turn = asyncio.Lock()
        self.begin(hub)

    def begin(self, hub: str) -> None:
        """Use the board of the hub `hub` for new pages; none if empty."""
        self.hub = hub
        self._drafts = Drafts(hub) if hub else None

    def drafts_of(self, hub: str) -> Drafts:
        """Return the drafts of the board of the hub `hub`. Raise OpenError unless the studio uses this board."""
        if self._drafts is None or hub != self.hub:
            raise OpenError("the studio does not use this board any more", reason=Reason.NOT_FOUND)
        return self._drafts

    def pages_of(self, hub: str) -> list[OpenPage]:
        """Return the open pages that show the board of the hub `hub`."""
        return [page for page in self.pages if page.hub == hub]

    def is_link(self, token: Token) -> bool:
        """Return whether a token belongs to a valid link, so that its page is on another machine."""
        return self.links is not None and self.links.is_one(token)

    async def use(self, hub: str, by: str) -> None:
        """Lead all pages to the board of the hub `hub`, for the page `by`; to none if empty.

        First the servos of the present board are stopped, and the pages are told; they give back the lease. Raise
        OpenError while a program has exclusive use of the present board.
        """
        async with self._turn:
            if hub == self.hub:
                return
            notice = Moving(by, self.hub, not self.hub or await stop_before_leaving(self.hub))
            self.begin(hub)
            for page in tuple(self.pages):
                page.notify("studio.moving", notice)
                page.leave()

    async def welcome(self, welcome: Welcome, *, is_link: bool) -> Welcomed:
        """Return the first message for a page, opened through a link or not, after the hub has admitted the page.

        Whether the board is virtual is found out each time: another hub of this name may share another board by now.
        """
        is_virtual = await asyncio.to_thread(_is_virtual, welcome.url)
        profile = msgspec.Raw(welcome.profile)
        return Welcomed(
            welcome.session,
            welcome.role,
            welcome.name,
            welcome.url,
            is_virtual,
            profile,
            is_link=is_link,
            has_fleet=self.fleet is not None,
            stops=welcome.stops,
        )


def _is_virtual(address: str) -> bool:
    """Return whether a board is simulated, as far as this machine knows."""
    return address.startswith("virtual:") or any(one.url == address for one in announced_boards())


class Welcomed(Struct, frozen=True):
    """The first message to a page."""

    session: str
    """Id of the page's session with the hub, as in the status."""
    role: RoleName
    name: str
    """Name of the board; empty without a board."""
    url: str
    is_virtual: bool
    """Whether the board is virtual, so that nothing real moves."""
    profile: msgspec.Raw
    is_link: bool
    """Whether the page was opened through a link, so that it changes nothing of this computer, and no other board."""
    has_fleet: bool
    """Whether the studio sees a fleet."""
    stops: int | None
    """Number of stops so far, for `stop.heard`; null without a board, and from an earlier hub."""


class About(Struct, frozen=True):
    """Description of the studio for a page."""

    version: str
    has_twin: bool
    """Whether the extra `twin` is installed."""


class PageName(Struct, forbid_unknown_fields=True):
    """Name of a page for people."""

    who: Annotated[str, Meta(max_length=MOST_NAME)]


class PageCaller(NamedTuple):
    """Page that calls a method."""

    studio: Studio
    url: str
    """The address of the board; empty without a board."""
    page: OpenPage
    hub: str = ""
    """Hub of the board; empty without a board."""
    profile: ProfileInUse | None = None
    """Description of the board in the hub."""

    def tell_others(self, name: str, params: Struct) -> None:
        """Send a notification to the other pages that show this board."""
        for page in self.studio.pages_of(self.hub):
            if page is not self.page:
                page.notify(name, params)


METHODS: Methods[PageCaller] = Methods()


@METHODS.add("rename", Role.WATCH, touches=Touches.SESSION)  # in place of the hub's, which gives any name
@METHODS.add("studio.rename", Role.WATCH, touches=Touches.SESSION)
def rename(caller: PageCaller, params: PageName) -> PageName:
    """Change the name of the page for people."""
    caller.page.rename(params.who)
    return params


@METHODS.add("studio.about", Role.WATCH, touches=Touches.NOTHING)
def about(caller: PageCaller, params: NoParams) -> About:
    """Return the version of servolink, and whether this computer has physics for a twin."""
    return About(version("servolink"), is_installed())
