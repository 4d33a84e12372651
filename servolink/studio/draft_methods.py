"""Methods for drafts, which all pages of a studio share."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from typing import Annotated

from msgspec import Meta, Struct

from servolink.control import NoParams, Role, Touches
from servolink.errors import ProjectError
from servolink.studio.drafts import MOST_RECORDS, Edit, Kept
from servolink.studio.studio_methods import METHODS, PageCaller, Studio

_LOOK = 0.5  # seconds between two checks for edits of other studios


class DraftNow(Struct, frozen=True):
    """Draft of the board; also the notification `studio.draft`, with the records edited by another page."""

    records: tuple[Kept, ...]


class DraftSave(Struct, forbid_unknown_fields=True):
    """Edits of records, in their order."""

    edits: Annotated[list[Edit], Meta(max_length=MOST_RECORDS)]


class DraftSaved(Struct, frozen=True):
    """Result of saving the edits."""

    saved: tuple[Kept, ...]
    conflicts: tuple[Kept, ...]
    """Kept edits of other pages that won over edits of this page, which were not saved."""


@METHODS.add("studio.draft.get", Role.WATCH, touches=Touches.NOTHING)
async def draft_get(caller: PageCaller, params: NoParams) -> DraftNow:
    """Return the unwritten edits. From now on, `studio.draft` reports edits of other pages."""
    return DraftNow(await caller.studio.drafts_of(caller.hub).kept())


@METHODS.add("studio.draft.save", Role.EDIT, touches=Touches.BOARD, in_order=True, finishes=True)
async def draft_save(caller: PageCaller, params: DraftSave) -> DraftSaved:
    """Keep each edit, unless another page has edited the record since the revision known to the page."""
    saved, conflicts = await caller.studio.drafts_of(caller.hub).save(params.edits, caller.page.who)
    if saved:
        caller.tell_others("studio.draft", DraftNow(saved))
    return DraftSaved(saved, conflicts)


async def follow_drafts(studio: Studio) -> None:
    """Send the pages of `studio` the edits of other studios of the board, until cancelled."""
    while True:
        await asyncio.sleep(_LOOK)
        hub = studio.hub
        if not hub or not studio.pages_of(hub):
            continue
        with suppress(ProjectError):  # the page gets the error with the next save
            if records := await studio.drafts_of(hub).news():
                for page in studio.pages_of(hub):
                    page.notify("studio.draft", DraftNow(records))
