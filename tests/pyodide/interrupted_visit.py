"""Imports a project in a page that ends before a packet, and goes on at the next visit; prints how many it tried.

Files are kept as the page keeps them (`kept-files.js`); stores of the browser are stand-ins.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import browser  # type: ignore[import-not-found]  # of runner.mjs

from servolink.client import connect
from servolink.errors import ConnectionLost
from servolink.virtual import VirtualBoard, VirtualTransport
from tests.project.pulled import NEW, NEW_CONTENTS, OLD, OLD_CONTENTS, Make, has_backup, same, undo
from tests.sampling import some

URL = "virtual://rex"


class EndingVisit(VirtualTransport):
    """A board at a page that ends before the packet number `last`."""

    def __init__(self, board: VirtualBoard, last: int, stores: Any) -> None:
        super().__init__(board, URL)
        self.left = last
        self._stores = stores
        self.kept: Any = None
        """What the browser has of the files when the page has ended."""

    def _send(self, data: bytes) -> None:
        if self.left == 0 and self.kept is None:
            self.kept = browser.copyOf(self._stores)
        if self.kept is not None:
            raise ConnectionLost("the page has ended")
        self.left -= 1
        super()._send(data)


async def main() -> None:
    """Try some packets, `STEP` apart; with 1 all."""
    make, count = Make(), 0
    for last in some(0, 10_000, int(sys.argv[1])):
        board = make.board(OLD_CONTENTS, 1)
        folder, stores = f"/visit{last}", browser.newStores()
        browser.keep(folder, stores)
        visit = EndingVisit(board, last, stores)
        try:
            async with connect(visit) as here:
                await here.apply_project(NEW, folder=Path(folder, "servolink"))
        except Exception:
            if visit.kept is None:
                raise
        if visit.kept is None:
            break
        left, count = board.storage.contents, count + 1
        for how in ("on", "back"):
            again = Path(f"/visit{last}{how}")
            browser.keep(str(again), browser.copyOf(visit.kept), folder)
            again /= "servolink"
            assert same(left, OLD_CONTENTS) or has_backup(again, OLD), last
            board.storage.contents = left
            async with connect(VirtualTransport(board, URL)) as there:
                await (there.apply_project(NEW, folder=again) if how == "on" else undo(there, again))
            assert same(board.storage.contents, NEW_CONTENTS if how == "on" else OLD_CONTENTS), (last, how)
    else:
        raise AssertionError("the import never came to its end")
    print(count)
