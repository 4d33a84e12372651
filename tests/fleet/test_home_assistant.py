"""What Home Assistant finds, and what its buttons do."""

from __future__ import annotations

import json
import signal
from typing import Any

import pytest

from servolink.control import ServoNow, ServosFrame, encode
from servolink.fleet import home_assistant
from servolink.fleet.home_assistant import HomeAssistant, discovery, without
from servolink.fleet.policy import BoardPolicy
from servolink.fleet.topics import BoardNow, EventNow, Stored, Topics, Vitals
from servolink.protocol import Action, Step
from tests.fleet.bridged import Far, bridged, far_away, run
from tests.fleet.home_assistant_rules import check_document, check_topic
from tests.fleet.mosquitto import Broker, needs_broker

NOW = BoardNow(
    board="rex",
    host="laptop",
    version="1.0",
    connection="connected",
    allow="edit",
    battery_percent=71.5,
    noise=3,
    actions=(Stored(1, "Bow"), Stored(2, ""), Stored(3, "bad \udcff byte")),
    macros=(Stored(1, "Wave"),),
    at=0.0,
)
TOPIC = "homeassistant/device/rex/servolink_rex/config"


def document(allow: Any = "edit", *, numbers: bool = False, **angles: Any) -> dict[str, Any]:
    found = discovery(Topics(), NOW, (1, 2), BoardPolicy(allow, angles=angles.get("angles", {})), numbers=numbers)
    return json.loads(encode(found))  # type: ignore[no-any-return]


@pytest.mark.parametrize("numbers", [False, True])
@pytest.mark.parametrize("allow", ["watch", "run", "move", "edit"])
def test_the_document_follows_the_rules(allow: str, numbers: bool) -> None:
    check_document(document(allow, numbers=numbers))
    check_topic(HomeAssistant().topic(Topics(), "rex"), "rex")


def test_each_board_of_each_fleet_has_an_id_of_its_own() -> None:
    boards = [
        ("servolink", "rex"),
        ("servolink", "room1_rex"),
        ("servolink/room1", "rex"),
        ("servolink_room1", "rex"),
        ("学校", "rex"),
        ("教室", "rex"),
    ]
    found = [HomeAssistant().topic(Topics(prefix), board) for prefix, board in boards]
    assert len(set(found)) == len(boards)
    assert found[0] == TOPIC
    for topic in found:
        check_topic(topic, "rex")
    documents = [discovery(Topics(prefix), NOW, (), BoardPolicy(), numbers=False) for prefix, _ in boards]
    ids = {component["unique_id"] for each in documents for component in each["components"].values()}
    assert len(ids) == len({prefix for prefix, _ in boards}) * len(documents[0]["components"])


def test_only_what_is_allowed_can_be_pressed() -> None:
    def pressed(allow: str) -> set[str]:
        found = document(allow, numbers=True)["components"]
        return {key for key, one in found.items() if one["platform"] in {"button", "number"}}

    records = {"action_1", "action_2", "action_3", "macro_1"}
    assert pressed("watch") == {"stop"}
    assert pressed("run") == {"stop", *records}
    assert pressed("move") == {"stop", *records, "servo_1_angle", "servo_2_angle"}


def test_raw_numbers_have_neither_unit_nor_class() -> None:
    for key, one in document()["components"].items():
        if key.endswith("_raw"):
            assert not {"unit_of_measurement", "device_class"} & set(one)
    assert document()["components"]["servo_1_current_raw"]["enabled_by_default"] is False


def test_an_angle_is_only_what_the_servo_reports() -> None:
    found = document(numbers=True, angles={"1": (-20, 30), "all": (-90, 90)})["components"]
    assert found["servo_1_angle"]["optimistic"] is False
    assert (found["servo_1_angle"]["min"], found["servo_1_angle"]["max"]) == (-20, 30)
    assert (found["servo_2_angle"]["min"], found["servo_2_angle"]["max"]) == (-90, 90)
    assert "servo_1_angle" not in document()["components"]


