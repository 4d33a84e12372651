"""Every way to a board opens the same odd boards: connect, doctor, learning, a hub, and a program that spy listens to.

Modules: servolink.connection.opening, servolink.doctor.contact.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import pytest

from servolink.boards import ProfileFile
from servolink.client import connect
from servolink.doctor import Relay
from servolink.errors import OpenError
from servolink.hub import share
from servolink.protocol import Codec
from servolink.transports import BaseTransport, StreamTransport
from servolink.virtual import BoardTransport
from tests.hub.local_transport import LocalTransport
from tests.lab.odd.board import OddBoard
from tests.lab.zoo.table import TABLE
from tests.lab.zoo.trials import MakeZoo
from tests.sampling import sampled

ALWAYS = {"big-old", "old-at-opening", "twice", "padded", "no-project-id", "servos-only", "resetting", "loop-back"}
"""Kinds that are tried in every run, beside others."""
BY_CHANCE = {"text-bridge"}
"""Kinds that are opened, or not, by the bytes that happen to be damaged."""


class Port(BoardTransport[OddBoard]):
    """Port of a board as a relay needs it."""

    on_accepted: Callable[[], object] | None = None

    def pass_on(self, data: bytes) -> bool:
        self._send(data)
        return True

    def pause_reading(self) -> None:
        """Do nothing: a board in the same process does not wait."""

    resume_reading = pause_reading


class Spied(BaseTransport):
    """Transport of a program to the relay of a spy."""

    def __init__(self, relay: Relay) -> None:
        super().__init__("pty:///spied")
        self._relay = relay

    async def _open(self) -> None:
        self._relay.join(self._deliver)

    def _send(self, data: bytes) -> None:
        self._relay.receive(data)

    async def _close(self) -> None:
        self._relay.leave()

    def _abort(self) -> None:
        self._relay.leave()


async def _is_opened(*arguments: object, **options: Any) -> bool:
    try:
        async with connect(*arguments, **options):  # type: ignore[arg-type]
            return True
    except OpenError:
        return False


async def by_hub() -> bool:
    try:
        async with connect("rex", reconnect=True, angle_unit=None) as upstream, share(upstream, name="rex") as hub:
            return await _is_opened(LocalTransport(hub, codec=Codec()), patience=10)
    except OpenError:
        return False


async def by_spy(board: OddBoard) -> bool:
    for _ in range(2):  # the first opening resets some boards
        relay = Relay(cast("StreamTransport", Port(board)), lambda *heard: None, bool)
        await relay.open()
        is_opened = await _is_opened(Spied(relay), profile=ProfileFile("rex").load())
        await relay.close()
        if is_opened:
            return True
    return False


@pytest.mark.parametrize("kind", sampled([kind for kind in TABLE if kind not in BY_CHANCE], 3, ALWAYS))
def test_what_one_of_the_ways_opens_all_open(kind: str, zoo: MakeZoo) -> None:
    board, row = zoo(kind), TABLE[kind]
    learnt = board.learn()
    ways = {
        # A board that is opened and then not measured, as during a pause, is refused with that reason.
        "learn": learnt.code == 0 or (isinstance(row.learnt, str) and not row.refused and row.learnt in learnt.err),
        "connect": board.clock.run(_is_opened("rex")),
        "hub": board.clock.run(by_hub()),
        "spy": board.clock.run(by_spy(board.board)),
        "doctor": board("--json", "doctor", "rex").json["response"] is not None,
    }
    assert len({*ways.values()}) == 1, ways
