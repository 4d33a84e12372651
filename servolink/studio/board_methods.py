"""Methods about the surroundings of a board: the doctor, and links for other machines."""

from __future__ import annotations

import asyncio
from typing import Literal

from msgspec import Struct

from servolink.control import Code, NoParams, Role, RpcError, Touches
from servolink.doctor import Finding, SystemFacts, checks_before_opening
from servolink.errors import InvalidAddress
from servolink.studio.links import LinkAddress, LinkRole
from servolink.studio.studio_methods import METHODS, PageCaller

_OF_THE_HUB = "in use"


class DoctorReport(Struct, frozen=True):
    """Findings of the doctor, the first to be dealt with first."""

    findings: tuple[Finding, ...]


class DoctorAsk(Struct, forbid_unknown_fields=True):
    """Description of the board for the page."""

    is_connected: bool


class LinkList(Struct, frozen=True):
    """Valid links; none if the studio was started without --allow-host."""

    links: tuple[LinkAddress, ...]
    is_open_to_others: bool
    """Whether the studio was started for links."""


class LinkChange(Struct, forbid_unknown_fields=True):
    """Action for the link of a role."""

    role: LinkRole
    action: Literal["revoke", "renew"]


@METHODS.add("studio.doctor", Role.EDIT, touches=Touches.NOTHING)
async def doctor(caller: PageCaller, params: DoctorAsk) -> DoctorReport:
    """Examine the connection to the board without opening the port: a hub has the port open."""
    try:
        found = await asyncio.to_thread(checks_before_opening, SystemFacts(), [caller.url] if caller.url else [])
    except InvalidAddress:  # of a kind known to the hub only
        found = []
    # While the hub uses the board, the port is open in the process of the hub.
    shown = [one for one in found if not (params.is_connected and one.check == _OF_THE_HUB)]
    return DoctorReport(tuple(shown))


@METHODS.add("studio.links", Role.EDIT, touches=Touches.HOST)
def links(caller: PageCaller, params: NoParams) -> LinkList:
    """Return the links for other machines."""
    return _links(caller)


@METHODS.add("studio.links.change", Role.EDIT, touches=Touches.HOST)
def links_change(caller: PageCaller, params: LinkChange) -> LinkList:
    """Revoke a link, which also closes the pages opened through the link, or make a new link."""
    known = caller.studio.links
    if known is None:
        raise RpcError(Code.FORBIDDEN, "the studio is not open to others", remedy="start it with --allow-host")
    if params.action == "renew":
        known.renew(params.role)
    elif (token := known.revoke(params.role)) is not None:
        for page in [each for each in caller.studio.pages if each.token == token]:
            page.close()
    return _links(caller)


def _links(caller: PageCaller) -> LinkList:
    known = caller.studio.links
    return LinkList(known.addresses() if known else (), known is not None)