def test_an_angle_keeps_to_the_limits_of_all_and_needs_room() -> None:
    found = document(numbers=True, angles={"1": (-120, 120), "all": (-90, 100)})
    one = found["components"]["servo_1_angle"]
    assert (one["min"], one["max"]) == (-90, 100)
    for angles in ({"1": (10.5, 10.5)}, {"1": (-50, -20), "all": (20, 50)}):
        found = document(numbers=True, angles=angles)
        assert "servo_1_angle" not in found["components"]
        assert "servo_2_angle" in found["components"]
        check_document(found)


def test_names_are_text() -> None:
    found = document()["components"]
    assert (found["action_2"]["name"], found["action_3"]["name"]) == ("Action 2", "bad ? byte")


def test_what_is_gone_is_removed() -> None:
    before, after = document(numbers=True), document("watch")
    removal = without(after, before)
    assert removal is not None
    check_document(removal)
    assert removal["components"]["macro_1"] == {"platform": "button"}
    assert without(after, after) is None


def test_values_that_cannot_be_true_are_unknown_and_never_the_highest() -> None:
    true = ServoNow(1, 10, "degree", 40, 250, 0, True, True)
    false = ServoNow(2, -1, "degree", -1, 900, 0, True, True, doubt="not measured")
    sent = encode(home_assistant._vitals(ServosFrame(1, 0.0, (false, true), 0)))
    assert json.loads(sent) == {
        "angle": {"1": 10, "2": None},
        "temperature_raw": {"1": 250, "2": None},
        "current_raw": {"1": 40, "2": None},
        "highest_temperature_raw": 250,
        "highest_current_raw": 40,
    }
    sent = encode(home_assistant._vitals(ServosFrame(1, 0.0, (false,), 0)))
    assert json.loads(sent)["highest_temperature_raw"] is None


def test_templates_find_what_is_sent() -> None:
    jinja2 = pytest.importorskip("jinja2", reason="Jinja is not installed")
    environment = jinja2.Environment(undefined=jinja2.StrictUndefined)
    environment.filters["to_json"] = json.dumps
    vitals = Vitals({1: 10, 2: 20}, {1: 250, 2: 260}, {1: 40, 2: 50}, 260, 50)
    sent = {
        "servolink/rex/state": encode(NOW),
        "servolink/rex/vitals": encode(vitals),
        "servolink/rex/event": encode(EventNow(3, 2, "long_press", id=1, at=0.0)),
    }

    def shown(key: str) -> str:
        one = document(numbers=True)["components"][key]
        value = json.loads(sent[one["state_topic"]])
        return str(environment.from_string(one["value_template"]).render(value_json=value))

    assert [shown(key) for key in ("battery", "connection", "noise")] == ["71.5", "ON", "3"]
    assert [shown(key) for key in ("highest_temperature_raw", "servo_2_current_raw", "servo_1_angle")] == [
        "260",
        "50",
        "10",
    ]
    assert json.loads(shown("buttons")) == {"event_type": "long_press", "button_id": 3}
    assert "long_press" in document()["components"]["buttons"]["event_types"]
    is_connected = document()["availability"][1]
    state = json.loads(sent["servolink/rex/state"])
    assert environment.from_string(is_connected["value_template"]).render(value_json=state) == "online"
    command = document(numbers=True)["components"]["servo_1_angle"]["command_template"]
    assert json.loads(environment.from_string(command).render(value=12.5))["params"]["targets"] == {"1": 12.5}


