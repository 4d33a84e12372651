"""The cable is pulled at each byte while `board.play` plays: no step is sent twice, and the error is clear."""

from __future__ import annotations

import asyncio

import pytest

from servolink import Action, Macro, MacroCommand, Project, Step, connect
from servolink.errors import ConnectionLost, OpenError, ServolinkError
from servolink.protocol import ExecuteActionRequest, FrameParser
from servolink.virtual import VirtualBoard
from tests.plugged import plugged
from tests.project.cable import URL, Cable
from tests.sampling import every, some
from tests.virtual_time import run

WAVE = Action(1, "Wave", (Step(1, 40, 20), Step(2, -40, 30)))
BACK = Action(2, "Back", (Step(1, -40, 20),))
DANCE = Macro(1, "Dance", (MacroCommand(1), MacroCommand(100, 1), MacroCommand(2, loop=2), MacroCommand(1, ratio=50)))
PROJECT = Project(actions=(WAVE, BACK), macros=(DANCE,))


class Tapped(Cable):
    """A cable that keeps what is sent through it."""

    wanted = b""
    """All that the host sent."""
    passed = b""
    """As much of it as reached the board."""

    async def send(self, data: bytes) -> None:
        self.wanted += data
        before = self.sent
        try:
            await super().send(data)
        finally:
            self.passed += data[: self.sent - before]


def movements(data: bytes) -> list[bytes]:
    """Return the movements in what was sent."""
    return [content for packet_id, content in FrameParser().feed(data) if packet_id == ExecuteActionRequest.packet_id]


async def play(cable: Tapped) -> ServolinkError | None:
    """Play the dance on a new connection; return what ended it early."""
    try:
        async with connect(cable) as board:
            await board.play(PROJECT, "Dance")
    except ServolinkError as error:
        return error
    return None


async def whole() -> Tapped:
    """Return the cable through which all of it was played."""
    cable = Tapped(VirtualBoard(3))
    assert await play(cable) is None
    return cable


@every(5)
@pytest.mark.parametrize("direction", ["sent", "received"])
def test_no_step_is_sent_twice_wherever_the_cable_is_pulled(direction: str, step: int) -> None:
    async def pulled(at: int) -> None:
        cable = Tapped(VirtualBoard(3), **{direction: at})
        error = await play(cable)
        asked, arrived = movements(cable.wanted), movements(cable.passed)
        if error is None:  # a handshake is not always as long
            assert asked == arrived == expected, f"at {at}"
            return
        assert isinstance(error, (ConnectionLost, OpenError)), f"at {at}: {error!r}"
        text = (
            f"macro 1 'Dance' was started, and the connection was lost before it was over: the connection to {URL} is"
        )
        assert str(error).startswith(text) == bool(asked), f"at {at}: {error}"
        assert asked == expected[: len(asked)], f"at {at}"
        assert arrived == asked[: len(arrived)], f"at {at}"
        assert len(asked) - len(arrived) <= 1, f"at {at}"

    cable = run(whole())
    expected = movements(cable.wanted)
    assert len(expected) == 4
    for at in some(1, getattr(cable, direction), step):
        run(pulled(at))


@every(11)
@pytest.mark.parametrize("direction", ["sent", "received"])
def test_a_board_that_comes_back_is_not_sent_the_rest(
    direction: str, step: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def pulled(at: int) -> None:
        virtual = VirtualBoard(3)
        cables = [Tapped(virtual, **{direction: at}), Tapped(virtual)]
        left = iter(cables)
        url = plugged(monkeypatch, lambda _: next(left))
        try:
            board = await connect(url, reconnect=True)
        except ServolinkError:
            return  # it was pulled before anything was played
        try:
            await board.play(PROJECT, "Dance")
        except ConnectionLost:
            async for state in board.states():
                if state == "connected":
                    break
            await asyncio.sleep(5)
            assert movements(cables[0].wanted) == expected[: len(movements(cables[0].wanted))], f"at {at}"
            assert not movements(cables[1].wanted), f"at {at}"
            assert await board.servo_ids() == (1, 2, 3)
        await board.close()

    cable = run(whole())
    expected = movements(cable.wanted)
    for at in some(1, getattr(cable, direction), step):
        run(pulled(at))
