"""Board: the 32 commands of the protocol as a person would say them."""

from __future__ import annotations

import logging
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import suppress
from pathlib import Path

from servolink.client.records import Editing, ReadBack
from servolink.client.servos import Servos
from servolink.client.session import Chapter, ConnectionState, Reconnector, States
from servolink.connection.connection import Connection
from servolink.connection.explain import lost, same
from servolink.connection.stats import Stats
from servolink.errors import ConnectionLost, Rejected, ServolinkError
from servolink.escaping import escape
from servolink.motion import AngleUnit, MotionLimits
from servolink.project.model import Project
from servolink.project.transfer.results import ApplyResult, Plan, ProgressCallback, ignore_progress
from servolink.protocol.settings import (
    ClearAllDataRequest,
    QueryMemorySizeRequest,
    QueryMemorySizeResponse,
    QueryRemainPowerRequest,
    SendDummyDataRequest,
    TransmissionModeSettingRequest,
)


class Settings(Chapter):
    """What concerns the whole board."""

    _mode: int | None = None  # the transmission mode that was set on this connection

    async def set_transmission_mode(self, mode: int) -> None:
        """Set mode 1, this protocol, or 0, the old one, which this library does not speak (3.1.1)."""
        await _set_mode(self._link, mode)
        self._mode = mode

    async def _speak_this_protocol(self, link: Connection) -> None:
        """Set mode 1 on a new link, if any was set on the one before it: in mode 0 no board says which it is."""
        if self._mode is not None:
            await _set_mode(link, 1)

    async def _restore_mode(self, link: Connection) -> None:
        """Set on a new link, which leads to the same board, the transmission mode that was set before."""
        if self._mode not in (None, 1):
            await _set_mode(link, self._mode)

    async def clear_all_data(self) -> None:
        """Delete everything stored on the board (3.1.2); nothing else is sent before it is answered."""
        with self._identity.changing(self._link, 0):
            await self._do(ClearAllDataRequest(), "its data was not deleted")
        self._identity.may_have(0)  # boards differ in whether they keep it

    async def memory(self) -> QueryMemorySizeResponse:
        """Return free and total memory in bytes, `size` and `total_size` (None on boards that do not tell) (3.1.3)."""
        return await self.request(QueryMemorySizeRequest())

    async def battery(self) -> float:
        """Return the remaining charge in percent, in steps of 0.1 (3.1.4)."""
        return (await self.request(QueryRemainPowerRequest())).permil / 10

    async def send_dummy_data(self, data: bytes) -> None:
        """Send up to 65,535 bytes that the board throws away (3.1.5)."""
        await self.send(SendDummyDataRequest(data))


async def _set_mode(link: Connection, mode: int) -> None:
    request = TransmissionModeSettingRequest(mode)
    if (answer := await link.request(request)).result != mode:
        raise Rejected(f"the board was asked for mode {mode} and is in mode {answer.result}", request)


