"""What is done to many boards at once, with boards that misbehave.

Modules: servolink.fleet.checks, servolink.fleet.each, servolink.fleet.start_servos, servolink.fleet.together,
servolink.fleet.transfer.
"""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

import msgspec
import pytest

from servolink.errors import ConnectionLost, NotFound
from servolink.fleet import checks, stop_boards, together
from servolink.fleet.broker import Denied
from servolink.fleet.client import Fleet, connect
from servolink.fleet.pending_command import PendingCommand
from servolink.fleet.topics import Stored
from servolink.project import ProjectFile, load_project
from tests.fleet.mosquitto import Broker, needs_broker
from tests.fleet.patience import LIMIT, have_answered, patience_ends
from tests.fleet.stand_in import Refused, StandIn, stand_ins
from tests.project.projects import HUMANOID

pytestmark = needs_broker

IDLE = {
    "servo_id": 1,
    "angle": 0,
    "angle_unit": "degree",
    "current_raw": 0,
    "temperature_raw": 0,
    "servo_type": 0,
    "is_start": False,
    "is_hold": True,
}
STARTED = {"host": "here", "after": 0.001, "monotonic": 5.0}


def fleet_of(broker: Broker, **groups: tuple[str, ...]) -> Fleet:
    fleet = connect(broker.url, groups=groups)
    fleet.controller.patience = LIMIT
    return fleet


def ready_to_run(board: StandIn, monotonic: float, host: str = "here") -> None:
    board.answers |= {
        "prepare": lambda params: {"seconds": 2.0},
        "cancel": lambda params: {},
        "start": lambda params: {"host": host, "after": 0.001, "monotonic": monotonic},
        "echo": lambda params: {"monotonic": 0.0},
    }


def methods(board: StandIn) -> list[str]:
    return [command.method for command in board.commands]


def refuse(kind: str, text: str) -> Any:
    def answer(params: object) -> None:
        raise Refused(kind, text)

    return answer


# --- stop -------------------------------------------------------------------------------------------------------------


def test_a_stop_names_who_is_silent_and_waits_for_nobody_else(broker: Broker, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stop_boards, "_AGAIN", 0.01)

    async def main() -> None:
        async with stand_ins(broker, "rex", "fido", "bob") as (rex, fido, _), fleet_of(broker) as fleet:
            fido.is_silent = True
            rex.answers["stop"] = refuse("OutcomeUnknown", "servo 3 still moves")
            answered = have_answered("rex", "bob")
            patience_ends(monkeypatch, lambda pending: answered(pending) and fido.stops > 1)
            stopped = await fleet.stop(patience=LIMIT)
            assert list(stopped.stopped) == ["bob"]
            assert stopped.failed == {"rex": "rex: servo 3 still moves"}
            assert stopped.silent == ("fido",)
            assert fido.stops > 1, "it is sent again"
            assert not stopped.is_complete

    asyncio.run(main())


def test_a_stop_names_who_is_away(broker: Broker) -> None:
    async def main() -> None:
        async with stand_ins(broker, "rex") as (rex,):
            topic = f"servolink/{rex.name}-old/available"
            await rex.publish(topic, "offline")
            async with fleet_of(broker) as fleet:
                stopped = await fleet.stop(patience=LIMIT)
                assert stopped.offline == ("rex-old",)
                assert stopped.is_complete

    asyncio.run(main())


# --- run --------------------------------------------------------------------------------------------------------------


def test_boards_start_together(broker: Broker) -> None:
    async def main() -> None:
        async with stand_ins(broker, "rex", "fido") as (rex, fido), fleet_of(broker, front=("rex", "fido")) as fleet:
            ready_to_run(rex, 5.0)
            ready_to_run(fido, 5.012)
            ran = await fleet.run("Wave", "front")
            assert ran.started == ("fido", "rex")
            assert ran.spread == pytest.approx(0.012)
            assert ran.measured_by == "clock"
            assert ran.duration == 2.0
            assert rex.commands[0].params["run"] == {"type": "macro", "id": "Wave"}

    asyncio.run(main())


