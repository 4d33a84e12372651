"""Metrics of a fleet: what Prometheus reads, how much at most, and the dashboard that shows them.

Modules: servolink.gateways.metrics.exposition, servolink.cli.fleet.fleet_metrics.
"""

from __future__ import annotations

import asyncio
import json
import re
import signal
import urllib.request
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest
from msgspec.structs import replace

from servolink.client import Alarm
from servolink.control import ServoNow
from servolink.fleet import BoardNow, ServosNow
from servolink.support import ExitCode
from tests.cli.programs import call, finished, started
from tests.extras import hide
from tests.fleet.mosquitto import Broker, needs_broker
from tests.fleet.stand_in import stand_ins

pytest.importorskip("prometheus_client", reason="in the extra metrics")

from prometheus_client.openmetrics.exposition import generate_latest
from prometheus_client.openmetrics.parser import text_string_to_metric_families

from servolink.fleet import Roster
from servolink.gateways.metrics import exposition as metrics
from servolink.gateways.metrics.exposition import FleetCollector

pytestmark = needs_broker

DASHBOARD = Path(__file__).parents[2] / "docs/examples/grafana-dashboard.json"
ALARM = Alarm.parse("temperature_raw>300")


class FleetSeen:
    """What a collector reads of a controller."""

    def __init__(self) -> None:
        self.roster = Roster()
        self.connections = 2

    def take(self, board: str, *, servos: int = 2, doubtful: int = 0, **known: Any) -> None:
        """Take the messages of a board, whose servo `doubtful` has not measured anything."""
        now = BoardNow(board=board, host="desk", version="1", connection="connected", allow="run", at=0.0, **known)
        each = [
            ServoNow(n, 10 * n, "degree" if n != 2 else "adc", n, 299 + n, 0, True, n != 2, 3 if n == 1 else None)
            for n in range(1, servos + 1)
        ]
        each = [replace(one, doubt="not measured") if one.servo_id == doubtful else one for one in each]
        frame = ServosNow(1, 0.0, tuple(each), 0)
        for kind, payload in (
            ("available", b"online"),
            ("state", msgspec.json.encode(now)),
            ("servos", msgspec.json.encode(frame)),
        ):
            self.roster.take(board, kind, payload, 0.0)


async def read(fleet: Any) -> dict[tuple[str, ...], float]:
    """Return the values of all samples, by name and labels (in the order of the names), as a reader finds them."""
    found = FleetCollector(fleet, [ALARM]).collect()
    registry: Any = SimpleNamespace(collect=lambda: found)
    text = generate_latest(registry).decode()  # type: ignore[no-untyped-call,unused-ignore]
    return {
        (sample.name, *(sample.labels[label] for label in sorted(sample.labels))): sample.value
        for family in text_string_to_metric_families(text)  # type: ignore[no-untyped-call,unused-ignore]
        for sample in family.samples
    }


async def test_boards_servos_and_alarms_are_read() -> None:
    fleet = FleetSeen()
    fleet.take("rex", battery_percent=71.5, noise=3, problems=("hot",), lease="studio", programs=2, servos=2)
    fleet.roster.take("max", "available", b"offline", 0.0)
    found = await read(fleet)
    assert found["servolink_fleet_boards", "online"] == found["servolink_fleet_boards", "offline"] == 1
    assert found["servolink_board_battery_percent", "rex"] == 71.5
    assert found["servolink_board_noise_bytes_total", "rex"] == 3
    assert found["servolink_board_moved", "rex"] == found["servolink_board_problems", "rex"] == 1
    assert found["servolink_board_exclusive", "rex"] == found["servolink_board_online", "max"] == 0
    assert found["servolink_board_info", "rex", "desk", "1"] == 1
    assert found["servolink_servo_temperature_raw", "rex", "2"] == 301
    assert (found["servolink_servo_ready", "rex", "1"], found["servolink_servo_ready", "rex", "2"]) == (1, 0)
    assert found["servolink_servo_angle_degrees", "rex", "1"] == 10
    assert ("servolink_servo_angle_degrees", "rex", "2") not in found  # raw ADC
    assert found["servolink_servo_lag_degrees", "rex", "1"] == 3
    assert ("servolink_servo_lag_degrees", "rex", "2") not in found  # unknown, as from an older sender
    assert found["servolink_board_alarm_servos", "temperature_raw>300", "rex"] == 1
    assert found["servolink_fleet_broker_connections_total",] == 2
    assert not [name for name, *labels in found if "max" in labels and name.startswith("servolink_servo")]


async def test_values_that_cannot_be_true_are_no_samples_and_no_alarm() -> None:
    fleet = FleetSeen()
    fleet.take("rex", servos=3, doubtful=3)
    found = await read(fleet)
    assert {name for name, *labels in found if labels == ["rex", "3"]} == {"servolink_servo_doubtful"}
    assert [found["servolink_servo_doubtful", "rex", str(servo)] for servo in (1, 2, 3)] == [0, 0, 1]
    assert found["servolink_board_alarm_servos", "temperature_raw>300", "rex"] == 1, "servo 2 alone, of 301"


async def test_the_number_of_series_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(metrics, "MOST_BOARDS", 3)
    monkeypatch.setattr(metrics, "MOST_SERVOS", 5)
    fleet = FleetSeen()
    for number in range(9):
        fleet.roster.take(f"a{number}", "available", b"offline", 0.0)
        fleet.take(f"b{number}", servos=20, problems=("\x1b]0;" * 50,))
    found = await read(fleet)
    assert found["servolink_fleet_boards_left_out",] == 15
    assert {labels[0] for name, *labels in found if name == "servolink_board_online"} == {"b0", "b1", "b2"}
    assert sum(name == "servolink_servo_current_raw" for name, *_ in found) == 15


def test_the_command_serves_what_the_broker_tells(broker: Broker) -> None:
    async def main() -> None:
        async with stand_ins(broker, "rex", battery_percent=50.0):
            serving = started("fleet", "metrics", "--broker", broker.url, "--listen", "127.0.0.1:0", "--json")
            assert serving.stdout is not None
            url = json.loads(await asyncio.to_thread(serving.stdout.readline))["metrics"]
            asked = urllib.request.Request(url, headers={"Accept": "application/openmetrics-text"})  # noqa: S310 - http
            with await asyncio.to_thread(urllib.request.urlopen, asked) as answer:
                assert answer.headers["Content-Type"].startswith("application/openmetrics-text")
                text = answer.read().decode()
            said = await asyncio.to_thread(finished, serving, signal.SIGINT)
            assert said.code == 0
            assert 'servolink_board_battery_percent{board="rex"} 50.0' in text
            assert "every user of this machine" in said.err

    asyncio.run(main())


def test_without_the_extra_the_command_says_how_to_install_it(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.MonkeyPatch.context() as patch:
        hide("prometheus_client", "servolink.gateways.metrics", patch)
        found = call(capsys, "fleet", "metrics")
    assert found.code == ExitCode.FAILED
    assert "pip install '.[metrics]'" in found.err


async def test_the_dashboard_shows_metrics_that_exist() -> None:
    fleet = FleetSeen()
    fleet.take("rex", battery_percent=1.0)
    names = {name for name, *_ in await read(fleet)}
    panels = json.loads(DASHBOARD.read_text())["panels"]
    queries = [target["expr"] for panel in panels for target in panel["targets"]]
    shown = {name for query in queries for name in re.findall(r"servolink_\w+", query)}
    assert len(panels) >= 8
    assert shown <= names
    places = [tuple(panel["gridPos"].values()) for panel in panels]
    assert len(set(places)) == len(places)
