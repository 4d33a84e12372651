"""Writing to a board for measurements only: protected by an import, so that a rollback restores everything."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from msgspec.structs import replace

from servolink.boards import BoardProfile
from servolink.client import Board, connect
from servolink.doctor.learn_line import SharedTransport
from servolink.errors import OutcomeUnknown, ProjectError
from servolink.project import UNFINISHED, BackupStore, Journal, JournalPhase, Project
from servolink.protocol import Action, Codec, QueryProjectIDRequest, Step, WriteProjectIDRequest

SCRATCH = "servolink scratch"
"""Beginning of the captions of all records stored only for measurements."""

_MOST_STEPS = 24
_DEGREE, _INTERVAL = 0, 100
_TRIES = 3


@dataclass
class Trial:
    """Board open to scratch records, with the content from before."""

    transport: SharedTransport
    codec: Codec
    """Byte order and caption encoding of the board."""
    store: BackupStore
    backup: Path
    content: Project
    """Content of the board before the trial."""
    journal: Journal
    """Journal of the import that undoes everything; the board keeps as much of the marker as of any project id."""
    servo_ids: tuple[int, ...] = ()
    _used: set[int] = field(default_factory=set)

    @asynccontextmanager
    async def board(self, patience: float | None = None) -> AsyncIterator[Board]:
        """Connect to the board. Nothing else may use the transport meanwhile."""
        async with connected(self.transport, self.codec, patience) as board:
            yield board

    def scratch_actions(self, number: int) -> list[Action]:
        """Return new actions with unused ids, not run by any macro."""
        used_ids = {action.action_id for action in self.content.actions} | self._used
        ids = (each for each in range(1, len(used_ids) + number + 1) if each not in used_ids)
        found = [self._scratch_action(action_id) for action_id, _ in zip(ids, range(number), strict=False)]
        self._used |= {action.action_id for action in found}
        return found

    def free_ids(self, used_ids: set[int]) -> None:
        """Use the ids of scratch records again, except for `used_ids`: a board may have few ids."""
        self._used &= used_ids

    def _scratch_action(self, action_id: int) -> Action:
        steps = tuple(Step(servo_id, _DEGREE, _INTERVAL) for servo_id in self.servo_ids[:_MOST_STEPS])
        return Action(action_id, SCRATCH, steps)

    async def note(self, phase: JournalPhase) -> None:
        """Record in the journal whether the board is cleared (`clearing`) or only written to (`writing`)."""
        self.journal = replace(self.journal, phase=phase)
        await asyncio.to_thread(self.store.write, self.journal)


@asynccontextmanager
async def connected(transport: SharedTransport, codec: Codec, patience: float | None = None) -> AsyncIterator[Board]:
    """Connect to the board on `transport`, one request at a time, and leave the transport open."""
    async with connect(
        transport,
        byte_order=codec.byte_order,
        caption_encoding=codec.caption_encoding,
        patience=patience,
        depth=1,
        profile=BoardProfile(settings=transport.settings),
    ) as board:
        yield board


async def begin_trial(
    transport: SharedTransport, codec: Codec, store: BackupStore, on_trial: Callable[[Trial], None]
) -> Trial:
    """Save the content of the board, call `on_trial`, and mark the board as having an unfinished import.

    Raise ProjectError for a board with an unfinished import, and for a failed backup.
    """
    async with connected(transport, codec) as board:
        project_id = (await board.request(QueryProjectIDRequest())).project_id
        begun = await asyncio.to_thread(store.journal_of, project_id, board.url)
        if project_id in UNFINISHED or begun is not None:
            raise ProjectError(
                f"{board.url} holds an unfinished import: `servolink apply FILE` finishes it, `servolink rollback` "
                "undoes it; learn afterwards"
            )
        content = await board.export_project()
        _refuse_scratch(board, content, store)
        backup = await asyncio.to_thread(store.keep, content, board.url, codec.caption_encoding)
        marker = await asyncio.to_thread(store.new_marker)
        journal = Journal(marker, board.url, content.project_id, backup.name)
        await asyncio.to_thread(store.write, journal)
        trial = Trial(transport, codec, store, backup, content, journal, await board.servo_ids())
        on_trial(trial)
        await write_marker(board, marker)
    return trial


def _refuse_scratch(board: Board, content: Project, store: BackupStore) -> None:
    """Raise ProjectError for records of an interrupted trial: not every board keeps a mark of the trial."""
    if any(action.action_caption.startswith(SCRATCH) for action in content.actions):
        raise ProjectError(
            f"{board.url} holds records of an interrupted measurement: restore the content from before with "
            "`servolink rollback BACKUP`, where BACKUP is the number shown by `servolink backups`"
        )


async def write_marker(board: Board, marker: int) -> int:
    """Write the marker of an unfinished import, and return the resulting project id of the board."""
    found = marker
    for _ in range(_TRIES):
        with suppress(OutcomeUnknown):
            await board.request(WriteProjectIDRequest(marker))
        found = (await board.request(QueryProjectIDRequest())).project_id
        if found == marker:
            break
    return found


async def end_trial(trial: Trial) -> None:
    """Restore the content of the board, and make `servolink rollback` undo the same import as before the trial."""
    before = [each for each in await _journals(trial) if each.marker != trial.journal.marker]
    async with trial.board() as board:
        await board.rollback_project(trial.backup, folder=trial.store.folder)
    for each in await _journals(trial):
        if each.restores == trial.backup.name:
            await asyncio.to_thread(trial.store.end, each)
    for each in before:  # the rollback ends journals of earlier imports
        await asyncio.to_thread(trial.store.write, each)


async def _journals(trial: Trial) -> list[Journal]:
    journals = await asyncio.to_thread(trial.store.journals, trial.content.project_id)
    return [each for each in journals if each.url == trial.journal.url]
