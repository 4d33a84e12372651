"""Easing off: a stalled servo turns back by 2 degrees, once, and only if nothing has happened since the stop.

Module: servolink.hub.engine.guarding.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager

import pytest
from msgspec.structs import replace

from servolink.boards import BoardProfile, BoardSettings, Evidence, SafetyLimits
from servolink.hub.rules.tried import HubVerdict, Uncertain
from servolink.protocol import ExecuteActionRequest, Packet
from tests.hub.control_program import RpcProgram, Shared
from tests.hub.test_forecast_gate import LocalTwin
from tests.hub.test_guarding import block, guarded
from tests.virtual_time import run

STAYS = BoardProfile(settings=BoardSettings(when_started="stays"), limits=SafetyLimits(ease_off=(1,)))


@asynccontextmanager
async def stalling(profile: BoardProfile = STAYS) -> AsyncIterator[tuple[Shared, RpcProgram, list[Packet]]]:
    """Share a board whose servo 1 is about to stall at 20 degrees, with the motions that are sent from now on."""
    sent = list[Packet]()
    async with guarded(profile) as (here, page):
        block(here, 1, 20.0)
        here.hub.follow_requests(lambda packet, outcome, *_: sent.append(packet) if outcome is True else None)
        yield here, page, sent


async def after_stall(here: Shared, page: RpcProgram) -> str:
    """Stall servo 1; return what the guard says of easing it off."""
    await page.call("move", targets={"1": 60}, duration=1.0)
    told = (await page.until("problem", 2))["text"]
    await here.hub.stop("the test")
    assert [state.is_start for state in await here.states()] == [0, 0, 0], "it is stopped whatever came of it"
    return str(told)


def moves(sent: list[Packet]) -> list[ExecuteActionRequest]:
    return [packet for packet in sent if isinstance(packet, ExecuteActionRequest)]


def test_a_stalled_servo_turns_back_by_two_degrees_and_is_stopped_again() -> None:
    async def main() -> None:
        async with stalling() as (here, page, sent):
            told = await after_stall(here, page)
            assert told == "the guard has eased servo 1 off from 20 to 18 degrees, and stops it again"
            assert here.angle(1) == pytest.approx(18, abs=0.2)
            assert [step.degree for packet in moves(sent) for step in packet.steps] == [60, 18]
            assert {each["stalled"] for each in page.of("stopped")[:2]} == {1}, "a page goes on marking the servo"
            assert here.hub.lease is None
            await page.call("move", targets={"1": 0}, duration=0.5, start=True, wait=True)
            assert here.angle(1) == 0, "the program may move again"

    run(main())


@pytest.mark.parametrize("profile", [None, BoardProfile(settings=BoardSettings(when_started="stays"))])
def test_nothing_is_eased_off_unless_the_profile_names_the_servo(profile: BoardProfile | None) -> None:
    async def main() -> None:
        async with stalling(profile or BoardProfile()) as (here, page, sent):
            await page.call("move", targets={"1": 60}, duration=1.0)
            await page.until("stopped")
            await here.hub.stop("the test")
            assert (len(moves(sent)), len(page.of("problem"))) == (1, 1)

    run(main())


@pytest.mark.parametrize(
    "profile",
    [
        replace(STAYS, settings=BoardSettings(when_started="turns")),
        replace(STAYS, settings=BoardSettings()),
        replace(STAYS, evidence={"when_started": Evidence("likely", "none turned")}),
    ],
)
def test_a_board_that_may_turn_a_started_servo_to_its_old_target_eases_nothing_off(profile: BoardProfile) -> None:
    async def main() -> None:
        async with stalling(profile) as (here, page, sent):
            assert "is not certain that a started servo stays" in await after_stall(here, page)
            assert (here.virtual.servos[1].angle, len(moves(sent))) == (20, 1)

    run(main())


def test_a_stop_of_a_person_after_that_of_the_guard_keeps_the_servo_where_it_is() -> None:
    async def main() -> None:
        async with stalling() as (here, page, sent), here.program("person", "watch") as person:
            await page.call("move", targets={"1": 60}, duration=1.0)
            await page.until("stopped")
            person.tell("stop")
            await asyncio.sleep(5)
            assert (here.virtual.servos[1].angle, len(moves(sent)), len(page.of("problem"))) == (20, 1, 1)

    run(main())


def test_a_stop_while_the_twin_is_asked_refuses_the_easing() -> None:
    async def main() -> None:
        async with stalling() as (here, page, sent):

            class SlowTwin(LocalTwin):
                async def check_move(
                    self, pose: Mapping[int, float], targets: Mapping[int, float], seconds: float
                ) -> HubVerdict:
                    if targets == {1: 18}:
                        await here.hub.stop("a person")
                    return HubVerdict("stands", "")

            gate = here.hub.begin_forecast(SlowTwin())
            await page.call("move", targets={"1": 60}, duration=1.0)
            told = (await page.until("problem", 2))["text"]
            assert told == "the guard does not ease servo 1 off: nothing was moved: a stop came first"
            assert (here.virtual.servos[1].angle, len(moves(sent))) == (20, 1)
            await gate.close()

    run(main())


def test_a_stop_amid_the_easing_ends_it_and_nothing_is_repeated() -> None:
    async def main() -> None:
        async with stalling() as (here, page, sent):
            await page.call("move", targets={"1": 60}, duration=1.0)
            while len(moves(sent)) < 2:
                await asyncio.sleep(0.02)
            await here.hub.stop("the test")
            await page.until("problem", 2)
            angle = here.angle(1)
            assert 18 < angle <= 20
            await page.call("servos.list")
            assert (here.angle(1), len(moves(sent))) == (angle, 2)

    run(main())


def test_another_program_with_exclusive_use_refuses_the_easing() -> None:
    async def main() -> None:
        async with stalling() as (here, page, sent), here.program("writer") as writer:
            await page.call("move", targets={"1": 60}, duration=1.0)
            await page.until("stopped")
            writer.tell("board.hold", reason="writing a project")
            told = (await page.until("problem", 2))["text"]
            assert told.startswith("the guard does not ease servo 1 off: ")
            assert "writer has exclusive use of the board" in told
            assert len(moves(sent)) == 1

    run(main())


@pytest.mark.parametrize("uncertain", ["ask", "pass", "refuse"])
@pytest.mark.parametrize("verdict", ["stands", "uncertain", "falls"])
def test_with_a_forecast_the_twin_must_stand_and_nobody_is_asked(uncertain: Uncertain, verdict: str) -> None:
    async def main() -> None:
        twin = LocalTwin()
        twin.says = HubVerdict("stands", "")
        async with stalling() as (here, page, sent):
            gate = here.hub.begin_forecast(twin, uncertain)
            await page.call("question.show")
            await page.call("move", targets={"1": 60}, duration=1.0)
            twin.says = HubVerdict(verdict, "the leg carries the body")
            told = (await page.until("problem", 2))["text"]
            assert here.angle(1) == pytest.approx(18 if verdict == "stands" else 20, abs=0.2)
            assert len(moves(sent)) == (2 if verdict == "stands" else 1)
            assert ("the leg carries the body" in told) == (verdict != "stands")
            assert not page.of("question")
            await gate.close()

    run(main())
