"""The project id during an import: a marker that names its journal, as far as the board keeps project ids."""

from __future__ import annotations

from contextlib import suppress

from servolink.errors import OutcomeUnknown, ProjectError, Rejected
from servolink.project.model import is_unfinished
from servolink.project.transfer.pinned import BoardConnection, ProjectIDBits
from servolink.project.transfer.read import read_project_id
from servolink.project.transfer.results import Phase, Progress, ProgressCallback

_TRIES = 4
_LOW_HALF = 0xFFFF


def is_same_id(found: int, wanted: int, bits: ProjectIDBits | None) -> bool:
    """Return whether a board that keeps so many bits, None for all, returns `found` after `wanted` was written."""
    return bits == 0 or found == wanted or (bits == 16 and (found ^ wanted) & _LOW_HALF == 0)


def is_cut(found: int, written: int) -> bool:
    """Return whether `found` is `written` cut to its low 16 bits, with or without its sign."""
    low = written & _LOW_HALF
    return found in (low, low - 0x1_0000)


class Marker:
    """Writes the marker, finds out how much of it the board keeps, and watches over it."""

    def __init__(self, board: BoardConnection, marker: int, on_progress: ProgressCallback) -> None:
        """Use the number `marker`, which no other import has."""
        self.bits: ProjectIDBits = 32
        """How many bits of it the board keeps; known after `put`."""
        self.found = marker
        """The project id that the board returns while the marker is on it."""
        self._board = board
        self._marker = marker
        self._before = 0
        self._on_progress = on_progress

    async def put(self, before: int) -> None:
        """Write the marker over the project id `before`, and set `bits`. Raise ProjectError if another import has."""
        self._before = before
        found = await self._write(self._marker, "marking")
        if found == self._marker:
            return
        if not is_cut(found, self._marker):
            self._refuse_other(found)
            # Refused because it is too large, perhaps: then a small number has a chance.
            found = await self._write(self._marker & _LOW_HALF, "marking")
        self.found = found
        self.bits = 16 if is_cut(found, self._marker) else 0

    async def keep(self) -> bool:
        """Return whether the marker is on the board; restore it if it is not.

        Raise ProjectError if another import has written its own. Of a board that keeps nothing this is always True.
        """
        found = await read_project_id(self._board, self.found)
        if found == self.found or self.bits == 0:
            return True
        self._refuse_other(found)
        await self.restore("verifying")
        return False

    async def restore(self, phase: Phase) -> None:
        """Write the marker again, after the board was cleared or something else has changed it."""
        if self.bits:
            await self.finish(self.found, phase)

    async def finish(self, project_id: int, phase: Phase = "finishing") -> None:
        """Write `project_id`, of which the board keeps as much as of the marker. Raise ProjectError if it does not."""
        if not is_same_id(await self._write(project_id, phase), project_id, self.bits):
            raise ProjectError(not_taken(self._board, f"project id {project_id}"))

    def _is_marker_of_another(self, found: int) -> bool:
        if found == self._before:
            return False
        # Sixteen bits do not show a marker, so any number but the former project id counts as one.
        return is_unfinished(found) if self.bits == 32 else found != 0

    def _refuse_other(self, found: int) -> None:
        if self._is_marker_of_another(found):
            raise ProjectError(
                f"another program has begun to import to {self._board.url} in the middle of this import; "
                "let one of them do it"
            )

    async def _write(self, project_id: int, phase: Phase) -> int:
        """Write a project id; return what the board has then: `project_id`, its low half, or something else."""
        self._on_progress(Progress(phase, 0, 1, f"project id {project_id}"))
        found = 0
        for _ in range(_TRIES):
            with suppress(Rejected, OutcomeUnknown):  # what the board returns next is what counts
                await self._board.write_project_id(project_id)
            found = await read_project_id(self._board, project_id)
            if is_same_id(found, project_id, self.bits):
                break
            if phase == "marking" and (is_cut(found, project_id) or self._is_marker_of_another(found)):
                break
        return found


def not_taken(board: BoardConnection, what: str) -> str:
    """Return the text of the error for something that the board does not take."""
    return f"{board.url} does not take {what}; the import is unfinished: apply a project that it takes, or roll back"
