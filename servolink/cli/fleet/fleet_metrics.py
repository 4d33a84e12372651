"""`servolink fleet metrics`: the state of all boards for Prometheus."""

from __future__ import annotations

import argparse
import asyncio

from servolink.cli.arguments import alarm, listening
from servolink.cli.command import Command, option
from servolink.cli.command_session import ENDLESS, Interruption, interruptible
from servolink.cli.fleet.broker_options import BROKER, fleet_of
from servolink.cli.screen.output import print_error
from servolink.cli.screen.result import show_served
from servolink.client import Alarm
from servolink.support import ExitCode
from servolink.transports import NetworkPlace


@Command(
    "fleet metrics",
    help="serve the state of all boards to Prometheus",
    details=f"Only reads, in the format of OpenMetrics. {ENDLESS}",
    examples=("fleet metrics", "fleet metrics --alarm 'temperature_raw>300'"),
    options=(
        option(
            "--listen",
            "HOST:PORT",
            "where to serve; port 0 takes a free one (127.0.0.1:9464)",
            listening,
            default="127.0.0.1:9464",
        ),
        option(
            "--alarm",
            "RULE",
            "count the servos for which this holds, as in 'temperature_raw>300'; may be repeated",
            alarm,
            action="append",
            default=[],
        ),
        *BROKER,
    ),
    takes_board=False,
)
@interruptible("nothing was changed")
async def run(args: argparse.Namespace, interruption: Interruption) -> int:
    """Serve until Ctrl-C or SIGTERM."""
    fleet = fleet_of(args, servos=True)
    from servolink.gateways.metrics import serve_metrics

    host, port = NetworkPlace.parse(args.listen)
    async with fleet:
        await fleet.list()
        alarms = [Alarm.parse(text) for text in args.alarm]
        async with serve_metrics(fleet.controller, host, port, alarms) as found:
            interruption.code = ExitCode.OK
            place = NetworkPlace(host, found)
            url = f"http://{place}/metrics"
            show_served(metrics=url)
            print_error(f"servolink: {url} can be read by {place.reached_by}")
            await asyncio.Event().wait()
    return ExitCode.OK
