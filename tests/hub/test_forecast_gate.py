"""The forecast gate of a hub: what falls or hits itself is refused, a person lets it pass once, a stop is never gated.

Modules: servolink.hub.engine.forecast_gate, servolink.hub.rules.tried.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncGenerator, AsyncIterator, Mapping
from contextlib import asynccontextmanager

import msgspec
import pytest

from servolink.client import connect
from servolink.control import ErrorObject
from servolink.errors import MotionRefused, Reason
from servolink.hub.engine import forecast_gate
from servolink.hub.engine.hub_gates import ForecastRefused
from servolink.hub.rules.tried import HubVerdict, TwinVerdict, Uncertain
from servolink.motion import Ticket
from servolink.project import Project
from servolink.protocol import Action, Macro, MacroCommand, Packet, Step
from servolink.twin import check_move, check_record
from tests.hub.control_program import RpcFailed, RpcProgram, Shared, shared
from tests.hub.door_hub import sharing
from tests.twin.figures import template
from tests.virtual_time import run

FIGURE = json.dumps(template("humanoid-16").checked().to_json()).encode()
FALLS, STANDS = 8, 1  # servos of a thigh and of a shoulder


class LocalTwin:
    """The checks of the twin, without a process of their own."""

    def __init__(self) -> None:
        self.moves: list[Mapping[int, float]] = []
        self.records = 0
        self.seconds = 0.0
        self.says: HubVerdict | None = None

    async def check_move(self, pose: Mapping[int, float], targets: Mapping[int, float], seconds: float) -> TwinVerdict:
        if targets:
            self.moves.append(targets)
        return self.says or next(check_move(FIGURE, pose, targets, seconds))

    async def check_record(
        self, project: Project, record: Action | Macro, pose: Mapping[int, float]
    ) -> AsyncGenerator[TwinVerdict | bool, None]:
        self.records += 1
        for piece in [self.says] if self.says else check_record(FIGURE, project, record, pose):
            yield piece

    async def close(self) -> None:
        pass


@asynccontextmanager
async def forecast(uncertain: Uncertain = "ask") -> AsyncIterator[tuple[Shared, LocalTwin, RpcProgram, RpcProgram]]:
    """Share a board of a humanoid with a forecast, with a program and a page that shows questions."""
    twin = LocalTwin()
    async with shared(16) as here:
        await here.hub.board.add_action(Action(1, "Fall", (Step(FALLS, 60, 100),)))
        await here.hub.board.add_action(Action(2, "Wave", (Step(STANDS, 20, 50),)))
        await here.hub.board.add_macro(Macro(1, "Down", (MacroCommand(1),)))
        await here.hub.board.add_macro(Macro(2, "Hello", (MacroCommand(2),)))
        for servo in here.virtual.servos.values():
            servo.angle = 0.0
        gate = here.hub.begin_forecast(twin, uncertain)
        async with here.program("program", "edit") as program, here.program("page", "edit") as page:
            yield here, twin, program, page
        await gate.close()


def test_a_movement_with_which_the_robot_falls_is_refused_with_moment_and_servo() -> None:
    async def main() -> None:
        async with forecast() as (here, _, program, _):
            with pytest.raises(RpcFailed, match=r"on the twin: the robot falls after \d\.\d s; servo 8") as failed:
                await program.call("move", targets={str(FALLS): 60}, duration=1.0)
            assert (failed.value.kind, failed.value.code) == ("MotionRefused", 202)
            assert "(weight assumed, strength assumed, speed assumed, lag assumed)" in str(failed.value)
            assert here.angle(FALLS) == 0
            await program.call("move", targets={str(STANDS): 20}, duration=0.5, wait=True)
            assert here.angle(STANDS) == 20

    run(main())


def test_a_macro_is_tried_once_for_a_pose_and_again_when_it_was_changed_or_the_pose_is_another() -> None:
    async def main() -> None:
        async with forecast() as (here, twin, program, _):
            with pytest.raises(RpcFailed, match=r"falls after 1\.. s \(after the end\); servo 8"):
                await program.call("run", type="macro", id=1)
            assert (here.angle(FALLS), twin.records) == (0, 1)
            with pytest.raises(RpcFailed, match="on the twin"):
                await program.call("run", type="macro", id=1)
            assert twin.records == 1, "the verdict is known"
            for _ in range(2):
                await program.call("run", type="macro", id=2)
            assert twin.records == 2
            await program.call("move", targets={str(STANDS): 0}, duration=0.5, wait=True)
            await program.call("run", type="action", id=2)
            assert twin.records == 3, "another record"
            await program.call("move", targets={str(STANDS): -20}, duration=0.5, wait=True)
            await program.call("run", type="action", id=2)
            assert twin.records == 4, "another pose"
            await program.call("records.delete", type="macro", id=1)
            await program.call("run", type="action", id=2)
            assert twin.records == 5, "the content was changed"

    run(main())


@pytest.mark.parametrize("at_page", [False, True], ids=["program", "page"])
def test_a_person_lets_a_refused_motion_pass_once(at_page: bool) -> None:
    async def main() -> None:
        async with forecast() as (here, _, program, page):
            await page.call("question.show")
            mover, move = page if at_page else program, {"targets": {str(FALLS): 60}, "duration": 1.0}
            with pytest.raises(RpcFailed, match="asks a person"):
                await mover.call("move", **move)
            asked = await page.until("question")
            assert asked["targets"] == {str(FALLS): 60.0}
            assert asked["warning"].startswith("the robot falls after")
            if not at_page:
                with pytest.raises(RpcFailed):
                    await program.call("question.answer", number=asked["number"], is_yes=True)
            await page.call("question.answer", number=asked["number"], is_yes=True)
            await page.until("question.over")
            await mover.call("move", **move, wait=True)
            assert here.angle(FALLS) == 60
            with pytest.raises(RpcFailed, match="uncertain: the twin does not stand where the robot is now"):
                await mover.call("move", targets={str(FALLS): 0}, duration=0.1)

    run(main())


def test_a_stop_voids_the_yes_of_a_person_and_a_no_lets_nothing_pass() -> None:
    async def main() -> None:
        async with forecast() as (here, _, program, page):
            await page.call("question.show")
            for answer in (True, False):
                with pytest.raises(RpcFailed, match="asks a person"):
                    await program.call("run", type="macro", id=1)
                number = len(page.of("question"))
                asked = await page.until("question", number)
                await page.call("question.answer", number=asked["number"], is_yes=answer)
                await page.until("question.over", number)
                if answer:
                    await page.call("stop")
            with pytest.raises(RpcFailed, match="on the twin"):
                await program.call("run", type="macro", id=1)
            assert here.angle(FALLS) == 0

    run(main())


@pytest.mark.parametrize("choice", ["refuse", "ask", "pass"])
def test_an_uncertain_motion_is_refused_asked_about_or_let_pass(choice: Uncertain) -> None:
    async def main() -> None:
        async with forecast(choice) as (here, twin, program, page):
            await page.call("question.show")
            twin.says = HubVerdict("uncertain", "nobody knows")
            move = program.begin("move", targets={"2": 10}, duration=0.2, wait=True)
            if choice == "pass":
                await move
                assert here.angle(2) == 10
                return
            with pytest.raises(RpcFailed, match="the forecast is uncertain: nobody knows") as failed:
                await move
            assert ("asks a person" in str(failed.value)) == (choice == "ask") == bool(page.of("question"))
            assert here.angle(2) == 0

    run(main())


def test_stop_release_and_start_are_never_tried() -> None:
    async def main() -> None:
        async with forecast("refuse") as (here, twin, program, _):
            twin.says = HubVerdict("falls", "always")
            await program.call("stop")
            assert [state.is_start for state in await here.states()] == [0] * 16
            await program.call("servo.set", servo=3, start=True, hold=True)
            await program.call("release", servo=3)
            assert twin.moves == []

    run(main())


def test_a_stream_is_tried_at_its_start_and_where_it_leaves_what_was_tried() -> None:
    async def main() -> None:
        async with forecast() as (_, twin, program, _):
            stream = (await program.call("stream.begin", hz=20))["stream"]
            for angle in (0, 3, 6, 9):
                await program.call("stream.send", stream=stream, targets={str(STANDS): angle})
            assert len(twin.moves) == 1
            await program.call("stream.send", stream=stream, targets={str(STANDS): 15})
            assert len(twin.moves) == 2
            with pytest.raises(RpcFailed, match="on the twin"):
                await program.call("stream.send", stream=stream, targets={str(FALLS): 60})

    run(main())


def test_a_prepared_run_is_tried_before_its_moment() -> None:
    async def main() -> None:
        async with forecast() as (_, twin, program, _):
            await program.call("run.prepare", type="macro", id=2)
            assert twin.records == 1
            await program.call("run.start")
            assert twin.records == 1

    run(main())


def test_a_client_of_the_hub_gets_the_refusal_of_a_frame_as_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(forecast_gate, "LONGEST", 60.0)  # in real time, and physics in the event loop

    async def main() -> None:
        async with (
            forecast() as (here, _, _, page),
            sharing(here.hub, here.interface.open_channel) as url,
            connect(url) as board,
        ):
            await page.call("question.show")
            with pytest.raises(MotionRefused, match="on the twin: the robot falls") as refused:
                await board.move({FALLS: 60}, duration=1.0)
            assert refused.value.reason is Reason.FORECAST
            asked = await page.until("question")
            await page.call("question.answer", number=asked["number"], is_yes=True)
            await page.until("question.over")
            await board.move({FALLS: 60}, duration=1.0)
            await board.stop()

    asyncio.run(main())


def test_a_client_gets_the_reason_why_a_macro_that_was_uncertain_is_refused_when_it_is_sent() -> None:
    async def main() -> None:
        async with (
            forecast("pass") as (here, twin, _, _),
            sharing(here.hub, here.interface.open_channel) as url,
            connect(url) as board,
        ):
            twin.says = HubVerdict("uncertain", "nobody knows")

            await board.run_macro(2)

            async def know(packet: Packet, ticket: Ticket) -> None:
                """Be the trial that ends between the check of the client and the sending."""
                if packet.is_motion:
                    twin.says = HubVerdict("falls", "the robot falls after 1.0 s")
                    assert here.hub.forecast is not None
                    here.hub.forecast.forget(records=True)

            board.connection.preparations += (know,)
            with pytest.raises(MotionRefused, match="on the twin: the robot falls after 1") as refused:
                await board.run_macro(2)
            assert refused.value.reason is Reason.FORECAST
            await board.stop()

    asyncio.run(main())


async def test_what_is_checked_must_be_one_frame() -> None:
    async with shared() as here, here.program() as program:
        with pytest.raises(RpcFailed, match="one whole frame"):
            await program.call("motion.check", frame="ffff")


def test_programs_read_what_a_refusal_rests_on() -> None:
    basis = {"weight": "written", "strength": "assumed", "speed": "measured", "lag": "measured"}
    assert ErrorObject.of(ForecastRefused("nothing was moved", basis)).data.basis == basis
    assert b"basis" not in msgspec.json.encode(ErrorObject.of(ForecastRefused("nothing was moved")))