def test_the_spread_over_several_machines_is_estimated_by_echo(broker: Broker, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(together, "_ECHO_LIMIT", LIMIT)

    async def main() -> None:
        async with stand_ins(broker, "rex", "fido") as (rex, fido), fleet_of(broker) as fleet:
            ready_to_run(rex, 5.0, "a")
            ready_to_run(fido, 1e6, "b")
            ran = await fleet.run("Bow")
            assert ran.measured_by == "echo"
            assert ran.spread is not None
            assert 0 <= ran.spread < 1000, "whatever the clocks say"

    asyncio.run(main())


def test_all_boards_are_told_the_same_moment_by_their_own_clocks(broker: Broker) -> None:
    """Each clock is off by up to 5 s, and drifts. The longest echo bounds the difference, on a busy machine too."""

    async def main() -> None:
        now = asyncio.get_running_loop().time
        async with stand_ins(broker, "rex", "fido", "bob") as boards, fleet_of(broker) as fleet:
            told: dict[str, float] = {}
            for board, off, pace in zip(boards, (-5.0, 0.0, 5.0), (0.9995, 1.0, 1.0005), strict=True):
                ready_to_run(board, 5.0)

                def echo(_: object, off: float = off, pace: float = pace) -> dict[str, float]:
                    return {"monotonic": now() * pace + off}

                def start(
                    params: dict[str, Any], board: StandIn = board, off: float = off, pace: float = pace
                ) -> dict[str, Any]:
                    told[board.name] = (params["at"] - off) / pace - now()
                    return {"host": board.name, "after": 0.3, "monotonic": now()}

                board.now = msgspec.structs.replace(board.now, host=board.name)
                await board.announce()
                board.answers |= {"echo": echo, "start": start}
            began = now()
            ran = await fleet.run("Wave")
            took = now() - began
            assert ran.started == ("bob", "fido", "rex")
            assert len(told) == 3
            assert max(told.values()) - min(told.values()) < min(took, 1.0)
            assert all(-took < ahead < 1.0 for ahead in told.values())

    asyncio.run(main())


@pytest.mark.parametrize("anyway", [False, True])
def test_one_that_cannot_prepare_keeps_all_from_starting(broker: Broker, anyway: bool) -> None:
    async def main() -> None:
        async with stand_ins(broker, "rex", "fido") as (rex, fido), fleet_of(broker) as fleet:
            ready_to_run(rex, 5.0)
            ready_to_run(fido, 5.0)
            fido.answers["prepare"] = refuse("MotionRefused", "somebody else has the lease")
            ran = await fleet.run("Wave", anyway=anyway)
            assert ran.started == (("rex",) if anyway else ())
            assert ran.held_back == (() if anyway else ("rex",))
            assert ran.failed == {"fido": "fido: somebody else has the lease"}
            assert ("cancel" in methods(rex)) == (not anyway)

    asyncio.run(main())


@pytest.mark.parametrize("anyway", [False, True])
def test_one_whose_servos_cannot_be_started_keeps_all_from_starting(broker: Broker, anyway: bool) -> None:
    async def main() -> None:
        async with stand_ins(broker, "rex", "fido") as (rex, fido), fleet_of(broker) as fleet:
            steps = [{"servo_id": 1, "degree": 5, "interval_ms": 10}]
            bow = {"type": "action", "record": {"action_id": 1, "action_caption": "Bow", "steps": steps}}
            for board in (rex, fido):
                ready_to_run(board, 5.0)
                board.answers |= {
                    "records.get": lambda params: bow,
                    "servos.list": lambda params: {"servos": [IDLE]},
                    "servo.set": lambda params: {},
                }
                await board.publish(f"servolink/{board.name}/pulse", f"{board.name}-1")
            fido.answers["servo.set"] = refuse("Forbidden", "servo.set is not allowed from afar")
            await fleet.controller.settle()
            ran = await fleet.run("Bow", anyway=anyway, start=True)
            assert ran.started == (("rex",) if anyway else ())
            assert ran.held_back == (() if anyway else ("rex",))
            assert ran.failed == {"fido": "fido: servo.set is not allowed from afar"}
            assert ("cancel" in methods(fido), "cancel" in methods(rex)) == (True, not anyway)
            started = [(command.params, command.pulse) for command in rex.commands if command.method == "servo.set"]
            assert started == [({"servo": 1, "start": True, "hold": True}, "rex-1")]

    asyncio.run(main())


def test_a_board_that_does_not_confirm_its_start_is_named(broker: Broker, monkeypatch: pytest.MonkeyPatch) -> None:
    async def main() -> None:
        async with stand_ins(broker, "rex", "fido") as (rex, fido), fleet_of(broker) as fleet:
            ready_to_run(rex, 5.0)
            ready_to_run(fido, 5.0)
            del fido.answers["start"]
            patience_ends(monkeypatch, lambda pending: _said(pending, "rex", "after"))
            ran = await fleet.run("Wave")
            assert ran.started == ("rex",)
            assert "fido was prepared, and has not reported a start" in ran.failed["fido"]
            assert ran.may_have_started == ("fido",)

    asyncio.run(main())


def _said(pending: PendingCommand, board: str, what: str) -> bool:
    """Return whether a board has answered with a result that has the field `what`."""
    result = pending.results.get(board)
    return result is not None and what in result.result


def test_a_start_that_the_broker_has_not_confirmed_may_have_been_one(
    broker: Broker, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def main() -> None:
        async with stand_ins(broker, "rex") as (rex,), fleet_of(broker) as fleet:
            ready_to_run(rex, 5.0)
            send = fleet.controller.publish

            async def send_or_lose(topic: str, *rest: Any, **options: Any) -> None:
                if topic == "servolink/rex/start":
                    patience_ends(monkeypatch, lambda pending: True)
                    raise ConnectionLost("the broker is gone")
                await send(topic, *rest, **options)

            monkeypatch.setattr(fleet.controller, "publish", send_or_lose)
            ran = await fleet.run("Wave")
            assert (ran.started, ran.may_have_started) == ((), ("rex",))

    asyncio.run(main())


def test_a_board_whose_start_the_broker_denies_has_not_started(broker: Broker, monkeypatch: pytest.MonkeyPatch) -> None:
    async def main() -> None:
        async with stand_ins(broker, "rex", "fido") as both, fleet_of(broker) as fleet:
            for board in both:
                ready_to_run(board, 5.0)
            send = fleet.controller.publish

            async def send_or_deny(topic: str, *rest: Any, **options: Any) -> None:
                if topic == "servolink/rex/start":
                    raise Denied("the broker does not allow writing there")
                await send(topic, *rest, **options)

            monkeypatch.setattr(fleet.controller, "publish", send_or_deny)
            ran = await fleet.run("Wave")
            assert (ran.started, ran.may_have_started) == (("fido",), ())
            assert ran.failed == {"rex": "the broker does not allow writing there"}

    asyncio.run(main())


def test_a_board_that_answers_nonsense_is_named(broker: Broker) -> None:
    async def main() -> None:
        async with stand_ins(broker, "rex", "fido") as (rex, fido), fleet_of(broker) as fleet:
            ready_to_run(rex, 5.0)
            fido.answers["prepare"] = lambda params: {"seconds": "\x1b"}
            ran = await fleet.run("Wave")
            assert "fido sends an answer that this version of servolink cannot read" in ran.failed["fido"]
            assert ran.held_back == ("rex",)
            assert ran.may_have_started == ()

    asyncio.run(main())


def test_what_a_board_does_not_have_is_not_run(broker: Broker) -> None:
    async def main() -> None:
        async with stand_ins(broker, "rex") as (rex,), fleet_of(broker) as fleet:
            ran = await fleet.run("Dance")
            assert ran.failed == {"rex": "rex has no action or macro 'Dance'"}
            ran = await fleet.run("Wave", kind="action")
            assert ran.failed == {"rex": "rex has no action 'Wave'"}
            assert not rex.commands
            with pytest.raises(NotFound, match="'rax' is neither a board nor a group"):
                await fleet.run("Wave", "rax")

    asyncio.run(main())


def test_a_name_of_two_things_needs_a_type(broker: Broker) -> None:
    async def main() -> None:
        async with stand_ins(broker, "rex", actions=(Stored(1, "Wave"),)) as _, fleet_of(broker) as fleet:
            ran = await fleet.run("Wave")
            assert "an action and a macro 'Wave'" in ran.failed["rex"]

    asyncio.run(main())


# --- apply and export -------------------------------------------------------------------------------------------------

APPLIED = {"changed": True, "resumed": False, "backup": None, "project_id_bits": 32}


def test_a_full_board_says_so_and_the_others_are_done(broker: Broker) -> None:
    async def main() -> None:
        async with stand_ins(broker, "rex", "fido", "bob") as boards, fleet_of(broker) as fleet:
            for board in boards:
                board.answers["project.apply"] = lambda params: APPLIED
            boards[1].answers["project.apply"] = refuse("ProjectError", "the board is full")
            outcomes = await fleet.apply(HUMANOID)
            assert sorted(outcomes.done) == ["bob", "rex"]
            assert {board: str(error) for board, error in outcomes.failed.items()} == {
                "fido": "fido: the board is full"
            }
            assert boards[0].commands[0].params["project"] == json.loads(json.dumps(ProjectFile(HUMANOID).form()))

    asyncio.run(main())


def test_fail_fast_begins_no_further_board(broker: Broker) -> None:
    async def main() -> None:
        async with stand_ins(broker, "a", "b", "c") as boards, fleet_of(broker) as fleet:
            for board in boards:
                board.answers["project.apply"] = refuse("ProjectError", "the board is full")
            outcomes = await fleet.apply(HUMANOID, parallel=1, fail_fast=True)
            assert list(outcomes.failed) == ["a"]
            assert outcomes.skipped == ("b", "c")
            assert not boards[1].commands

    asyncio.run(main())


def test_contents_are_written_to_files(broker: Broker, tmp_path: Path) -> None:
    async def main() -> None:
        async with stand_ins(broker, "rex", "fido") as (rex, fido), fleet_of(broker) as fleet:
            rex.answers["project.export"] = lambda params: {"project": ProjectFile(HUMANOID).form()}
            fido.answers["project.export"] = lambda params: {"project": {"schema": 1, "actions": "\x1b"}}
            outcomes = await fleet.export(tmp_path / "boards")
            assert load_project(outcomes.done["rex"]) == HUMANOID.sorted()
            assert "fido sends a project that cannot be read: actions" in str(outcomes.failed["fido"])

    asyncio.run(main())


# --- doctor -----------------------------------------------------------------------------------------------------------


def test_the_doctor_finds_what_is_wrong(broker: Broker, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checks, "_PATIENCE", LIMIT)
    monkeypatch.setattr(checks, "_SLOW", LIMIT)
    answered = have_answered("rex", "bob")
    patience_ends(monkeypatch, lambda pending: pending.board == "fido" or answered(pending))

    async def main() -> None:
        async with stand_ins(broker, "rex", "fido", "bob") as (rex, fido, bob):
            for board in (rex, bob):
                board.answers |= {"board.state": lambda params: {}, "echo": lambda params: {"monotonic": 0.0}}
            fido.is_silent = True
            await bob.publish("servolink/bob/state", b"{")
            async with fleet_of(broker) as fleet:
                found = {(one.about, one.observation) for one in await fleet.doctor()}
        assert ("rex", "") not in found
        assert any(about == "fido" and "does not answer" in text for about, text in found)
        assert any(about == "bob" and "cannot be read" in text for about, text in found)
        assert not any(about == "rex" for about, _ in found)

    asyncio.run(main())


def test_the_doctor_says_that_nobody_is_there(broker: Broker) -> None:
    async def main() -> None:
        async with fleet_of(broker) as fleet:
            (found,) = await fleet.doctor()
            assert "no board has ever joined" in found.observation

    asyncio.run(main())
