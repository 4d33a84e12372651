"""An import belongs to one connection: behind the next one there may be another board."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from servolink.errors import ConnectionLost
from servolink.project.transfer.pinned import PinnedConnection
from servolink.protocol import QueryServoListRequest
from tests.client.reconnections import connected, until
from tests.client.sockets import Socket
from tests.plugged import plugged
from tests.project.boards import OTHER_CONTENTS
from tests.project.pulled import NEW, OLD_CONTENTS, Make
from tests.virtual_time import run


@pytest.mark.parametrize("at", ["keep", "new_marker", "write"])
def test_a_board_that_is_plugged_in_while_files_are_written_is_left_alone(
    at: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing waits for an answer then, so nothing but the connection tells."""
    mine, other = Make().board(OLD_CONTENTS, 1), Make().board(OTHER_CONTENTS, 1)
    mine.storage.project_id = other.storage.project_id = 5
    before = other.storage.contents
    socket = Socket(mine)
    url = plugged(monkeypatch, socket.transport)

    async def main() -> None:
        async with connected(url) as board:

            async def swapped(function: Any, *args: Any) -> Any:
                if function.__name__ == at and socket.board is mine:
                    socket.pull()
                    socket.plug(other)
                    await until(board, "connected")
                return function(*args)

            monkeypatch.setattr(asyncio, "to_thread", swapped)
            with pytest.raises(
                ConnectionLost, match=r"was lost and restored .* perhaps to another board; start the transfer again"
            ):
                await board.apply_project(NEW, folder=tmp_path)

    run(main())
    assert other.storage.contents == before


def test_whatever_is_asked_after_a_loss_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    socket = Socket(Make().board(OLD_CONTENTS, 1))
    url = plugged(monkeypatch, socket.transport)

    async def main() -> None:
        async with connected(url) as board:
            one, there = PinnedConnection(board), socket.board
            assert (await one.request(QueryServoListRequest())).servo_id_list
            assert (one.url, one.codec) == (board.url, board.codec)
            assert there is not None
            socket.pull()
            socket.plug(there)
            await until(board, "connected")
            for asked in (one.request(QueryServoListRequest()), one.write_project_id(3), one.clear_all_data()):
                with pytest.raises(ConnectionLost):
                    await asked

    run(main())
    assert socket.board is not None
    assert socket.board.storage.contents == OLD_CONTENTS
