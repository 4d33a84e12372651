"""Servos are counted by their ids against the list of servos, whatever the response for all of them holds."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

import pytest

from servolink.client.board import Board
from servolink.client.connecting import connect
from servolink.errors import OutcomeUnknown
from servolink.hub import share
from servolink.protocol import ALL_SERVOS, Codec, QueryServoRequest, SetServoParameterRequest
from servolink.virtual import BoardTransport
from tests.hub.local_transport import LocalTransport
from tests.lab.odd.board import OddBoard, OddLine
from tests.lab.odd.wire import Values, frame

States = list[Values]


class CountedBoard(OddBoard, name="counted"):
    """Board that changes its response for all servos, and answers truthfully for single ones that are not mute."""

    change: Callable[[States], States] = staticmethod(lambda states: states)
    mute: frozenset[int] = frozenset()
    in_frames = False
    """Whether each servo comes in a frame of its own."""

    def __init__(self) -> None:
        super().__init__()
        self.asked: list[tuple[str, int]] = []

    def servo_states(self, values: Values) -> Values:
        servo_id = values["servoID"]
        self.asked.append(("states", servo_id))
        states = [] if servo_id in self.mute else super().servo_states(values)["servos"]
        if servo_id == ALL_SERVOS:
            states = self.change(states)
        return {"servoCount": len(states), "servos": states}

    def servo_list(self, values: Values) -> Values:
        self.asked.append(("list", 0))
        return super().servo_list(values)

    def transmit(self, line: OddLine, data: bytes) -> None:
        packet_id = QueryServoRequest.packet_id
        if not self.in_frames or self.asked[-1:] != [("states", ALL_SERVOS)] or data[4:6] != b"\x35\x4e":
            super().transmit(line, data)
            return
        for number, servo in enumerate(self.servos.values()):
            content = self.content(packet_id + 1, {"servoCount": 1, "servos": [servo.state(self.now)]})
            part = frame(packet_id + 1, content, self.order)
            self.after(self.delay + 0.002 * number, lambda part=part: line.send(part))  # type: ignore[misc]


def one_of(states: States) -> States:
    return states[:1]


def without_the_third(states: States) -> States:
    return [state for state in states if state["servoID"] != 3]


def one_twice(states: States) -> States:
    """Return as many records as servos, one of which is there twice and another one not at all."""
    return [*states[:3], {**states[2], "isStart": 1 - states[2]["isStart"]}]


def one_twice_too_many(states: States) -> States:
    return [states[0], *states]


def under_another_id(states: States) -> States:
    return [*states[:3], {**states[3], "servoID": 9}]


def one_more(states: States) -> States:
    return [*states, {**states[0], "servoID": 77}]


CHANGES = (one_of, without_the_third, one_twice, one_twice_too_many, under_another_id, one_more)


@asynccontextmanager
async def directly(odd: OddBoard, **options: Any) -> AsyncIterator[Board]:
    async with connect(BoardTransport(odd, "virtual://"), **options) as board:
        yield board


@asynccontextmanager
async def through_a_hub(odd: OddBoard, **options: Any) -> AsyncIterator[Board]:
    async with (
        connect(BoardTransport(odd, "virtual://"), angle_unit=None) as upstream,
        share(upstream, name="rex") as hub,
        connect(LocalTransport(hub, codec=Codec()), **options) as board,
    ):
        yield board


def ids(servos: Any) -> list[int]:
    return [servo.servo_id for servo in servos]


@pytest.mark.parametrize("door", [directly, through_a_hub])
@pytest.mark.parametrize("change", CHANGES)
async def test_each_reading_has_each_servo_once(change: Any, door: Any) -> None:
    odd = CountedBoard()
    odd.change = change
    async with door(odd) as board:
        for _ in range(4):
            assert ids(await board.servos()) == [1, 2, 3, 4]
        await board.move({4: 30}, duration=0.1, wait=True)
        await board.stop()
        assert {(servo.is_start, servo.is_hold) for servo in await board.servos()} == {(False, True)}
        async with board.watch() as readings:
            assert ids((await anext(readings)).servos) == [1, 2, 3, 4]


async def test_servos_in_frames_of_their_own_are_read_singly() -> None:
    odd = CountedBoard()
    odd.in_frames = True
    async with directly(odd) as board:
        for _ in range(3):
            assert ids(await board.servos()) == [1, 2, 3, 4]
        await board.stop()


@pytest.mark.parametrize("change", [one_of, without_the_third, one_twice, under_another_id])
async def test_a_stop_is_unknown_if_a_servo_reports_nothing(change: Any) -> None:
    odd = CountedBoard()
    odd.change, odd.mute = change, frozenset({3, 4})
    async with directly(odd) as board:
        with pytest.raises(OutcomeUnknown, match=r"servos \[.*[34]\] do not report"):
            await board.stop()
        assert board._servos.known.listed == frozenset({1, 2, 3, 4})


async def test_a_servo_without_a_response_is_asked_once_and_named(caplog: pytest.LogCaptureFixture) -> None:
    odd = CountedBoard()
    odd.change, odd.mute = without_the_third, frozenset({3})
    async with directly(odd) as board:
        for _ in range(3):
            assert ids(await board.servos()) == [1, 2, 4]
        assert odd.asked.count(("states", 3)) == 1
        assert "servo 3 is in the list of servos and reports nothing" in caplog.text


async def test_the_list_is_read_once_and_again_for_servos_plugged_in_and_out() -> None:
    odd = CountedBoard()
    async with directly(odd) as board:
        for _ in range(5):
            await board.servos()
        assert odd.asked.count(("list", 0)) == 1
        gone = odd.servos.pop(2)
        assert ids(await board.servos()) == ids(await board.servos()) == [1, 3, 4]
        await board.stop()
        odd.servos[2] = gone
        assert set(ids(await board.servos())) == {1, 2, 3, 4}
        assert odd.asked.count(("list", 0)) == 3
        assert ("states", 2) not in odd.asked


async def test_a_hub_counts_the_servos_that_a_stop_reached() -> None:
    odd = CountedBoard()
    odd.change, odd.mute = without_the_third, frozenset({3})
    async with (
        connect(BoardTransport(odd, "virtual://"), angle_unit=None) as upstream,
        share(upstream, name="rex") as hub,
    ):
        with pytest.raises(OutcomeUnknown, match=r"servos \[3\] do not report"):
            await hub.stop("a page")
        odd.mute = frozenset()
        await hub.stop("a page")


class UnlistedBoard(CountedBoard, name="unlisted"):
    """Board without a response to the query for the list of servos."""

    ignored = frozenset({"QueryServoList"})


class WrongListBoard(CountedBoard, name="wrong-list"):
    """Board whose list of servos contradicts itself."""

    def servo_list(self, values: Values) -> Values:
        found = super().servo_list(values)
        return {**found, "servoCount": found["servoCount"] + 1}


@pytest.mark.parametrize("kind", [UnlistedBoard, WrongListBoard])
async def test_servos_of_a_board_without_a_readable_list_move_and_stop(kind: type[CountedBoard]) -> None:
    odd = kind()
    async with directly(odd) as board:
        await board.move({1: 30}, duration=0.1)
        asked = len(odd.asked)
        for angle in (0, 30, 0):
            await board.move({1: angle, 4: angle}, duration=0.1)
        assert len(odd.asked) == asked
        assert ids(await board.servos()) == [1, 2, 3, 4]
        await board.stop()


async def test_the_effect_of_a_request_for_all_servos_is_counted_too() -> None:
    odd = CountedBoard()
    odd.change = without_the_third
    async with directly(odd) as board:
        await board.set_servo("all", start=False, hold=True)
        await board.set_servo(3, start=True, hold=True)
        assert await board.took_effect(SetServoParameterRequest(ALL_SERVOS, 0, 1)) is False
        await board.set_servo(3, start=False, hold=True)
        assert await board.took_effect(SetServoParameterRequest(ALL_SERVOS, 0, 1)) is True
