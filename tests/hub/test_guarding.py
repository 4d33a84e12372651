"""The guard of a hub on a virtual board: stalls while servos are moved, and what all programs hear.

Module: servolink.hub.engine.guarding.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from msgspec.structs import replace

from servolink.boards import BoardNormals, BoardProfile, SafetyLimits
from servolink.client import connect
from servolink.hub import share
from servolink.protocol import Action, Macro, MacroCommand, Step
from servolink.virtual import BoardKind, SimulatedServo, VirtualBoard
from tests.client.sockets import Socket
from tests.hub.control_program import RpcFailed, RpcProgram, Shared, shared
from tests.hub.door_hub import until
from tests.plugged import plugged
from tests.virtual_time import run


@asynccontextmanager
async def guarded(profile: BoardProfile | None = None) -> AsyncIterator[tuple[Shared, RpcProgram]]:
    """Share a board with a guard, and a program; servo 1 has moved enough for its normal."""
    async with shared(profile=profile) as here, here.program("page") as page:
        here.interface.begin_guard(otherwise=True)
        for target in (30, -30, 30, 0):
            await page.call("move", targets={"1": target}, duration=1.0, wait=True)
        yield here, page


async def stopped(page: RpcProgram) -> float:
    """Return the seconds until the program hears of a stop."""
    loop = asyncio.get_running_loop()
    begun = loop.time()
    await page.until("stopped")
    return loop.time() - begun


def block(here: Shared, servo_id: int, most: float) -> SimulatedServo:
    servo = here.virtual.servos[servo_id]
    servo.reach = -180.0, most
    return servo


def test_a_stalled_servo_is_stopped_while_it_presses_and_named_to_all() -> None:
    async def main() -> None:
        async with guarded() as (here, page), here.program("other", role="watch") as other:
            other.tell("status")
            servo = block(here, 1, 20.0)
            await page.call("move", targets={"1": 60}, duration=1.0)
            assert await stopped(page) < 0.34 + 0.5, "20 of 60 degrees are reached after 0.33 s"
            told = (await other.until("problem"))["text"]
            assert told.startswith("the guard stops the board: servo 1 is stalled: for 0.")
            assert "has stood at 20 degrees" in told
            assert "behind its course to 60, and draws 900, normally at most 1" in told
            stop = page.of("stopped")[0]
            assert (stop["by"], stop["stalled"]) == (None, 1)
            assert stop["reason"].startswith("servo 1 is stalled")
            await here.hub.stop("the test")  # ends together with the stop of the guard
            assert [state.is_start for state in await here.states()] == [0, 0, 0]
            assert servo.angle == 20, "it holds where it was stopped"

    run(main())


def test_a_program_that_waits_gets_a_typed_error() -> None:
    async def main() -> None:
        async with guarded() as (here, page):
            block(here, 1, 20.0)
            with pytest.raises(RpcFailed, match="ended by the guard: servo 1 is stalled") as failed:
                await page.call("move", targets={"1": 60}, duration=1.0, wait=True)
            assert (failed.value.kind, failed.value.code) == ("ServoStalled", 308)

    run(main())


def test_what_is_normal_outlives_the_hub_unless_it_is_old_or_the_board_is_another_one(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))

    async def learn() -> None:
        async with guarded():
            await asyncio.sleep(5)

    async def says(servos: int = 3) -> str:
        """Return what the guard of a new hub says of its first motion, which stalls."""
        async with shared(servos) as here, here.program("page") as page:
            here.interface.begin_guard(otherwise=True)
            await asyncio.sleep(1)
            block(here, 1, 20.0)
            await page.call("move", targets={"1": 60}, duration=3.0)
            return str((await page.until("problem"))["text"])

    assert "its normal current is not known" in run(says())
    run(learn())
    kept = BoardNormals.load("rex")
    assert kept is not None
    assert kept.servos[1].seconds > 3
    assert abs(datetime.now(UTC) - kept.servos[1].learnt_at) < timedelta(minutes=1)
    assert "draws 900, normally at most 1" in run(says())
    kept = BoardNormals.load("rex")
    assert kept is not None
    assert "its normal current is not known" in run(says(servos=4))
    old = {
        each: replace(normal, learnt_at=normal.learnt_at - timedelta(days=31)) for each, normal in kept.servos.items()
    }
    BoardNormals(kept.identity, old).save("rex")
    assert "its normal current is not known" in run(says())


def test_what_is_normal_is_kept_every_five_minutes(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))

    async def main() -> None:
        async with guarded():
            await asyncio.sleep(10)
            assert BoardNormals.load("rex") is None
            await asyncio.sleep(300)
            assert BoardNormals.load("rex") is not None

    run(main())


def test_a_board_without_currents_is_stopped_by_lag_alone_later() -> None:
    async def main() -> None:
        async with guarded() as (here, page):
            block(here, 2, 20.0).has_sensor = False
            await page.call("move", targets={"2": 60}, duration=3.0)
            await page.until("stopped")
            assert "the lag alone says this" in page.of("problem")[0]["text"]

    run(main())


def test_a_macro_is_ended_too() -> None:
    async def main() -> None:
        async with guarded() as (here, page):
            board = here.hub.board
            await board.add_action(Action(1, "near", (Step(1, 0, 100),)))
            await board.add_action(Action(2, "far", (Step(1, 60, 100),)))
            await board.add_macro(Macro(1, "there and back", (MacroCommand(1), MacroCommand(2), MacroCommand(1))))
            block(here, 1, 20.0)
            begun = asyncio.get_running_loop().time()
            await page.call("run", type="macro", id=1)
            await page.until("stopped")
            assert asyncio.get_running_loop().time() - begun < 1.34 + 0.5, "the second action presses from 1.33 s on"

    run(main())


def test_a_person_who_turns_a_held_servo_is_no_stall() -> None:
    async def main() -> None:
        async with guarded() as (here, page):
            await asyncio.sleep(3)
            servo = block(here, 1, -20.0)
            assert servo.state().current == 900, "it is turned away from its target, and resists"
            await asyncio.sleep(60)
            assert not page.of("stopped")

    run(main())


def test_the_board_is_read_faster_only_while_something_moves() -> None:
    async def main() -> None:
        async with guarded() as (here, page):
            await asyncio.sleep(3)
            counts = []
            for seconds in (10, 2):
                before = here.hub.board.stats.frames_sent
                if seconds == 2:
                    await page.call("move", targets={"1": 60}, duration=3.0)
                await asyncio.sleep(seconds)
                counts.append(here.hub.board.stats.frames_sent - before)
            assert counts[0] in range(9, 12)
            assert counts[1] in range(60, 110)

    run(main())


async def test_a_board_that_is_lost_amid_a_stall_is_stopped_when_it_is_back(monkeypatch: pytest.MonkeyPatch) -> None:
    virtual = VirtualBoard()
    socket = Socket(virtual)
    url = plugged(monkeypatch, socket.transport)
    async with (
        connect(url, reconnect=True, angle_unit=None) as board,
        share(board, name="rex") as hub,
        Shared(hub, virtual).program("page") as page,
    ):
        await page.call("move", targets={"1": 60}, duration=60.0)
        socket.pull()
        assert (await page.until("connection"))["state"] == "lost"
        stopping = hub.stop_stalled(1, "servo 1 is stalled")
        assert "as soon as it is connected again" in (await page.until("problem"))["text"]
        socket.plug(virtual)
        await until(lambda: not virtual.servos[1].is_start)
        assert await stopping is None, "and nothing is eased off on it"


def test_neither_a_stop_nor_another_holder_of_the_lease_confuses_the_guard() -> None:
    async def main() -> None:
        async with guarded() as (here, page), here.program("other") as other:
            block(here, 1, 20.0)
            await page.call("move", targets={"1": 60}, duration=1.0)
            await asyncio.sleep(0.45)  # it presses, and is suspect
            await here.hub.stop("the test")
            await other.call("lease.take", force=True)
            await asyncio.sleep(5)
            assert not page.of("problem"), "a stopped servo is none that stalls"
            await other.call("move", targets={"1": 60}, duration=1.0, start=True)
            assert (await other.until("problem"))["text"].startswith("the guard stops the board: servo 1 is stalled")

    run(main())


@pytest.mark.parametrize(("profile", "otherwise"), [(None, True), (True, False), (False, True), (None, False)])
def test_the_profile_of_the_board_decides_first_whether_there_is_a_guard(
    *, profile: bool | None, otherwise: bool
) -> None:
    async def main() -> None:
        limits = SafetyLimits(guard=profile, temperature=200)
        async with shared(profile=BoardProfile(limits=limits)) as here, here.program("page") as page:
            await page.call("status")
            here.interface.begin_guard(otherwise=otherwise)
            await asyncio.sleep(5)
            told = {each["text"][:46] for each in page.of("problem")}
            guards = profile or (profile is None and otherwise)
            assert told == {f"the guard warns: servo {each}: temperature_raw is 2" for each in (1, 2, 3) if guards}

    run(main())


def test_a_line_that_is_too_slow_for_the_promise_is_told_once() -> None:
    async def main() -> None:
        async with shared(kind=BoardKind(turnaround=0.05)) as here, here.program("page") as page:
            here.interface.begin_guard(otherwise=True)
            await asyncio.sleep(5)
            for target in (60, 0):
                before = here.hub.board.stats.frames_sent
                await page.call("move", targets={"1": target}, duration=10.0)
                await asyncio.sleep(10)
                assert here.hub.board.stats.frames_sent - before in range(40, 56), "a quarter of 20 readings a second"
            [told] = page.of("problem")
            assert told["text"].startswith("a quarter of this line carries 5.0 readings")

    run(main())
