"""A program with its tests, which need no board: run it with `pytest test_wave.py`."""

from servolink import Board, ConnectionLost
from servolink.protocol import ExecuteActionRequest
from servolink.testing import FakeBoard, run


async def wave(board: Board, times: int = 3) -> None:
    """Lift the arm, servo 1, and wave with the hand, servo 2."""
    await board.move({1: 80}, duration=1, wait=True)
    for _ in range(times):
        await board.move({2: 30}, duration=0.5, wait=True)
        await board.move({2: -30}, duration=0.5, wait=True)
    await board.move({1: 0, 2: 0}, duration=1, wait=True)


def test_the_arm_is_down_after_waving() -> None:
    """The fake board lives in virtual time: five seconds are over at once."""

    async def main() -> None:
        fake = FakeBoard(servos=2)
        async with fake.connect() as board:
            await wave(board)
            assert [servo.angle for servo in await board.servos()] == [0, 0]
        assert len(fake.received(ExecuteActionRequest)) == 8

    run(main())


def test_a_cable_that_is_pulled_ends_the_waving() -> None:
    """Faults come where the test plans them."""

    async def main() -> None:
        fake = FakeBoard(servos=2)
        async with fake.connect() as board:
            fake.lose_connection(ExecuteActionRequest)
            try:
                await wave(board)
            except ConnectionLost:
                return
            raise AssertionError("the program has noticed nothing")

    run(main())
