"""Commands to boards: one result each, whatever the board and the broker do."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from servolink.errors import MotionRefused, OpenError, OutcomeUnknown, RequestTimeout, ServolinkError
from servolink.fleet.access import BrokerAccess
from servolink.fleet.controller import Controller
from servolink.fleet.stop_boards import stop_all
from tests.fleet.mosquitto import OPEN, Broker, needs_broker
from tests.fleet.patience import LIMIT, patience_ends
from tests.fleet.stand_in import TOPICS, Refused, stand_ins

pytestmark = needs_broker


def controller_of(broker: Broker, *, with_servos: bool = False) -> Controller:
    controller = Controller(BrokerAccess.of(broker.url), TOPICS, with_servos=with_servos)
    controller.patience = LIMIT
    return controller


def test_everybody_who_is_there_is_known(broker: Broker) -> None:
    async def main() -> None:
        async with stand_ins(broker, "rex", "fido") as (rex, _), controller_of(broker) as controller:
            await controller.settle()
            assert controller.roster.online == ("fido", "rex")
            assert controller.roster["rex"].now == rex.now

    asyncio.run(main())


def test_a_broker_that_queues_few_messages_loses_neither_boards_nor_answers_to_a_stop(tmp_path: Path) -> None:
    async def main() -> None:
        names = [f"board{number}" for number in range(8)]
        async with stand_ins(broker, *names), controller_of(broker) as controller:
            await controller.settle()
            assert list(controller.roster.online) == names
            assert all(seen.now is not None for seen in controller.roster)
            assert (await stop_all(controller)).stopped.keys() == set(names)

    broker = Broker(tmp_path, (*OPEN, "max_inflight_messages 1", "max_queued_messages 1"))
    broker.start()
    asyncio.run(main())
    broker.end()


def test_a_command_has_one_result(broker: Broker) -> None:
    async def main() -> None:
        async with stand_ins(broker, "rex") as (rex,), controller_of(broker) as controller:
            rex.answers["battery"] = lambda params: {"percent": 50.5}
            rex.copies = 3  # delivered again
            assert await controller.call("rex", "battery") == {"percent": 50.5}
            assert [command.method for command in rex.commands] == ["battery"]

    asyncio.run(main())


def test_who_has_stopped_a_board_knows_a_word_of_its_pulse_that_is_later(broker: Broker) -> None:
    async def main() -> None:
        async with stand_ins(broker, "rex") as (rex,), controller_of(broker) as controller:
            await controller.settle()
            rex.answers["stop"] = lambda params: {"pulse": "after-1"}
            rex.answers["release"] = lambda params: {}
            await controller.call("rex", "stop")
            await controller.call("rex", "release")
            assert rex.commands[-1].pulse == "after-1"

    asyncio.run(main())


def test_a_program_that_may_not_move_is_sent_no_pulse_and_stops_boards_all_the_same(broker: Broker) -> None:
    async def main() -> None:
        access = BrokerAccess.of(broker.url)
        async with stand_ins(broker, "rex") as (rex,), Controller(access, TOPICS, may_move=False) as controller:
            await rex.publish(TOPICS.board("rex", "pulse"), "word-1")
            await controller.settle()
            assert controller.roster["rex"].pulse is None
            with pytest.raises(ServolinkError, match="rex: this program has connected without `may_move`"):
                await controller.call("rex", "move", {"targets": {"1": 5}})
            assert rex.commands == []
            assert list((await stop_all(controller)).stopped) == ["rex"]

    asyncio.run(main())


def test_news_of_boards_that_come_all_the_time_do_not_prolong_the_wait_for_what_the_broker_kept(broker: Broker) -> None:
    async def main() -> None:
        async with stand_ins(broker, "rex") as (rex,), controller_of(broker) as controller:
            await controller.settle()
            began = asyncio.get_running_loop().time()
            heard = asyncio.Event()
            controller.on_change = lambda seen: heard.set()
            await rex.announce()
            await heard.wait()
            await controller.settle()
            assert controller._heard < began

    asyncio.run(main())


def test_an_error_of_a_board_is_raised_with_its_name(broker: Broker) -> None:
    def refuse(params: object) -> None:
        raise Refused("MotionRefused", "servo 1 would turn too far")

    async def main() -> None:
        async with stand_ins(broker, "rex") as (rex,), controller_of(broker) as controller:
            rex.answers["move"] = refuse
            with pytest.raises(MotionRefused, match="rex: servo 1 would turn too far"):
                await controller.call("rex", "move", {"targets": {"1": 500}})

    asyncio.run(main())


def test_silence_says_whether_something_may_have_been_done(broker: Broker, monkeypatch: pytest.MonkeyPatch) -> None:
    patience_ends(monkeypatch, lambda pending: pending.board == "rex")

    async def main() -> None:
        async with stand_ins(broker, "rex") as (rex,), controller_of(broker) as controller:
            rex.is_silent = True
            with pytest.raises(OutcomeUnknown, match="rex has not answered move within"):
                await controller.call("rex", "move", {"targets": {"1": 5}}, patience=LIMIT)
            with pytest.raises(RequestTimeout, match="rex has not answered battery"):
                await controller.call("rex", "battery", patience=LIMIT)

    asyncio.run(main())


def test_without_a_broker_there_is_an_error(broker: Broker) -> None:
    async def main() -> None:
        broker.end()
        async with controller_of(broker):
            pass

    with pytest.raises(OpenError):
        asyncio.run(main())


def test_a_command_outlives_the_broker(broker: Broker) -> None:
    async def main() -> None:
        async with controller_of(broker) as controller:
            broker.end()
            asked = asyncio.create_task(controller.call("rex", "battery"))
            broker.start()
            async with stand_ins(broker, "rex") as (rex,):
                rex.answers["battery"] = lambda params: {"percent": 1.0}
                await controller.settle()
                assert controller.roster.online == ("rex",)
                asked.cancel()
                assert await controller.call("rex", "battery") == {"percent": 1.0}

    asyncio.run(main())
