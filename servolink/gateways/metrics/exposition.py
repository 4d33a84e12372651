"""Metrics of a fleet for Prometheus: boards, servos and the connection with the broker; nothing is commanded."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterator, Mapping, Sequence
from contextlib import asynccontextmanager
from ipaddress import ip_address
from typing import Any, Final

from aiohttp import web
from prometheus_client.core import (  # pyright: ignore[reportMissingImports]
    CounterMetricFamily,
    GaugeMetricFamily,
    InfoMetricFamily,
)
from prometheus_client.exposition import choose_encoder  # pyright: ignore[reportMissingImports]
from prometheus_client.registry import Collector  # pyright: ignore[reportMissingImports]

from servolink.client import Alarm
from servolink.control import ServoNow
from servolink.fleet import BoardSeen, Controller
from servolink.support import computed
from servolink.transports import HttpServing, NetworkPlace

MOST_BOARDS: Final = 500
"""Most boards with metrics of their own, connected ones first; the others are counted."""
MOST_SERVOS: Final = 64
"""Most servos of a board with metrics of their own, by id."""

_LONGEST = 64  # characters of a text that a board has sent
_LOOPBACK = ("127.0.0.1", "localhost", "::1")
_WRONG_METHOD, _WRONG_HOST = 405, 421
_BOARD = {
    "online": "Whether the program that shares the board is connected with the broker.",
    "connected": "Whether the hub is connected with the board.",
    "battery_percent": "Remaining charge of the battery, in percent.",
    "programs": "Programs that use the board on its machine.",
    "moved": "Whether a program has the lease, and may move the board.",
    "exclusive": "Whether a program has exclusive use of the board.",
    "problems": "Latest problems that people should look at.",
    "servos": "Servos of the board.",
    "silent_seconds": "Seconds since the latest message of the board.",
}
_SERVO = {
    "angle_degrees": "Angle of the servo, in degrees.",
    "lag_degrees": "Difference between the angle of the servo and its target by now, in degrees.",
    "current_raw": "Current of the servo, as the board reports it, without a unit.",
    "temperature_raw": "Temperature of the servo, as the board reports it, without a unit.",
    "ready": "Whether the servo holds its angle and obeys movements.",
    "doubtful": "Whether the servo reports values that cannot be true, which are left out.",
}


class FleetCollector:
    """Collector of the present metrics of a fleet."""

    def __init__(self, controller: Controller, alarms: Sequence[Alarm]) -> None:
        """Count the servos of each board for which an alarm's value is bad; the time of an alarm does not count."""
        self._controller = controller
        self._alarms = alarms
        self._loop = asyncio.get_running_loop()

    def collect(self) -> list[Any]:
        """Return all metrics."""
        roster = self._controller.roster
        boards = sorted(roster, key=lambda seen: not seen.is_online)
        shown = boards[:MOST_BOARDS]
        return [*self._of_fleet(len(boards), len(roster.online)), *self._of_boards(shown), *self._of_servos(shown)]

    def _of_fleet(self, known: int, online: int) -> Iterator[Any]:
        boards = GaugeMetricFamily("servolink_fleet_boards", "Boards known to the broker.", labels=["state"])
        boards.add_metric(["online"], online)
        boards.add_metric(["offline"], known - online)
        yield boards
        left_out = "Boards without metrics of their own, beyond the most that are shown."
        yield GaugeMetricFamily("servolink_fleet_boards_left_out", left_out, value=max(0, known - MOST_BOARDS))
        refused = "Messages refused for their size or number."
        yield CounterMetricFamily("servolink_fleet_messages_refused", refused, value=self._controller.roster.refused)
        connections = "Connections with the broker so far."
        yield CounterMetricFamily("servolink_fleet_broker_connections", connections, value=self._controller.connections)

    def _of_boards(self, shown: Sequence[BoardSeen]) -> Iterator[Any]:
        gauges = _gauges("board", _BOARD, ["board"])
        noise = "Bytes from the board that belong to no frame."
        noises = CounterMetricFamily("servolink_board_noise_bytes", noise, labels=["board"])
        about = InfoMetricFamily("servolink_board", "Machine and version of the board's program.", labels=["board"])
        for seen in shown:
            for name, value in self._values_of(seen).items():
                if value is not None:
                    gauges[name].add_metric([seen.name], value)
            if (now := seen.now) is not None:
                noises.add_metric([seen.name], now.noise)
                about.add_metric([seen.name], {"host": now.host[:_LONGEST], "version": now.version[:_LONGEST]})
        yield from (*gauges.values(), noises, about)

    def _values_of(self, seen: BoardSeen) -> Mapping[str, float | None]:
        """Return the values of a board by name; None for an unknown value."""
        online = {"online": float(seen.is_online), "silent_seconds": self._loop.time() - seen.heard}
        if (now := seen.now) is None:
            return online
        return online | {
            "connected": float(seen.is_online and now.connection == "connected"),
            "battery_percent": now.battery_percent,
            "programs": now.programs,
            "moved": float(now.lease is not None),
            "exclusive": float(now.hold is not None),
            "problems": len(now.problems),
            "servos": now.servos,
        }

    def _of_servos(self, shown: Sequence[BoardSeen]) -> Iterator[Any]:
        gauges = _gauges("servo", _SERVO, ["board", "servo"])
        bad = "Servos whose value is bad by an alarm."
        alarms = GaugeMetricFamily("servolink_board_alarm_servos", bad, labels=["board", "alarm"])
        for seen in shown:
            frame = seen.servos if seen.is_online else None
            if frame is None:
                continue
            for servo in frame.servos[:MOST_SERVOS]:
                for name, value in _servo_values(servo).items():
                    gauges[name].add_metric([seen.name, str(servo.servo_id)], value)
            for alarm in self._alarms:
                count = sum(alarm.is_bad(getattr(servo, alarm.quantity)) for servo in frame.servos if not servo.doubt)
                alarms.add_metric([seen.name, str(alarm)], count)
        yield from (*gauges.values(), alarms)


