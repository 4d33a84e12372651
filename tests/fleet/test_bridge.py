"""A board through a bridge and a real broker.

Modules: servolink.fleet.join, servolink.fleet.telemetry.
"""

from __future__ import annotations

import asyncio
import itertools
import json
import socket
from collections.abc import AsyncGenerator
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import pytest

from servolink.boards import Alias, Aliases
from servolink.client import connect
from servolink.control import open_channel
from servolink.errors import OpenError
from servolink.fleet import hub_session, join, telemetry
from servolink.fleet.access import BrokerAccess
from servolink.fleet.broker import BrokerConnection
from servolink.fleet.controller import Controller
from servolink.fleet.home_assistant import HomeAssistant
from servolink.fleet.join import LocalBoard, local_boards
from servolink.fleet.policy import BoardPolicy, PolicyFile
from servolink.fleet.topics import BoardNow, EventNow, ServosNow
from servolink.hub import serve_board
from servolink.project import build_project
from servolink.protocol import Action, Macro, Step
from servolink.transports import DeviceInfo
from servolink.virtual import BOARDS, VirtualTransport
from tests.fleet.bridged import TOPICS, bridged, far_away, joined, run, running
from tests.fleet.mosquitto import OPEN, Broker, needs_broker
from tests.lab.odd.firmwares import CutCaptions

pytestmark = [*needs_broker, pytest.mark.usefixtures("user")]


def test_a_board_is_seen_and_moved_from_afar(broker: Broker) -> None:
    async def main() -> None:
        async with serve_board("virtual://?servos=4", name="rex"), far_away(broker) as far:
            async with joined(broker, BoardPolicy("edit"), hz=50.0):
                state = await far.state(lambda state: state["servos"] == 4)
                assert (state["board"], state["connection"], state["allow"]) == ("rex", "connected", "edit")
                assert far.heard["servolink/rex/available"][0].payload == b"online"
                moved = await far.call("move", params={"targets": {"1": 60}, "duration": 0.1, "wait": True})
                assert moved == {"seconds": 0.1}
                await far.until(
                    lambda: json.loads(far.heard["servolink/rex/servos"][-1].payload)["servos"][0]["angle"] == 60
                )
                servos = await far.call("servos.list")
                assert servos["servos"][0]["angle"] == 60
            await far.until(lambda: far.heard["servolink/rex/available"][-1].payload == b"offline")

    run(main())


def test_captions_with_bytes_that_are_not_text_are_documents_for_all_and_whole_in_results(broker: Broker) -> None:
    async def main() -> None:
        BOARDS["zoo"] = CutCaptions()
        async with (
            serve_board("virtual://zoo", name="rex"),
            far_away(broker) as far,
            joined(broker, BoardPolicy("edit")),
        ):
            await far.state(lambda state: len(state["actions"]) == 2)
            payload = far.heard["servolink/rex/state"][-1].payload
            assert msgspec.json.decode(payload)["actions"][0]["caption"] == "揮動左手然後再揮動右?"
            assert (await far.call("records.list"))["records"][0]["caption"] == "揮動左手然後再揮動右\udce6"
            assert (await far.call("run", params={"type": "action", "id": "揮動左手然後再揮動右\udce6"}))[
                "seconds"
            ] == 0.5
            async with Controller(BrokerAccess.of(broker.url), TOPICS) as controller:
                listed = await controller.call("rex", "records.list")
                assert listed["records"][0]["caption"] == "揮動左手然後再揮動右\udce6"

    run(main())


def test_a_board_that_the_broker_does_not_let_be_seen_has_not_joined(tmp_path: Path) -> None:
    access = tmp_path / "acl"
    access.write_text("topic read servolink/#\ntopic write servolink/rex/pulse\n", encoding="utf-8")
    broker = Broker(tmp_path, [*OPEN, f"acl_file {access}"])
    broker.start()

    async def main() -> None:
        async with serve_board("virtual://?servos=4", name="rex"):
            with pytest.raises(OpenError, match=r"rex has not joined: .* writing to servolink/rex/available"):
                await joined(broker, BoardPolicy("edit")).__aenter__()

    run(main())


