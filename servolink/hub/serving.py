"""Hub that serves programs: a board with a name, a claim on the name, and doors."""

from __future__ import annotations

import asyncio
import re
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Any

from servolink.boards import Aliases, HubClaim, hub_of, resolve_board
from servolink.client import connect
from servolink.control import Role
from servolink.errors import OpenError, Reason
from servolink.hub.doors.frame_doors import pty_door, tcp_door
from servolink.hub.doors.socket_door import socket_door
from servolink.hub.hub import Hub, share
from servolink.hub.methods.control_session import ControlInterface
from servolink.hub.rules.tried import MotionTwin, Uncertain
from servolink.motion import AngleUnit
from servolink.protocol import ByteOrder, Codec
from servolink.support import is_name

_LONGEST_NAME = 32
_SHARED = "share://"


@asynccontextmanager
async def serve_board(
    url: str | None = None,
    *,
    name: str | None = None,
    tcp: str | None = None,
    watch_tcp: str | None = None,
    pty: str | None = None,
    unit: AngleUnit = "degree",
    door_byte_order: ByteOrder | None = None,
    lease_seconds: float = Hub.LEASE_SECONDS,
    guard: bool = False,
    forecast: MotionTwin | None = None,
    uncertain: Uncertain = "ask",
    **options: Any,
) -> AsyncIterator[tuple[Hub, list[str]]]:
    """Share a board with the programs of this user, at `share://NAME`, until the block ends; yield hub and addresses.

    Args:
        url: Address or name of the board, as for `connect`.
        name: Name of the hub; that of the board unless given.
        tcp: HOST:PORT for programs in any language; whoever reaches the port may use the board.
        watch_tcp: HOST:PORT for programs that may only read.
        pty: Path of a link to a pseudo-terminal for one program; empty for a pseudo-terminal without a link.
        unit: Angle unit, `degree` or `adc`, of programs behind these doors that set none.
        door_byte_order: Byte order of these programs; that of the board unless given.
        lease_seconds: Seconds, 0 or more, for which a program keeps the lease after its last motion.
        guard: Whether a guard stops the board for a stalled servo, if the profile of the board says nothing.
        forecast: Twin on which motions are tried before they are sent; None for none.
        uncertain: What happens to a motion whose outcome on the twin is uncertain: `refuse`, `ask` or `pass`.
        options: Options of `connect`, other than `reconnect` and `angle_unit`.

    Raises:
        OpenError: The board cannot be opened, or the name or the board is in use; the text names the other hub.
    """
    found = await resolve_board(url, through_hub=False)
    address = found.url
    if (other := await asyncio.to_thread(hub_of, address)) is not None:
        raise OpenError(
            f"{address} is {other.product} already: use {other.url}, or end that hub first", reason=Reason.IN_USE
        )
    chosen = name or found.name or await asyncio.to_thread(Aliases.name_at, address) or default_name(address)
    async with AsyncExitStack() as stack:
        claim = stack.enter_context(await HubClaim.of(chosen))
        board = await stack.enter_async_context(connect(address, reconnect=True, angle_unit=None, **options))
        hub = await stack.enter_async_context(share(board, name=chosen, lease_seconds=lease_seconds))
        if forecast is not None:
            stack.push_async_callback(hub.begin_forecast(forecast, uncertain).close)
        codec = Codec(door_byte_order or board.codec.byte_order, board.codec.caption_encoding)
        control = ControlInterface(hub)
        stack.push_async_callback(control.close)
        control.begin_guard(otherwise=guard)
        doors = [socket_door(hub, claim, control.open_channel)]
        if tcp is not None:
            doors.append(tcp_door(hub, tcp, codec=codec, unit=unit))
        if watch_tcp is not None:
            doors.append(tcp_door(hub, watch_tcp, role=Role.WATCH, codec=codec, unit=unit))
        if pty is not None:
            doors.append(pty_door(hub, link=pty or None, codec=codec, unit=unit))
        urls = [await stack.enter_async_context(door) for door in doors]
        hub.doors = tuple(urls)
        await asyncio.to_thread(claim.announce, address)
        yield hub, urls


def default_name(url: str) -> str:
    """Return the name of a hub for a board without one: the end of the address, such as `ttyACM0`."""
    place = url.partition("?")[0].rstrip("/")
    scheme, _, rest = place.rpartition("://")
    last = re.sub(r"[^A-Za-z0-9_-]+", "-", rest.rpartition("/")[2]).strip("-")[:_LONGEST_NAME]
    return last if is_name(last) else scheme or "board"


@asynccontextmanager
async def hub_of_board(url: str | None = None, **options: Any) -> AsyncIterator[str]:
    """Yield the name of the hub that shares a board; without such a hub, share the board in this context.

    `url` and `options` are those of `connect`; the options do not count for a hub that runs.
    """
    address = (await resolve_board(url)).url
    if address.startswith(_SHARED):
        yield address.removeprefix(_SHARED).partition("?")[0]
        return
    async with serve_board(url, **options) as (hub, _):
        yield hub.name