def _gauges(kind: str, described: Mapping[str, str], labels: Sequence[str]) -> dict[str, Any]:
    """Return an empty gauge for each name, described for people."""
    return {
        name: GaugeMetricFamily(f"servolink_{kind}_{name}", text, labels=labels) for name, text in described.items()
    }


def _servo_values(servo: ServoNow) -> dict[str, float]:
    """Return the values of a servo by name, without an angle in another unit than degrees, and an unknown lag.

    Of values that cannot be true, only that is returned.
    """
    if servo.doubt:
        return {"doubtful": 1.0}
    values = {"current_raw": servo.current_raw, "temperature_raw": servo.temperature_raw}
    if servo.angle_unit == "degree":
        values["angle_degrees"] = servo.angle
    if servo.lag is not None:
        values["lag_degrees"] = servo.lag
    return {**values, "ready": float(servo.is_start and servo.is_hold), "doubtful": 0.0}


@asynccontextmanager
async def serve_metrics(
    controller: Controller, host: str, port: int, alarms: Sequence[Alarm] = ()
) -> AsyncIterator[int]:
    """Serve the metrics of a fleet on HTTP in this context; yield the port, a free one for 0.

    A server that only this machine reaches is reached under the names of this machine only (DNS rebinding). Raise
    OpenError if the address cannot be used.
    """
    collector = FleetCollector(controller, alarms)
    listening = await NetworkPlace(host, port).listen()
    is_local = all(ip_address(each.getsockname()[0]).is_loopback for each in listening)

    async def answer(request: web.BaseRequest) -> web.Response:
        await HttpServing.connection_of(request).heard()
        if is_local and request.url.host not in _LOOPBACK:
            return web.Response(status=_WRONG_HOST, text="the metrics are not reached under this name\n")
        if request.method != "GET":
            return web.Response(status=_WRONG_METHOD, headers={"Allow": "GET"})
        encode, content_type = choose_encoder(request.headers.get("Accept", ""))
        body = await computed(encode)(_Collected(collector.collect()))
        response = web.Response(body=body, headers={"Content-Type": content_type})
        response.enable_compression()
        return response

    serving = HttpServing(web.Server(answer), {})
    async with serving.accepting(listening):
        yield listening[0].getsockname()[1]


class _Collected(Collector):  # type: ignore[misc,unused-ignore]  # without the extra it is Any
    """Metrics that were collected on the event loop, to be written in a thread."""

    def __init__(self, found: list[Any]) -> None:
        self._found = found

    def collect(self) -> list[Any]:
        """Return the metrics."""
        return self._found
