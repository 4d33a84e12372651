"""The layout for Foxglove shows what is in a recording: its paths lead to fields of a schema, its panels are placed."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from mcap.reader import make_reader

from servolink.recorder.channels import CHANNELS, RecordedServo, ServosRead
from tests.recorder.files import write

LAYOUT = json.loads((Path(__file__).parents[2] / "docs/examples/foxglove-layout.json").read_text())
_PATH = re.compile(r"(/\w+)\.(\w+)\[:\]\{(\w+)==(\d+)\}\.(\w+)")
STATE = RecordedServo(3, 90.0, "degree", 5, 300, 1, is_start=True, is_hold=True)


def placed(node: Any) -> list[str]:
    return [node] if isinstance(node, str) else placed(node["first"]) + placed(node["second"])


def test_each_panel_is_placed_once() -> None:
    assert sorted(placed(LAYOUT["layout"])) == sorted(LAYOUT["configById"])


def test_each_path_leads_to_a_number(tmp_path: Path) -> None:
    """Read it as others do, by the schema in the file."""
    with write(tmp_path / "out.mcap", [(0.0, ServosRead((STATE,)))]).open("rb") as file:
        [(schema, channel, message)] = make_reader(file).iter_messages()
    assert (channel.message_encoding, schema and schema.encoding) == ("json", "jsonschema")
    fields = json.loads(schema.data if schema else b"")["properties"]
    servo = json.loads(message.data)["servos"][0]
    paths = [path["value"] for panel in LAYOUT["configById"].values() for path in panel.get("paths", ())]
    assert len(paths) == 48
    for path in paths:
        found = _PATH.fullmatch(path)
        assert found is not None, path
        topic, array, key, _, field = found.groups()
        assert topic == channel.topic
        assert {key, field} <= fields[array]["items"]["properties"].keys()
        assert fields[array]["items"]["properties"][field]["type"] in ("number", "integer")
        assert isinstance(servo[field], (int, float))


def test_messages_are_shown_of_channels_that_exist() -> None:
    shown = {panel["topicPath"] for panel in LAYOUT["configById"].values() if "topicPath" in panel}
    assert shown == {"/commands", "/events", "/problems"}
    assert shown <= CHANNELS.keys()


def test_the_robot_and_its_log_are_those_of_the_live_channels() -> None:
    panels = LAYOUT["configById"]
    source = (Path(__file__).parents[2] / "servolink/gateways/foxglove/live_channels.py").read_text()
    for topic in (*panels["3D!robot"]["topics"], panels["Log!log"]["topicToRender"]):
        assert f'"{topic}"' in source
    assert panels["3D!robot"]["followTf"] == "world"
