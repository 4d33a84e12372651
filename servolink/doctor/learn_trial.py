"""Writing to a board only to learn of it: under the protection of an import, so that a rollback restores everything."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from msgspec.structs import replace

from servolink.client.board import Board
from servolink.client.connect import connect
from servolink.doctor.learn_line import SharedTransport
from servolink.errors import OutcomeUnknown, ProjectError
from servolink.project.model import Project, is_unfinished
from servolink.project.transfer.backups import BackupStore
from servolink.project.transfer.journal import Journal, JournalPhase, journal_of
from servolink.protocol.codec import Codec
from servolink.protocol.editing import QueryProjectIDRequest, WriteProjectIDRequest
from servolink.protocol.records import Action, Step

SCRATCH = "servolink scratch"
"""How captions of records begin that are stored only to learn of the board."""

_MOST_STEPS = 24
_DEGREE, _INTERVAL = 0, 100
_TRIES = 3


@dataclass
class Trial:
    """A board on which scratch records may be written, with what it held before."""

    transport: SharedTransport
    codec: Codec
    """Byte order and caption encoding of the board."""
    store: BackupStore
    backup: Path
    content: Project
    """What the board held before."""
    journal: Journal
    """That of the import that undoes everything; the board has its marker as far as it keeps project ids."""
    servo_ids: tuple[int, ...] = ()
    _used: set[int] = field(default_factory=set)

    @asynccontextmanager
    async def board(self, patience: float | None = None) -> AsyncIterator[Board]:
        """Connect to the board. Nothing else may use the transport meanwhile."""
        async with connected(self.transport, self.codec, patience) as board:
            yield board

    def scratch_actions(self, number: int) -> list[Action]:
        """Return new actions, with ids that the board does not have, that nobody runs."""
        taken = {action.action_id for action in self.content.actions} | self._used
        ids = (each for each in range(1, len(taken) + number + 1) if each not in taken)
        found = [self._scratch_action(action_id) for action_id, _ in zip(ids, range(number), strict=False)]
        self._used |= {action.action_id for action in found}
        return found

    def free_ids(self, taken: set[int]) -> None:
        """Use the ids of scratch records again, but for those in `taken`: a board may have few."""
        self._used &= taken

    def _scratch_action(self, action_id: int) -> Action:
        steps = tuple(Step(servo_id, _DEGREE, _INTERVAL) for servo_id in self.servo_ids[:_MOST_STEPS])
        return Action(action_id, SCRATCH, steps)

    async def note(self, phase: JournalPhase) -> None:
        """Keep in the journal that the board is cleared (`clearing`), or only written to (`writing`)."""
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
    ) as board:
        yield board


async def begin_trial(
    transport: SharedTransport, codec: Codec, store: BackupStore, on_trial: Callable[[Trial], None]
) -> Trial:
    """Save what the board holds, and mark it as a board with an unfinished import; before that, call `on_trial`.

    Raise ProjectError if it has one already, or if no backup can be made.
    """
    async with connected(transport, codec) as board:
        project_id = (await board.request(QueryProjectIDRequest())).project_id
        journals = await asyncio.to_thread(store.journals, project_id)
        if is_unfinished(project_id) or journal_of(journals, project_id, board.url) is not None:
            raise ProjectError(
                f"{board.url} holds an unfinished import: `servolink apply FILE` finishes it, `servolink rollback` "
                "undoes it; learn after that"
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
    """Raise ProjectError for records of an interrupted trial: not every board keeps a mark of it."""
    if any(action.action_caption.startswith(SCRATCH) for action in content.actions):
        raise ProjectError(
            f"{board.url} holds records of a measurement that was interrupted: restore what was there before with "
            "`servolink rollback BACKUP`, where BACKUP is the number that `servolink backups` shows for it"
        )


async def write_marker(board: Board, marker: int) -> int:
    """Write the marker of an unfinished import and return the project id that the board has then."""
    found = marker
    for _ in range(_TRIES):
        with suppress(OutcomeUnknown):
            await board.request(WriteProjectIDRequest(marker))
        found = (await board.request(QueryProjectIDRequest())).project_id
        if found == marker:
            break
    return found


async def end_trial(trial: Trial) -> None:
    """Restore what the board held before, and make `servolink rollback` undo the same import as before the trial."""
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