def test_a_result_goes_where_its_sender_listens(broker: Broker) -> None:
    async def main() -> None:
        async with bridged(broker) as (far, _):
            reply = "servolink/rex/result/me"
            command = await far.send("battery", response_topic=reply, correlation=b"\x00\xff")
            await far.result(command, reply)
            assert far.heard[reply][0].correlation == b"\x00\xff"
            for elsewhere in ("servolink/fido/cmd", "servolink/fido/result/me", "servolink/_fleet/result/me"):
                await far.result(await far.send("battery", response_topic=elsewhere))
                assert elsewhere not in far.heard

    run(main())


def test_a_program_of_an_earlier_version_is_named_as_a_problem_of_the_board(broker: Broker) -> None:
    async def main() -> None:
        async with bridged(broker) as (far, _):
            for topic, options in (("cmd", {"expiry": 10}), ("stop", {})):
                command = {"id": topic, "method": "battery"} if topic == "cmd" else {"id": topic}
                asked = {"response_topic": "servolink/_fleet/reply/desk", **options}
                await far.publish(f"servolink/rex/{topic}", command, **asked)
                await far.result(topic)
            problem = (await far.state(lambda state: bool(state["problems"])))["problems"]
            assert len(problem) == 1
            assert "a program of an earlier servolink sends commands, and does not hear the answers" in problem[0]
            assert "servolink/_fleet/reply/desk" not in far.heard

    run(main())


def test_a_policy_says_what_may_be_done(broker: Broker) -> None:
    async def main() -> None:
        async with bridged(broker, "watch") as (far, hub):
            error = await far.failure("move", params={"targets": {"1": 60}, "duration": 0.1})
            assert (error["data"]["kind"], error["data"]["remedy"]) == (
                "forbidden",
                'on its machine, write allow = "move" for rex in fleet.toml',
            )
            await far.call("stop")
            assert hub.lease is None
            assert (await far.failure("lease.take"))["data"]["kind"] == "method_not_found"

    run(main())


@pytest.mark.parametrize("payload", [b"offline", b"", b"\xff"])
def test_a_board_that_is_there_corrects_what_others_say_of_it(broker: Broker, payload: bytes) -> None:
    async def main() -> None:
        topic = "servolink/rex/available"
        async with bridged(broker, "watch") as (far, _):
            await far.until(lambda: topic in far.heard)
            far.heard.clear()
            await far.publish(topic, payload, retain=True)
            await far.until(lambda: [each.payload for each in far.heard.get(topic, [])] == [payload, b"online"])
        async with far_away(broker, "later") as later:  # and not after it has left
            await later.until(lambda: topic in later.heard)
            assert [each.payload for each in later.heard[topic]] == [b"offline"]

    run(main())


def test_commands_that_waited_at_the_broker_find_the_hub(broker: Broker, monkeypatch: pytest.MonkeyPatch) -> None:
    order, run_broker = list[str](), BrokerConnection.run

    async def opened(*arguments: Any) -> Any:
        channel = await open_channel(*arguments)
        order.append("hub")
        return channel

    async def connected(connection: BrokerConnection) -> None:
        order.append(connection._options.identifier)
        await run_broker(connection)

    monkeypatch.setattr(hub_session, "open_channel", opened)
    monkeypatch.setattr(BrokerConnection, "run", connected)

    async def main() -> None:
        async with bridged(broker) as (far, _):
            await far.call("battery")
            assert order.index("hub") < order.index("servolink/rex")

    run(main())


