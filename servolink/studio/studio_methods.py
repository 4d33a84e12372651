"""Methods that the studio adds to the control interface of the hub, and the shared state of the methods."""

from __future__ import annotations

import asyncio
from importlib.metadata import version
from typing import Annotated, NamedTuple, Protocol

import msgspec
from msgspec import Meta, Struct

from servolink.control.greeting import Welcome
from servolink.control.messages import NoParams
from servolink.control.peer import Methods
from servolink.control.roles import Role, RoleName
from servolink.discovery import announcements
from servolink.profiles.profile import ProfileInUse
from servolink.studio.drafts import Drafts
from servolink.studio.gate import Token
from servolink.studio.links import Links

MOST_NAME = 60
"""Characters of the name of a page."""


class OpenPage(Protocol):
    """Page that is open in a browser."""

    token: Token
    """Token with which the page was opened."""
    who: str
    """Name of the page for people."""

    def rename(self, who: str) -> None:
        """Give the page the name `who`."""

    def notify(self, name: str, params: Struct) -> None:
        """Send a notification."""

    def close(self) -> None:
        """Close the page from the studio."""


class Studio:
    """State shared by all pages of a studio."""

    def __init__(self, hub: str) -> None:
        self.hub = hub
        self.drafts = Drafts(hub)
        self.pages: set[OpenPage] = set()
        self.links: Links | None = None
        """Links of the studio; None if only this machine reaches the studio."""

    async def welcome(self, welcome: Welcome) -> Welcomed:
        """Return the first message for a page, after the hub has admitted the page.

        Whether the board is virtual is found out each time: another hub of this name may share another board by now.
        """
        is_virtual = await asyncio.to_thread(_is_virtual, welcome.url)
        profile = msgspec.Raw(welcome.profile)
        return Welcomed(welcome.session, welcome.role, welcome.name, welcome.url, is_virtual, profile)


def _is_virtual(address: str) -> bool:
    """Return whether a board is simulated, as far as this machine knows."""
    return address.startswith("virtual:") or any(one.url == address for one in announcements.candidates())


class Welcomed(Struct, frozen=True):
    """The first message to a page."""

    session: str
    """Id of the page's session with the hub, as in the status."""
    role: RoleName
    name: str
    url: str
    is_virtual: bool
    """Whether the board is virtual, so that nothing real moves."""
    profile: msgspec.Raw


class About(Struct, frozen=True):
    """Description of the studio for a page."""

    version: str


class PageName(Struct, forbid_unknown_fields=True):
    """Name of a page for people."""

    who: Annotated[str, Meta(max_length=MOST_NAME)]


class PageCaller(NamedTuple):
    """Page that calls a method."""

    studio: Studio
    url: str
    """The address of the board."""
    page: OpenPage
    profile: ProfileInUse | None = None
    """Description of the board in the hub."""


METHODS: Methods[PageCaller] = Methods()


@METHODS.add("rename", Role.WATCH)  # in place of the hub's, which gives any name
@METHODS.add("studio.rename", Role.WATCH)
def rename(caller: PageCaller, params: PageName) -> PageName:
    """Change the name of the page for people."""
    caller.page.rename(params.who)
    return params


@METHODS.add("studio.about", Role.WATCH)
def about(caller: PageCaller, params: NoParams) -> About:
    """Return the version of servolink."""
    return About(version("servolink"))
