"""A program on a hub's socket hears of stops on another connection than the one with its responses, perhaps later."""

from __future__ import annotations

from typing import Any, cast

import pytest

from servolink.client import connect
from servolink.errors import MotionRefused, Reason, Rejected, RequestRefused, RequestTimeout, ServolinkError
from servolink.hub.hub import Hub
from servolink.hub.methods.control_session import ControlInterface
from servolink.protocol import (
    ExecuteMacroRequest,
    ExecuteMacroResponse,
    Macro,
    Packet,
    SetServoParameterRequest,
    SetServoParameterResponse,
)
from servolink.virtual import VirtualBoard
from tests.client.piped_board import PipedBoard, lie, opened
from tests.hub.door_hub import on_hub, sharing


class LateHub:
    """Hub whose word of a stop comes behind the refusal."""

    def __init__(self, board: Any, *, tells: str) -> None:
        self._board = board
        self._tells = tells

    async def catch_up(self) -> None:
        if self._tells == "a stop":
            self._board.connection.stops.stop()
        elif not self._tells:
            raise RequestTimeout("the hub does not answer")

    def refusal_of(self, packet: Packet) -> None:
        """Nothing was refused for another reason."""

    async def close(self) -> None:
        """Nothing is open."""


@pytest.mark.parametrize("tells", ["a stop", "nothing of it", ""])
@pytest.mark.parametrize("motion", ["start", "macro"])
async def test_the_error_of_a_refused_motion_names_a_stop_that_is_heard_a_little_later(motion: str, tells: str) -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        await board.add_macro(Macro(1, "wave"))
        board.connection.hub = cast("Any", LateHub(board, tells=tells))
        fake.plan(SetServoParameterRequest, lie(SetServoParameterResponse(1, 0, 1)))
        fake.plan(ExecuteMacroRequest, lie(ExecuteMacroResponse(0)))
        with pytest.raises(RequestRefused if tells == "a stop" else Rejected) as refused:
            await (board.set_servo(1, start=True, hold=True) if motion == "start" else board.run_macro(1))
        assert (refused.value.reason is Reason.STOP) == (tells == "a stop")


def test_after_catching_up_a_program_has_heard_of_the_stop_and_the_lease_of_another_one() -> None:
    async def use(hub: Hub, virtual: VirtualBoard) -> None:
        interface = ControlInterface(hub)
        async with sharing(hub, interface.open_channel) as url, connect(url) as board, connect(url) as other:
            connection = board.connection
            assert connection.hub is not None
            ticket = connection.stops.ticket()
            await other.stop()
            await connection.hub.catch_up()
            assert not connection.stops.holds(ticket)
            await other.set_servo(1, start=True, hold=True)
            await connection.hub.catch_up()
            refusal: ServolinkError | None = connection.gates.lease(
                SetServoParameterRequest(1, 1, 1), connection.stops.ticket()
            )
            assert isinstance(refusal, MotionRefused)
        await interface.close()

    on_hub(use)
