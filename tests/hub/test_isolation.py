"""Programs with different angle units and subscriptions on one board, through a hub: nothing of one reaches another."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from contextlib import AsyncExitStack
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from servolink.client import connect
from servolink.hub.engine.unit_switch import UnitReservation
from servolink.hub.hub import Hub, share
from servolink.motion import AngleUnit, ServoUnits
from servolink.project import Project
from servolink.protocol import (
    ALL_SERVOS,
    Action,
    ButtonEventResponse,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    Macro,
    MacroCommand,
    Packet,
    QueryActionRequest,
    QueryServoRequest,
    QueryServoResponse,
    SendDummyDataRequest,
    SetAngleUnitRequest,
    SetAngleUnitResponse,
    Step,
    SubscribeButtonEventRequest,
    SubscribeButtonEventResponse,
    WriteProjectIDRequest,
)
from servolink.virtual import VirtualBoard, VirtualTransport, to_adc
from tests.client.piped_board import LOST, SWALLOWED, PipedBoard, now, opened
from tests.client.sockets import Socket
from tests.hub.raw_program import RawProgram
from tests.plugged import plugged
from tests.project.pulled import contents_of
from tests.proofs.fuzz.amounts import MANY
from tests.virtual_time import VirtualTimeLoop, run

SERVOS = (1, 2, 3)
LOW, HIGH = 0, 90
"""All programs stay between these angles. In ADC they are 2048..3072: no number is possible in both units."""
POSES = {
    "degree": Action(1, "degrees", tuple(Step(servo_id, 30, 10) for servo_id in SERVOS)),
    "adc": Action(2, "adc", tuple(Step(servo_id, to_adc(60), 10) for servo_id in SERVOS)),
}
DANCES = {
    "degree": Macro(1, "degrees", (MacroCommand(1), MacroCommand(700, 1), MacroCommand(1, loop=3))),
    "adc": Macro(2, "adc", (MacroCommand(2), MacroCommand(700, 1), MacroCommand(2, loop=3))),
}
STORED = Project(actions=tuple(POSES.values()), macros=tuple(DANCES.values()))

units = st.sampled_from(["degree", "adc"])
servo_ids = st.sampled_from([*SERVOS, ALL_SERVOS])


class Angler:
    """A program without the library, and the units that it believes in."""

    def __init__(self, hub: Hub, who: str, unit: AngleUnit) -> None:
        self.raw = RawProgram(hub, who, unit=unit)
        self.units: dict[int, AngleUnit] = dict.fromkeys(SERVOS, unit)
        self.answered = 0
        self._hub = hub
        self._tasks: asyncio.Queue[Coroutine[Any, Any, None]] = asyncio.Queue()
        self._worker = asyncio.create_task(self._work())

    def begin(self, doing: Coroutine[Any, Any, None]) -> None:
        """Do something when everything before it is done."""
        self._tasks.put_nowait(doing)

    async def until_done(self) -> None:
        await self._tasks.join()
        self._worker.cancel()
        await asyncio.gather(self._worker, return_exceptions=True)

    async def read(self, servo_id: int) -> None:
        response = await self.raw.ask(QueryServoRequest(servo_id), 1000)
        if response is None:
            return
        assert isinstance(response, QueryServoResponse)
        self.answered += 1
        for servo in response.servos:
            low, high = (LOW, HIGH) if self.units[servo.servo_id] == "degree" else (to_adc(LOW), to_adc(HIGH))
            assert low - 1 <= servo.angle <= high + 1, f"{self.raw.session.who} reads {servo} in {self.units}"

    async def set_unit(self, servo_id: int, unit: AngleUnit) -> None:
        request = SetAngleUnitRequest(servo_id, int(unit == "adc"))
        if await self.raw.ask(request, 1000) == SetAngleUnitResponse(servo_id, request.unit_type):
            self.units |= dict.fromkeys(SERVOS if servo_id == ALL_SERVOS else [servo_id], unit)

    async def move(self, degrees: int) -> None:
        angles = {one: degrees if unit == "degree" else to_adc(degrees) for one, unit in self.units.items()}
        self._take_lease()
        self.raw.send(ExecuteActionRequest(tuple(Step(one, angle, 20) for one, angle in angles.items())))

    async def run(self, *, macro: bool) -> None:
        """Run what is stored in its units, if all servos have the same."""
        if len(found := set(self.units.values())) == 1:
            unit = found.pop()
            self._take_lease()
            if macro:  # and wait: a program that sets other units meanwhile would spoil its own macro
                await self.raw.ask(ExecuteMacroRequest(DANCES[unit].macro_id), 1000)
                await asyncio.sleep(2)
            else:
                self.raw.send(ExecuteActionExRequest(POSES[unit].action_id))

    def _take_lease(self) -> None:
        self._hub.leases.take(self.raw.session.session_id, force=True)

    async def _work(self) -> None:
        while True:
            doing = await self._tasks.get()
            try:
                await doing
            finally:
                self._tasks.task_done()


class Units(RuleBasedStateMachine):
    """Two to four programs at once, on a line that loses requests and responses."""

    def __init__(self) -> None:
        super().__init__()
        self.runner = asyncio.Runner(loop_factory=VirtualTimeLoop)
        self.stack = AsyncExitStack()
        self.fake = PipedBoard(servos=len(SERVOS))
        self.programs: list[Angler] = []
        self.wrong: list[BaseException] = []

    @initialize(
        own=st.lists(units, min_size=2, max_size=4),
        depth=st.sampled_from([1, 4]),
        limits=st.sampled_from([None, (LOW, HIGH)]),
    )
    def join(self, own: list[AngleUnit], depth: int, limits: tuple[int, int] | None = None) -> None:
        async def main() -> None:
            self.fake.storage.contents = contents_of(STORED)
            for servo in self.fake.servos.values():
                servo.angle = float(LOW)
            board = await self.stack.enter_async_context(
                opened(self.fake, angle_unit=None, depth=depth, angle_limits=limits)
            )
            hub = await self.stack.enter_async_context(share(board, name="rex"))
            self.programs = [Angler(hub, f"program {number}", unit) for number, unit in enumerate(own)]

        self.runner.run(main())

    def begin(self, number: int, what: Callable[[Angler], Coroutine[Any, Any, None]]) -> None:
        program = self.programs[number % len(self.programs)]

        async def do() -> None:
            try:
                await what(program)
            except AssertionError as error:
                self.wrong.append(error)

        program.begin(do())

    numbers = st.integers(0, 3)

    @rule(number=numbers, servo_id=servo_ids)
    def read(self, number: int, servo_id: int) -> None:
        self.begin(number, lambda program: program.read(servo_id))

    @rule(reads=st.lists(st.tuples(numbers, servo_ids), min_size=2, max_size=12))
    def read_at_once(self, reads: list[tuple[int, int]]) -> None:
        for number, servo_id in reads:
            self.read(number, servo_id)

    @rule(number=numbers, servo_id=st.sampled_from([*SERVOS, 9, ALL_SERVOS]), unit=units)
    def set_unit(self, number: int, servo_id: int, unit: AngleUnit) -> None:
        self.begin(number, lambda program: program.set_unit(servo_id, unit))

    @rule(number=numbers, degrees=st.integers(LOW, HIGH))
    def move(self, number: int, degrees: int) -> None:
        self.begin(number, lambda program: program.move(degrees))

    @rule(number=numbers, macro=st.booleans())
    def run(self, number: int, *, macro: bool) -> None:
        self.begin(number, lambda program: program.run(macro=macro))

    @rule(
        kind=st.sampled_from([SetAngleUnitRequest, SetAngleUnitRequest, QueryServoRequest]),
        fates=st.lists(st.sampled_from([LOST, SWALLOWED]), min_size=1, max_size=40),
    )
    def lose(self, kind: type[Packet], fates: list[Any]) -> None:
        self.fake.plan(kind, *fates)

    @rule(seconds=st.sampled_from([0.001, 0.01, 0.1, 1.0, 5.0]))
    def wait(self, seconds: float) -> None:
        self.runner.run(asyncio.sleep(seconds))

    @invariant()
    def no_angle_is_in_a_wrong_unit(self) -> None:
        assert self.wrong == []
        self.fake.advance(self.runner.get_loop().time())
        angles = [servo.angle for servo in self.fake.servos.values()]
        assert all(LOW - 0.1 <= angle <= HIGH + 0.1 for angle in angles) or not self.programs, angles

    def teardown(self) -> None:
        async def end() -> None:
            for program in self.programs:
                await program.until_done()
            self.fake.forget_plans()
            await asyncio.sleep(10)  # what was sent without waiting is over: a motion keeps the units of its program
            for program in self.programs:  # everybody is served again, in the right units
                before = program.answered
                await program.read(ALL_SERVOS)
                assert program.answered == before + 1
            await self.stack.aclose()

        with self.runner:
            self.runner.run(end())
            self.no_angle_is_in_a_wrong_unit()


TestUnits = pytest.mark.virtual_only("the raw angles of the firmware are pulse widths")(Units.TestCase)
TestUnits.settings = settings(max_examples=15 * MANY, stateful_step_count=50, deadline=None)


class Events(RuleBasedStateMachine):
    """Programs subscribe, unsubscribe, come and go; who asked gets each button event once, and nobody else does."""

    def __init__(self) -> None:
        super().__init__()
        self.runner = asyncio.Runner(loop_factory=VirtualTimeLoop)
        self.stack = AsyncExitStack()
        self.virtual = VirtualBoard(1)
        self.raw: dict[str, RawProgram] = {}
        self.expected: dict[str, list[Packet]] = {}
        self.subscribed: set[str] = set()
        self.runner.run(self.open())

    async def open(self) -> None:
        board = await self.stack.enter_async_context(connect(VirtualTransport(self.virtual), angle_unit=None))
        self.hub = await self.stack.enter_async_context(share(board, name="rex"))

    def program(self, who: str) -> RawProgram:
        """Return the program of this name, which joins if it is not there."""

        async def join() -> RawProgram:
            return RawProgram(self.hub, who)

        if who not in self.raw:
            self.raw[who], self.expected[who] = self.runner.run(join()), []
        return self.raw[who]

    names = st.sampled_from(["ann", "bob", "cid", "dot"])

    @rule(requests=st.lists(st.tuples(names, st.booleans()), min_size=1, max_size=4))
    def change(self, requests: list[tuple[str, bool]]) -> None:
        """Send several requests at once."""
        for who, subscribe in requests:
            self.program(who).send(SubscribeButtonEventRequest(int(subscribe)))
            self.expected[who].append(SubscribeButtonEventResponse(1))
            self.subscribed = self.subscribed | {who} if subscribe else self.subscribed - {who}
        self.runner.run(asyncio.sleep(1))

    @rule(who=names)
    def leave(self, who: str) -> None:
        program = self.program(who)

        async def end() -> None:
            program.session.leave()
            await asyncio.sleep(1)

        self.runner.run(end())
        assert self.raw.pop(who).heard == self.expected.pop(who)
        self.subscribed.discard(who)

    @rule(button_id=st.integers(1, 5))
    def press(self, button_id: int) -> None:
        async def press() -> None:
            self.virtual.press_button(button_id, now())
            await asyncio.sleep(0.1)
            self.virtual.release_button(button_id, now())
            await asyncio.sleep(0.1)

        self.runner.run(press())
        for who in self.subscribed:
            self.expected[who] += [
                ButtonEventResponse(button_id, ButtonEventResponse.PRESS),
                ButtonEventResponse(button_id, ButtonEventResponse.UP),
            ]

    @invariant()
    def each_hears_what_it_asked_for(self) -> None:
        assert {who: program.heard for who, program in self.raw.items()} == self.expected
        assert [session.subscribed for session in self.virtual.sessions] == [bool(self.subscribed)]

    def teardown(self) -> None:
        with self.runner:
            self.runner.run(self.stack.aclose())


TestEvents = Events.TestCase
TestEvents.settings = settings(max_examples=15 * MANY, stateful_step_count=25, deadline=None)


@pytest.mark.parametrize("mutation", ["needed", "allows"])
def test_the_check_notices_a_hub_that_mixes_units(mutation: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if mutation == "needed":
        monkeypatch.setattr(ServoUnits, "needed", lambda *_: ())
    else:
        monkeypatch.setattr(UnitReservation, "allows", lambda *_: True)
    machine = Units()
    machine.join(["degree", "adc"], depth=1)
    machine.run(0, macro=mutation == "allows")
    machine.wait(0.1)
    machine.read(1, ALL_SERVOS)
    machine.read(0, ALL_SERVOS)
    with pytest.raises(AssertionError):
        machine.teardown()


@pytest.mark.virtual_only("the raw angles of the firmware are pulse widths")
async def test_units_are_set_again_on_a_board_that_was_switched_off_and_on(monkeypatch: pytest.MonkeyPatch) -> None:
    virtual = VirtualBoard(len(SERVOS))
    for servo in virtual.servos.values():
        servo.angle = float(HIGH)
    socket = Socket(virtual)
    url = plugged(monkeypatch, socket.transport)
    async with connect(url, reconnect=True, angle_unit=None) as board, share(board, name="rex") as hub:
        programs = [Angler(hub, "ann", "degree"), Angler(hub, "bob", "adc"), Angler(hub, "cid", "degree")]
        await programs[2].set_unit(2, "adc")
        for _ in range(3):
            for program in programs:
                await program.read(ALL_SERVOS)
            socket.pull()
            virtual.power_cycle(now())
            await asyncio.sleep(1)
            socket.plug(virtual)
            await asyncio.sleep(10)
        for program in programs:
            assert program.answered == 3
            await program.until_done()


kinds = st.sampled_from(["query", "state", "write", "motion", "unit", "data"])


def numbered(kind: str, number: int) -> Packet:
    """Return a packet of some kind that differs from all with another number."""
    match kind:
        case "query":
            return QueryActionRequest(number)
        case "state":
            return QueryServoRequest(number)
        case "write":
            return WriteProjectIDRequest(number)
        case "motion":
            return ExecuteActionRequest((Step(1, number, 1),))
        case "unit":
            return SetAngleUnitRequest(1, number % 2)
        case _:
            return SendDummyDataRequest(bytes([number]))


@settings(max_examples=15 * MANY)
@given(
    sent=st.lists(kinds, min_size=2, max_size=12),
    depth=st.sampled_from([1, 2, 8]),
    limits=st.sampled_from([None, (-180, 180)]),
)
def test_what_a_program_sends_at_once_reaches_the_board_in_its_order(sent: list[str], depth: int, limits: Any) -> None:
    async def main() -> None:
        fake = PipedBoard()
        async with (
            opened(fake, angle_unit=None, depth=depth, write_depth=depth, angle_limits=limits) as board,
            share(board, name="rex") as hub,
        ):
            program, other = RawProgram(hub), RawProgram(hub, unit="adc")
            packets = [numbered(kind, number) for number, kind in enumerate(sent, 1) if not (limits and kind == "unit")]
            program.send(QueryServoRequest(100))  # so that the units are those of this program
            await asyncio.sleep(0.1)
            other.send(QueryServoRequest(200))
            program.session.receive(b"".join(map(program.codec.encode, packets)))
            await asyncio.sleep(5)
            arrived = [packet for _, packet in fake.executed if packet in packets]
            assert list(dict.fromkeys(arrived)) == list(dict.fromkeys(packets))

    run(main())
