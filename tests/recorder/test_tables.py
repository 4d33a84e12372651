"""Tables of a recording appear together or not at all.

Module: servolink.recorder.tables.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from servolink.errors import RecordingError
from servolink.recorder import Event, Recording, Wire, tables, write_tables
from servolink.recorder.channels import Message
from servolink.recorder.reading import Entry
from tests.recorder.files import write


def test_no_table_is_replaced_if_one_of_them_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The disk is full at the last row."""
    messages: list[tuple[float, Message]] = [(float(at), Event("mark", "mark", "x" * 99)) for at in range(500)]
    messages += [(999.0, Wire("sent", b"last", 999.0))]
    path = write(tmp_path / "out.mcap", messages)
    cells = tables.cells

    def cells_until_full(entry: Entry[Message]) -> Iterator[tuple[Any, ...]]:
        if isinstance(entry.message, Wire):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return cells(entry)

    monkeypatch.setattr(tables, "cells", cells_until_full)
    written = [tmp_path / f"{channel}.csv" for channel in ("events", "wire")]
    for each in written:
        each.write_text("precious")
    with pytest.raises(RecordingError) as caught:
        write_tables(Recording(path).entries(), lambda channel: tmp_path / f"{channel}.csv", replace=True)
    assert str(caught.value) == f"{written[1]} cannot be written: {os.strerror(errno.ENOSPC)}"
    assert [each.read_text() for each in written] == ["precious", "precious"]
    assert len(list(tmp_path.iterdir())) == 3
