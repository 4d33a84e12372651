"""Project id during an import: a marker that identifies the journal, as far as the board keeps project ids."""

from __future__ import annotations

from contextlib import suppress

from servolink.errors import OutcomeUnknown, ProjectError, Rejected
from servolink.project.model import UNFINISHED
from servolink.project.transfer.pinned import BoardConnection, ProjectIDBits
from servolink.project.transfer.read import read_project_id
from servolink.project.transfer.results import Phase, Progress, ProgressCallback

_TRIES = 4
_LOW_HALF = 0xFFFF


def is_same_id(found: int, expected: int, bits: ProjectIDBits | None) -> bool:
    """Return whether `found` is a possible reading after writing `expected`; `bits` are the bits kept, None for all."""
    return bits == 0 or found == expected or (bits == 16 and (found ^ expected) & _LOW_HALF == 0)


def is_cut(found: int, written: int) -> bool:
    """Return whether `found` is `written` cut to the low 16 bits, with or without the sign."""
    low = written & _LOW_HALF
    return found in (low, low - 0x1_0000)


class Marker:
    """Writes the marker, determines the number of bits kept by the board, and watches over the marker."""

    def __init__(self, board: BoardConnection, marker: int, on_progress: ProgressCallback) -> None:
        self.bits: ProjectIDBits = 32
        """Number of marker bits kept by the board; known after `put`."""
        self.found = marker
        """Project id returned by the board with the marker written."""
        self._board = board
        self._marker = marker
        self._before = 0
        self._on_progress = on_progress

    async def put(self, before: int) -> None:
        """Write the marker over the project id `before`, and set `bits`. Raise ProjectError for a foreign marker."""
        self._before = before
        found = await self._write(self._marker, "marking")
        if found == self._marker:
            return
        if not is_cut(found, self._marker):
            self._refuse_other(found)
            # Perhaps refused for being too large: then a small number has a chance.
            found = await self._write(self._marker & _LOW_HALF, "marking")
        self.found = found
        self.bits = 16 if is_cut(found, self._marker) else 0

    async def keep(self) -> bool:
        """Return whether the marker is on the board; restore a missing marker.

        Raise ProjectError for the marker of another import. With a board that keeps no bits, always return True.
        """
        found = await read_project_id(self._board, self.found)
        if found == self.found or self.bits == 0:
            return True
        self._refuse_other(found)
        await self.restore("verifying")
        return False

    async def restore(self, phase: Phase) -> None:
        """Write the marker again, after the board was cleared or the project id changed."""
        if self.bits:
            await self.finish(self.found, phase)

    async def finish(self, project_id: int, phase: Phase = "finishing") -> None:
        """Write `project_id`, kept with as many bits as the marker. Raise ProjectError if another id is read."""
        if not is_same_id(await self._write(project_id, phase), project_id, self.bits):
            raise ProjectError(not_stored(self._board, f"project id {project_id}"))

    def _is_marker_of_another(self, found: int) -> bool:
        if found == self._before:
            return False
        # Sixteen bits do not show a marker, so any number except the former project id counts as a marker.
        return found in UNFINISHED if self.bits == 32 else found != 0

    def _refuse_other(self, found: int) -> None:
        if self._is_marker_of_another(found):
            raise ProjectError(
                f"another program has begun to import to {self._board.url} in the middle of this import; "
                "let a single program import"
            )

    async def _write(self, project_id: int, phase: Phase) -> int:
        """Write a project id, and return the id then on the board: `project_id`, the low half, or another number."""
        self._on_progress(Progress(phase, 0, 1, f"project id {project_id}"))
        found = 0
        for _ in range(_TRIES):
            with suppress(Rejected, OutcomeUnknown):  # only the next reading of the id counts
                await self._board.write_project_id(project_id)
            found = await read_project_id(self._board, project_id)
            if is_same_id(found, project_id, self.bits):
                break
            if phase == "marking" and (is_cut(found, project_id) or self._is_marker_of_another(found)):
                break
        return found


def not_stored(board: BoardConnection, what: str) -> str:
    """Return the error text for data not accepted by the board."""
    return f"{board.url} does not accept {what}; the import is unfinished: apply another project, or roll back"
