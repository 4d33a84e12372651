"""A query that the board does not know keeps the other programs of a hub waiting for a moment only."""

from __future__ import annotations

import asyncio

import pytest

from servolink.hub.hub import Hub
from servolink.protocol import Packet, QueryActionRequest, QueryMacroRequest, QueryServoListRequest
from tests.client.piped_board import LOST, PipedBoard, now
from tests.hub.fake_board_hub import on_hub
from tests.hub.raw_program import RawProgram

LIST = QueryServoListRequest()


async def longest_wait(program: RawProgram, packet: Packet, until: asyncio.Task[Packet | None]) -> float:
    """Ask one query after the other; return how long the longest one took."""
    longest = 0.0
    while not until.done():
        begun = now()
        assert await program.ask(packet) is not None
        longest = max(longest, now() - begun)
        await asyncio.sleep(0.03)
    return longest


@pytest.mark.parametrize("unknown", [1, 3])
def test_other_programs_are_answered_meanwhile(unknown: int) -> None:
    async def use(hub: Hub, board: PipedBoard) -> None:
        board.usual_of[QueryActionRequest] = board.usual_of[QueryMacroRequest] = LOST
        programs = [RawProgram(hub) for _ in range(unknown)]
        other = RawProgram(hub, "another program")
        assert await other.ask(LIST) is not None
        asking = [
            asyncio.create_task(each.ask(QueryActionRequest(at), 5.0 * unknown)) for at, each in enumerate(programs)
        ]
        await asyncio.sleep(0)
        assert await longest_wait(other, LIST, asking[-1]) < unknown
        assert await asyncio.gather(*asking) == [None] * unknown
        begun = now()
        assert await other.ask(LIST) is not None
        assert now() < begun + 0.1

    on_hub(use)
