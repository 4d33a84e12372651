"""Method by which a page fetches a recording, piece by piece, for the browser to save."""

from __future__ import annotations

import asyncio
import re
from pathlib import Path
from typing import Annotated

from msgspec import Meta, Struct

from servolink.control import Code, Role, RpcError, Touches
from servolink.studio.studio_methods import METHODS, PageCaller
from servolink.support import open_file, reason, user_folder

_PIECE = 256 * 1024
_NAME = re.compile(r"[\w][\w.-]{0,120}\.mcap", re.ASCII)


class RecordingPart(Struct, forbid_unknown_fields=True):
    """Place of a piece in a recording named by `recorder.list`."""

    name: Annotated[str, Meta(max_length=128)]
    offset: Annotated[int, Meta(ge=0, le=2**53)] = 0


class RecordingPiece(Struct, frozen=True):
    """A piece of a recording, at most 256 KiB."""

    data: bytes
    """Bytes of the piece, in base64."""
    size: int
    """Size of the whole file in bytes, growing during recording."""


@METHODS.add("studio.recording.read", Role.RUN, touches=Touches.NOTHING)
async def recording_read(caller: PageCaller, params: RecordingPart) -> RecordingPiece:
    """Return the piece of a recording that begins at `offset`; an empty piece at the end."""
    if not _NAME.fullmatch(params.name):
        raise RpcError(Code.INVALID_PARAMS, "no recording has such a name; `recorder.list` has the names")
    try:
        return await asyncio.to_thread(_read, user_folder("data") / "recordings" / params.name, params.offset)
    except OSError as error:
        raise RpcError(Code.INVALID_PARAMS, f"the recording cannot be read: {reason(error)}") from error


def _read(path: Path, offset: int) -> RecordingPiece:
    with open_file(path) as file:
        size = file.seek(0, 2)
        file.seek(min(offset, size))
        return RecordingPiece(file.read(_PIECE), size)
