"""Methods for choosing the robot: boards here, and the board that all pages show."""

from __future__ import annotations

import asyncio
from typing import Annotated

from msgspec import Meta, Struct

from servolink.boards import Aliases, boards, search
from servolink.control import Done, NoParams, Role, Touches
from servolink.doctor import Finding, SystemFacts, checks_before_opening
from servolink.errors import ServolinkError
from servolink.studio.studio_methods import METHODS, FarBoard, PageCaller
from servolink.transports import DeviceInfo

_SHARED = "share://"
_MOST_ADDRESS = 500


class FoundBoard(Struct, frozen=True):
    """Board of this machine, as `servolink list` shows it, or a board with a name given by the user."""

    url: str
    shares: str
    """Address of the board behind a hub; empty for other boards."""
    name: str
    """Name of the hub, or name given by the user; empty without a name."""
    product: str
    problem: str
    findings: tuple[Finding, ...]
    """Findings of the doctor about a board with a problem."""
    is_ours: bool
    """Whether the studio uses the board, directly or through a hub."""
    is_kept: bool
    """Whether the studio itself shares the board."""


class FoundBoards(Struct, frozen=True):
    """All boards on this machine, and those of the fleet on other machines."""

    boards: tuple[FoundBoard, ...]
    fleet: tuple[FarBoard, ...]


class BoardAddress(Struct, forbid_unknown_fields=True):
    """Address of a board, such as `/dev/ttyACM0`, `tcp://10.0.0.7:9000` or `share://rex`; empty for no board."""

    url: Annotated[str, Meta(max_length=_MOST_ADDRESS)]


class HubName(Struct, forbid_unknown_fields=True):
    """Name of the hub of a board that the studio shares."""

    name: Annotated[str, Meta(max_length=_MOST_ADDRESS)]


@METHODS.add("studio.boards", Role.EDIT, touches=Touches.HOST)
async def studio_boards(caller: PageCaller, params: NoParams) -> FoundBoards:
    """Return the boards on this machine without opening any."""
    view = caller.studio.fleet
    return FoundBoards(await asyncio.to_thread(_found, caller), () if view is None else view.far_boards())


@METHODS.add("studio.use", Role.EDIT, touches=Touches.HOST, in_order=True)
async def use(caller: PageCaller, params: BoardAddress) -> Done:
    """Connect to a board, and show it on all pages in place of the present board, whose servos are stopped first.

    Every page gets the notification `studio.moving`, and is disconnected. Without an address the studio has no board.
    """
    hub = await caller.studio.robots.open(params.url) if params.url else ""
    await caller.studio.use(hub, caller.page.who)
    return Done()


@METHODS.add("studio.share", Role.EDIT, touches=Touches.HOST, in_order=True)
async def share(caller: PageCaller, params: BoardAddress) -> HubName:
    """Connect to a board for other programs, beside the present board."""
    return HubName(await caller.studio.robots.open(params.url))


@METHODS.add("studio.give_back", Role.EDIT, touches=Touches.HOST, in_order=True)
async def give_back(caller: PageCaller, params: HubName) -> Done:
    """End the sharing of a board by the studio, so that its port is free; pages that show the board leave it first.

    The content of a new virtual board is lost.
    """
    if params.name == caller.studio.hub:
        await caller.studio.use("", caller.page.who)
    await caller.studio.robots.give_back(params.name)
    return Done()


@METHODS.add("studio.stop", Role.WATCH, touches=Touches.NOTHING, is_urgent=True)
async def stop(caller: PageCaller, params: NoParams) -> Done:
    """Stop all servos of all boards that the studio shares. ServolinkError if a board does not confirm that."""
    await caller.studio.robots.stop_all()
    return Done()


def _found(caller: PageCaller) -> tuple[FoundBoard, ...]:
    try:
        aliases = Aliases.load()
    except ServolinkError:  # `servolink use` says what is wrong with the file
        aliases = Aliases()
    found = boards(search())
    ours = {caller.url, f"{_SHARED}{caller.studio.hub}"} - {"", _SHARED}
    named = {name: next((one for one in found if alias.fits(one)), None) for name, alias in aliases.items()}
    names = {one.url: name for name, one in named.items() if one is not None}
    absent = [(DeviceInfo(aliases[name].url), name) for name, one in named.items() if one is None]
    places = [one for one in absent if not aliases[one[1]].serial_number]
    return tuple(
        _described(caller, one, name, is_ours=one.url in ours)
        for one, name in [*((one, names.get(one.url, "")) for one in found), *places]
    )


def _described(caller: PageCaller, board: DeviceInfo, name: str, *, is_ours: bool) -> FoundBoard:
    findings = tuple(checks_before_opening(SystemFacts(), [board.url])) if board.problem else ()
    hub = board.url.removeprefix(_SHARED) if board.shares else ""
    return FoundBoard(
        board.url,
        board.shares,
        name or hub,
        board.product,
        board.problem,
        findings,
        is_ours=is_ours,
        is_kept=hub in caller.studio.robots,
    )
