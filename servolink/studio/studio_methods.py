"""The methods that the studio adds to the control interface of the hub, and the studio that they work on."""

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
    """A page that is open."""

    token: Token
    """Token with which the page was opened."""
    who: str
    """What people call it."""

    def rename(self, who: str) -> None:
        """Give the page the name `who`."""

    def notify(self, name: str, params: Struct) -> None:
        """Send a notification."""

    def close(self) -> None:
        """Close it from here."""


class Studio:
    """State that all pages share."""

    def __init__(self, hub: str) -> None:
        """Serve the board that is shared as `hub`."""
        self.hub = hub
        self.drafts = Drafts(hub)
        self.pages: set[OpenPage] = set()
        self.links: Links | None = None
        """None if only this machine reaches the studio."""

    async def welcome(self, welcome: Welcome) -> Welcomed:
        """Return what a page is told first, when the hub has let it in.

        Whether the board is virtual is found out each time: another hub of this name may share another board by now.
        """
        is_virtual = await asyncio.to_thread(_is_virtual, welcome.url)
        profile = msgspec.Raw(welcome.profile)
        return Welcomed(welcome.session, welcome.role, welcome.name, welcome.url, is_virtual, profile)


def _is_virtual(address: str) -> bool:
    """Return whether a board is made of software, as far as this machine knows."""
    return address.startswith("virtual:") or any(one.url == address for one in announcements.candidates())


class Welcomed(Struct, frozen=True):
    """The first message to a page."""

    session: str
    """Its session with the hub, by which it finds itself in the status."""
    role: RoleName
    name: str
    url: str
    is_virtual: bool
    """Whether nothing real moves."""
    profile: msgspec.Raw


class About(Struct, frozen=True):
    """The studio."""

    version: str


class PageName(Struct, forbid_unknown_fields=True):
    """What people call a page."""

    who: Annotated[str, Meta(max_length=MOST_NAME)]


class PageCaller(NamedTuple):
    """The page that calls a method."""

    studio: Studio
    url: str
    """The address of the board."""
    page: OpenPage
    profile: ProfileInUse | None = None
    """What the hub knows of the board."""


METHODS: Methods[PageCaller] = Methods()


@METHODS.add("studio.rename", Role.WATCH)
def rename(caller: PageCaller, params: PageName) -> PageName:
    """Change what people call the page."""
    caller.page.rename(params.who)
    return params


@METHODS.add("studio.about", Role.WATCH)
def about(caller: PageCaller, params: NoParams) -> About:
    """Return the version of servolink."""
    return About(version("servolink"))
