"""Lines on which responses come more often than they were asked for: late copies, and several boards.

Module: servolink.connection.repeats.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress
from random import Random
from typing import ClassVar

import pytest

from servolink.client import Board, connect
from servolink.errors import OpenError, OutcomeUnknown, Reason, RequestRefused, RequestTimeout, ServolinkError
from servolink.hub import share
from servolink.protocol import Codec, SetServoParameterRequest
from servolink.virtual import BOARDS
from tests.hub.local_transport import LocalTransport
from tests.lab.odd.board import OddBoard, OddLine
from tests.lab.odd.lines import CrowdedLine, Echoing, LateCopies, Twice, Twins
from tests.lab.odd.wire import Values
from tests.lab.zoo.trials import MakeZoo

SEVERAL = "two boards, or more, answer on this line"


class Sometimes(LateCopies, name="late-copies-3"):
    each = 3


class Soon(LateCopies, name="soon-copies"):
    copied_after = 0.2


class Later(LateCopies, name="later-copies"):
    copied_after = 3.0


class AtAnyTime(LateCopies, name="copies-at-any-time"):
    chance: ClassVar[Random] = Random(1)

    @property
    def copied_after(self) -> float:  # type: ignore[override]
        return self.chance.uniform(0.1, 3.0)


class Jittery(OddBoard, name="jittery"):
    """Responses in turn, each up to 150 ms after the previous one."""

    def __init__(self) -> None:
        super().__init__()
        self.chance = Random(5)

    def transmit(self, line: OddLine, data: bytes) -> None:
        line.send_in_turn(self.chance.uniform(0.0, 0.15), data)


class InAnyOrder(CrowdedLine, name="boards-in-any-order"):
    others = 2

    def __init__(self) -> None:
        self.chance = Random(2)
        super().__init__()

    @property
    def lag(self) -> float:  # type: ignore[override]
        return self.chance.choice((-0.0004, 0.0004, 0.002))


class Rarely(CrowdedLine, name="rarely-two"):
    """A second board that answers one request in five."""

    def __init__(self) -> None:
        super().__init__()
        self.chance = Random(4)

    def answers(self) -> list[OddBoard]:
        return super().answers() if self.chance.random() < 0.2 else []


class Joining(CrowdedLine, name="joining"):
    """A second board that is switched on later."""

    has_joined = False

    def answers(self) -> list[OddBoard]:
        return super().answers() if self.has_joined else []


class JoiningTwins(Twins, name="joining-twins"):
    """Boards switched on later, which differ in one angle."""

    has_joined = False

    def answers(self) -> list[OddBoard]:
        return super().answers() if self.has_joined else []


def put(kind: type[OddBoard]) -> OddBoard:
    board = kind()
    BOARDS["zoo"] = board
    return board


def angles_of(board: CrowdedLine) -> list[float]:
    """Return the angles to which all servos of the line are sent."""
    return [servo.degrees(board.now + 10) for each in (board, *board.twins) for servo in each.servos.values()]


def are_stopped(board: OddBoard) -> bool:
    boards = (board, *(board.twins if isinstance(board, CrowdedLine) else ()))
    return not any(servo.is_start for each in boards for servo in each.servos.values())


def _deaf(board: OddBoard) -> Callable[[int, Values], Values | None]:
    """Return the answers of a board that answers a stop and ignores it."""
    answer = board.answer
    return lambda packet_id, values: values if packet_id == 20030 else answer(packet_id, values)


# --- late copies --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("options", ["", "?late_copies=yes"])
@pytest.mark.parametrize(("pause", "seconds"), [(0.0, 5), pytest.param(0.0, 12, marks=pytest.mark.slow), (0.03, 12)])
@pytest.mark.parametrize("kind", [LateCopies, Sometimes, Soon, Later, AtAnyTime])
async def test_no_reading_of_a_servo_that_moves_is_wrong(
    kind: type[OddBoard], pause: float, seconds: float, options: str
) -> None:
    """Copies at any time: the first one can look like a response in time, unless the setting says that it comes."""
    seconds = 12 if kind is Later else seconds  # whose copies come after 3 s
    board = put(kind)
    async with connect(f"virtual://zoo{options}") as robot:
        readings, wrong = await _read_moving(robot, board, seconds, pause)
        assert robot.stats.late_copies > 2
        assert not robot.connection.repeats.several
    assert readings > 100
    assert wrong <= (kind is AtAnyTime and not options)


async def test_late_originals_are_no_copies() -> None:
    """Quick responses begin proofs, and late ones follow repeated queries."""
    board = put(Jittery)
    async with connect("virtual://zoo") as robot:
        readings, wrong = await _read_moving(robot, board, 60, 0.1)
        assert not robot.connection.repeats.several
    assert (wrong, readings > 250) == (0, True)


async def test_the_reading_that_ends_proofs_is_a_new_one() -> None:
    put(OddBoard)
    async with connect("virtual://zoo") as robot:
        await robot.move({1: 0}, duration=0.1)
        robot.connection.repeats.suspect()
        await robot.servo(1)
        await robot.move({1: 90}, duration=0.1)
        await asyncio.sleep(3)
        assert (await robot.servo(1)).angle == 90
        assert not robot.connection.repeats.is_proving


async def _read_moving(robot: Board, board: OddBoard, seconds: float, pause: float) -> tuple[int, int]:
    """Return how often servo 1 was read while it moved, and how often its angle was not one of that time."""
    loop, chance = asyncio.get_running_loop(), Random(3)
    readings = wrong = 0
    end, next_at, goal = loop.time() + seconds, 0.0, 120
    while loop.time() < end:
        if loop.time() >= next_at:
            await robot.move({1: goal}, duration=1.5)
            next_at, goal = loop.time() + chance.choice((0.7, 1.8)), -goal
        begun = loop.time()
        try:
            angle = float((await robot.servo(1)).angle)
        except RequestTimeout:
            continue
        readings += 1
        over = [begun + (loop.time() - begun) * share / 50 for share in range(51)]
        angles = [board.servos[1].degrees(now) for now in over]
        wrong += not min(angles) - 3 <= angle <= max(angles) + 3
        await asyncio.sleep(pause * (0.5 + chance.random()))
    return readings, wrong


async def test_copies_are_named_by_connect_and_counted(caplog: pytest.LogCaptureFixture) -> None:
    put(LateCopies)
    async with connect("virtual://zoo") as robot:
        await robot.servo(1)
        await asyncio.sleep(3)
        await robot.servo(1)
        await asyncio.sleep(2)
        assert robot.stats.late_copies >= 3
        assert robot.stats.reopenings == 1
    assert "late_copies=yes in the address" in caplog.text


@pytest.mark.parametrize("kind", [LateCopies, Soon, Later])
async def test_a_proved_reading_takes_twice_the_time(kind: type[OddBoard]) -> None:
    board, loop = put(kind), asyncio.get_running_loop()
    async with connect("virtual://zoo?late_copies=yes") as robot:
        await robot.servo(1)
        await asyncio.sleep(4)
        begun = loop.time()
        await robot.servo(1)
        assert loop.time() - begun <= 2.1 * board.delay


# --- several boards -----------------------------------------------------------------------------------------------

OPTIONS = ("", "?answers_twice=yes", "?late_copies=yes", "?answers_twice=yes&late_copies=yes")


@pytest.mark.parametrize("options", OPTIONS)
@pytest.mark.parametrize("kind", [CrowdedLine, Twins, InAnyOrder])
async def test_two_boards_are_refused_with_every_setting(kind: type[CrowdedLine], options: str) -> None:
    put(kind)
    with pytest.raises(OpenError, match=SEVERAL) as caught:
        await connect(f"virtual://zoo{options}")
    assert caught.value.reason is Reason.SEVERAL_BOARDS


@pytest.mark.parametrize("options", OPTIONS)
@pytest.mark.parametrize("kind", [CrowdedLine, Twins, InAnyOrder])
async def test_a_stop_is_written_to_two_boards_and_never_confirmed(kind: type[CrowdedLine], options: str) -> None:
    board = kind()
    BOARDS["zoo"] = board
    async with connect(f"virtual://zoo{options}", handshake=False) as robot:
        for _ in range(2):
            with pytest.raises(OutcomeUnknown, match=SEVERAL):
                await robot.stop()
            await asyncio.sleep(0.01)
            assert are_stopped(board)
            for servo in board.servos.values():
                servo.is_start = 1


@pytest.mark.parametrize("options", ["", "?answers_twice=yes"])
@pytest.mark.parametrize("kind", [Joining, JoiningTwins])
async def test_a_board_that_joins_later_closes_the_gate(
    kind: type[Joining | JoiningTwins], options: str, caplog: pytest.LogCaptureFixture
) -> None:
    board = kind()
    BOARDS["zoo"] = board
    async with connect(f"virtual://zoo{options}") as robot:
        await robot.servos()
        await robot.move({1: 20}, duration=0.1)
        await asyncio.sleep(1)
        board.has_joined = True
        before = angles_of(board)
        for _ in range(30):
            try:
                await robot.servos()
            except RequestRefused:
                break
            except ServolinkError:
                continue
            await asyncio.sleep(0.3)
        for motion in (lambda: robot.move({1: 50}, duration=1), lambda: robot.run_macro(1), robot.release):
            with pytest.raises(RequestRefused, match=SEVERAL) as caught:
                await motion()
            assert caught.value.reason is Reason.SEVERAL_BOARDS
        assert angles_of(board) == before
        with pytest.raises(OutcomeUnknown, match=SEVERAL):
            await robot.stop()
        await asyncio.sleep(0.01)
        assert are_stopped(board)
        with pytest.raises(OutcomeUnknown):
            await robot.request(SetServoParameterRequest(1, 0, 1))
    assert SEVERAL in caplog.text


@pytest.mark.parametrize("options", ["", "?answers_twice=yes", "?late_copies=yes"])
async def test_a_board_that_answers_rarely_closes_the_gate(options: str) -> None:
    board = Rarely()
    BOARDS["zoo"] = board
    before = angles_of(board)

    async def read() -> None:
        async with connect(f"virtual://zoo{options}") as robot:
            for _ in range(400):
                await robot.project_id()
                await robot.servos()

    with pytest.raises((OpenError, RequestRefused), match=SEVERAL):
        await read()
    assert angles_of(board) == before


async def test_a_hub_writes_a_stop_to_two_boards_and_says_that_it_is_not_known() -> None:
    board = Joining()
    BOARDS["zoo"] = board
    async with (
        connect("virtual://zoo", angle_unit=None) as upstream,
        share(upstream, name="zoo") as hub,
        connect(LocalTransport(hub, codec=Codec())) as program,
    ):
        await program.servos()
        board.has_joined = True
        await asyncio.sleep(0.1)
        with suppress(ServolinkError):
            for _ in range(20):
                await program.project_id()
        for stop in (program.stop, lambda: hub.stop("a test")):
            with pytest.raises(OutcomeUnknown, match="could not be confirmed"):
                await stop()
            await asyncio.sleep(0.01)
            assert are_stopped(board)
            for servo in board.servos.values():
                servo.is_start = 1
        before = angles_of(board)
        with pytest.raises(ServolinkError):
            await program.move({1: 50}, duration=1)
        assert angles_of(board) == before


@pytest.mark.parametrize("kind", ["two-boards", "twins"])
def test_the_shell_stops_two_boards_and_moves_none(kind: str, zoo: MakeZoo) -> None:
    trial = zoo(kind)
    board = trial.board
    assert isinstance(board, CrowdedLine)
    before = angles_of(board)
    for options in ("", "?answers_twice=yes", "?late_copies=yes"):
        assert trial("use", "rex", f"virtual://zoo{options}", "--yes").code == 0
        said = trial.on_board("move", "1=30")
        assert said.code
        assert SEVERAL in said.err
        assert angles_of(board) == before
        said = trial.on_board("stop")
        assert said.code
        assert SEVERAL in said.err
        assert "all" not in said.out
        assert are_stopped(board)
        for each in (board, *board.twins):
            for servo in each.servos.values():
                servo.is_start = 1
    assert SEVERAL in trial("doctor", "rex").out


# --- stops on other lines -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [LateCopies, Soon, AtAnyTime, Twice, Echoing])
@pytest.mark.parametrize("options", ["", "?late_copies=yes", "?answers_twice=yes"])
async def test_a_stop_is_written_and_confirmed_by_a_fresh_reading_only(
    kind: type[OddBoard], options: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The board ignores it: copies of earlier readings, when the servos were stopped, confirm nothing."""
    board = put(kind)
    async with connect(f"virtual://zoo{options}", handshake=False) as robot:
        try:
            await robot.stop()
        except ServolinkError as error:
            assert are_stopped(board)
            assert "answers_twice=yes" in str(error) or "could not be confirmed" in str(error)  # noqa: PT017
            return
        assert are_stopped(board)
        await robot.servos()
        await robot.set_servo(255, start=True, hold=True)
        monkeypatch.setattr(board, "answer", _deaf(board))
        with pytest.raises(OutcomeUnknown, match="may still move"):
            await robot.stop()
