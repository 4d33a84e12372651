"""Programs made of blocks: kept on this computer for each board, shared by all pages of a studio."""

from __future__ import annotations

import asyncio
from hashlib import sha256
from typing import Annotated, Any

import msgspec
from msgspec import Meta, Struct

from servolink.control import NoParams, Role, Touches
from servolink.project import Blocks
from servolink.protocol import convert
from servolink.studio.kept import read_kept, write_kept
from servolink.studio.studio_methods import METHODS, PageCaller

_turn = asyncio.Lock()


class BlocksNow(Struct, frozen=True):
    """Blocks of the board; also the notification `studio.blocks`, after another page has saved blocks."""

    blocks: dict[str, Any] | None
    """Blocks in the form of project files; null if nobody has saved any."""
    tag: str
    """Text that changes with the blocks; empty without any."""


class BlocksSaved(BlocksNow, frozen=True):
    """Blocks of the board after saving."""

    saved: bool
    """Whether these are the blocks that were to be saved."""


class BlocksSave(Struct, forbid_unknown_fields=True):
    """Blocks to be saved."""

    blocks: Blocks
    known: Annotated[str, Meta(max_length=64)]
    """Tag of the blocks that these replace. If others are kept by now, nothing is saved, and those are returned; the
    same blocks count as saved, as a page that did not hear so sends them again."""


@METHODS.add("studio.blocks.get", Role.WATCH, touches=Touches.NOTHING)
async def blocks_get(caller: PageCaller, params: NoParams) -> BlocksNow:
    """Return the blocks of the board, null for none."""
    return _now(await asyncio.to_thread(_read, caller.hub))


@METHODS.add("studio.blocks.save", Role.EDIT, touches=Touches.BOARD, in_order=True, finishes=True)
async def blocks_save(caller: PageCaller, params: BlocksSave) -> BlocksSaved:
    """Keep the blocks, unless another page has changed them. EncodeError names the faulty place in the blocks."""
    blocks = params.blocks.checked()
    now = _now(blocks)
    async with _turn:
        kept = _now(await asyncio.to_thread(_read, caller.hub))
        if kept.tag not in (params.known, now.tag):
            return BlocksSaved(kept.blocks, kept.tag, saved=False)
        await asyncio.to_thread(write_kept, "blocks", caller.hub, now.blocks)
    caller.tell_others("studio.blocks", now)
    return BlocksSaved(now.blocks, now.tag, saved=True)


def _read(board: str) -> Blocks | None:
    return read_kept("blocks", board, lambda value: convert(value, Blocks).checked())


def _now(blocks: Blocks | None) -> BlocksNow:
    if blocks is None:
        return BlocksNow(None, "")
    return BlocksNow(blocks.to_json(), sha256(msgspec.json.encode(blocks)).hexdigest()[:16])
