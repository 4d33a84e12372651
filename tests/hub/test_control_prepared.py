"""Runs that are prepared first, and started when their moment has come.

Module: servolink.hub.methods.motion_methods.
"""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from servolink.protocol import Action, Macro, MacroCommand, Step
from servolink.virtual import BoardKind
from tests.hub.control_program import RpcFailed, RpcProgram, Shared, shared

BOW = Action(1, "Bow", (Step(1, 60, 50),))
WAVE = Macro(1, "Wave", (MacroCommand(1, total_interval=50),))
ALONE = Macro(2, "Alone", (MacroCommand(9, total_interval=50),))


@pytest.fixture(autouse=True)
def _backups_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))


async def stored(here: Shared) -> None:
    await here.hub.board.add_action(BOW)
    await here.hub.board.add_macro(WAVE)


async def angle(here: Shared) -> int:
    return round((await here.states())[0].angle / 10) * 10  # it is read with some noise


async def refusal(program: RpcProgram, method: str, **params: Any) -> str:
    with pytest.raises(RpcFailed) as failed:
        await program.call(method, **params)
    return str(failed.value)


@pytest.mark.parametrize(
    ("kind", "name", "seconds"), [("action", "Bow", 0.5), ("macro", "Wave", None), ("macro", 1, None)]
)
async def test_a_prepared_run_is_started_once(kind: str, name: int | str, seconds: float | None) -> None:
    async with shared() as here, here.program() as studio:
        await stored(here)
        assert await studio.call("run.prepare", type=kind, id=name) == {"seconds": seconds}
        assert here.hub.lease is not None
        await asyncio.sleep(1)
        assert await angle(here) == 0, "nothing moves before the start"
        now = asyncio.get_running_loop().time()
        assert await studio.call("run.start") == {"monotonic": now}
        await asyncio.sleep(1)
        assert await angle(here) == 60
        assert "nothing is prepared" in await refusal(studio, "run.start")


async def test_a_prepared_run_begins_at_the_moment_that_was_said_unless_a_stop_comes_first() -> None:
    async with shared() as here, here.program() as studio, here.program("tablet") as tablet:
        await stored(here)
        clock = asyncio.get_running_loop().time
        await studio.call("run.prepare", type="action", id=1)
        at = clock() + 0.25
        assert await studio.call("run.start", at=at) == {"monotonic": at}
        await studio.call("run.prepare", type="action", id=1)
        over = clock()
        assert await studio.call("run.start", at=over - 5) == {"monotonic": over}
        await studio.call("stop")
        await here.hub.board.set_servo("all", start=True, hold=True)
        await studio.call("run.prepare", type="action", id=1)
        assert "at most 1 s ahead, not 2 s" in await refusal(studio, "run.start", at=clock() + 2)
        at = clock() + 0.25
        late = asyncio.create_task(refusal(studio, "run.start", at=at))
        await asyncio.sleep(0.22)  # when other requests wait already
        await tablet.call("stop")
        assert clock() < at
        assert "the board was stopped since this was prepared" in await late


async def test_a_start_does_not_wait_for_responses_that_other_programs_have_asked_for() -> None:
    async with (
        shared(kind=BoardKind(turnaround=0.03)) as here,
        here.program() as studio,
        here.program("tablet") as tablet,
    ):
        await stored(here)

        async def read() -> None:
            while True:
                await tablet.call("servos.list")

        async with asyncio.TaskGroup() as group:
            reading = group.create_task(read())
            await studio.call("run.prepare", type="action", id=1)
            at = asyncio.get_running_loop().time() + 0.25
            assert await studio.call("run.start", at=at) == {"monotonic": pytest.approx(at)}
            received = here.virtual.work.received
            here.virtual.advance(at + 0.499)
            moving = [here.virtual.servos[1].moving]
            here.virtual.advance(at + 0.501)
            moving.append(here.virtual.servos[1].moving)
            assert moving == [True, False], "it began at the moment"
            await asyncio.sleep(1)
            assert here.virtual.work.received > received + 20, "and the others read again"
            reading.cancel()


@pytest.mark.parametrize("kind", ["action", "macro"])
async def test_a_start_asks_the_board_for_nothing_and_keeps_the_lease_until_the_end(kind: str) -> None:
    async with shared() as here, here.program() as studio:
        await stored(here)
        await studio.call("run.prepare", type=kind, id=1)
        sent = here.hub.board.stats.frames_sent
        await studio.call("run.start")
        await asyncio.sleep(0.4)  # of 0.5
        assert here.hub.board.stats.frames_sent == sent + 1
        assert here.hub.lease is not None
        await asyncio.sleep(60)
        assert here.hub.lease is None


async def test_what_a_macro_runs_must_be_there_before_it_is_started() -> None:
    async with shared() as here, here.program() as studio:
        await here.hub.board.add_macro(ALONE)
        text = "macro 2 'Alone' was not run: macro 2 'Alone' runs action 9, which could not be read"
        assert await refusal(studio, "run.prepare", type="macro", id="Alone") == text
        assert await refusal(studio, "run", type="macro", id=2, dry_run=True) == text
        assert here.hub.lease is None
        assert "nothing is prepared" in await refusal(studio, "run.start")


async def test_a_start_is_refused_after_a_stop_and_while_somebody_else_moves_the_board() -> None:
    async with shared() as here, here.program() as studio, here.program("tablet") as tablet:
        await stored(here)
        await studio.call("run.prepare", type="action", id=1)
        await tablet.call("stop")
        assert "the board was stopped since this was prepared" in await refusal(studio, "run.start")
        await here.hub.board.set_servo("all", start=True, hold=True)
        await studio.call("run.prepare", type="action", id=1)
        await tablet.call("lease.take", force=True)
        assert "are moved by tablet" in await refusal(studio, "run.start")
        await tablet.call("lease.give")
        await studio.call("run.prepare", type="action", id=1)
        await tablet.call("board.hold", reason="an import")
        assert "has taken exclusive use of the board" in await refusal(studio, "run.start")
        await tablet.call("board.release")
        await studio.call("run.prepare", type="action", id=1)
        await studio.call("lease.give")
        assert "nothing is prepared" in await refusal(studio, "run.start")
        await asyncio.sleep(1)
        assert await angle(here) == 0


async def test_limits_are_compared_again_at_the_start() -> None:
    async with shared() as here, here.program() as studio:
        await stored(here)
        await studio.call("limits.tighten", angles={"1": (-90, 90)}, speed_cap=200.0)
        await studio.call("run.prepare", type="macro", id=1)
        await here.hub.board.delete_action(1)
        await here.hub.board.add_action(Action(1, "Bow", (Step(1, 120, 50),)))
        assert "120 degrees; its limits are -90..90" in await refusal(studio, "run.start")
        assert "120 degrees" in await refusal(studio, "run.prepare", type="macro", id=1)