class Projects(Settings, ReadBack):
    """Everything stored on the board at once; `servolink.project` has what is done, and is loaded when it is used."""

    _told_of_import = False

    async def export_project(self, *, on_progress: ProgressCallback = ignore_progress) -> Project:
        """Return everything stored on the board, each part read until two consecutive readings agree (4.3).

        ProjectError if they never do, or if the board lists what it does not give.
        """
        from servolink.project.transfer.read import PinnedConnection, read_project

        return await read_project(PinnedConnection(self), on_progress)

    async def plan_project(
        self,
        project: Project,
        *,
        replace: bool = False,
        unchecked: bool = False,
        on_progress: ProgressCallback = ignore_progress,
    ) -> Plan:
        """Return what `apply` would change, and what that costs; changes nothing.

        `unchecked` is for a project that was read from a board and may hold what servolink would not write by itself.
        """
        from servolink.project.transfer.plan import plan_project
        from servolink.project.transfer.read import PinnedConnection

        return await plan_project(
            PinnedConnection(self), project, on_progress=on_progress, replace=replace, unchecked=unchecked
        )

    async def apply_project(
        self,
        project: Project,
        *,
        replace: bool = False,
        backup: bool = True,
        folder: Path | None = None,
        on_progress: ProgressCallback = ignore_progress,
    ) -> ApplyResult:
        """Make the board hold `project`: only what differs is written, or with `replace` all of it (4.2).

        Before anything is changed the board's content is kept in `folder` (the user's data folder). Whatever
        interrupts it, a cancellation too, the next `apply` goes on, and `rollback` goes back. ProjectError for a
        project that cannot be written or does not fit, if no backup can be made, and if the board does not take it.
        """
        from servolink.project.transfer.apply import apply_project
        from servolink.project.transfer.backups import BackupStore
        from servolink.project.transfer.read import PinnedConnection

        board, store = PinnedConnection(self), BackupStore(folder)
        return await apply_project(board, project, store=store, on_progress=on_progress, replace=replace, backup=backup)

    async def rollback_project(
        self, backup: Path | None = None, *, folder: Path | None = None, on_progress: ProgressCallback = ignore_progress
    ) -> ApplyResult:
        """Make the board hold what it held before the last import at this address, or what `backup` holds.

        ProjectError if there is no such backup, or if the board is not as that import left it.
        """
        from servolink.project.transfer.apply import roll_back
        from servolink.project.transfer.backups import BackupStore
        from servolink.project.transfer.read import PinnedConnection

        return await roll_back(PinnedConnection(self), backup, store=BackupStore(folder), on_progress=on_progress)

    async def has_unfinished_import(self) -> bool:
        """Tell whether an import was begun on the board and not finished; `apply` again, or `rollback`."""
        from servolink.project.model import is_unfinished

        self._told_of_import = True
        return is_unfinished(await super().project_id())

    async def project_id(self) -> int:
        """Return the project id; 0 if the board has none (3.3.13).

        One that says that an import was begun and not finished is a warning in the log, once.
        """
        from servolink.project.model import is_unfinished

        project_id = await super().project_id()
        if is_unfinished(project_id) and not self._told_of_import:
            self._told_of_import = True
            logging.getLogger(__name__).warning(
                "%s holds an unfinished import: `apply` finishes it, `rollback` undoes it", escape(self.url)
            )
        return project_id


class Board(Servos, Projects):
    """A connected board; one file per chapter of the document holds its commands."""

    def __init__(
        self,
        link: Connection,
        angle_unit: AngleUnit | None,
        limits: MotionLimits,
        reopen: Callable[[], Awaitable[Connection]] | None = None,
    ) -> None:
        """Use `connect`; with `reopen`, which opens a new link to the same board, a lost link is replaced."""
        super().__init__(link, angle_unit, limits)
        self._states = States()
        self._reconnector: Reconnector | None = None
        if reopen is not None:
            self._reconnector = Reconnector(lambda: self._open_again(reopen), self._resume)
        link.answers.on_end = self._link_ended

    @property
    def stats(self) -> Stats:
        """What the link has seen: frames, bytes, noise, late answers, round trips."""
        return self._link.stats

    def states(self) -> AsyncIterator[ConnectionState]:
        """Yield `connected`, `lost` or `closed`: the state as it is, and then each change up to `closed`."""
        return self._states.read()

    async def clear_all_data(self) -> None:
        """Delete everything stored on the board (3.1.2); nothing else is sent before it is answered."""
        await super().clear_all_data()
        if self._reconnector is not None:
            with suppress(ServolinkError):  # it is deleted; only less would be known of which board this is
                await Editing.project_id(self)  # that of Projects would warn of an import that is under way

    async def close(self) -> None:
        """End the button events and free the port; may be called again."""
        try:
            if self._reconnector is not None:
                await self._reconnector.stop()
            await self._events.close()
        finally:
            self._link.answers.on_end = self._events.end
            try:
                await self._link.close()
            finally:
                self._events.end(lost(self.url, None))
                self._states.become("closed")

    def _link_ended(self, error: ConnectionLost) -> None:
        self._states.become("lost")
        if self._reconnector is None or not self._reconnector.start():
            self._events.end(error)

    async def _open_again(self, reopen: Callable[[], Awaitable[Connection]]) -> Connection:
        await self._link.close()  # it may have ended by silence and still hold the port
        return await reopen()

    async def _resume(self, link: Connection) -> None:
        """Restore the session on a new link and use it from then on; raises what keeps it from being restored."""
        link.answers.on_end = self._link_ended
        await self._speak_this_protocol(link)
        await self._identity.check(link)  # any answer also proves that nothing is owed
        await self._restore_units(link)
        self._link = link
        await self._events.move(link)
        await self._restore_mode(link)  # last, as the old one is the end of all answers
        if link.answers.ended is not None:
            raise same(link.answers.ended)
        self.stats.reconnects += 1
        self._states.become("connected")
