"""The methods for drafts, which all pages of a studio share."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from typing import Annotated

from msgspec import Meta, Struct

from servolink.control.messages import NoParams
from servolink.control.roles import Role
from servolink.errors import ProjectError
from servolink.studio.drafts import MOST_RECORDS, Edit, Kept
from servolink.studio.studio_methods import METHODS, PageCaller, Studio

_LOOK = 0.5  # seconds between two looks at what other studios keep


class DraftNow(Struct, frozen=True):
    """The draft; also the notification `studio.draft`, with the records that another page has edited."""

    records: tuple[Kept, ...]


class DraftSave(Struct, forbid_unknown_fields=True):
    """What was edited."""

    edits: Annotated[list[Edit], Meta(max_length=MOST_RECORDS)]


class DraftSaved(Struct, frozen=True):
    """What became of it."""

    saved: tuple[Kept, ...]
    conflicts: tuple[Kept, ...]
    """What is kept instead, of the records that somebody else edited meanwhile. They were not saved."""


@METHODS.add("studio.draft.get", Role.WATCH)
async def draft_get(caller: PageCaller, params: NoParams) -> DraftNow:
    """Return what is edited and not written. From now on, `studio.draft` tells of the edits of other pages."""
    return DraftNow(await caller.studio.drafts.kept())


@METHODS.add("studio.draft.save", Role.EDIT, in_order=True)
async def draft_save(caller: PageCaller, params: DraftSave) -> DraftSaved:
    """Keep each edit, unless another page has edited the same record since the revision that this page knows."""
    saved, conflicts = await caller.studio.drafts.save(params.edits, caller.page.who)
    for page in caller.studio.pages - {caller.page}:
        if saved:
            page.notify("studio.draft", DraftNow(saved))
    return DraftSaved(saved, conflicts)


async def follow_drafts(studio: Studio) -> None:
    """Tell the pages of `studio` what is edited at other studios of its board, until it is cancelled."""
    while True:
        await asyncio.sleep(_LOOK)
        if not studio.pages:
            continue
        with suppress(ProjectError):  # the page is told when it saves
            if records := await studio.drafts.news():
                for page in studio.pages:
                    page.notify("studio.draft", DraftNow(records))