def test_a_policy_file_that_changes_is_followed(broker: Broker, user: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(join, "_LOOK", 0.01)
    path = user / "fleet.toml"
    path.write_text('[default]\nallow = "watch"\n', encoding="utf-8")
    move = {"targets": {"1": 40}, "duration": 0.01, "wait": True}

    async def main() -> None:
        file, said = PolicyFile(path), list[str]()
        async with (
            serve_board("virtual://?servos=2", name="rex"),
            far_away(broker) as far,
            joined(broker, file.policies.default) as fleet,
            running(fleet.follow(file)),
        ):
            fleet.on_line = lambda level, text: said.append(text)

            async def moved() -> Any:
                """Return the answer to a move, when the session with the hub has begun again."""
                while "reconnecting" in str(answer := await far.result(await far.send("move", params=move))):
                    pass
                return answer

            assert "rex allows watch" in str(await moved())
            path.write_text('[default]\nallow = "move"\nangles.all = [0, 30]\n', encoding="utf-8")
            await far.state(lambda state: state["allow"] == "move")
            answer = await moved()
            assert answer["error"]["data"]["kind"] == "MotionRefused"
            assert "fleet.toml" in answer["error"]["message"]
            path.write_text("[default\n", encoding="utf-8")
            while not any("the earlier policy applies" in each for each in said):
                await far.call("status")
            assert (await far.state())["allow"] == "move"
            path.write_text('[default]\nallow = "edit"\n', encoding="utf-8")
            await far.state(lambda state: state["allow"] == "edit")
            assert (await moved())["ok"]

    run(main())


class Verdict(NamedTuple):
    verdict: str
    text: str
    basis: dict[str, str]


class Twin:
    """A twin that says what it is told to say."""

    says = Verdict("stands", "", {})

    async def check_move(self, pose: object, targets: object, seconds: float) -> Verdict:
        return self.says

    async def check_record(self, project: object, record: object, pose: object) -> AsyncGenerator[Verdict, None]:
        yield self.says

    async def close(self) -> None:
        """Nothing is open."""


def test_a_policy_that_asks_for_a_forecast_lets_nobody_move_a_board_whose_hub_has_none(broker: Broker) -> None:
    async def main() -> None:
        twin, move = Twin(), {"targets": {"1": 40}, "duration": 0.01, "wait": True}
        async with serve_board("virtual://?servos=2", name="rex") as (hub, _), far_away(broker) as far:
            async with joined(broker, BoardPolicy("edit", forecast=True)):
                error = await far.failure("move", params=move)
                assert "this program has the role watch" in error["message"]
                [problem] = (await far.state(lambda state: bool(state["problems"])))["problems"]
                assert "fleet.toml asks for a forecast: others may only watch and stop rex until its hub" in problem
                await far.call("stop")
            gate = hub.begin_forecast(twin)
            async with joined(broker, BoardPolicy("edit", forecast=True)):
                await far.call("move", params={**move, "start": True})
                twin.says = Verdict("falls", "the robot falls", {"weight": "assumed"})
                error = await far.failure("move", params={**move, "targets": {"1": 0}})
                assert (error["data"]["kind"], error["data"]["reason"]) == ("MotionRefused", "forecast")
            await gate.close()

    run(main())


def test_a_policy_limits_what_is_moved(broker: Broker) -> None:
    async def main() -> None:
        policy = BoardPolicy("edit", 90.0, {"1": (-30, 30)})
        async with bridged(broker, policy=policy) as (far, hub):
            error = await far.failure("move", params={"targets": {"1": 31}, "duration": 2})
            assert error["message"].endswith("-30..30 (from fleet.toml)")
            await hub.board.add_action(Action(7, "Far", (Step(1, 60, 200),)))
            error = await far.failure("run", params={"type": "action", "id": 7})
            assert "-30..30 (from fleet.toml)" in error["message"]

    run(main())


@pytest.mark.parametrize(
    ("topic", "payload", "command_id"),
    [
        ("servolink/_fleet/stop", b'{"id": "all"}', "all"),
        ("servolink/rex/stop", b"", "stop"),
        ("servolink/rex/stop", b"\xff nonsense", "stop"),
        ("servolink/rex/cmd", b'{"id": "x", "method": "stop"}', "x"),
    ],
)
def test_anybody_may_stop_the_board(broker: Broker, topic: str, payload: bytes, command_id: str) -> None:
    async def main() -> None:
        async with bridged(broker, "watch") as (far, hub):
            await hub.board.move({1: 90}, duration=20, wait=False)
            await far.publish(topic, payload)
            assert (await far.result(command_id))["ok"]
            assert not any(servo.is_start for servo in await hub.board.servos())

    run(main())


@pytest.mark.parametrize("where", ["far away", "at the board"])
def test_commands_that_wait_are_not_begun_after_a_stop(broker: Broker, where: str) -> None:
    async def main() -> None:
        async with bridged(broker) as (far, hub):
            await far.send("move", params={"targets": {"1": 90}, "duration": 20, "wait": True})
            second = await far.send("move", params={"targets": {"2": 90}, "duration": 20, "wait": True})
            if where == "far away":
                await far.publish("servolink/rex/stop", b"")
                await far.result("stop")
            else:
                while hub.lease is None:  # the first one has begun
                    await asyncio.sleep(0)
                await far.call("status")  # and the second one has come
                await hub.stop("a page")
            error = (await far.result(second))["error"]
            assert error["message"] == "the board was stopped before this began"

    run(main())


def test_what_is_stored_is_in_the_state(broker: Broker) -> None:
    async def main() -> None:
        async with bridged(broker) as (far, _):
            bow = {"action_id": 3, "action_caption": "Bow", "steps": []}
            await far.call("records.put", params={"type": "action", "record": bow})
            state = await far.state(lambda state: bool(state["actions"]))
            assert state["actions"] == [{"id": 3, "caption": "Bow"}]

    run(main())


def test_what_another_program_stores_is_in_the_state_at_once(broker: Broker) -> None:
    async def main() -> None:
        async with bridged(broker) as (far, hub), connect(f"share://{hub.name}") as board:
            await far.state(lambda state: state["macros"] == [])
            await board.apply_project(build_project(Macro.of("Bow", 0.5)))
            begun = asyncio.get_running_loop().time()
            await far.state(lambda state: [each["caption"] for each in state["macros"]] == ["Bow"])
            assert asyncio.get_running_loop().time() - begun < telemetry.CATALOG_SECONDS / 2

    run(main())


def test_a_lost_hub_is_told_and_waited_for(broker: Broker) -> None:
    async def main() -> None:
        async with far_away(broker) as far:
            async with serve_board("virtual://?servos=1", name="rex"):
                joining = joined(broker, BoardPolicy("edit"))
                await joining.__aenter__()
                await far.state(lambda state: state["connection"] == "connected")
            await far.state(lambda state: state["connection"] == "lost")
            error = await far.failure("battery")
            assert error["data"]["kind"] == "ConnectionLost"
            async with serve_board("virtual://?servos=1", name="rex"):
                await far.state(lambda state: state["connection"] == "connected")
                await far.call("battery")
                await joining.__aexit__(None, None, None)

    run(main())


def test_a_board_joins_under_the_name_that_it_is_given_by() -> None:
    async def main() -> None:
        Aliases.save("rex", Alias("virtual://?servos=1"))
        async with serve_board("virtual://?servos=2", name="fido"):
            async with local_boards(["rex", "fido"]) as here:
                assert here == [LocalBoard("rex", "rex"), LocalBoard("fido", "fido")]
            async with local_boards(["rex"], "max") as here:
                assert here == [LocalBoard("rex", "max")]

    run(main())


def test_a_board_that_is_found_joins_under_the_name_that_its_user_gave(monkeypatch: pytest.MonkeyPatch) -> None:
    async def main() -> None:
        Aliases.save("rex", Alias("virtual://"))
        monkeypatch.setattr(join, "search", lambda: [DeviceInfo("virtual://")])
        async with local_boards([]) as here:
            assert here == [LocalBoard("rex", "rex")]

    run(main())


def test_two_new_boards_join_under_the_names_that_they_are_given() -> None:
    async def main() -> None:
        async with local_boards(["virtual://"], "fido") as fido, local_boards(["virtual://?seed=2"], "bob") as bob:
            assert (fido, bob) == ([LocalBoard("fido", "fido")], [LocalBoard("bob", "bob")])
            async with local_boards(["fido"], "max") as here:
                assert here == [LocalBoard("fido", "max")]

    run(main())


def test_a_name_belongs_to_one_machine(broker: Broker) -> None:
    async def main() -> None:
        async with bridged(broker) as (far, _):
            with pytest.raises(OpenError, match="another program of this machine connects rex"):
                async with joined(broker, BoardPolicy()):
                    pass
            state = await far.state()
        async with far_away(broker) as far:
            await far.publish("servolink/rex/state", {**state, "host": "elsewhere"}, retain=True)
            await far.publish("servolink/rex/available", b"online", retain=True)
            with pytest.raises(OpenError, match="has joined already, from elsewhere: give this one another name"):
                async with joined(broker, BoardPolicy()):
                    pass

    run(main())


@pytest.mark.parametrize("is_there", [False, True])
def test_another_machine_may_be_called_as_this_one(
    broker: Broker, monkeypatch: pytest.MonkeyPatch, is_there: bool
) -> None:
    for name in ("INTERVAL", "SLACK"):
        monkeypatch.setattr(join, name, 0.05)

    async def main() -> None:
        async with serve_board("virtual://?servos=1", name="rex"), far_away(broker) as far:
            now = BoardNow(board="rex", host=socket.gethostname(), version="", connection="lost", allow="run", at=0.0)
            await far.publish("servolink/rex/state", msgspec.json.encode(now), retain=True)
            await far.publish("servolink/rex/available", b"online", retain=True)
            await far.publish("servolink/rex/pulse", b"other-0", retain=True)

            async def beat() -> None:
                for number in itertools.count(1):
                    await far.publish("servolink/rex/pulse", f"other-{number}".encode(), retain=True)

            async with AsyncExitStack() as stack:
                if is_there:
                    await stack.enter_async_context(running(beat()))
                    stack.enter_context(pytest.raises(OpenError, match="from another machine called"))
                await stack.enter_async_context(joined(broker, BoardPolicy()))

    run(main())


@pytest.mark.parametrize("state", [b"\xff", b'{"x": ' + b"[" * 100_000, b"[]"])
def test_what_others_have_left_at_the_broker_keeps_nobody_from_joining(broker: Broker, state: bytes) -> None:
    async def main() -> None:
        async with far_away(broker) as far:
            await far.publish("servolink/rex/state", state, retain=True)
            await far.publish("servolink/rex/available", b"online", retain=True)
            await far.publish("homeassistant/device/servolink_rex/config", state, retain=True)
        async with bridged(broker, home_assistant=HomeAssistant()) as (far, _):
            assert 0 < (await far.call("battery"))["percent"] <= 100

    run(main())


def test_two_that_take_each_others_place_say_so(broker: Broker) -> None:
    async def main() -> None:
        async with far_away(broker) as far:
            await far.publish("servolink/rex/pulse", b"left-7", retain=True)
            async with serve_board("virtual://?servos=1", name="rex"), joined(broker, BoardPolicy()):
                assert not (await far.state(lambda state: state["servos"] == 1))["problems"]
                await far.publish("servolink/rex/pulse", b"other-8")
                state = await far.state(lambda state: bool(state["problems"]))
                assert state["problems"][0].startswith("another program has joined as rex, too")

    run(main())


def test_payloads_are_as_declared(broker: Broker) -> None:
    async def main() -> None:
        async with bridged(broker, hz=50.0) as (far, hub):
            await far.state(lambda state: state["servos"] == 4)  # read after the buttons were subscribed to
            await far.until(lambda: "servolink/rex/servos" in far.heard)
            transport = hub.board.connection.transport
            assert isinstance(transport, VirtualTransport)
            transport.board.press_button(3, asyncio.get_running_loop().time())
            await far.until(lambda: "servolink/rex/event" in far.heard)
            event = msgspec.json.decode(far.heard["servolink/rex/event"][0].payload, type=EventNow, strict=True)
            assert (event.id, event.button_id, event.kind) == (1, 3, "press")
            for message in far.heard["servolink/rex/state"]:
                assert msgspec.json.decode(message.payload, type=BoardNow, strict=True).board == "rex"
            for message in far.heard["servolink/rex/servos"]:
                assert len(msgspec.json.decode(message.payload, type=ServosNow, strict=True).servos) == 4

    run(main())


@pytest.mark.parametrize(
    ("door", "address"),
    [
        ("share://rex", None),
        ("tcp://127.0.0.1:9000", None),
        ("tcp://[::1]:9000", None),
        ("tcp://0.0.0.0:9000", f"tcp://{socket.gethostname()}:9000"),
        ("tcp://10.0.0.7:9000", "tcp://10.0.0.7:9000"),
    ],
)
def test_the_state_names_the_door_that_other_machines_reach(door: str, address: str | None) -> None:
    assert telemetry._seen_from_afar(door) == address