@pytest.mark.usefixtures("user")
class TestWithABroker:
    pytestmark = needs_broker

    def test_a_button_runs_what_is_stored(self, broker: Broker, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(home_assistant, "VITALS_SECONDS", 0.02)

        async def main() -> None:
            async with bridged(broker, home_assistant=HomeAssistant(numbers=True)) as (far, hub):
                bow = {"action_id": 3, "action_caption": "Bow", "steps": []}
                await far.call("records.put", params={"type": "action", "record": bow})

                def latest() -> dict[str, Any]:
                    return json.loads(far.heard[TOPIC][-1].payload) if TOPIC in far.heard else {"components": {}}

                await far.until(lambda: "action_3" in latest()["components"])
                check_document(latest())
                assert far.heard[TOPIC][-1].is_retained
                await far.until(lambda: "servolink/rex/vitals" in far.heard)
                await hub.board.add_action(Action(3, "Bow", (Step(1, 60, 1),)))
                button = latest()["components"]["action_3"]
                await far.publish(button["command_topic"], button["payload_press"].encode())
                await far.until(lambda: json.loads(far.heard["servolink/rex/vitals"][-1].payload)["angle"]["1"] == 60)
                number = latest()["components"]["servo_1_angle"]
                command = number["command_template"].replace("{{ value }}", "50")
                await far.publish(number["command_topic"], command.encode())
                await far.until(lambda: json.loads(far.heard["servolink/rex/vitals"][-1].payload)["angle"]["1"] == 50)
                stop = latest()["components"]["stop"]
                await far.publish(stop["command_topic"], stop["payload_press"].encode())
                await far.result("stop")
                await far.publish("servolink/rex/press", b"nonsense")
                await far.call("records.delete", params={"type": "action", "id": 3})
                await far.until(lambda: "action_3" not in latest()["components"])
                removal = json.loads(far.heard[TOPIC][-2].payload)
                assert removal["components"]["action_3"] == {"platform": "button"}

        run(main())

    def test_the_document_of_an_earlier_version_is_removed_and_others_are_left(self, broker: Broker) -> None:
        earlier = [f"homeassistant/device/servolink_{name}/config" for name in ("rex", "fido")]

        async def main() -> None:
            async with far_away(broker) as far:
                for topic in earlier:
                    await far.publish(topic, b"{}", retain=True)
            async with bridged(broker, home_assistant=HomeAssistant()) as (far, _):
                await far.until(lambda: TOPIC in far.heard)
                assert [[each.payload for each in far.heard[topic]] for topic in earlier] == [[b"{}", b""], [b"{}"]]

        run(main())

    def test_what_is_gone_when_a_bridge_comes_back_is_removed(self, broker: Broker) -> None:
        async def main() -> None:
            async with bridged(broker, home_assistant=HomeAssistant(numbers=True)) as (far, _):
                await far.until(lambda: TOPIC in far.heard)
            async with bridged(broker, "watch", home_assistant=HomeAssistant()) as (far, _):
                await far.until(lambda: len(far.heard.get(TOPIC, [])) >= 3)  # the former, the removal, and the new one
                _, removal, now = (json.loads(each.payload) for each in far.heard[TOPIC])
                assert removal["components"]["servo_1_angle"] == {"platform": "number"}
                assert "servo_1_angle" not in now["components"]

        run(main())

    def test_a_home_assistant_that_has_started_is_told_everything_again(self, broker: Broker) -> None:
        told = (TOPIC, "servolink/rex/state")

        async def main() -> None:
            async with bridged(broker, home_assistant=HomeAssistant()) as (far, _):
                await far.state(lambda state: state["servos"] == 4)
                await far.until(lambda: TOPIC in far.heard)
                for topic in told:
                    await far.publish(topic, b"", retain=True)
                await far.until(lambda: all(not far.heard[topic][-1].payload for topic in told))
                for said in (b"offline", b"online"):
                    await far.publish("homeassistant/status", said)
                await far.until(lambda: all(far.heard[topic][-1].payload for topic in told))
                check_document(json.loads(far.heard[TOPIC][-1].payload))

        run(main())

    def test_a_broker_that_has_forgotten_everything_is_told_it_again(
        self, broker: Broker, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Mosquitto keeps nothing over its end by default."""

        def kept_by_board(far: Far) -> set[str]:
            return {topic for topic, heard in far.heard.items() if heard[-1].is_retained and heard[-1].payload}

        async def main() -> None:
            monkeypatch.setattr(home_assistant, "VITALS_SECONDS", 0.02)
            async with bridged(broker, home_assistant=HomeAssistant()) as (far, _):
                await far.state(lambda state: state["servos"] == 4)
                await far.until(lambda: TOPIC in far.heard and "servolink/rex/vitals" in far.heard)
                async with far_away(broker, "before") as before:
                    await before.until(lambda: TOPIC in kept_by_board(before))
                    await before.until(lambda: "servolink/rex/vitals" in kept_by_board(before))
                    kept = kept_by_board(before)
                broker.end(signal.SIGKILL)
                broker.start()
                async with far_away(broker, "after") as after:
                    await after.until(
                        lambda: kept <= {topic for topic, heard in after.heard.items() if heard[-1].payload}
                    )

        run(main())
